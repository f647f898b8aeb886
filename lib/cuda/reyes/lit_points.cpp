#include "cuda/reyes/lit_points.h"

#include <algorithm>
#include <bit>

#include "cuda/layout.h"

namespace gpurt::cuda {
namespace {

// Half of it stays empty at least.
uint64_t table_size(uint64_t num_samples) { return std::bit_ceil(2 * num_samples); }

}  // namespace

struct LitPoints::Arrays {
  uint32_t *table, *point_of, *points, *num_points;
  Vec3f *light;
  uint64_t bytes;
};

LitPoints::Arrays LitPoints::lay_out(std::byte *base, uint64_t num_samples)
{
  Layout layout(base);
  Arrays a;
  a.table = layout.take<uint32_t>(table_size(num_samples));
  a.point_of = layout.take<uint32_t>(num_samples);
  a.points = layout.take<uint32_t>(num_samples);
  a.num_points = layout.take<uint32_t>(1);
  a.light = layout.take<Vec3f>(num_samples);
  a.bytes = layout.bytes();
  return a;
}

LitPoints::LitPoints(const std::shared_ptr<DeviceMemory> &memory, uint64_t num_samples)
    : buffer_(memory, lay_out(nullptr, num_samples).bytes, "points that REYES lights after visibility")
{
  const Arrays a = lay_out(buffer_.data(), num_samples);
  view_.table = a.table;
  view_.point_of = a.point_of;
  view_.points = a.points;
  view_.num_points = a.num_points;
  view_.light = a.light;
}

bool LitPoints::run(const TraceScene &scene, const PathSettings &settings, bool has_found_light,
                    const ReyesSettings &reyes, VisibleSamples &visible, WaveMemory &wave,
                    const FilmView &film, const std::atomic<bool> *cancelled, cudaStream_t stream,
                    ReyesCounters &counters, WaveCounters &wave_counters)
{
  PointView v = view_;
  v.eye = visible.eye_hits(settings);
  v.is_sampled = has_found_light ? 1 : 0;
  v.num_samples = visible.grid().num_samples;
  v.edge2 = largest_edge2(reyes.shading_rate, reyes.shading == ReyesShading::Blocks ? 1 : 0);
  const uint64_t size = table_size(v.num_samples);
  v.table_mask = uint32_t(size - 1);
  visible.begin_shading(stream);
  check(cudaMemsetAsync(v.table, 0xff, size * sizeof *v.table, stream), "cudaMemsetAsync");
  check(cudaMemsetAsync(v.num_points, 0, sizeof *v.num_points, stream), "cudaMemsetAsync");
  launch_dice_triangles(v, visible.spots(), stream);
  launch_find_points(v, stream);
  visible.end_shading(stream);
  uint32_t *found = wave.host_numbers() + 2;
  check(cudaMemcpyAsync(found, v.num_points, sizeof *found, cudaMemcpyDeviceToHost, stream),
        "cudaMemcpyAsync");
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  const uint32_t num_points = *found;
  counters.num_shaded += num_points;

  RayStandIns stand_ins;
  stand_ins.no_shadows = reyes.no_shadows != 0;
  const uint32_t num_lights =
      settings.max_depth < 2 ? 0 : scene.scene.num_tree_lights + scene.scene.num_distant_lights;
  for (uint32_t first = 0; first < num_points; first += wave.capacity()) {
    const uint32_t n = std::min(wave.capacity(), num_points - first);
    if (has_found_light) {
      stand_ins.eye_hits = [&](const PathUnit &, const PathWave &paths, uint32_t count, cudaStream_t on) {
        launch_point_paths(v, paths, first, count, on);
      };
      // Paths are points, not samples: they go to no film from here.
      if (!render_wave(scene, settings, v.eye.unit, FilmView{}, n, cancelled, wave, stream, wave_counters,
                       stand_ins))
        return false;
    } else {
      launch_clear_paths(wave.wave(), n, stream);
      for (uint32_t light = 0; light < num_lights; ++light) {
        const auto make_rays = [&] { launch_point_shadows(v, wave.wave(), light, first, n, stream); };
        if (!add_direct_light(scene, n, make_rays, cancelled, wave, stream, wave_counters, stand_ins))
          return false;
      }
    }
    launch_keep_point_light(v, wave.wave(), first, n, stream);
  }
  wave_counters.largest_sample = 0;
  visible.begin_shading(stream);
  launch_resolve_points(v, film, film.width * film.height, &v.eye.numbers->largest_sample, stream);
  visible.end_shading(stream);
  return true;
}

}  // namespace gpurt::cuda
