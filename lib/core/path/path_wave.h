// Memory and stages of a wave of paths: what happens at every step of every path, whatever runs it.
//
// A wave holds up to `capacity` paths; a path makes at most one next ray and one shadow ray a step, so the queues cannot
// overflow. Stages are named after the talk's kernels.
#pragma once

#include "core/path/film_view.h"
#include "core/path/path_vertex.h"

namespace gpurt {

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
// i / pixels of those, counted from `first_path` on. Pixels go by tiles of 8 x 4 where that comes out even: neighbours in
// both directions, rather than in a row alone, go the same way through a tree.
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

GPURT_FUNCTIONS_BEGIN

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
  const uint32_t pixel = uint32_t(k - turn * num_pixels);
  uint32_t x, y;
  if (width % 8 == 0 && (unit.y1 - unit.y0) % 4 == 0) {
    const uint32_t tile = pixel / 32, tiles_per_row = width / 8;
    const uint32_t tile_y = tile / tiles_per_row, tile_x = tile - tile_y * tiles_per_row;
    x = tile_x * 8 + pixel % 8;
    y = tile_y * 4 + pixel / 8 % 4;
  } else {
    y = pixel / width;
    x = pixel - y * width;
  }
  return {unit.x0 + x, unit.y0 + y, y * width + x, unit.first_sample + turn};
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
    wave.paths[i] = {vec3(1.0f), 0.0f, vec3(0.0f), vec3(0.0f), vec3(0.0f), key, 0, medium_air};
  }
};

// Puts the rays that a vertex makes into its slots of the wave.
struct VertexSlots {
  const PathWave &wave;
  uint32_t i;

  GPURT_HD void shadow(const Ray &ray, Vec3f contribution, uint32_t) const
  {
    wave.shadows.rays[i] = ray;
    wave.shadows.contributions[i] = contribution;
  }
  GPURT_HD void next(const Ray &ray) const { wave.next_rays.rays[i] = ray; }
};

template <bool MayAbsorb>
struct BasicShadePathVertex {
  SceneView scene;
  PathSettings settings;
  PathWave wave;
  uint32_t depth;  // of the rays that were traced

  GPURT_HD void operator()(uint32_t i) const
  {
    const uint32_t path_index = wave.rays.paths[i];
    wave.next_rays.rays[i].tmax = -1.0f;
    wave.shadows.rays[i].tmax = -1.0f;
    wave.next_rays.paths[i] = path_index;
    wave.shadows.paths[i] = path_index;
    wave.paths[path_index] = shade(i, path_index, VertexSlots{wave, i});
  }

  // Hands the rays that hit i makes to the sink and returns what becomes of the path.
  template <class Sink>
  GPURT_HD PathState shade(uint32_t i, uint32_t path_index, const Sink &sink) const
  {
    PathState path = wave.paths[path_index];
    BasicPathVertex<MayAbsorb>{scene, settings, depth}.shade(wave.rays.rays[i], wave.hits[i], path, sink);
    return path;
  }
};
using ShadePathVertex = BasicShadePathVertex<true>;

// What an eye ray met, for the film's optional arrays. `add(sum, term)` adds to a sum of the pixel's.
struct EyeFeatures {
  SceneView scene;
  PathSettings settings;
  FilmView film;

  template <class Add>
  GPURT_HD void operator()(uint64_t sample, uint32_t pixel, const Ray &ray, const Hit &hit, Add &&add) const
  {
    const bool is_first = film.first_hits != nullptr && sample == 0;
    if (is_first) film.first_hits[pixel] = {infinity, vec3(0.0f), invalid_id, invalid_id, invalid_id, 1};
    if (hit.triangle == invalid_id) return;
    const SurfaceHit surface = surface_at(scene, hit);
    if (film.features != nullptr) add_features(film.features[pixel], surface, ray, add);
    if (is_first) set_first_hit(film.first_hits[pixel], surface, hit, ray);
  }

 private:
  template <class Add>
  GPURT_HD void add_features(PixelFeatures &f, const SurfaceHit &surface, const Ray &ray, Add &&add) const
  {
    const Vec3f n =
        dot(surface.shading_normal, ray.direction) > 0.0f ? -surface.shading_normal : surface.shading_normal;
    const Vec3f albedo = base_color(scene, scene.materials[surface.material], surface.uv);
    add(f.normal[0], feature_from(n.x));
    add(f.normal[1], feature_from(n.y));
    add(f.normal[2], feature_from(n.z));
    add(f.albedo[0], feature_from(albedo.x));
    add(f.albedo[1], feature_from(albedo.y));
    add(f.albedo[2], feature_from(albedo.z));
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

// Adds what the eye rays met: one call a pixel, right after the first trace, while ray k still belongs to path k.
struct AddFeatures {
  EyeFeatures features;
  PathUnit unit;
  PathWave wave;
  uint32_t num_paths;

  GPURT_HD void operator()(uint32_t i) const
  {
    const uint32_t num_pixels = features.film.width * features.film.height;
    for (uint32_t k = i; k < num_paths; k += num_pixels) {
      const PathSample sample = path_sample(unit, k);
      features(sample.sample, sample.local, wave.rays.rays[k], wave.hits[k],
               [](int64_t &sum, int64_t term) { sum += term; });
    }
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
