// Choosing one of many lights in proportion to a bound on what it can contribute at a point.
//
// Source: Conty Estevez and Kulla 2018, importance sampling of many lights with adaptive tree splitting, Section 4.1
// (the importance measure); no splitting.
#pragma once

#include "core/scene/scene_view.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

// Bounds on the irradiance at p, on a surface with normal n, from each node of a bundle, up to a constant. 0 only if
// nothing can arrive. Free of branches, so that compilers make one vector of the four.
GPURT_INLINE void light_importance(const LightBundle &node, Vec3f p, Vec3f n, float (&importance)[4])
{
  for (int k = 0; k < 4; ++k) {
    const float x = node.center[0][k] - p.x, y = node.center[1][k] - p.y, z = node.center[2][k] - p.z;
    const float distance2 = x * x + y * y + z * z, radius = node.radius[k];
    const float inv_distance = 1.0f / sqrt(max(distance2, 0x1p-100f));
    const float sin_u = radius * inv_distance;
    const float cos_u = safe_sqrt(1.0f - sin_u * sin_u);

    // cos(max(a - b, 0)) = a < b ? 1 : cos a cos b + sin a sin b, for angles in [0, pi]; sines likewise.
    const float cos_i = clamp((n.x * x + n.y * y + n.z * z) * inv_distance, -1.0f, 1.0f);
    const float sin_i = safe_sqrt(1.0f - cos_i * cos_i);
    const float cos_incidence = cos_i > cos_u ? 1.0f : cos_i * cos_u + sin_i * sin_u;

    // The angle between the axis and the direction to p, less the spread of normals and of the box.
    const float along = (node.axis[0][k] * x + node.axis[1][k] * y + node.axis[2][k] * z) * -inv_distance;
    const float cos_w = clamp(max(along, along * node.facing[k]), -1.0f, 1.0f);
    const float sin_w = safe_sqrt(1.0f - cos_w * cos_w);
    const float cos_o = node.cos_theta[k], sin_o = node.sin_theta[k];
    const float cos_x = cos_w > cos_o ? 1.0f : cos_w * cos_o + sin_w * sin_o;
    const float sin_x = cos_w > cos_o ? 0.0f : max(sin_w * cos_o - cos_w * sin_o, 0.0f);
    const float cos_emission = cos_x > cos_u ? 1.0f : cos_x * cos_u + sin_x * sin_u;

    const float power = node.power[k];
    // Widened: rounding must not exclude a light that contributes. One condition a choice, since GCC does not vectorise
    // choices by two.
    const float seen = cos_incidence < -1e-5f ? 0.0f : power;
    const float lit = cos_emission < node.cos_emit[k] - 1e-5f ? 0.0f : seen;
    const float outside =
        lit * max(cos_emission, 1e-3f) * max(cos_incidence, 1e-3f) * inv_distance * inv_distance;
    // Within the bounding sphere every direction is possible.
    const float inside = power / max(radius * radius, 0x1p-100f);
    importance[k] = distance2 <= radius * radius * 1.0001f ? inside : outside;
  }
}

// Where a bundle has what lies two levels down a path.
GPURT_INLINE uint32_t light_slot(uint64_t path) { return uint32_t((path & 1) << 1 | (path >> 1 & 1)); }

// A bound for all of the tree.
GPURT_INLINE float light_importance(const SceneView &scene, Vec3f p, Vec3f n)
{
  float importance[4];
  light_importance(scene.light_bundles[0], p, n, importance);
  return importance[0];
}

// A light of the tree and the probability of its choice; invalid_id if no light can contribute.
GPURT_INLINE uint32_t sample_light_tree(const SceneView &scene, Vec3f p, Vec3f n, float u, float &probability)
{
  probability = 1.0f;
  uint32_t child = scene.light_bundles[0].child[0];
  while (!(child & light_leaf_bit)) {
    const LightBundle &bundle = scene.light_bundles[child];
    float importance[4];
    light_importance(bundle, p, n, importance);
    const float first_two = importance[0] + importance[1];
    const float sum = first_two + (importance[2] + importance[3]);
    if (!(sum > 0.0f)) return invalid_id;
    // First which pair, then which of the pair.
    float x = u * sum;
    const int pair = x < first_two ? 0 : 2;
    x -= pair == 0 ? 0.0f : first_two;
    const bool second = !(x < importance[pair]);
    x -= second ? importance[pair] : 0.0f;
    // Rounding may point behind the last one that has a share.
    int k = pair + int(second);
    while (!(importance[k] > 0.0f)) k = (k + 3) & 3;
    u = clamp(x / importance[k], 0.0f, 1.0f - float_epsilon);
    probability *= importance[k] / sum;
    child = bundle.child[k];
  }
  return child & ~light_leaf_bit;
}

// The probability that sample_light_tree chooses `light`.
GPURT_INLINE float light_tree_probability(const SceneView &scene, Vec3f p, Vec3f n, uint32_t light)
{
  float probability = 1.0f;
  uint64_t path = scene.lights[light].tree_path;
  uint32_t child = scene.light_bundles[0].child[0];
  while (!(child & light_leaf_bit)) {
    const LightBundle &bundle = scene.light_bundles[child];
    float importance[4];
    light_importance(bundle, p, n, importance);
    const float sum = (importance[0] + importance[1]) + (importance[2] + importance[3]);
    if (!(sum > 0.0f)) return 0.0f;
    const uint32_t k = light_slot(path);
    probability *= importance[k] / sum;
    child = bundle.child[k];
    path >>= 2;
  }
  return probability;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
