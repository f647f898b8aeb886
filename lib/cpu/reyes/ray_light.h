// Micropolygons' own light where it takes rays, where not all that is seen is a micropolygon, or where more than light is
// asked for.
//
// Samples keep the micropolygon that they see, by its patch and the middle of its (u, v): the light of each is then found
// once, however many samples see it, and of none that nobody sees. The point is that of the patch's tessellation, from
// which rays leave without meeting their own surface. Of triangles of meshes, which are not diced, every sample is a point of
// its own.
//
// Points, spots and distant lights are all looked at, one shadow ray each: without noise. Where there are lamps or an
// environment to be found, a path of depth 2 at most is traced from each point, by path tracing's stages, with random
// numbers that are a function of the patch, the place on it and the samples for which it is: for every samples_per_path even
// samples one, and one for as many odd ones, so that the film's halves stay independent and more samples mean less noise.
// Source: Burns, Fatahalian and Mark 2010, lazy shading of shared points after visibility.
#pragma once

#include "core/path/path_wave.h"
#include "core/reyes/map.h"
#include "core/reyes/shade.h"
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
        wave_capacity_(min(wave_capacity, bucket.has_found_light ? wave_capacity : lit_points)),
        film_seed_(mix_bits(settings.seed + 0x9e3779b97f4a7c15u * (uint64_t(settings.frame_index) + 1)))
  {
    is_first_trace_ = false;  // no ray comes from the camera
  }

  void run(const FilmView &film, ReyesKernelCounters &counters)
  {
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

  // Which samples share a point's light, counted from the bucket's first ones.
  uint32_t group_of(uint64_t sample) const
  {
    if (!bucket_.has_found_light) return 0;
    const uint64_t first = bucket_.first_sample / (2 * samples_per_path);
    return uint32_t(sample / (2 * samples_per_path) - first) << 1 | uint32_t(sample & 1);
  }

  bool is_same(const ShadedPoint &p, uint32_t slot, uint32_t group) const
  {
    return p.group == group && memory_.root[p.slot] == memory_.root[slot] &&
           float_bits(memory_.u[p.slot]) == float_bits(memory_.u[slot]) &&
           float_bits(memory_.v[p.slot]) == float_bits(memory_.v[slot]);
  }

  uint64_t hash_of(uint32_t slot) const
  {
    return mix_bits((uint64_t(memory_.root[slot]) + 1) * 0x9e3779b97f4a7c15u +
                    (uint64_t(float_bits(memory_.u[slot])) << 32 | float_bits(memory_.v[slot])));
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
      const uint32_t group = group_of(path_sample(unit, k).sample);
      uint32_t at = uint32_t(hash_of(slot) + group * 0x9e3779b1u) & mask;
      while (points_.table[at] != invalid_id && !is_same(points_.points[points_.table[at]], slot, group))
        at = (at + 1) & mask;
      if (points_.table[at] == invalid_id) {
        points_.points[num_points_] = {slot, group, vec3(0.0f)};
        points_.table[at] = num_points_++;
      }
      points_.point_of[slot] = points_.table[at];
    }
  }

  // The ray from the eye to a point, and what it meets there.
  Hit hit_of_point(const ShadedPoint &point, Ray &ray) const
  {
    const uint32_t slot = point.slot;
    Hit hit = hit_of_root(scene_, memory_.root[slot], memory_.u[slot], memory_.v[slot], 0.0f);
    const Transform &m = settings_.camera.camera_to_world;
    const Vec3f eye{m.m[0][3], m.m[1][3], m.m[2][3]};
    const Vec3f to_point = surface_at(scene_.scene, hit).position - eye;
    hit.t = length(to_point);
    ray = {eye, 0.0f, to_point * (1.0f / hit.t), infinity};
    return hit;
  }

  SampleKey key_of_point(const ShadedPoint &point) const
  {
    const uint64_t index = bucket_.first_sample / (2 * samples_per_path) + uint64_t(point.group >> 1);
    const uint64_t sequence = hash_of(point.slot) ^ ((index >> 32) << 1 | (point.group & 1));
    return {mix_bits(film_seed_ ^ sequence), reverse_bits(uint32_t(index))};
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
      wave_.hits[i] = hit_of_point(point, wave_.rays.rays[i]);
      wave_.rays.paths[i] = i;
      wave_.paths[i] = {vec3(1.0f), 0.0f, vec3(0.0f), vec3(0.0f), vec3(0.0f), key_of_point(point), 0};
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

  // A point with what its light depends on.
  struct LitPoint {
    SurfaceHit surface;
    Bsdf bsdf;
    Vec3f normal, s, t, wo;
  };

  // Direct light of all lights without extent.
  void look_at_lights(uint32_t first, uint32_t n)
  {
    if (settings_.max_depth < 2) return;
    LitPoint lit[lit_points];
    for (uint32_t i = 0; i < n; ++i) {
      Ray ray;
      const Hit hit = hit_of_point(points_.points[first + i], ray);
      LitPoint &p = lit[i];
      p.surface = surface_at(scene_.scene, hit);
      const Material &material = scene_.scene.materials[p.surface.material];
      const Vec3f wo_world = -ray.direction;
      p.normal = p.surface.shading_normal;
      if (dot(p.normal, wo_world) < 0.0f) p.normal = -p.normal;
      p.bsdf = {material.type, base_color(scene_.scene, material, p.surface.uv), material.alpha_ggx,
                material.ior};
      make_frame(p.normal, p.s, p.t);
      p.wo = {dot(wo_world, p.s), dot(wo_world, p.t), dot(wo_world, p.normal)};
    }
    charge(PathStage::Generate);
    const SceneView &scene = scene_.scene;
    for (uint32_t l = 0; l < scene.num_tree_lights + scene.num_distant_lights; ++l) {
      uint32_t num_rays = 0;
      for (uint32_t i = 0; i < n; ++i) num_rays += make_shadow_ray(scene.lights[l], lit[i], i, num_rays);
      charge(PathStage::Shade);
      find_occluded(num_rays);
      for (uint32_t i = 0; i < num_rays; ++i) {
        if (!wave_.occluded[i])
          points_.points[first + wave_.shadow_queue.paths[i]].light += wave_.shadow_queue.contributions[i];
      }
      charge(PathStage::Shadow);
    }
  }

  // The ray of point i to a light without extent, in a slot of the queue; 0: none is needed.
  uint32_t make_shadow_ray(const Light &light, const LitPoint &p, uint32_t i, uint32_t slot) const
  {
    if (is_delta(p.bsdf)) return 0;
    const bool is_distant = light.type == LightType::Distant;
    Vec3f wi_world = -light.direction, radiance = light.color;
    if (!is_distant) {
      const Vec3f to_light = light.position - p.surface.position;
      const float distance2 = length2(to_light);
      if (!(distance2 > 0.0f)) return 0;
      wi_world = to_light * (1.0f / sqrt(distance2));
      radiance *= 1.0f / distance2;
      if (light.type == LightType::Spot) radiance *= spot_falloff(light, -wi_world);
    }
    float pdf;
    const Vec3f wi{dot(wi_world, p.s), dot(wi_world, p.t), dot(wi_world, p.normal)};
    const Vec3f contribution = eval_bsdf(p.bsdf, p.wo, wi, pdf) * radiance;
    if (!(max_component(contribution) > 0.0f)) return 0;
    Ray &ray = wave_.shadow_queue.rays[slot];
    ray.origin =
        offset_origin(p.surface.position, p.surface.position_error, p.surface.geometric_normal, wi_world);
    ray.tmin = leaving_tmin;
    ray.direction = is_distant ? wi_world : light.position - ray.origin;
    ray.tmax = is_distant ? infinity : shadow_tmax;
    wave_.shadow_queue.contributions[slot] = contribution;
    wave_.shadow_queue.paths[slot] = i;
    return 1;
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
  const uint64_t film_seed_;
  uint32_t num_points_ = 0;
};

}  // namespace
GPURT_FUNCTIONS_END
}  // namespace gpurt
