// The eye pass: paths from the camera through mirrors, glass and smooth metal to the first surface that gathers photons.
//
// Along the way light is what path tracing finds: lamps that are met, weighed against next-event estimation. At the last
// vertex direct light is estimated, one ray goes on to meet lamps that next-event estimation finds badly, and photons
// stand for all that was scattered once or more.
#pragma once

#include "core/photon/photon_wave.h"

namespace gpurt {

// Where a path gathers.
struct VisiblePoint {
  Vec3f position;
  uint32_t normal_code;  // of the surface's own normal, on the viewer's side
  Vec3f geometric_normal;
  uint32_t depth;        // of the vertex; 0: the path gathers nowhere
  Vec3f weight;          // Lambert: throughput times reflectance / pi; Metal: throughput
  float alpha_ggx;       // 0: Lambert
  Vec3f shading_normal;  // Metal alone
  float inverse_area;    // 1 over the share of the disc that lies on a surface: its estimate
  Vec3f wo;              // Metal alone
  Vec3f color;           // Metal alone: F0
  float clearance;  // distance to the rim of the triangle that was hit; infinity: the disc has been measured
  float radius;     // of the gather, where pixels have radii of their own
  int32_t missed;   // blur_weight of the trials that met no surface, summed up in units of 2^-20
};

// Bits of PathState::covered.
constexpr uint32_t path_covered = 1, path_gathers = 2;

GPURT_FUNCTIONS_BEGIN

// A vertex of an eye path.
template <bool MayAbsorb>
struct BasicEyeVertex {
  const SceneView &scene;
  const PathSettings &settings;
  uint32_t depth;  // of the ray that was traced: 1 is the eye ray

  // As PathVertex::shade; `point` is set where the path gathers, and its depth cleared at the first vertex.
  template <class Sink>
  GPURT_HD void shade(const Ray &ray, const Hit &hit, PathState &path, VisiblePoint &point,
                      const Sink &sink) const
  {
    if (depth == 1) point.depth = 0;
    const BasicPathVertex<MayAbsorb> vertex{scene, settings, depth};
    if (hit.triangle == invalid_id) {
      vertex.add_environment(ray, path);
      return;
    }
    const SurfaceHit surface = surface_at(scene, hit);
    const Material &material = scene.materials[surface.material];
    const Vec3f wo_world = -normalize(ray.direction);
    vertex.absorb(ray, hit, surface, material, wo_world, path);
    vertex.add_lamp(surface, material, wo_world, path);
    if (depth == 1) path.covered = path_covered;
    if (path.covered & path_gathers || depth >= settings.max_depth) return;

    Vec3f normal = surface.shading_normal;
    const bool behind = dot(normal, wo_world) < 0.0f;
    if (behind) normal = -normal;
    const Bsdf bsdf = bsdf_at(scene, material, surface.uv, behind);
    Vec3f s, t;
    make_frame(normal, s, t);
    const Vec3f wo{dot(wo_world, s), dot(wo_world, t), dot(wo_world, normal)};
    const uint32_t pair = (depth - 1) * dims_per_step;
    const Vec2f choice = sample_2d(path.key, pair + dim_choice);
    if (!is_delta(bsdf)) {
      vertex.direct_light(sink, surface, bsdf, normal, s, t, wo, choice.x,
                          sample_2d(path.key, pair + dim_light), path);
    }
    if (receives_photons(bsdf)) {
      // The shortest way of a photon: lamp, another surface, here.
      if (depth + 2 <= settings.max_depth) set_point(point, hit, surface, bsdf, normal, wo_world, path);
      path.covered |= path_gathers;
    }
    vertex.continue_path(sink, surface, bsdf, normal, s, t, wo, choice, sample_2d(path.key, pair + dim_bsdf),
                         path);
  }

 private:
  GPURT_HD void set_point(VisiblePoint &point, const Hit &hit, const SurfaceHit &surface, const Bsdf &bsdf,
                          Vec3f normal, Vec3f wo_world, const PathState &path) const
  {
    point.position = surface.position;
    const bool front = dot(surface.geometric_normal, wo_world) > 0.0f;
    point.geometric_normal = front ? surface.geometric_normal : -surface.geometric_normal;
    point.normal_code = encode_normal(point.geometric_normal);
    point.depth = depth;
    point.inverse_area = 1.0f;
    point.missed = 0;
    point.clearance = clearance(hit);
    point.shading_normal = normal;
    point.wo = wo_world;
    point.color = bsdf.color;
    if (bsdf.type == MaterialType::Lambert) {
      point.weight = path.throughput * bsdf.color * inv_pi;
      point.alpha_ggx = 0.0f;
    } else {
      point.weight = path.throughput;
      point.alpha_ggx = bsdf.alpha_ggx;
    }
  }

  // How far the hit is from the edges of its triangle, at least.
  GPURT_HD float clearance(const Hit &hit) const
  {
    const UInt3 corner = scene.indices[hit.triangle];
    Vec3f a = scene.positions[corner.x], b = scene.positions[corner.y], c = scene.positions[corner.z];
    if (hit.placement != invalid_id) {
      const Transform &m = scene.placements[hit.placement].object_to_world;
      a = transform_point(m, a);
      b = transform_point(m, b);
      c = transform_point(m, c);
    }
    const float twice_area = length(cross(b - a, c - a));
    const float w = 1.0f - hit.u - hit.v;
    return twice_area * min(w / length(c - b), min(hit.u / length(c - a), hit.v / length(b - a)));
  }
};
using EyeVertex = BasicEyeVertex<true>;

struct ShadeEyeVertex {
  SceneView scene;
  PathSettings settings;
  PathWave wave;
  VisiblePoint *points;  // one a path
  uint32_t depth;        // as EyeVertex::depth

  GPURT_HD void operator()(uint32_t i) const
  {
    const uint32_t path_index = wave.rays.paths[i];
    wave.next_rays.rays[i].tmax = -1.0f;
    wave.shadows.rays[i].tmax = -1.0f;
    wave.next_rays.paths[i] = path_index;
    wave.shadows.paths[i] = path_index;
    PathState path = wave.paths[path_index];
    EyeVertex{scene, settings, depth}.shade(wave.rays.rays[i], wave.hits[i], path, points[path_index],
                                            VertexSlots{wave, i});
    wave.paths[path_index] = path;
  }
};

GPURT_FUNCTIONS_END
}  // namespace gpurt
