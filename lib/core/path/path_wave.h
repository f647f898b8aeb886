// Memory and stages of a wave of paths: what happens at every step of every path, whatever runs it.
//
// A wave holds up to `capacity` paths; a path makes at most one next ray and one shadow ray a step, so the queues cannot
// overflow. Stages are named after the talk's kernels.
#pragma once

#include "core/path/bsdf.h"
#include "core/path/camera.h"
#include "core/path/film_view.h"
#include "core/path/lights.h"
#include "core/random/sobol.h"

namespace gpurt {

// What a path carries from vertex to vertex.
struct PathState {
  Vec3f throughput;
  float pdf;       // of the last direction; 0: it had no alternative (the camera, mirrors, glass)
  Vec3f position;  // of the last vertex, for the density of lights seen from it
  Vec3f normal;
  Vec3f radiance;
  SampleKey key;
  uint32_t covered;
};

struct RayQueue {
  Ray *rays;
  uint32_t *paths;  // which path a ray belongs to
};

struct ShadowQueue {
  Ray *rays;
  uint32_t *paths;
  Vec3f *contributions;  // radiance that arrives if nothing is in the way
};

// Pixels [x0, x1) x [y0, y1) with samples first_sample, first_sample + 1, ...: path i takes pixel i % pixels and sample
// i / pixels of those, counted from `first_path` on.
struct PathUnit {
  uint32_t x0, y0, x1, y1;
  uint64_t first_sample;
  uint64_t first_path;
};

struct PathWave {
  PathState *paths;
  RayQueue rays;             // traced next
  Hit *hits;                 // of rays
  RayQueue next_rays;        // written by a step, one slot a ray; tmax < 0: no ray
  ShadowQueue shadows;       // likewise
  ShadowQueue shadow_queue;  // the shadow rays that are there
  uint8_t *occluded;         // of shadow_queue
};

// A ray that leaves a surface starts beyond its own surface, or on it where coordinates are exact, as on the plane y = 0:
// t = 0 is no hit. A ray to a lamp ends short of t = 1, which is the lamp.
constexpr float leaving_tmin = 0x1p-149f;
constexpr float shadow_tmax = 1.0f - 0x1p-24f;

GPURT_FUNCTIONS_BEGIN

// Pairs of sample dimensions: one for the pixel, then these for every step. `choice` picks the light, or what glass
// does, and decides the roulette.
enum PathDimension : uint32_t {
  dim_pixel = 0,
  dim_choice = 1,
  dim_light = 2,
  dim_bsdf = 3,
  dims_per_step = 3
};

struct PathSample {
  uint32_t x, y;   // pixel
  uint32_t local;  // pixel of the unit
  uint64_t sample;
};

GPURT_INLINE PathSample path_sample(const PathUnit &unit, uint32_t i)
{
  const uint32_t width = unit.x1 - unit.x0;
  const uint64_t num_pixels = uint64_t(width) * (unit.y1 - unit.y0);
  const uint64_t k = unit.first_path + i;
  const uint64_t turn = k / num_pixels;
  const uint32_t local = uint32_t(k - turn * num_pixels);
  const uint32_t row = local / width;
  return {unit.x0 + (local - row * width), unit.y0 + row, local, unit.first_sample + turn};
}

struct GenerateCameraRays {
  PathSettings settings;
  PathUnit unit;
  PathWave wave;

  GPURT_HD void operator()(uint32_t i) const
  {
    const PathSample s = path_sample(unit, i);
    const SampleKey key = sample_key(settings.seed, settings.frame_index, s.x, s.y, s.sample);
    const Vec2f u = sample_2d(key, dim_pixel);
    float depth_per_t;
    wave.rays.rays[i] = camera_ray(settings.camera, float(s.x) + u.x, float(s.y) + u.y, depth_per_t);
    wave.rays.paths[i] = i;
    wave.paths[i] = {vec3(1.0f), 0.0f, vec3(0.0f), vec3(0.0f), vec3(0.0f), key, 0};
  }
};

// Puts the rays that a vertex makes into its slots of the wave.
struct VertexSlots {
  const PathWave &wave;
  uint32_t i;

  GPURT_HD void shadow(const Ray &ray, Vec3f contribution) const
  {
    wave.shadows.rays[i] = ray;
    wave.shadows.contributions[i] = contribution;
  }
  GPURT_HD void next(const Ray &ray) const { wave.next_rays.rays[i] = ray; }
};

// The talk's material and light kernel: radiance that is found here, the shadow ray, the next ray.
struct ShadePathVertex {
  SceneView scene;
  PathSettings settings;
  PathWave wave;
  uint32_t depth;  // of the ray that was traced: 1 is the eye ray

