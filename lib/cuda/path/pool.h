// A pool of paths on a CUDA stream: its memory, and one run of it over a unit.
#pragma once

#include "core/path/path_pool.h"
#include "cuda/path/wave.h"

namespace gpurt::cuda {

/// Shadow rays of a step: the triangles that they leave out are those that they leave and end at.
struct PoolShadows {
  ShadowQueue queue;
  uint32_t *left_out, *ended_at;
  uint8_t *occluded;
};

/// Memory of one pool, for one lane.
class PoolMemory {
 public:
  /// For `capacity` paths at a time, and units of up to max_unit_paths. Throws OUT_OF_MEMORY. `schedule` is resolved.
  PoolMemory(const std::shared_ptr<DeviceMemory> &memory, uint32_t capacity, uint64_t max_unit_paths,
             const Schedule &schedule, cudaStream_t stream);

  uint32_t capacity() const { return capacity_; }
  uint32_t unit_capacity() const { return unit_capacity_; }
  /// Of the two, a step reads one and writes the other.
  const PathQueue &queue(int k) const { return queues_[k]; }
  Hit *hits() const { return hits_; }
  const PoolShadows &shadows() const { return shadows_; }
  PathResult *results() const { return results_; }
  uint32_t *trace_scratch() const { return trace_scratch_; }
  /// In device memory: the paths and shadow rays that a step has made, and the bits of the largest radiance.
  uint32_t *numbers() const { return numbers_; }
  static constexpr unsigned num_numbers = 3;
  /// In pinned host memory: room for these.
  uint32_t *host_numbers() const { return static_cast<uint32_t *>(pinned_numbers_); }
  /// Null where the schedule is that of the fused kernels.
  ScheduledTracer *tracer() { return tracer_ ? &*tracer_ : nullptr; }

  StageClock clock;
  RaySlices slices;

 private:
  struct Arrays;
  static Arrays lay_out(std::byte *base, uint64_t capacity, uint64_t unit_capacity);

  uint32_t capacity_, unit_capacity_;
  DeviceBuffer<std::byte> buffer_;
  std::optional<ScheduledTracer> tracer_;
  PathQueue queues_[2] = {};
  Hit *hits_ = nullptr;
  PoolShadows shadows_{};
  PathResult *results_ = nullptr;
  uint32_t *trace_scratch_ = nullptr, *numbers_ = nullptr;
  PinnedBuffer pinned_;
  void *pinned_numbers_ = nullptr;
};

/// Renders paths 0 .. num_paths - 1 of the unit, at most unit_capacity(), into a film in device memory. Returns when they
/// are done; false if `cancelled` became true on the way, with nothing of them in the film's colours.
bool render_pool(const TraceScene &scene, const PathSettings &settings, const PathUnit &unit,
                 const FilmView &film, uint32_t num_paths, const std::atomic<bool> *cancelled,
                 PoolMemory &memory, cudaStream_t stream, WaveCounters &counters);

}  // namespace gpurt::cuda
