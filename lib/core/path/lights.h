// Next-event estimation: choosing a light, a point on it, and the densities that weigh it against the BSDF's directions.
//
// Lights come in three groups: those of the light tree (lamps, points, spots), distant ones, and the environment image.
// A group is chosen half uniformly and half in proportion to an estimate of its irradiance: the estimate may be poor,
// but no group starves.
#pragma once

#include "core/path/environment.h"
#include "core/path/light_tree.h"
#include "core/path/warp.h"
#include "core/scene/surface.h"

namespace gpurt {

struct LightSample {
  Vec3f target;       // where the shadow ray ends; a direction if the light is at infinity
  Vec3f radiance;     // divided by nothing: radiance of lamps and the environment, irradiance of deltas at p
  Vec3f wi;           // unit, towards the light
  float pdf;          // solid angle, choice included; for deltas the probability of the choice
  uint32_t triangle;  // of the lamp that target is on; invalid_id: another kind of light
  bool is_delta;
  bool at_infinity;
};

struct LightGroups {
  float tree, distant, environment;  // probabilities
};

GPURT_FUNCTIONS_BEGIN

GPURT_HD inline LightGroups light_groups(const SceneView &scene, Vec3f p, Vec3f n)
{
  const bool has_tree = scene.num_tree_lights != 0, has_distant = scene.num_distant_lights != 0;
  const bool has_environment = samples_environment(scene.environment);
  const int num = int(has_tree) + int(has_distant) + int(has_environment);
  if (num == 1) return {has_tree ? 1.0f : 0.0f, has_distant ? 1.0f : 0.0f, has_environment ? 1.0f : 0.0f};
  if (num == 0) return {0.0f, 0.0f, 0.0f};
  // A node's power is that of an isotropic emitter: irradiance is about power / (4 pi d^2).
  const float tree = has_tree ? light_importance(scene, p, n) * (0.25f * inv_pi) : 0.0f;
  float distant = 0.0f;
  for (uint32_t i = 0; i < scene.num_distant_lights; ++i) {
    const Light &light = scene.lights[scene.num_tree_lights + i];
    distant += luminance(light.color) * max(-dot(light.direction, n), 0.0f);
  }
  const float environment = has_environment ? pi * scene.environment.mean_luminance : 0.0f;
  const float sum = tree + distant + environment;
  const float uniform = 1.0f / float(num);
  if (!(sum > 0.0f) || !is_finite(sum)) {
    return {has_tree ? uniform : 0.0f, has_distant ? uniform : 0.0f, has_environment ? uniform : 0.0f};
  }
  const float share = 0.5f / sum, floor_share = 0.5f * uniform;
  return {has_tree ? floor_share + share * tree : 0.0f, has_distant ? floor_share + share * distant : 0.0f,
          has_environment ? floor_share + share * environment : 0.0f};
}

// The corners of a lamp's triangle in world space.
GPURT_INLINE void light_triangle(const SceneView &scene, const Light &light, Vec3f &a, Vec3f &b, Vec3f &c)
{
  const UInt3 corner = scene.indices[light.triangle];
  a = scene.positions[corner.x];
  b = scene.positions[corner.y];
  c = scene.positions[corner.z];
  if (light.placement != invalid_id) {
    const Transform &m = scene.placements[light.placement].object_to_world;
    a = transform_point(m, a);
    b = transform_point(m, b);
    c = transform_point(m, c);
    if (scene.placements[light.placement].flips) {
      const Vec3f swap = b;
      b = c;
      c = swap;
    }
  }
}

// Opacity of a lamp at the point with the given weights of light_triangle's second and third corner.
GPURT_INLINE float lamp_opacity(const SceneView &scene, const Light &light, Vec2f uv)
{
  if (!scene.has_alpha_masks) return 1.0f;
  const bool flips = light.placement != invalid_id && scene.placements[light.placement].flips != 0;
  return opacity_at(scene, light.triangle, flips ? uv.y : uv.x, flips ? uv.x : uv.y);
}

// Radiance of a lamp where its texture coordinates are uv, opacity aside.
GPURT_INLINE Vec3f lamp_radiance(const SceneView &scene, const Material &material, Vec2f uv)
{
  if (!scene.has_emission_textures || material.emission_texture == invalid_id) return material.emission;
  const Texel t = sample_texture(scene.textures[material.emission_texture], uv);
  return material.emission * Vec3f{t.r, t.g, t.b};
}

// The same at the point with the given weights of light_triangle's second and third corner, opacity included.
GPURT_INLINE Vec3f lamp_radiance(const SceneView &scene, const Light &light, Vec2f uv)
{
  if (!scene.has_emission_textures) return light.color * lamp_opacity(scene, light, uv);
  const Segment &segment = scene.segments[scene.triangle_segment[light.triangle]];
  const bool flips = light.placement != invalid_id && scene.placements[light.placement].flips != 0;
  const Vec2f at =
      interpolate_uv(scene, segment, scene.indices[light.triangle], flips ? uv.y : uv.x, flips ? uv.x : uv.y);
  return lamp_radiance(scene, scene.materials[segment.material], at) * lamp_opacity(scene, light, uv);
}

GPURT_INLINE float spot_falloff(const Light &light, Vec3f to_surface)
{
  // Source: glTF extension KHR_lights_punctual, with its floor of 0.001 on the cone's width.
  const float cos_angle = dot(light.direction, to_surface);
  const float x =
      clamp((cos_angle - light.cos_outer) / max(0.001f, light.cos_inner - light.cos_outer), 0.0f, 1.0f);
  return x * x;
}

// False if no light was drawn that can contribute. u0 chooses, u1 places.
GPURT_HD inline bool sample_light(const SceneView &scene, Vec3f p, Vec3f n, float u0, Vec2f u1,
                                  LightSample &s)
{
  const LightGroups groups = light_groups(scene, p, n);
  s.triangle = invalid_id;
  if (u0 < groups.tree) {
    float probability;
    const uint32_t index = sample_light_tree(scene, p, n, u0 / groups.tree, probability);
    if (index == invalid_id) return false;
    probability *= groups.tree;
    const Light &light = scene.lights[index];
    s.at_infinity = false;
    if (light.type == LightType::Triangle) {
      Vec3f a, b, c;
      light_triangle(scene, light, a, b, c);
      const Vec2f uv = sample_triangle(u1);
      const float w = 1.0f - uv.x - uv.y;
      const Vec3f q = a * w + b * uv.x + c * uv.y;
      const Vec3f error =
          (abs(a * w) + abs(b * uv.x) + abs(c * uv.y)) * error_gamma(7) + t_error_at(scene, q, a, b, c);
      const Vec3f area_vector = cross(b - a, c - a);
      const float twice_area = length(area_vector);
      const Vec3f normal = area_vector / twice_area;
      const Vec3f to_light = q - p;
      const float distance2 = length2(to_light);
      s.wi = to_light / sqrt(distance2);
      float cos_light = -dot(normal, s.wi);
      if (light.two_sided) cos_light = abs(cos_light);
      if (!(cos_light > 0.0f) || !(twice_area > 0.0f) || !(distance2 > 0.0f)) return false;
      s.pdf = probability * distance2 / (0.5f * twice_area * cos_light);
      s.radiance = lamp_radiance(scene, light, uv);
      s.triangle = light.triangle;
      // End in front of the lamp by its rounding error and that of a distance measured along the ray, in float, so that
      // the lamp does not shadow itself.
      s.target = offset_origin(q, error + abs(to_light) * error_gamma(8), normal, -s.wi);
      s.is_delta = false;
      return is_finite(s.pdf);
    }
    const Vec3f to_light = light.position - p;
    const float distance2 = length2(to_light);
    if (!(distance2 > 0.0f)) return false;
    s.wi = to_light / sqrt(distance2);
    s.radiance = light.color / distance2;
    if (light.type == LightType::Spot) s.radiance *= spot_falloff(light, -s.wi);
    s.pdf = probability;
    s.target = light.position;
    s.is_delta = true;
    return max_component(s.radiance) > 0.0f;
  }
  s.at_infinity = true;
  if (u0 < groups.tree + groups.distant || groups.environment <= 0.0f) {
    if (scene.num_distant_lights == 0) return false;
    const float u = clamp((u0 - groups.tree) / groups.distant, 0.0f, 1.0f - float_epsilon);
    const uint32_t i = min(uint32_t(u * float(scene.num_distant_lights)), scene.num_distant_lights - 1);
    const Light &light = scene.lights[scene.num_tree_lights + i];
    s.wi = -light.direction;
    s.target = s.wi;
    s.radiance = light.color;
    s.pdf = groups.distant / float(scene.num_distant_lights);
    s.is_delta = true;
    return true;
  }
  s.wi = sample_environment(scene.environment, u1, s.pdf);
  s.target = s.wi;
  s.pdf *= groups.environment;
  s.is_delta = false;
  if (!(s.pdf > 0.0f)) return false;
  s.radiance = environment_radiance(scene, s.wi);
  return true;
}

// Solid-angle density with which sample_light at (p, n) would have drawn the lamp point q that a ray along w met.
GPURT_HD inline float lamp_pdf(const SceneView &scene, Vec3f p, Vec3f n, uint32_t index, Vec3f q, Vec3f w)
{
  const LightGroups groups = light_groups(scene, p, n);
  const Light &light = scene.lights[index];
  Vec3f a, b, c;
  light_triangle(scene, light, a, b, c);
  const Vec3f area_vector = cross(b - a, c - a);
  const float twice_area = length(area_vector);
  const float cos_light = abs(dot(area_vector / twice_area, w));
  if (!(cos_light > 0.0f) || !(twice_area > 0.0f)) return 0.0f;
  return groups.tree * light_tree_probability(scene, p, n, index) * length2(q - p) /
         (0.5f * twice_area * cos_light);
}

GPURT_HD inline float environment_light_pdf(const SceneView &scene, Vec3f p, Vec3f n, Vec3f w)
{
  if (!samples_environment(scene.environment)) return 0.0f;
  return light_groups(scene, p, n).environment * environment_pdf(scene.environment, w);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
