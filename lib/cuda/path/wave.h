// A wave of paths on a CUDA stream: its memory, and one run of the path pipeline over it.
#pragma once

#include <atomic>
#include <functional>
#include <optional>
#include <vector>

#include "core/path/path_pipeline.h"
#include "cuda/accel/ray_slices.h"
#include "cuda/accel/schedule/tracer.h"
#include "cuda/lanes.h"
#include "cuda/path/compact.h"
#include "cuda/path/place.h"

namespace gpurt::cuda {

/// Times between marks on a stream, added up by stage.
class StageClock {
 public:
  void start(cudaStream_t stream)
  {
    stages_.clear();
    record(stream, PathStage::Count);
  }
  /// What ran since the last mark belongs to `stage`.
  void mark(cudaStream_t stream, PathStage stage) { record(stream, stage); }
  /// Adds the times to seconds[stage] and starts anew; the stream must have passed all marks.
  void collect(double (&seconds)[uint32_t(PathStage::Count)]);

 private:
  void record(cudaStream_t stream, PathStage stage);
  std::vector<std::unique_ptr<Event>> events_;
  std::vector<PathStage> stages_;
};

/// Memory of one wave, for one lane.
class WaveMemory {
 public:
  /// For work on a stream by a resolved schedule. Throws OUT_OF_MEMORY.
  WaveMemory(const std::shared_ptr<DeviceMemory> &memory, uint32_t capacity, const Schedule &schedule,
             cudaStream_t stream);
  static uint64_t bytes_for(uint32_t capacity, const Schedule &schedule);

  uint32_t capacity() const { return capacity_; }
  const PathWave &wave() const { return wave_; }
  CompactScratch compaction() const;
  /// In device memory: the bits of the largest radiance of a path, 0 at first.
  uint32_t *largest_bits() const { return largest_; }
  /// In device memory: what tracing the wave's rays works on.
  uint32_t *trace_scratch() const { return trace_scratch_; }
  const Schedule &schedule() const { return schedule_; }
  /// Null where the schedule is that of the fused kernels.
  ScheduledTracer *tracer() { return tracer_ ? &*tracer_ : nullptr; }
  /// Flags and places of the wave's rays, and what placing works on; the second set is for the next rays of counted
  /// generation.
  Placement placement(int set) const
  {
    return {schedule_.compaction, placement_memory_, placement_bytes_, flags_[set]};
  }
  uint32_t *places(int set) const { return places_[set]; }
  void *sort_memory() const { return sort_memory_; }
  uint64_t sort_bytes() const { return sort_bytes_; }
  /// Rays that counted generation has room for.
  uint64_t ray_budget() const;
  /// In device memory: what the uber-kernel of paths counts, and its pool, 0 at first.
  unsigned long long *uber_numbers() const { return uber_numbers_; }
  /// In pinned host memory: room for four numbers.
  uint32_t *host_numbers() const { return static_cast<uint32_t *>(pinned_numbers_); }

  StageClock clock;
  RaySlices slices;
  // Of whole paths, which the uber-kernel of paths follows.
  SliceSize uber_slices{uint64_t(1) << 14};

 private:
  uint32_t capacity_;
  Schedule schedule_;
  DeviceBuffer<std::byte> buffer_;
  std::optional<ScheduledTracer> tracer_;
  uint32_t *flags_[2] = {}, *places_[2] = {};
  std::byte *placement_memory_ = nullptr, *sort_memory_ = nullptr;
  uint64_t placement_bytes_ = 0, sort_bytes_ = 0;
  unsigned long long *uber_numbers_ = nullptr;
  PathWave wave_{};
  uint32_t *block_counts_ = nullptr;
  uint32_t *largest_ = nullptr, *trace_scratch_ = nullptr;
  PinnedBuffer pinned_;
  void *pinned_numbers_ = nullptr;
};

/// What waves did; times by stage.
struct WaveCounters {
  uint64_t num_camera_rays = 0, num_bounce_rays = 0, num_shadow_rays = 0;
  double stage_seconds[uint32_t(PathStage::Count)] = {};
  float largest_sample = 0;
  ScheduleCounters schedule;
};

/// What another pipeline, whose points are shaded by these stages, puts in place of tracing rays.
struct RayStandIns {
  /// Writes the hits of the wave's eye rays on the stream; null: they are traced.
  std::function<void(const PathUnit &unit, const PathWave &wave, uint32_t num_paths, cudaStream_t stream)>
      eye_hits;
  bool no_shadows = false;  // nothing stands between a surface and a light
};

/// Renders paths 0 .. num_paths - 1 of the unit, at most the wave's capacity, into a film in device memory. Returns
/// when they are done; false if `cancelled` became true on the way, with part of the paths in the film. Stand-ins need a
/// schedule that generates rays in slots.
bool render_wave(const TraceScene &scene, const PathSettings &settings, const PathUnit &unit,
                 const FilmView &film, uint32_t num_paths, const std::atomic<bool> *cancelled,
                 WaveMemory &memory, cudaStream_t stream, WaveCounters &counters,
                 const RayStandIns &stand_ins = {});

/// Adds direct light to paths 0 .. n - 1 of the wave, whose shadow rays `make_rays` puts into its slots on the stream; false
/// if `cancelled` became true on the way. The schedule must be one with slots.
bool add_direct_light(const TraceScene &scene, uint32_t n, const std::function<void()> &make_rays,
                      const std::atomic<bool> *cancelled, WaveMemory &memory, cudaStream_t stream,
                      WaveCounters &counters, const RayStandIns &stand_ins = {});

}  // namespace gpurt::cuda
