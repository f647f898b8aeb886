// The steps of a pool of paths as kernels, and their order.
#include "cuda/accel/near.h"
#include "cuda/launch.h"
#include "cuda/path/pool.h"
#include "cuda/path/pool_places.h"
#include "cuda/warp_reduce.h"

namespace gpurt::cuda {
namespace {

struct PoolStep {
  SceneView scene;
  PathSettings settings;
  PathUnit unit;
  PathQueue from, to;
  const Hit *hits;  // of from
  PoolShadows shadows;
  PathResult *results;
  FilmView film;  // its optional arrays
  bool leaves_out;
  uint32_t *numbers;  // of paths and of shadow rays that were made
};

__global__ void __launch_bounds__(block_size)
    start_kernel(const __grid_constant__ StartPaths start, uint32_t n)
{
  const uint64_t i = thread_item();
  if (i < n) start(uint32_t(i));
}

template <bool MayAbsorb>
__global__ void __launch_bounds__(block_size)
    shade_pool_kernel(const __grid_constant__ PoolStep s, uint32_t n)
{
  __shared__ uint32_t next_places[num_warps + 1], shadow_places[num_warps + 1];
  const uint64_t i = thread_item();
  MadeRays made;
  made.has_next = made.has_shadow = false;
  PoolPath path;
  PathState state;
  uint32_t triangle = invalid_id;
  if (i < n) {
    path = s.from.paths[i];
    const Ray ray = s.from.rays[i];
    const Hit hit = s.hits[i];
    triangle = hit.triangle;
    state = {path.throughput,
             path.pdf,
             path.position,
             path.normal,
             vec3(0.0f),
             {path.seed, path.reversed_index},
             0,
             path.medium};
    if (path.depth == 1 && (s.film.features != nullptr || s.film.first_hits != nullptr)) {
      const PathSample sample = path_sample(s.unit, path.number);
      // Sums of integers: any order gives the same bits.
      EyeFeatures{s.scene, s.settings, s.film}(
          sample.sample, sample.local, ray, hit, [](int64_t &sum, int64_t term) {
            atomicAdd(reinterpret_cast<unsigned long long *>(&sum), static_cast<unsigned long long>(term));
          });
    }
    BasicPathVertex<MayAbsorb>{s.scene, s.settings, path.depth}.shade(ray, hit, state, MadeRaysSink{made});
    const bool has_radiance =
        state.radiance.x != 0.0f || state.radiance.y != 0.0f || state.radiance.z != 0.0f;
    if (has_radiance || state.covered != 0) {
      PathResult &result = s.results[path.number];
      result = {result.radiance + state.radiance, result.covered | state.covered};
    }
  }
  const uint32_t next_place = take_place(made.has_next, s.numbers, next_places);
  if (made.has_next) {
    s.to.paths[next_place] = {state.throughput, state.pdf, state.position,      path.number, state.normal,
                              path.depth + 1,   path.seed, path.reversed_index, state.medium};
    store_ray(s.to.rays + next_place, made.next);
    s.to.left_out[next_place] = s.leaves_out ? leave_out(s.scene, made.next, triangle) : invalid_id;
  }
  const uint32_t shadow_place = take_place(made.has_shadow, s.numbers + 1, shadow_places);
  if (made.has_shadow) {
    store_ray(s.shadows.queue.rays + shadow_place, made.shadow);
    s.shadows.queue.paths[shadow_place] = path.number;
    s.shadows.queue.contributions[shadow_place] = made.contribution;
    if (s.leaves_out) {
      s.shadows.left_out[shadow_place] = leave_out(s.scene, made.shadow, triangle);
      s.shadows.ended_at[shadow_place] =
          made.target != invalid_id ? leave_out(s.scene, made.shadow, made.target) : invalid_id;
    }
  }
}

// A path has no more than one shadow ray a step.
__global__ void __launch_bounds__(block_size)
    add_direct_light_kernel(PoolShadows shadows, PathResult *results, uint32_t n)
{
  const uint64_t i = thread_item();
  if (i >= n || shadows.occluded[i]) return;
  PathResult &result = results[shadows.queue.paths[i]];
  result.radiance += shadows.queue.contributions[i];
}

__global__ void __launch_bounds__(block_size)
    add_results_kernel(const __grid_constant__ AddResults add, uint32_t n, uint32_t *largest_bits)
{
  const uint64_t i = thread_item();
  const float largest = i < n ? add(uint32_t(i)) : 0.0f;
  // The bits of positive floats are ordered as the floats.
  const unsigned of_warp = warp_max(float_bits(largest));
  if (threadIdx.x % warp_size == 0 && of_warp > *largest_bits) atomicMax(largest_bits, of_warp);
}

class Pool {
 public:
  Pool(const TraceScene &scene, PoolMemory &memory, cudaStream_t stream, WaveCounters &counters)
      : scene_(scene),
        memory_(memory),
        stream_(stream),
        counters_(counters),
        has_near_((memory.tracer() == nullptr || memory.tracer()->takes_known_triangles()) &&
                  has_near_kernels_for_paths(scene))
  {}

  bool has_near() const { return has_near_; }

