// From a hit to the surface there: position with its error bound, normals, texture coordinates, material.
#pragma once

#include "core/accel/trace_ray.h"
#include "core/random/sobol.h"
#include "core/scene/texture.h"

namespace gpurt {

struct SurfaceHit {
  Vec3f position;
  Vec3f
      position_error;  // bound on each coordinate's rounding error and on SceneView::t_error's part along it
  Vec3f geometric_normal;  // unit; the counter-clockwise side
  Vec3f shading_normal;    // unit; on the geometric normal's side or not, as interpolated
  Vec2f uv;
  uint32_t material;
  uint32_t light;  // index into SceneView::lights; invalid_id: not a lamp
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE Vec2f interpolate_uv(const SceneView &scene, const Segment &segment, UInt3 corner, float u,
                                  float v)
{
  if (segment.first_uv == invalid_id) return {0.0f, 0.0f};
  const Vec2f *uvs = scene.uvs + segment.first_uv - segment.first_vertex;
  const Vec2f a = uvs[corner.x], b = uvs[corner.y], c = uvs[corner.z];
  const float w = 1.0f - u - v;
  return {fma(w, a.x, fma(u, b.x, v * c.x)), fma(w, a.y, fma(u, b.y, v * c.y))};
}

// Opacity of a triangle at a point: 0 in the holes of alpha masks, which are where alpha is below the material's cutoff.
GPURT_INLINE float opacity_at(const SceneView &scene, uint32_t triangle, float u, float v)
{
  const Segment &segment = scene.segments[scene.triangle_segment[triangle]];
  const Material &material = scene.materials[segment.material];
  if (material.alpha_cutoff <= 0.0f && material.blends == 0) return 1.0f;
  float alpha = material.alpha;
  if (material.base_color_texture != invalid_id) {
    const Vec2f uv = interpolate_uv(scene, segment, scene.indices[triangle], u, v);
    alpha *= sample_texture(scene.textures[material.base_color_texture], uv).a;
  }
  if (material.blends != 0) return alpha;
  return alpha < material.alpha_cutoff ? 0.0f : 1.0f;
}

// What decides for a ray, triangle by triangle, whether it meets surfaces that blend.
GPURT_INLINE uint64_t ray_key(const TraceRay &ray)
{
  const auto pair = [](float a, float b) { return uint64_t(float_bits(a)) << 32 | float_bits(b); };
  const uint64_t key =
      mix_bits(mix_bits(pair(ray.origin.x, ray.origin.y)) ^ pair(ray.origin.z, ray.direction.x));
  return mix_bits(key ^ pair(ray.direction.y, ray.direction.z));
}

// Whether a ray passes a triangle that it crosses: in holes, and by chance where the material blends. A function of the ray
// and the triangle, so that every leaf that has the triangle, every accelerator and every device decide alike; rays of
// other samples have other keys, so that the mean over samples is that of light which is let through.
// Source: Enderton et al. 2010, stochastic transparency, by the ray's hash in place of sample masks.
GPURT_INLINE bool lets_pass(const SceneView &scene, uint64_t key, uint32_t triangle, uint32_t placement,
                            float u, float v)
{
  const float opacity = opacity_at(scene, triangle, u, v);
  if (opacity >= 1.0f) return false;
  if (!(opacity > 0.0f)) return true;
  const uint64_t id = uint64_t(placement) << 32 | triangle;
  return unit_float(uint32_t(mix_bits(key ^ mix_bits(id + 0x9e3779b97f4a7c15u)))) >= opacity;
}

GPURT_INLINE Vec3f base_color(const SceneView &scene, const Material &material, Vec2f uv)
{
  if (material.base_color_texture == invalid_id) return material.base_color;
  const Texel t = sample_texture(scene.textures[material.base_color_texture], uv);
  return material.base_color * Vec3f{t.r, t.g, t.b};
}

// The part of a point's error that comes from SceneView::t_error.
GPURT_INLINE Vec3f t_error_at(const SceneView &scene, Vec3f p, Vec3f a, Vec3f b, Vec3f c)
{
  const float extent =
      max(max_component(abs(a - p)), max(max_component(abs(b - p)), max_component(abs(c - p))));
  return vec3(scene.t_error * extent);
}

// The point is recomputed from barycentrics: its error depends on the triangle's coordinates, not on the ray's length.
// Source: Pharr, Jakob and Humphreys 2023, Section 6.8.
GPURT_HD inline SurfaceHit surface_at(const SceneView &scene, const Hit &hit)
{
  SurfaceHit s;
  const Segment &segment = scene.segments[scene.triangle_segment[hit.triangle]];
  const UInt3 corner = scene.indices[hit.triangle];
  const Vec3f a = scene.positions[corner.x], b = scene.positions[corner.y], c = scene.positions[corner.z];
  const float w = 1.0f - hit.u - hit.v;
  s.position = a * w + b * hit.u + c * hit.v;
  s.position_error = (abs(a * w) + abs(b * hit.u) + abs(c * hit.v)) * error_gamma(7) +
                     t_error_at(scene, s.position, a, b, c);
  Vec3f n = cross(b - a, c - a);
  Vec3f shading = n;
  bool is_flat = true;
  if (segment.first_normal != invalid_id) {
    const Vec3f *normals = scene.normals + segment.first_normal - segment.first_vertex;
    const Vec3f m = normals[corner.x] * w + normals[corner.y] * hit.u + normals[corner.z] * hit.v;
    if (length2(m) > 0.0f) {
      shading = m;
      is_flat = false;
    }
  }
  s.light = invalid_id;
  if (segment.first_light != invalid_id)
    s.light = segment.first_light + (hit.triangle - segment.first_triangle);
  if (hit.placement != invalid_id) {
    const Placement &p = scene.placements[hit.placement];
    const Transform &m = p.object_to_world;
    const Vec3f q = s.position, e = s.position_error;
    for (int i = 0; i < 3; ++i) {
      const float spread = abs(m.m[i][0]) * e.x + abs(m.m[i][1]) * e.y + abs(m.m[i][2]) * e.z;
      const float size = abs(m.m[i][0] * q.x) + abs(m.m[i][1] * q.y) + abs(m.m[i][2] * q.z) + abs(m.m[i][3]);
      set(s.position_error, i, spread * (1.0f + error_gamma(4)) + size * error_gamma(4));
    }
    s.position = transform_point(m, q);
    // The inverse transpose keeps the front outside also where the transform mirrors, as glTF wants it.
    n = transform_normal(p.world_to_object, n);
    if (!is_flat) shading = transform_normal(p.world_to_object, shading);
    if (p.first_light != invalid_id) s.light = p.first_light + (hit.triangle - segment.first_triangle);
  }
  s.geometric_normal = normalize_any_scale(n);
  s.shading_normal = is_flat ? s.geometric_normal : normalize_any_scale(shading);
  s.uv = interpolate_uv(scene, segment, corner, hit.u, hit.v);
  s.material = segment.material;
  return s;
}

// A ray origin that no rounding puts on the wrong side of the surface, for a ray that leaves along w.
GPURT_INLINE Vec3f offset_origin(Vec3f p, Vec3f error, Vec3f normal, Vec3f w)
{
  const float d = dot(abs(normal), error);
  const Vec3f offset = dot(w, normal) < 0.0f ? normal * -d : normal * d;
  Vec3f o = p + offset;
  // Round away from the surface.
  o.x = offset.x > 0.0f ? next_up(o.x) : (offset.x < 0.0f ? next_down(o.x) : o.x);
  o.y = offset.y > 0.0f ? next_up(o.y) : (offset.y < 0.0f ? next_down(o.y) : o.y);
  o.z = offset.z > 0.0f ? next_up(o.z) : (offset.z < 0.0f ? next_down(o.z) : o.z);
  return o;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
