// The path pipeline's stages as kernels, and the executor that starts them on a stream.
#include <type_traits>
#include <vector>

#include "cuda/launch.h"
#include "cuda/path/count_rays.h"
#include "cuda/path/sort_hits.h"
#include "cuda/path/uber_path.h"
#include "cuda/path/wave.h"

namespace gpurt::cuda {
namespace {

// The generic kernel of per-item stages.
template <class Stage>
__global__ void __launch_bounds__(block_size) run_stage(const __grid_constant__ Stage stage, uint32_t n)
{
  const uint64_t i = thread_item();
  if (i < n) stage(uint32_t(i));
}

// Shading in an order of its own: hits of one material lie together.
template <bool MayAbsorb>
struct ShadeSorted {
  BasicShadePathVertex<MayAbsorb> stage;
  const uint32_t *order;

  __device__ void operator()(uint32_t i) const { stage(order[i]); }
};

// The bits of positive floats are ordered as the floats; what is not a number is not above 0.
struct FindLargestSample {
  const PathState *paths;
  uint32_t *largest_bits;

  __device__ void operator()(uint32_t i) const
  {
    const float largest = max_component(paths[i].radiance);
    // Most paths see that they are not the largest without an atomic operation.
    if (largest > 0.0f && float_bits(largest) > *largest_bits) atomicMax(largest_bits, float_bits(largest));
  }
};

constexpr const char *stage_names[] = {"path stage 'generate'", "path stage 'trace'", "path stage 'shade'",
                                       "path stage 'shadow'", "path stage 'film'"};

class StreamExecutor {
 public:
  StreamExecutor(const TraceScene &scene, const std::atomic<bool> *cancelled, WaveMemory &memory,
                 cudaStream_t stream, WaveCounters &counters, const PathUnit &unit,
                 const RayStandIns &stand_ins)
      : scene_(scene),
        cancelled_(cancelled),
        memory_(memory),
        stream_(stream),
        counters_(counters),
        unit_(unit),
        stand_ins_(stand_ins)
  {
    memory_.clock.start(stream_);
  }

  template <class Stage>
  void for_each(PathStage id, uint32_t n, const Stage &stage)
  {
    if constexpr (std::is_same_v<Stage, ShadePathVertex>) {
      if (stage.scene.has_absorption) shade(n, stage);
      else shade(n, BasicShadePathVertex<false>{stage.scene, stage.settings, stage.wave, stage.depth});
      return;
    }
    launch(stage_names[uint32_t(id)], run_stage<Stage>, n, stream_, stage, n);
    memory_.clock.mark(stream_, id);
  }

  void trace_closest(const Ray *rays, Hit *hits, uint32_t n)
  {
    if (is_first_trace_ && stand_ins_.eye_hits) {
      stand_ins_.eye_hits(unit_, memory_.wave(), n, stream_);
      is_first_trace_ = false;
      memory_.clock.mark(stream_, PathStage::Trace);
      return;
    }
    memory_.slices.run(*scene_.slices, n, stream_, [&](uint64_t first, uint64_t count) {
      if (ScheduledTracer *tracer = memory_.tracer())
        tracer->closest(scene_, rays + first, count, HitLayout::Internal, hits + first,
                        {nullptr, nullptr, !is_first_trace_});
      else
        launch_closest(scene_, rays + first, count, HitLayout::Internal, hits + first, order(is_first_trace_),
                       stream_);
    });
    (is_first_trace_ ? counters_.num_camera_rays : counters_.num_bounce_rays) += n;
    is_first_trace_ = false;
    memory_.clock.mark(stream_, PathStage::Trace);
  }

  void trace_occluded(const Ray *rays, uint8_t *occluded, uint32_t n)
  {
    if (stand_ins_.no_shadows) {
      check(cudaMemsetAsync(occluded, 0, n, stream_), "cudaMemsetAsync");
      return;
    }
    memory_.slices.run(*scene_.slices, n, stream_, [&](uint64_t first, uint64_t count) {
      if (ScheduledTracer *tracer = memory_.tracer())
        tracer->any(scene_, rays + first, count, occluded + first, {nullptr, nullptr, true});
      else launch_any(scene_, rays + first, count, occluded + first, order(false), stream_);
    });
    counters_.num_shadow_rays += n;
    memory_.clock.mark(stream_, PathStage::Shadow);
  }