  // The hits of the first num_old rays, which go on, and of num_new that come from the camera.
  void trace_closest(const PathQueue &queue, uint32_t num_old, uint32_t num_new)
  {
    const auto trace = [&](uint32_t begin, uint32_t n, const TracedRays &known, const RayOrder &order) {
      memory_.slices.run(*scene_.slices, n, stream_, [&](uint64_t first, uint64_t count) {
        const Ray *rays = queue.rays + begin + first;
        Hit *hits = memory_.hits() + begin + first;
        TracedRays part = known;
        RayOrder part_order = order;
        if (known.left_out != nullptr) part.left_out += first;
        if (order.left_out != nullptr) part_order.left_out += first;
        if (ScheduledTracer *tracer = memory_.tracer())
          tracer->closest(scene_, rays, count, HitLayout::Internal, hits, part);
        else launch_closest(scene_, rays, count, HitLayout::Internal, hits, part_order, stream_);
      });
    };
    const uint32_t *left_out = has_near_ ? queue.left_out : nullptr;
    if (memory_.tracer() != nullptr || has_near_) {
      trace(0, num_old, {left_out, nullptr, true},
            {Coherence::Incoherent, 0, memory_.trace_scratch(), left_out, nullptr});
      trace(num_old, num_new, {}, {Coherence::Coherent, 0, memory_.trace_scratch(), nullptr, nullptr});
    } else {
      trace(0, num_old + num_new, {}, {});
    }
    counters_.num_bounce_rays += num_old;
    counters_.num_camera_rays += num_new;
  }

  void trace_shadows(uint32_t n)
  {
    const PoolShadows &shadows = memory_.shadows();
    memory_.slices.run(*scene_.slices, n, stream_, [&](uint64_t first, uint64_t count) {
      const uint32_t *left_out = has_near_ ? shadows.left_out + first : nullptr,
                     *ended_at = has_near_ ? shadows.ended_at + first : nullptr;
      const Ray *rays = shadows.queue.rays + first;
      uint8_t *occluded = shadows.occluded + first;
      RayOrder order;
      if (has_near_) order = {Coherence::Incoherent, 0, memory_.trace_scratch(), left_out, ended_at};
      if (ScheduledTracer *tracer = memory_.tracer())
        tracer->any(scene_, rays, count, occluded, {left_out, ended_at, true});
      else launch_any(scene_, rays, count, occluded, order, stream_);
    });
    launch("kernel that adds direct light", add_direct_light_kernel, n, stream_, shadows, memory_.results(),
           n);
    counters_.num_shadow_rays += n;
  }

  void clear_numbers()
  {
    check(cudaMemsetAsync(memory_.numbers(), 0, PoolMemory::num_numbers * sizeof(uint32_t), stream_),
          "cudaMemsetAsync");
  }

  // Waits for the numbers of a step.
  const uint32_t *read_numbers()
  {
    check(cudaMemcpyAsync(memory_.host_numbers(), memory_.numbers(),
                          PoolMemory::num_numbers * sizeof(uint32_t), cudaMemcpyDeviceToHost, stream_),
          "cudaMemcpyAsync");
    check(cudaStreamSynchronize(stream_), "cudaStreamSynchronize");
    return memory_.host_numbers();
  }

 private:
  const TraceScene &scene_;
  PoolMemory &memory_;
  cudaStream_t stream_;
  WaveCounters &counters_;
  bool has_near_;
};

}  // namespace

bool render_pool(const TraceScene &scene, const PathSettings &settings, const PathUnit &unit,
                 const FilmView &film, uint32_t num_paths, const std::atomic<bool> *cancelled,
                 PoolMemory &memory, cudaStream_t stream, WaveCounters &counters)
{
  Pool pool(scene, memory, stream, counters);
  StageClock &clock = memory.clock;
  clock.start(stream);
  uint32_t num_started = 0, num_old = 0;
  for (int from = 0; num_old != 0 || num_started < num_paths; from = 1 - from) {
    if (cancelled != nullptr && cancelled->load(std::memory_order_relaxed)) return false;
    const PathQueue &queue = memory.queue(from);
    const uint32_t num_new = min(memory.capacity() - num_old, num_paths - num_started);
    if (num_started != 0) counters.schedule.path_refills += num_new;
    launch("kernel that starts paths", start_kernel, num_new, stream,
           StartPaths{settings, unit, queue, memory.results(), num_started, num_old}, num_new);
    clock.mark(stream, PathStage::Generate);
    pool.trace_closest(queue, num_old, num_new);
    clock.mark(stream, PathStage::Trace);
    const uint32_t n = num_old + num_new;
    num_started += num_new;
    pool.clear_numbers();
    launch("kernel that shades a pool's paths",
           scene.scene.has_absorption ? shade_pool_kernel<true> : shade_pool_kernel<false>, n, stream,
           PoolStep{scene.scene, settings, unit, queue, memory.queue(1 - from), memory.hits(),
                    memory.shadows(), memory.results(), film, pool.has_near(), memory.numbers()},
           n);
    clock.mark(stream, PathStage::Shade);
    const uint32_t *numbers = pool.read_numbers();
    num_old = numbers[0];
    pool.trace_shadows(numbers[1]);
    clock.mark(stream, PathStage::Shadow);
  }
  pool.clear_numbers();
  const uint32_t num_pixels = min(film.width * film.height, num_paths);
  launch("kernel that adds paths to the film", add_results_kernel, num_pixels, stream,
         AddResults{unit, memory.results(), film, num_paths}, num_pixels, memory.numbers() + 2);
  clock.mark(stream, PathStage::Film);
  const uint32_t largest = pool.read_numbers()[2];
  clock.collect(counters.stage_seconds);
  counters.largest_sample = max(counters.largest_sample, float_from_bits(largest));
  if (ScheduledTracer *tracer = memory.tracer()) tracer->collect(counters.schedule);
  return true;
}

}  // namespace gpurt::cuda
