#include "cpu/reyes/render.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <bit>
#include <cstring>

#include "core/reyes/blend.h"
#include "core/reyes/filter.h"
#include "cpu/path/render_counters.h"
#include "cpu/path/wave_scratch.h"
#include "cpu/reyes/buckets.h"
#include "cpu/reyes/wide_kernel.h"

namespace gpurt {
namespace {

// Paths that are shaded together.
constexpr uint32_t shaded_paths = 1024;
// Samples of a bucket at most: they are looked at again and again, and stay in a core's cache. Larger buckets cut and dice less
// twice; where surfaces blend, samples take many times the memory.
constexpr uint64_t bucket_samples = 1u << 16, blended_bucket_samples = 1u << 14;
// Fragments of surfaces that blend that a thread keeps at a time, where memory lets it.
constexpr uint64_t most_fragments = 1u << 18;
// Without a limit of the device, lists of roots may take this much.
constexpr uint64_t default_list_bytes = uint64_t(1) << 30;

// The edge of the largest bucket of a power of two that has at most so many samples.
uint32_t bucket_edge_for(uint64_t samples_per_pixel, uint64_t most_samples)
{
  uint32_t edge = 64;
  while (edge > 8 && uint64_t(edge) * edge * samples_per_pixel > most_samples) edge /= 2;
  return edge;
}

// One thread's memory for surfaces that blend.
class BlendScratch {
 public:
  BlendScratch(uint64_t num_samples, uint64_t num_fragments)
      : fragments_(num_fragments),
        last_(num_fragments != 0 ? num_samples : 0),
        ids_(2 * last_.size() + shaded_paths),
        floats_(2 * last_.size()),
        radiance_(last_.size()),
        standing_(last_.size())
  {}

  static uint64_t bytes_per_sample()
  {
    return sizeof(Fragment) + 2 * sizeof(uint32_t) + 2 * sizeof(float) + sizeof(Vec3f) + sizeof(Hit);
  }

  BlendMemory memory()
  {
    const size_t n = last_.size();
    return {fragments_.data(), fragments_.size(),  ids_.data(),      ids_.data() + n,  last_.data(),
            floats_.data(),    floats_.data() + n, radiance_.data(), standing_.data(), ids_.data() + 2 * n};
  }

 private:
  std::vector<Fragment> fragments_, last_;
  std::vector<uint32_t> ids_;
  std::vector<float> floats_;
  std::vector<Vec3f> radiance_;
  std::vector<Hit> standing_;
};

// One thread's memory for micropolygons that are lit by rays.
class PointScratch {
 public:
  // 0: none are.
  explicit PointScratch(uint64_t num_samples)
      : points_(num_samples), point_of_(num_samples), table_(table_size(num_samples))
  {}

  static uint64_t bytes(uint64_t num_samples)
  {
    return num_samples * (sizeof(ShadedPoint) + sizeof(uint32_t)) +
           table_size(num_samples) * sizeof(uint32_t);
  }

  PointMemory memory() { return {points_.data(), point_of_.data(), table_.data(), uint32_t(table_.size())}; }

 private:
  // Half of it stays empty at least.
  static uint64_t table_size(uint64_t num_samples)
  {
    return num_samples != 0 ? std::bit_ceil(2 * num_samples) : 0;
  }

  std::vector<ShadedPoint> points_;
  std::vector<uint32_t> point_of_, table_;
};

// One thread's memory for the samples of a bucket, for a wave of paths and for films.
class Scratch {
 public:
  Scratch(uint64_t num_samples, uint64_t num_cells, uint64_t num_fragments, bool lights_by_rays)
      : blend_(num_samples, num_fragments),
        points_(lights_by_rays ? num_samples : 0),
        floats_(8 * num_samples),
        ids_(2 * num_samples + num_cells + 1),
        num_samples_(num_samples),
        wave_(shaded_paths)
  {}

  static uint64_t bytes(uint64_t num_samples, uint64_t num_cells, bool lights_by_rays)
  {
    return num_samples * (8 * sizeof(float) + 2 * sizeof(uint32_t)) + (num_cells + 1) * sizeof(uint32_t) +
           WaveScratch::bytes(shaded_paths) + (lights_by_rays ? PointScratch::bytes(num_samples) : 0);
  }

  ReyesMemory memory()
  {
    const auto array = [&](int i) { return floats_.data() + i * num_samples_; };
    return {array(0),
            array(1),
            array(2),
            array(3),
            array(4),
            array(5),
            array(6),
            array(7),
            ids_.data(),
            ids_.data() + num_samples_,
            ids_.data() + 2 * num_samples_};
  }
  PathWave wave() { return wave_.wave(); }
  BlendMemory blend_memory() { return blend_.memory(); }
  PointMemory point_memory() { return points_.memory(); }