  uint32_t compact_rays(const RayQueue &from, uint32_t n, const RayQueue &to)
  {
    if (place(from.rays, n)) launch_move_rays(from, n, to, memory_.places(0), stream_);
    else launch_compact_rays(from, n, to, memory_.compaction(), stream_);
    return kept();
  }

  uint32_t compact_shadows(const ShadowQueue &from, uint32_t n, const ShadowQueue &to)
  {
    if (place(from.rays, n)) launch_move_shadows(from, n, to, memory_.places(0), stream_);
    else launch_compact_shadows(from, n, to, memory_.compaction(), stream_);
    return kept();
  }

  /// The rays that hits begin .. end - 1 make, which are counted before anything is made.
  struct RayCounts {
    uint32_t num_shadows, num_next;
  };
  RayCounts count_rays(const ShadePathVertex &stage, uint32_t begin, uint32_t end)
  {
    uint32_t *totals = memory_.host_numbers() + 2;
    const Placement shadows = memory_.placement(0), next = memory_.placement(1);
    launch_count_rays(stage, begin, end, shadows.flags, next.flags, stream_);
    launch_place(shadows, end - begin, memory_.places(0), totals, stream_);
    launch_place(next, end - begin, memory_.places(1), totals + 1, stream_);
    counters_.schedule.compactions += 2;
    memory_.clock.mark(stream_, PathStage::Shade);
    synchronize();
    return {totals[0], totals[1]};
  }

  void make_rays(const ShadePathVertex &stage, uint32_t begin, uint32_t end, RayCounts counts)
  {
    launch_make_rays(stage, begin, end, memory_.places(0), memory_.places(1), stream_);
    counters_.schedule.counted_rays += uint64_t(counts.num_shadows) + counts.num_next;
    memory_.clock.mark(stream_, PathStage::Shade);
  }

  /// Makes the next rays those that are traced, from `begin` on.
  void take_next_rays(uint32_t begin, uint32_t n)
  {
    const PathWave &wave = memory_.wave();
    copy(wave.rays.rays + begin, wave.next_rays.rays, n);
    copy(wave.rays.paths + begin, wave.next_rays.paths, n);
  }

  void count_split() { ++counters_.schedule.wave_splits; }
  bool was_cancelled() const { return was_cancelled_; }

  /// Waits; true if the job was cancelled meanwhile.
  bool synchronize()
  {
    check(cudaStreamSynchronize(stream_), "cudaStreamSynchronize");
    if (cancelled_ != nullptr && cancelled_->load(std::memory_order_relaxed)) was_cancelled_ = true;
    return was_cancelled_;
  }

 private:
  template <bool MayAbsorb>
  void shade(uint32_t n, const BasicShadePathVertex<MayAbsorb> &stage)
  {
    if (memory_.schedule().shading == Shading::Sorted) {
      const uint32_t *order = launch_sort_hits(scene_.scene, memory_.wave().hits, n, memory_.sort_memory(),
                                               memory_.sort_bytes(), stream_);
      counters_.schedule.sorted_hits += n;
      launch("path stage 'shade', sorted by material", run_stage<ShadeSorted<MayAbsorb>>, n, stream_,
             ShadeSorted<MayAbsorb>{stage, order}, n);
    } else {
      launch(stage_names[uint32_t(PathStage::Shade)], run_stage<BasicShadePathVertex<MayAbsorb>>, n, stream_,
             stage, n);
    }
    memory_.clock.mark(stream_, PathStage::Shade);
  }

  // The fast kernels serve camera rays alone: a ray that leaves a surface may always hit the triangle that it leaves, as far
  // as single precision can tell, and what has to be measured in addition costs more than they save.
  RayOrder order(bool is_camera) const
  {
    if (!is_camera) return {};
    return {Coherence::Coherent, 0, memory_.trace_scratch()};
  }

  // Finds places for the rays that are there; false if the schedule compacts by blocks.
  bool place(const Ray *rays, uint32_t n)
  {
    if (memory_.schedule().compaction == Compaction::BlockScan) return false;
    const Placement placement = memory_.placement(0);
    launch_flag_rays(rays, n, placement.flags, stream_);
    launch_place(placement, n, memory_.places(0), memory_.compaction().total, stream_);
    ++counters_.schedule.compactions;
    return true;
  }

  template <class T>
  void copy(T *to, const T *from, uint32_t n)
  {
    check(cudaMemcpyAsync(to, from, uint64_t(n) * sizeof(T), cudaMemcpyDeviceToDevice, stream_),
          "cudaMemcpyAsync");
  }

