// Traces rays in device memory by a schedule: its memory, its launches, its counters. Serves one lane.
#pragma once

#include "cuda/accel/schedule/kernels.h"
#include "cuda/device_memory.h"
#include "schedule.h"

namespace gpurt::cuda {

/// What is known of a batch beside its rays.
struct TracedRays {
  // As in RayOrder.
  const uint32_t *left_out = nullptr, *ended_at = nullptr;
  // Rays that leave surfaces, of which it is not known which triangle: as far as single precision can tell, each may hit it
  // again, and what has to be measured in addition costs more than the fast kernels save.
  bool leave_surfaces = false;
};

/// Whether the fused kernels of closest.cu and any.cu serve a resolved schedule.
bool is_fused(const Schedule &schedule);

/// For schedules that they do not serve.
class ScheduledTracer {
 public:
  /// Takes memory for batches of up to max_rays; larger ones are cut. Throws OUT_OF_MEMORY. `schedule` is resolved.
  /// `counts_lanes`: by the kernels of cuda/accel/counting, for closest hits alone.
  ScheduledTracer(const Schedule &schedule, const std::shared_ptr<DeviceMemory> &memory, uint64_t max_rays,
                  cudaStream_t stream, bool counts_lanes = false);

  /// Queue work on the stream that the tracer was made for; leaf lists also wait for it, once a round.
  void closest(const TraceScene &scene, const Ray *rays, uint64_t num_rays, HitLayout layout, void *hits,
               const TracedRays &known = {});
  void any(const TraceScene &scene, const Ray *rays, uint64_t num_rays, uint8_t *occluded,
           const TracedRays &known = {});

  /// Whether it looks at what is known of rays.
  bool takes_known_triangles() const { return is_persistent_stack(); }

  /// Adds what was counted since the last call; waits for the stream.
  void collect(ScheduleCounters &sum);

 private:
  bool is_persistent_stack() const;
  RayPool next_pool();
  void trace(const TraceScene &scene, const RayBatch &batch, const TracedRays &known);
  void trace_persistent(const TraceScene &scene, const RayBatch &batch, const TracedRays &known);
  void trace_lists(const TraceScene &scene, const RayBatch &batch);

  const Schedule schedule_;
  const cudaStream_t stream_;
  const bool counts_lanes_;
  // What is counted, the pool of persistent threads, and the number of active rays.
  DeviceBuffer<unsigned long long> numbers_;
  DeviceBuffer<std::byte> lists_;
  uint32_t list_capacity_ = 0;
  DeviceBuffer<uint32_t> scratch_;  // of the fast kernels, for scratch_rays_ at a time
  uint64_t scratch_rays_ = 0;
  uint64_t num_rounds_ = 0;
};

/// The schedule with values for what was left to the library. Throws UNSUPPORTED naming what the scene's accelerator, its
/// triangle test or the use does not have.
Schedule resolve_schedule(const Schedule &asked, ScheduleUse use, const TraceScene &scene);

}  // namespace gpurt::cuda