  TileFilm film, bucket_film;

 private:
  BlendScratch blend_;
  PointScratch points_;
  std::vector<float> floats_;
  std::vector<uint32_t> ids_;
  uint64_t num_samples_;
  WaveScratch wave_;
};

RenderCounters counters_from(const ReyesKernelCounters &k, uint64_t num_samples)
{
  RenderCounters c = counters_from(k.path, num_samples);
  ReyesCounters &r = c.reyes;
  r.num_patches = k.num_patches;
  r.num_triangles = k.num_triangles;
  r.num_splits = k.num_splits;
  r.num_culled = k.num_culled;
  r.num_grids = k.num_grids;
  r.num_micropolygons = k.num_micropolygons;
  r.num_fragments = k.num_fragments;
  r.num_shaded = k.num_shaded;
  r.largest_queue = k.largest_queue;
  r.largest_fragments = k.largest_fragments;
  r.num_lost_fragments = k.num_lost_fragments;
  r.split_seconds = k.split_seconds;
  r.dice_seconds = k.dice_seconds;
  r.sample_seconds = k.sample_seconds;
  return c;
}

// Lamps or an environment, which rays from surfaces may meet.
bool has_light_to_find(const SceneView &scene)
{
  bool has_lamps = false;
  for (uint32_t i = 0; i < scene.num_tree_lights; ++i)
    has_lamps |= scene.lights[i].type == LightType::Triangle;
  return has_lamps || scene.environment.is_present != 0;
}

}  // namespace

void render_reyes_on_cpu(const RenderPass &pass, const CpuAccel &accel, const ReyesScene &scene,
                         const ReyesKernels &kernels, const WideKernels *wide, tbb::task_arena &arena,
                         const std::shared_ptr<MemoryTracker> &memory)
{
  const ReyesSettings &reyes = *pass.reyes;
  const Camera &camera = pass.settings.camera;
  const uint64_t num_roots = scene.num_ranges == 0 ? 0 : scene.ranges[scene.num_ranges].first_root;
  if (num_roots > max_roots) {
    fail_invalid("the scene has {} patches and triangles through its instances; REYES takes at most {}",
                 num_roots, max_roots);
  }
  const bool has_found_light = has_light_to_find(scene.scene);
  const bool lights_by_rays = reyes.lights_by_rays != 0;
  uint64_t most_samples = 1, film_bytes = 0;
  for (const WorkUnit &u : pass.units) {
    most_samples = std::max(most_samples, u.num_samples);
    film_bytes =
        std::max(film_bytes, TileFilm::bytes_for(uint64_t(u.x1 - u.x0) * (u.y1 - u.y0), pass.outputs));
  }
  uint32_t edge =
      bucket_edge_for(most_samples, scene.scene.has_blending ? blended_bucket_samples : bucket_samples);
  // Samples take at most a quarter of what the memory limit leaves, where smaller buckets can do that.
  if (memory && memory->limit() != 0) {
    const uint64_t left = memory->limit() - std::min(memory->limit(), memory->used());
    const auto bytes = [&] {
      return uint64_t(arena.max_concurrency()) *
             Scratch::bytes(uint64_t(edge) * edge * most_samples, largest_cells(edge), lights_by_rays);
    };
    while (edge > 8 && bytes() > left / 4) edge /= 2;
  }
  const uint64_t num_samples = uint64_t(edge) * edge * most_samples, num_cells = largest_cells(edge);
  film_bytes += TileFilm::bytes_for(uint64_t(edge) * edge, pass.outputs);
  uint64_t scratch_bytes = uint64_t(arena.max_concurrency()) *
                           (Scratch::bytes(num_samples, num_cells, lights_by_rays) + film_bytes);
  uint64_t num_fragments = 0;
  if (scene.scene.has_blending) {
    scratch_bytes += uint64_t(arena.max_concurrency()) * num_samples * BlendScratch::bytes_per_sample();
    num_fragments = most_fragments;
    // A quarter of what is left.
    if (memory && memory->limit() != 0) {
      const uint64_t taken = memory->used() + scratch_bytes,
                     left = memory->limit() - std::min(memory->limit(), taken);
      num_fragments =
          std::min(num_fragments, left / 4 / uint64_t(arena.max_concurrency()) / sizeof(Fragment));
    }
    num_fragments = std::max(num_fragments, most_samples * smallest_blend_edge * smallest_blend_edge *
                                                std::max(reyes.fragment_slots, 1u));
    scratch_bytes += uint64_t(arena.max_concurrency()) * num_fragments * sizeof(Fragment);
  }
  const Reservation reserved(memory, scratch_bytes, "rendering's working memory");
  // Half of what is left goes to lists: several passes may run.
  uint64_t list_bytes = default_list_bytes;
  if (memory && memory->limit() != 0)
    list_bytes = std::min(list_bytes, (memory->limit() - std::min(memory->limit(), memory->used())) / 2);
  const auto is_cancelled = [&] {
    return pass.cancelled != nullptr && pass.cancelled->load(std::memory_order_relaxed);
  };

  arena.execute([&] {
    const double start = steady_seconds();
    const RootBuckets buckets(scene, kernels, camera, edge, filter_reach(reyes.filter), list_bytes);
    const Reservation lists(memory, buckets.bytes(), "REYES' lists of primitives");
    // Counted with the unit that comes first.
    std::atomic<bool> is_first{true};
    const double bound_seconds = steady_seconds() - start;
    tbb::enumerable_thread_specific<Scratch> scratches(
        [&] { return Scratch(num_samples, num_cells, num_fragments, lights_by_rays); });
    tbb::parallel_for(
        tbb::blocked_range<size_t>(0, pass.units.size(), 1),
        [&](const tbb::blocked_range<size_t> &range) {
          Scratch &scratch = scratches.local();
          const ReyesMemory samples = scratch.memory();
          const PathWave wave = scratch.wave();
          for (size_t k = range.begin(); k != range.end(); ++k) {
            const WorkUnit &unit = pass.units[k];
            scratch.film.reset(unit.x1 - unit.x0, unit.y1 - unit.y0, pass.outputs);
            ReyesKernelCounters counters{};
            uint64_t largest_bucket = 0;
            for (uint32_t y = unit.y0; y < unit.y1;) {
              const uint32_t y1 = std::min((y / edge + 1) * edge, unit.y1);
              for (uint32_t x = unit.x0; x < unit.x1;) {
                const uint32_t x1 = std::min((x / edge + 1) * edge, unit.x1);
                if (is_cancelled()) return;
                const std::span<const uint32_t> roots = buckets.roots_of(x, y);
                const ReyesBucket bucket{x,
                                         y,
                                         x1,
                                         y1,
                                         unit.first_sample,
                                         unit.num_samples,
                                         buckets.has_lists() ? roots.data() : nullptr,
                                         buckets.has_lists() ? roots.size() : num_roots,
                                         has_found_light,
                                         lights_by_rays,
                                         wide};
                largest_bucket = std::max(largest_bucket, bucket.num_roots);
                scratch.bucket_film.reset(x1 - x, y1 - y, pass.outputs);
                if (scene.scene.has_blending) {
                  kernels.blend(accel, scene, pass.settings, reyes, bucket, samples, scratch.blend_memory(),
                                wave, shaded_paths, scratch.bucket_film.view(), steady_seconds, counters);
                } else {
                  kernels.find_visible(scene, pass.settings, reyes, bucket, samples, steady_seconds,
                                       counters);
                  kernels.shade(accel, scene, pass.settings, reyes, bucket, samples, scratch.point_memory(),
                                wave, shaded_paths, scratch.bucket_film.view(), steady_seconds, counters);
                }
                add_film(scratch.film, scratch.bucket_film, x - unit.x0, y - unit.y0);
                x = x1;
              }
              y = y1;
            }
            RenderCounters c =
                counters_from(counters, uint64_t(unit.x1 - unit.x0) * (unit.y1 - unit.y0) * unit.num_samples);
            c.reyes.largest_bucket = largest_bucket;
            c.reyes.working_bytes = scratch_bytes + buckets.bytes();
            if (is_first.exchange(false)) c.reyes.bound_seconds = bound_seconds;
            pass.deliver(unit, scratch.film, c);
          }
        },
        tbb::simple_partitioner());
  });
}

#if defined(__x86_64__)
inline namespace x86_64 {
const ReyesKernels &reyes_kernels();
}
namespace x86_64_v3 {
const ReyesKernels &reyes_kernels();
}
namespace x86_64_v4 {
const WideKernels &wide_kernels();
}
const ReyesKernels &reyes_kernels(const char *isa_name)
{
  return std::strcmp(isa_name, "x86_64") == 0 ? x86_64::reyes_kernels() : x86_64_v3::reyes_kernels();
}
const WideKernels *wide_kernels(const char *isa_name)
{
  return std::strcmp(isa_name, "x86_64_v4") == 0 ? &x86_64_v4::wide_kernels() : nullptr;
}
#else
inline namespace generic {
const ReyesKernels &reyes_kernels();
}
const ReyesKernels &reyes_kernels(const char *) { return generic::reyes_kernels(); }
const WideKernels *wide_kernels(const char *) { return nullptr; }
#endif

}  // namespace gpurt
