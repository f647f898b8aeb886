#include "cpu/path/render.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <cstring>

#include "cpu/path/render_counters.h"
#include "cpu/path/wave_scratch.h"

namespace gpurt {
namespace {

uint64_t largest_film_bytes(const RenderPass &pass)
{
  uint64_t bytes = 0;
  for (const WorkUnit &u : pass.units) {
    bytes = std::max(bytes, TileFilm::bytes_for(uint64_t(u.x1 - u.x0) * (u.y1 - u.y0), pass.outputs));
  }
  return bytes;
}

}  // namespace

void render_on_cpu(const RenderPass &pass, const CpuAccel &accel, const SceneView &scene, PathKernel kernel,
                   tbb::task_arena &arena, const std::shared_ptr<MemoryTracker> &memory)
{
  const uint64_t num_threads = uint64_t(arena.max_concurrency());
  const Reservation reserved(memory, num_threads * (WaveScratch::bytes() + largest_film_bytes(pass)),
                             "rendering's working memory");
  const auto is_cancelled = [&] {
    return pass.cancelled != nullptr && pass.cancelled->load(std::memory_order_relaxed);
  };

  arena.execute([&] {
    tbb::enumerable_thread_specific<WaveScratch> scratches;
    tbb::parallel_for(
        tbb::blocked_range<size_t>(0, pass.units.size(), 1),
        [&](const tbb::blocked_range<size_t> &range) {
          WaveScratch &scratch = scratches.local();
          const PathWave wave = scratch.wave();
          for (size_t k = range.begin(); k != range.end(); ++k) {
            const WorkUnit &unit = pass.units[k];
            const uint32_t width = unit.x1 - unit.x0, height = unit.y1 - unit.y0;
            scratch.film.reset(width, height, pass.outputs);
            PathKernelCounters counters{};
            const uint64_t num_paths = uint64_t(width) * height * unit.num_samples;
            for (uint64_t first = 0; first < num_paths; first += wave_capacity) {
              if (is_cancelled()) return;
              const PathUnit part{unit.x0, unit.y0, unit.x1, unit.y1, unit.first_sample, first};
              kernel(accel, scene, pass.settings, part, wave, scratch.film.view(),
                     uint32_t(std::min<uint64_t>(wave_capacity, num_paths - first)), steady_seconds,
                     counters);
            }
            pass.deliver(unit, scratch.film, counters_from(counters, num_paths));
          }
        },
        tbb::simple_partitioner());
  });
}

#if defined(__x86_64__)
inline namespace x86_64 {
void render_paths(const CpuAccel &, const SceneView &, const PathSettings &, const PathUnit &,
                  const PathWave &, const FilmView &, uint32_t, double (*)(), PathKernelCounters &);
}
namespace x86_64_v3 {
void render_paths(const CpuAccel &, const SceneView &, const PathSettings &, const PathUnit &,
                  const PathWave &, const FilmView &, uint32_t, double (*)(), PathKernelCounters &);
}
PathKernel path_kernel(const char *isa_name)
{
  return std::strcmp(isa_name, "x86_64_v3") == 0 ? x86_64_v3::render_paths : x86_64::render_paths;
}
#else
inline namespace generic {
void render_paths(const CpuAccel &, const SceneView &, const PathSettings &, const PathUnit &,
                  const PathWave &, const FilmView &, uint32_t, double (*)(), PathKernelCounters &);
}
PathKernel path_kernel(const char *) { return generic::render_paths; }
#endif

}  // namespace gpurt