  GPURT_HD void operator()(uint32_t i) const
  {
    const uint32_t path_index = wave.rays.paths[i];
    wave.next_rays.rays[i].tmax = -1.0f;
    wave.shadows.rays[i].tmax = -1.0f;
    wave.next_rays.paths[i] = path_index;
    wave.shadows.paths[i] = path_index;
    shade<true>(i, path_index, VertexSlots{wave, i});
  }

  // Hands the rays that hit i makes to sink.shadow(ray, contribution) and sink.next(ray), each at most once. The path is
  // written back if `Stores`; else all that is kept is what the sink keeps.
  template <bool Stores, class Sink>
  GPURT_HD void shade(uint32_t i, uint32_t path_index, const Sink &sink) const
  {
    PathState path = wave.paths[path_index];
    const Ray ray = wave.rays.rays[i];
    const Hit hit = wave.hits[i];
    if (hit.triangle == invalid_id) {
      if (Stores && scene.environment.is_present) {
        const Vec3f w = depth == 1 ? ray.direction : normalize(ray.direction);
        float weight = 1.0f;
        if (path.pdf > 0.0f) {
          weight = power_heuristic(path.pdf, environment_light_pdf(scene, path.position, path.normal, w));
        }
        wave.paths[path_index].radiance =
            path.radiance + path.throughput * environment_radiance(scene, w) * weight;
      }
      return;
    }

    const SurfaceHit surface = surface_at(scene, hit);
    const Material &material = scene.materials[surface.material];
    const Vec3f wo_world = -normalize(ray.direction);
    const bool front = dot(surface.geometric_normal, wo_world) > 0.0f;

    // Lamps that the ray met, weighed against having drawn them at the last vertex.
    if (Stores && surface.light != invalid_id && (front || material.two_sided_emission)) {
      float weight = 1.0f;
      if (path.pdf > 0.0f) {
        weight = power_heuristic(
            path.pdf, lamp_pdf(scene, path.position, path.normal, surface.light, surface.position, wo_world));
      }
      path.radiance += path.throughput * material.emission * weight;
    }

    // The shading frame. Everything but glass is the same from both sides.
    Vec3f normal = surface.shading_normal;
    const bool behind = dot(normal, wo_world) < 0.0f;
    if (behind) normal = -normal;
    Bsdf bsdf{material.type, base_color(scene, material, surface.uv), material.alpha_ggx, material.ior};
    if (material.type == MaterialType::Glass && behind) bsdf.eta = 1.0f / material.ior;
    if (depth == 1) path.covered = 1;

    if (depth < settings.max_depth) {
      Vec3f s, t;
      make_frame(normal, s, t);
      const Vec3f wo{dot(wo_world, s), dot(wo_world, t), dot(wo_world, normal)};
      const uint32_t pair = (depth - 1) * dims_per_step;
      const Vec2f choice = sample_2d(path.key, pair + dim_choice);
      if (!is_delta(bsdf)) {
        direct_light(sink, surface, bsdf, normal, s, t, wo, choice.x, sample_2d(path.key, pair + dim_light),
                     path);
      }
      continue_path(sink, surface, bsdf, normal, s, t, wo, choice, sample_2d(path.key, pair + dim_bsdf),
                    path);
    }
    if (Stores) wave.paths[path_index] = path;
  }

 private:
  template <class Sink>
  GPURT_HD void direct_light(const Sink &sink, const SurfaceHit &surface, const Bsdf &bsdf, Vec3f normal,
                             Vec3f s, Vec3f t, Vec3f wo, float u0, Vec2f u1, const PathState &path) const
  {
    LightSample light;
    if (!sample_light(scene, surface.position, normal, u0, u1, light)) return;
    const Vec3f wi{dot(light.wi, s), dot(light.wi, t), dot(light.wi, normal)};
    float bsdf_pdf;
    const Vec3f f = eval_bsdf(bsdf, wo, wi, bsdf_pdf);
    if (!(max_component(f) > 0.0f)) return;
    const float weight = light.is_delta ? 1.0f : power_heuristic(light.pdf, bsdf_pdf);
    Ray ray;
    ray.origin = offset_origin(surface.position, surface.position_error, surface.geometric_normal, light.wi);
    ray.tmin = leaving_tmin;
    ray.direction = light.at_infinity ? light.target : light.target - ray.origin;
    ray.tmax = light.at_infinity ? infinity : shadow_tmax;
    sink.shadow(ray, path.throughput * f * light.radiance * (weight / light.pdf));
  }

