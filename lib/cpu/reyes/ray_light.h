// Micropolygons' own light where it takes rays, where not all that is seen is a micropolygon, or where more than light is
// asked for.
//
// What samples keep, and how a point is lit: core/reyes/lit_point.h.
#pragma once

#include "core/path/path_wave.h"
#include "core/reyes/lit_point.h"
#include "cpu/path/serial_executor.h"
#include "cpu/reyes/places.h"
#include "cpu/reyes/reyes_kernel.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN
namespace {

// Points whose surfaces are kept while lights are gone through.
constexpr uint32_t lit_points = 128;

class RayLight : public SerialExecutor {
 public:
  RayLight(const CpuAccel &accel, const ReyesScene &scene, const PathSettings &settings,
           const ReyesSettings &reyes, const ReyesBucket &bucket, const ReyesMemory &memory,
           const PointMemory &points, const PathWave &wave, uint32_t wave_capacity, double (*seconds)(),
           ReyesKernelCounters &counters)
      : SerialExecutor(accel, seconds, counters.path),
        scene_(scene),
        settings_(settings),
        reyes_(reyes),
        bucket_(bucket),
        memory_(memory),
        points_(points),
        wave_(wave),
        wave_capacity_(min(wave_capacity, bucket.has_found_light ? wave_capacity : lit_points))
  {
    is_first_trace_ = false;  // no ray comes from the camera
  }

  void run(const FilmView &film, ReyesKernelCounters &counters)
  {
    dice_triangles();
    find_points();
    counters.num_shaded += num_points_;
    charge(PathStage::Trace);
    for (uint32_t first = 0; first < num_points_; first += wave_capacity_) {
      const uint32_t n = min(wave_capacity_, num_points_ - first);
      if (bucket_.has_found_light) trace_paths(first, n);
      else look_at_lights(first, n);
    }
    add_samples(film);
    charge(PathStage::Film);
  }

 private:
  uint32_t num_paths() const
  {
    return (bucket_.x1 - bucket_.x0) * (bucket_.y1 - bucket_.y0) * uint32_t(bucket_.num_samples);
  }

  PointPlace place_of(uint32_t slot) const
  {
    return {memory_.root[slot], {memory_.u[slot], memory_.v[slot]}};
  }

  bool is_same(const ShadedPoint &p, uint32_t slot, uint32_t group) const
  {
    return p.group == group && is_same_place(place_of(p.slot), place_of(slot));
  }

  // Samples of meshes learn which micropolygon they see.
  void dice_triangles()
  {
    const RasterProjection projection = raster_projection(settings_.camera);
    const float edge2 = largest_edge2(reyes_.shading_rate, reyes_.shading == ReyesShading::Blocks ? 1 : 0);
    for (uint32_t slot = 0; slot < num_paths(); ++slot) {
      if (memory_.root[slot] == invalid_id) continue;
      const Vec2f middle =
          diced_place(scene_, projection, memory_.root[slot], {memory_.u[slot], memory_.v[slot]}, edge2);
      memory_.u[slot] = middle.x;
      memory_.v[slot] = middle.y;
    }
  }

  // The points that samples see, in the order of the samples, and which of them each sample sees.
  void find_points()
  {
    const uint32_t mask = points_.table_size - 1;
    for (uint32_t i = 0; i < points_.table_size; ++i) points_.table[i] = invalid_id;
    const PathUnit unit{bucket_.x0, bucket_.y0, bucket_.x1, bucket_.y1, bucket_.first_sample, 0};
    for (uint32_t k = 0; k < num_paths(); ++k) {
      const uint32_t slot = memory_.slot[k];
      if (memory_.root[slot] == invalid_id) continue;
      const uint32_t group =
          group_of_sample(path_sample(unit, k).sample, bucket_.first_sample, bucket_.has_found_light);
      uint32_t at = uint32_t(hash_of_place(place_of(slot)) + group * 0x9e3779b1u) & mask;
      while (points_.table[at] != invalid_id && !is_same(points_.points[points_.table[at]], slot, group))
        at = (at + 1) & mask;
      if (points_.table[at] == invalid_id) {
        points_.points[num_points_] = {slot, group, vec3(0.0f)};
        points_.table[at] = num_points_++;
      }
      points_.point_of[slot] = points_.table[at];
    }
  }

  void find_occluded(uint32_t n)
  {
    if (reyes_.no_shadows) {
      for (uint32_t i = 0; i < n; ++i) wave_.occluded[i] = 0;
      return;
    }
    trace_occluded(wave_.shadow_queue.rays, wave_.occluded, n);
  }

