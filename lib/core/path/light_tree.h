// Choosing one of many lights in proportion to a bound on what it can contribute at a point.
//
// Source: Conty Estevez and Kulla 2018, importance sampling of many lights with adaptive tree splitting, Section 4.1
// (the importance measure); no splitting.
#pragma once

#include "core/scene/scene_view.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

// cos(max(a - b, 0)) and sin of the same, from sines and cosines of angles in [0, pi].
GPURT_INLINE float cos_sub_clamped(float sin_a, float cos_a, float sin_b, float cos_b)
{
  return cos_a > cos_b ? 1.0f : fma(cos_a, cos_b, sin_a * sin_b);
}
GPURT_INLINE float sin_sub_clamped(float sin_a, float cos_a, float sin_b, float cos_b)
{
  return cos_a > cos_b ? 0.0f : max(sin_a * cos_b - cos_a * sin_b, 0.0f);
}

// Bound on the irradiance at p, on a surface with normal n, up to a constant. 0 only if nothing can arrive.
GPURT_INLINE float light_importance(const LightNode &node, Vec3f p, Vec3f n)
{
  if (node.power <= 0.0f) return 0.0f;
  const Vec3f center = node.bounds.lo * 0.5f + node.bounds.hi * 0.5f;
  const float radius2 = 0.25f * length2(node.bounds.hi - node.bounds.lo);
  const Vec3f to_light = center - p;
  const float distance2 = length2(to_light);
  // Within the bounding sphere every direction is possible.
  if (distance2 <= radius2 * 1.0001f) return node.power / max(radius2, 0x1p-100f);
  const float inv_distance = 1.0f / sqrt(distance2);
  const Vec3f w = to_light * inv_distance;
  const float sin_u = sqrt(radius2) * inv_distance;
  const float cos_u = safe_sqrt(1.0f - sin_u * sin_u);

  const float cos_i = clamp(dot(n, w), -1.0f, 1.0f);
  const float sin_i = safe_sqrt(1.0f - cos_i * cos_i);
  const float cos_incidence = cos_sub_clamped(sin_i, cos_i, sin_u, cos_u);
  // Here and below widened: rounding must not exclude a light that contributes.
  if (cos_incidence < -1e-5f) return 0.0f;

  // The angle between the axis and the direction to p, less the spread of normals and of the box.
  float cos_w = -dot(node.axis, w);
  if (node.two_sided) cos_w = abs(cos_w);
  cos_w = clamp(cos_w, -1.0f, 1.0f);
  const float sin_w = safe_sqrt(1.0f - cos_w * cos_w);
  const float sin_o = safe_sqrt(1.0f - node.cos_theta * node.cos_theta);
  const float cos_x = cos_sub_clamped(sin_w, cos_w, sin_o, node.cos_theta);
  const float sin_x = sin_sub_clamped(sin_w, cos_w, sin_o, node.cos_theta);
  const float cos_emission = cos_sub_clamped(sin_x, cos_x, sin_u, cos_u);
  if (cos_emission < node.cos_emit - 1e-5f) return 0.0f;
  return node.power * max(cos_emission, 1e-3f) * max(cos_incidence, 1e-3f) * (inv_distance * inv_distance);
}

// A leaf of the tree and the probability of its choice; invalid_id if no light can contribute.
GPURT_INLINE uint32_t sample_light_tree(const SceneView &scene, Vec3f p, Vec3f n, float u, float &probability)
{
  probability = 1.0f;
  uint32_t i = 0;
  while (!scene.light_nodes[i].is_leaf) {
    const uint32_t child = scene.light_nodes[i].child;
    const float a = light_importance(scene.light_nodes[child], p, n);
    const float b = light_importance(scene.light_nodes[child + 1], p, n);
    const float sum = a + b;
    if (!(sum > 0.0f)) return invalid_id;
    const float share = a / sum;
    if (u < share) {
      u = min(u / share, 1.0f - float_epsilon);
      probability *= share;
      i = child;
    } else {
      const float rest = 1.0f - share;
      u = min((u - share) / rest, 1.0f - float_epsilon);
      probability *= rest;
      i = child + 1;
    }
  }
  return scene.light_nodes[i].child;
}

// The probability that sample_light_tree chooses `light`.
GPURT_INLINE float light_tree_probability(const SceneView &scene, Vec3f p, Vec3f n, uint32_t light)
{
  float probability = 1.0f;
  uint64_t path = scene.lights[light].tree_path;
  uint32_t i = 0;
  while (!scene.light_nodes[i].is_leaf) {
    const uint32_t child = scene.light_nodes[i].child;
    const float a = light_importance(scene.light_nodes[child], p, n);
    const float b = light_importance(scene.light_nodes[child + 1], p, n);
    const float sum = a + b;
    if (!(sum > 0.0f)) return 0.0f;
    const float share = a / sum;
    probability *= (path & 1) ? 1.0f - share : share;
    i = child + uint32_t(path & 1);
    path >>= 1;
  }
  return probability;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