  template <class Sink>
  GPURT_HD void continue_path(const Sink &sink, const SurfaceHit &surface, const Bsdf &bsdf, Vec3f normal,
                              Vec3f s, Vec3f t, Vec3f wo, Vec2f choice, Vec2f u, PathState &path) const
  {
    BsdfSample next;
    if (!sample_bsdf(bsdf, wo, choice.x, u, next)) return;
    path.throughput *= next.weight;
    const float largest = max_component(path.throughput);
    if (!(largest > 0.0f)) return;
    // Russian roulette: a path goes on with twice the probability of its throughput, so that survivors carry at least a
    // half. The factor is where time x error is least, of 0.7 to 10, on Cornell boxes, a classroom and Veach's plates.
    // The square that glass puts on radiance inside is left out: it is given back on the way out.
    if (depth >= 2 && !is_delta(bsdf)) {
      const float survival = min(2.0f * largest, 1.0f);
      if (choice.y >= survival) return;
      path.throughput *= 1.0f / survival;
    }
    const Vec3f wi = s * next.wi.x + t * next.wi.y + normal * next.wi.z;
    path.pdf = next.pdf;
    path.position = surface.position;
    path.normal = normal;
    sink.next({offset_origin(surface.position, surface.position_error, surface.geometric_normal, wi),
               leaving_tmin, wi, infinity});
  }
};

// Adds what the eye rays met to the film's optional arrays: one call a pixel, right after the first trace, while ray k
// still belongs to path k.
struct AddFeatures {
  SceneView scene;
  PathSettings settings;
  PathUnit unit;
  PathWave wave;
  FilmView film;
  uint32_t num_paths;

  GPURT_HD void operator()(uint32_t i) const
  {
    const uint32_t num_pixels = film.width * film.height;
    for (uint32_t k = i; k < num_paths; k += num_pixels) {
      const PathSample sample = path_sample(unit, k);
      const Hit hit = wave.hits[k];
      const Ray ray = wave.rays.rays[k];
      const bool is_first = film.first_hits != nullptr && sample.sample == 0;
      if (is_first)
        film.first_hits[sample.local] = {infinity, vec3(0.0f), invalid_id, invalid_id, invalid_id, 1};
      if (hit.triangle == invalid_id) continue;
      const SurfaceHit surface = surface_at(scene, hit);
      if (film.features != nullptr) add_features(film.features[sample.local], surface, ray);
      if (is_first) set_first_hit(film.first_hits[sample.local], surface, hit, ray);
    }
  }

 private:
  GPURT_HD void add_features(PixelFeatures &f, const SurfaceHit &surface, const Ray &ray) const
  {
    const Vec3f n =
        dot(surface.shading_normal, ray.direction) > 0.0f ? -surface.shading_normal : surface.shading_normal;
    const Vec3f albedo = base_color(scene, scene.materials[surface.material], surface.uv);
    f.normal[0] += feature_from(n.x);
    f.normal[1] += feature_from(n.y);
    f.normal[2] += feature_from(n.z);
    f.albedo[0] += feature_from(albedo.x);
    f.albedo[1] += feature_from(albedo.y);
    f.albedo[2] += feature_from(albedo.z);
  }

  GPURT_HD void set_first_hit(PixelFirstHit &first, const SurfaceHit &surface, const Hit &hit,
                              const Ray &ray) const
  {
    const Segment &segment = scene.segments[scene.triangle_segment[hit.triangle]];
    const Transform &m = settings.camera.camera_to_world;
    const Vec3f forward{-m.m[0][2], -m.m[1][2], -m.m[2][2]};
    first.depth = hit.t * dot(ray.direction, forward);
    first.position = surface.position;
    first.primitive = hit.triangle - segment.first_triangle;
    first.geometry = segment.geometry;
    first.instance =
        hit.placement == invalid_id ? segment.instance : scene.placements[hit.placement].instance;
  }
};

// Adds direct light where the shadow ray reached the lamp.
struct AddDirectLight {
  PathWave wave;

  GPURT_HD void operator()(uint32_t i) const
  {
    if (!wave.occluded[i])
      wave.paths[wave.shadow_queue.paths[i]].radiance += wave.shadow_queue.contributions[i];
  }
};

// Adds the wave's finished paths to the film: one call a pixel, which takes all of the pixel's paths, so that no two
// calls touch the same sums.
struct AddSamples {
  PathUnit unit;
  PathWave wave;
  FilmView film;
  uint32_t num_paths;

  GPURT_HD void operator()(uint32_t i) const
  {
    const uint32_t num_pixels = film.width * film.height;
    for (uint32_t k = i; k < num_paths; k += num_pixels) {
      const PathSample sample = path_sample(unit, k);
      add_sample(film.pixels[sample.local], sample.sample, wave.paths[k].radiance,
                 wave.paths[k].covered != 0);
    }
  }
};

GPURT_FUNCTIONS_END
}  // namespace gpurt