  void trace_paths(uint32_t first, uint32_t n)
  {
    for (uint32_t i = 0; i < n; ++i) {
      const ShadedPoint &point = points_.points[first + i];
      const PointPlace place = place_of(point.slot);
      wave_.hits[i] = hit_of_place(scene_, settings_.camera, place, wave_.rays.rays[i]);
      wave_.rays.paths[i] = i;
      const SampleKey key = key_of_place(settings_, place, bucket_.first_sample, point.group);
      wave_.paths[i] = {vec3(1.0f), 0.0f, vec3(0.0f), vec3(0.0f), vec3(0.0f), key, 0, medium_air};
    }
    charge(PathStage::Generate);
    uint32_t num_rays = n;
    for (uint32_t depth = 1; num_rays != 0; ++depth) {
      if (depth != 1) trace_closest(wave_.rays.rays, wave_.hits, num_rays);
      for_each(PathStage::Shade, num_rays, ShadePathVertex{scene_.scene, settings_, wave_, depth});
      const uint32_t num_shadows = compact_shadows(wave_.shadows, num_rays, wave_.shadow_queue);
      find_occluded(num_shadows);
      for_each(PathStage::Shadow, num_shadows, AddDirectLight{wave_});
      num_rays = compact_rays(wave_.next_rays, num_rays, wave_.rays);
    }
    for (uint32_t i = 0; i < n; ++i) points_.points[first + i].light = wave_.paths[i].radiance;
  }

  // Direct light of all lights without extent.
  void look_at_lights(uint32_t first, uint32_t n)
  {
    if (settings_.max_depth < 2) return;
    LitPoint lit[lit_points];
    for (uint32_t i = 0; i < n; ++i)
      lit[i] = lit_point(scene_, settings_.camera, place_of(points_.points[first + i].slot));
    charge(PathStage::Generate);
    const SceneView &scene = scene_.scene;
    for (uint32_t l = 0; l < scene.num_tree_lights + scene.num_distant_lights; ++l) {
      uint32_t num_rays = 0;
      const ShadowQueue &queue = wave_.shadow_queue;
      for (uint32_t i = 0; i < n; ++i) {
        if (!make_shadow_ray(scene.lights[l], lit[i], queue.rays[num_rays], queue.contributions[num_rays]))
          continue;
        queue.paths[num_rays++] = i;
      }
      charge(PathStage::Shade);
      find_occluded(num_rays);
      for (uint32_t i = 0; i < num_rays; ++i) {
        if (!wave_.occluded[i])
          points_.points[first + wave_.shadow_queue.paths[i]].light += wave_.shadow_queue.contributions[i];
      }
      charge(PathStage::Shadow);
    }
  }

  // Features of a sample are those of its point, but for the depth, which is its own.
  void add_samples(const FilmView &film)
  {
    const bool has_features = film.features != nullptr || film.first_hits != nullptr;
    const PathUnit unit{bucket_.x0, bucket_.y0, bucket_.x1, bucket_.y1, bucket_.first_sample, 0};
    for (uint32_t k = 0; k < num_paths(); ++k) {
      const PathSample s = path_sample(unit, k);
      const uint32_t slot = memory_.slot[k];
      const bool covered = memory_.root[slot] != invalid_id;
      Vec3f light = vec3(0.0f);
      if (covered) light = points_.points[points_.point_of[slot]].light;
      else if (scene_.scene.environment.is_present)
        light = environment_radiance(scene_.scene, ray_of_sample(settings_.camera, memory_, s, k).direction);
      light *= memory_.weight[k];
      if (has_features) {
        const Ray ray = ray_of_sample(settings_.camera, memory_, s, k);
        const Hit hit = hit_of_sample(scene_, settings_.camera, ray, memory_.root[slot], memory_.z[slot],
                                      {memory_.u[slot], memory_.v[slot]});
        EyeFeatures{scene_.scene, settings_, film}(s.sample, s.local, ray, hit,
                                                   [](int64_t &sum, int64_t term) { sum += term; });
      }
      add_sample(film.pixels[s.local], s.sample, light, covered);
      const float largest = max_component(light);
      if (largest > counters_.largest_sample) counters_.largest_sample = largest;
    }
  }

  const ReyesScene &scene_;
  const PathSettings &settings_;
  const ReyesSettings &reyes_;
  const ReyesBucket &bucket_;
  const ReyesMemory &memory_;
  const PointMemory &points_;
  const PathWave &wave_;
  const uint32_t wave_capacity_;
  uint32_t num_points_ = 0;
};

}  // namespace
GPURT_FUNCTIONS_END
}  // namespace gpurt
