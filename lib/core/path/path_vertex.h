// A vertex of a path: the radiance that is found there, the shadow ray, the next ray.
#pragma once

#include "core/path/bsdf.h"
#include "core/path/camera.h"
#include "core/path/lights.h"
#include "core/path/medium.h"
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
  uint32_t medium;  // of the ray that is traced next (core/path/medium.h), where glass absorbs
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

// The talk's material and light kernel, of one hit. Without MayAbsorb for scenes whose glass does not: absorption costs
// kernels registers.
template <bool MayAbsorb>
struct BasicPathVertex {
  const SceneView &scene;
  const PathSettings &settings;
  uint32_t depth;  // of the ray that was traced: 1 is the eye ray

  // Adds emission to the path's radiance, and hands the rays that the hit makes to sink.shadow(ray, contribution,
  // target) and sink.next(ray), each at most once; `target` is the lamp's triangle that a shadow ray ends at, invalid_id for
  // other lights.
  template <class Sink>
  GPURT_HD void shade(const Ray &ray, const Hit &hit, PathState &path, const Sink &sink) const
  {
    if (hit.triangle == invalid_id) {
      add_environment(ray, path);
      return;
    }
    const SurfaceHit surface = surface_at(scene, hit);
    const Material &material = scene.materials[surface.material];
    const Vec3f wo_world = -normalize(ray.direction);
    absorb(ray, hit, surface, material, wo_world, path);
    add_lamp(surface, material, wo_world, path);

    // The shading frame. Everything but glass is the same from both sides.
    Vec3f normal = surface.shading_normal;
    const bool behind = dot(normal, wo_world) < 0.0f;
    if (behind) normal = -normal;
    Bsdf bsdf{material.type, base_color(scene, material, surface.uv), material.alpha_ggx, material.ior};
    if (material.type == MaterialType::Glass && behind) bsdf.eta = 1.0f / material.ior;
    if (depth == 1) path.covered = 1;
    if (depth >= settings.max_depth) return;

    Vec3f s, t;
    make_frame(normal, s, t);
    const Vec3f wo{dot(wo_world, s), dot(wo_world, t), dot(wo_world, normal)};
    const uint32_t pair = (depth - 1) * dims_per_step;
    const Vec2f choice = sample_2d(path.key, pair + dim_choice);
    if (!is_delta(bsdf)) {
      direct_light(sink, surface, bsdf, normal, s, t, wo, choice.x, sample_2d(path.key, pair + dim_light),
                   path);
    }
    continue_path(sink, surface, bsdf, normal, s, t, wo, choice, sample_2d(path.key, pair + dim_bsdf), path);
  }

  // The parts, for pipelines whose paths end elsewhere.
  GPURT_HD void add_environment(const Ray &ray, PathState &path) const
  {
    if (!scene.environment.is_present) return;
    if (absorbs()) path.throughput *= transmittance(scene, path.medium, infinity);
    const Vec3f w = depth == 1 ? ray.direction : normalize(ray.direction);
    float weight = 1.0f;
    if (path.pdf > 0.0f) {
      weight = power_heuristic(path.pdf, environment_light_pdf(scene, path.position, path.normal, w));
    }
    path.radiance = path.radiance + path.throughput * environment_radiance(scene, w) * weight;
  }

  GPURT_HD bool absorbs() const { return MayAbsorb && scene.has_absorption != 0; }

  // What the ray's way to the surface leaves of the path, and in which medium it came there.
  GPURT_HD void absorb(const Ray &ray, const Hit &hit, const SurfaceHit &surface, const Material &material,
                       Vec3f wo_world, PathState &path) const
  {
    if (!absorbs()) return;
    path.medium = medium_before(path.medium, surface, material, wo_world);
    path.throughput *= transmittance(scene, path.medium, hit.t * length(ray.direction));
  }

  // Lamps that the ray met, weighed against having drawn them at the last vertex.
  GPURT_HD void add_lamp(const SurfaceHit &surface, const Material &material, Vec3f wo_world,
                         PathState &path) const
  {
    const bool front = dot(surface.geometric_normal, wo_world) > 0.0f;
    if (surface.light == invalid_id || !(front || material.two_sided_emission)) return;
    float weight = 1.0f;
    if (path.pdf > 0.0f) {
      weight = power_heuristic(
          path.pdf, lamp_pdf(scene, path.position, path.normal, surface.light, surface.position, wo_world));
    }
    path.radiance += path.throughput * lamp_radiance(scene, material, surface.uv) * weight;
  }

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
    Vec3f contribution = path.throughput * f * light.radiance * (weight / light.pdf);
    if (absorbs()) {
      contribution *= transmittance(scene, path.medium, light.at_infinity ? infinity : length(ray.direction));
    }
    sink.shadow(ray, contribution, light.triangle);
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
    if (absorbs()) path.medium = medium_after(path.medium, surface, scene.materials[surface.material], wi);
    path.pdf = next.pdf;
    path.position = surface.position;
    path.normal = normal;
    sink.next({offset_origin(surface.position, surface.position_error, surface.geometric_normal, wi),
               leaving_tmin, wi, infinity});
  }
};
using PathVertex = BasicPathVertex<true>;

GPURT_FUNCTIONS_END
}  // namespace gpurt