  // Waits for a compaction. Cancelled: none are kept, and the paths end here.
  uint32_t kept() { return synchronize() ? 0 : *memory_.compaction().total; }

  const TraceScene &scene_;
  const std::atomic<bool> *cancelled_;
  WaveMemory &memory_;
  cudaStream_t stream_;
  WaveCounters &counters_;
  const PathUnit &unit_;
  const RayStandIns &stand_ins_;
  bool is_first_trace_ = true;
  bool was_cancelled_ = false;
};

// What the uber-kernel of paths and counted generation share with trace_paths: the eye rays' features.
void add_features(StreamExecutor &exec, const SceneView &scene, const PathSettings &settings,
                  const PathUnit &unit, const PathWave &wave, const FilmView &film, uint32_t num_paths)
{
  if (film.features == nullptr && film.first_hits == nullptr) return;
  exec.for_each(PathStage::Film, min(film.width * film.height, num_paths),
                AddFeatures{{scene, settings, film}, unit, wave, num_paths});
}

// Paths whose rays are counted before they are made. Hits begin .. end - 1 that would make more rays than the budget
// are split, and the first half is followed to its end before the second one goes on: what waits keeps its place in the
// wave, since no hit makes more than one next ray.
//
// Source: the talk: count, read back the total, check whether there are resources, then generate.
void trace_counted_paths(StreamExecutor &exec, const SceneView &scene, const PathSettings &settings,
                         const PathUnit &unit, const PathWave &wave, const FilmView &film, uint32_t num_paths,
                         uint64_t ray_budget)
{
  struct Part {
    uint32_t begin, end, depth;
    bool is_traced;
  };
  exec.for_each(PathStage::Generate, num_paths, GenerateCameraRays{settings, unit, wave});
  std::vector<Part> parts = {{0, num_paths, 1, false}};
  while (!parts.empty() && !exec.was_cancelled()) {
    const Part part = parts.back();
    parts.pop_back();
    if (!part.is_traced) {
      exec.trace_closest(wave.rays.rays + part.begin, wave.hits + part.begin, part.end - part.begin);
      if (part.depth == 1) add_features(exec, scene, settings, unit, wave, film, num_paths);
    }
    const ShadePathVertex stage{scene, settings, wave, part.depth};
    const StreamExecutor::RayCounts counts = exec.count_rays(stage, part.begin, part.end);
    if (exec.was_cancelled()) break;
    if (uint64_t(counts.num_shadows) + counts.num_next > ray_budget) {
      const uint32_t middle = part.begin + (part.end - part.begin) / 2;
      parts.push_back({middle, part.end, part.depth, true});
      parts.push_back({part.begin, middle, part.depth, true});
      exec.count_split();
      continue;
    }
    exec.make_rays(stage, part.begin, part.end, counts);
    exec.trace_occluded(wave.shadow_queue.rays, wave.occluded, counts.num_shadows);
    exec.for_each(PathStage::Shadow, counts.num_shadows, AddDirectLight{wave});
    if (counts.num_next == 0) continue;
    exec.take_next_rays(part.begin, counts.num_next);
    parts.push_back({part.begin, part.begin + counts.num_next, part.depth + 1, false});
  }
  exec.for_each(PathStage::Film, min(film.width * film.height, num_paths),
                AddSamples{unit, wave, film, num_paths});
}

// Paths that one kernel follows from end to end, a few at a time so that a job can be cancelled.
constexpr uint64_t max_uber_paths = uint64_t(1) << 19;

void trace_uber_paths(StreamExecutor &exec, const TraceScene &scene, const PathSettings &settings,
                      const PathUnit &unit, const FilmView &film, uint32_t num_paths, WaveMemory &memory,
                      cudaStream_t stream, WaveCounters &counters)
{
  const PathWave &wave = memory.wave();
  if (film.features != nullptr || film.first_hits != nullptr) {
    // What the film keeps of eye rays is gathered pixel by pixel, for which all of them must be there at once.
    exec.for_each(PathStage::Generate, num_paths, GenerateCameraRays{settings, unit, wave});
    memory.slices.run(*scene.slices, num_paths, stream, [&](uint64_t first, uint64_t count) {
      launch_closest(scene, wave.rays.rays + first, count, HitLayout::Internal, wave.hits + first, {},
                     stream);
    });
    add_features(exec, scene.scene, settings, unit, wave, film, num_paths);
  }
  unsigned long long *numbers = memory.uber_numbers();
  auto *device_counters = reinterpret_cast<UberPathCounters *>(numbers);
  unsigned long long *pool = numbers + num_uber_numbers - 1;
  check(cudaMemsetAsync(numbers, 0, num_uber_numbers * sizeof *numbers, stream), "cudaMemsetAsync");
  Event begin, end;
  for (uint32_t first = 0; first < num_paths;) {
    const uint32_t count =
        uint32_t(std::min<uint64_t>(std::min(memory.uber_slices.get(), max_uber_paths), num_paths - first));
    begin.record(stream);
    check(cudaMemsetAsync(pool, 0, sizeof *pool, stream), "cudaMemsetAsync");
    const bool is_persistent = memory.schedule().launch == Launch::Persistent;
    launch_uber_paths(scene, settings, unit, wave, first, count, {is_persistent ? pool : nullptr},
                      device_counters, stream);
    end.record(stream);
    memory.clock.mark(stream, PathStage::Trace);
    if (exec.synchronize()) return;
    memory.uber_slices.learn(count, seconds_between(begin, end));
    first += count;
  }
  UberPathCounters counted{};
  check(cudaMemcpyAsync(&counted, device_counters, sizeof counted, cudaMemcpyDeviceToHost, stream),
        "cudaMemcpyAsync");
  exec.for_each(PathStage::Film, min(film.width * film.height, num_paths),
                AddSamples{unit, wave, film, num_paths});
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  counters.num_camera_rays += num_paths;
  counters.num_bounce_rays += counted.num_bounce_rays;
  counters.num_shadow_rays += counted.num_shadow_rays;
  counters.schedule.ray_refills += counted.ray_refills;
  counters.schedule.mode_switches += counted.mode_switches;
}

}  // namespace

bool render_wave(const TraceScene &scene, const PathSettings &settings, const PathUnit &unit,
                 const FilmView &film, uint32_t num_paths, const std::atomic<bool> *cancelled,
                 WaveMemory &memory, cudaStream_t stream, WaveCounters &counters,
                 const RayStandIns &stand_ins)
{
  StreamExecutor executor(scene, cancelled, memory, stream, counters, unit, stand_ins);
  const Schedule &schedule = memory.schedule();
  if (schedule.traversal == Traversal::Uber) {
    trace_uber_paths(executor, scene, settings, unit, film, num_paths, memory, stream, counters);
  } else if (schedule.generation == Generation::Counted) {
    trace_counted_paths(executor, scene.scene, settings, unit, memory.wave(), film, num_paths,
                        memory.ray_budget());
  } else {
    trace_paths(executor, scene.scene, settings, unit, memory.wave(), film, num_paths);
  }
  if (ScheduledTracer *tracer = memory.tracer()) tracer->collect(counters.schedule);
  if (executor.was_cancelled()) return false;

  check(cudaMemsetAsync(memory.largest_bits(), 0, sizeof(uint32_t), stream), "cudaMemsetAsync");
  executor.for_each(PathStage::Film, num_paths,
                    FindLargestSample{memory.wave().paths, memory.largest_bits()});
  uint32_t *largest = memory.host_numbers() + 1;
  check(cudaMemcpyAsync(largest, memory.largest_bits(), sizeof(uint32_t), cudaMemcpyDeviceToHost, stream),
        "cudaMemcpyAsync");
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  memory.clock.collect(counters.stage_seconds);
  counters.largest_sample = max(counters.largest_sample, float_from_bits(*largest));
  return true;
}

bool add_direct_light(const TraceScene &scene, uint32_t n, const std::function<void()> &make_rays,
                      const std::atomic<bool> *cancelled, WaveMemory &memory, cudaStream_t stream,
                      WaveCounters &counters, const RayStandIns &stand_ins)
{
  const PathWave &wave = memory.wave();
  const PathUnit unit{};
  StreamExecutor executor(scene, cancelled, memory, stream, counters, unit, stand_ins);
  make_rays();
  memory.clock.mark(stream, PathStage::Shade);
  const uint32_t num_shadows = executor.compact_shadows(wave.shadows, n, wave.shadow_queue);
  if (executor.was_cancelled()) return false;
  executor.trace_occluded(wave.shadow_queue.rays, wave.occluded, num_shadows);
  executor.for_each(PathStage::Shadow, num_shadows, AddDirectLight{wave});
  if (ScheduledTracer *tracer = memory.tracer()) tracer->collect(counters.schedule);
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  memory.clock.collect(counters.stage_seconds);
  return true;
}

}  // namespace gpurt::cuda
