// Stage 'map': from the surface that a sample sees to a hit of the committed scene, for shading and for the film.
//
// A point (u, v) of a patch is the point of its tessellation with the same parameters: what is shaded is what rays meet,
// so that no surface shadows itself for want of accuracy, while the outline is that of the micropolygons.
#pragma once

#include "core/accel/ray.h"
#include "core/path/path_settings.h"
#include "core/reyes/transform.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

GPURT_HD inline Hit hit_of_root(const ReyesScene &s, uint32_t root, float u, float v, float t)
{
  const RootRange range = range_of_root(s, root);
  const Segment &segment = s.scene.segments[range.segment];
  const PatchRange &patches = s.patches[range.segment];
  const uint32_t primitive = uint32_t(root - range.first_root);
  if (patches.num_patches == 0) return {t, u, v, segment.first_triangle + primitive, range.placement};
  const float n = float(patches.rate);
  const float x = clamp(u, 0.0f, 1.0f) * n, y = clamp(v, 0.0f, 1.0f) * n;
  const uint32_t i = min(uint32_t(x), patches.rate - 1), j = min(uint32_t(y), patches.rate - 1);
  const float fx = clamp(x - float(i), 0.0f, 1.0f), fy = clamp(y - float(j), 0.0f, 1.0f);
  const uint32_t cell = (primitive * patches.rate + j) * patches.rate + i;
  // The lower right triangle a b d, or the upper left one a d c.
  const bool is_upper = fy > fx;
  const float second = is_upper ? fx : fx - fy, third = is_upper ? fy - fx : fy;
  const uint32_t triangle = segment.first_triangle + 2 * cell + (is_upper ? 1 : 0);
  return {t, segment.flips ? third : second, segment.flips ? second : third, triangle, range.placement};
}

// What stands for the hit of a sample's eye ray: the place on the root that it sees, at 1 / w = z.
GPURT_HD inline Hit hit_of_sample(const ReyesScene &s, const Camera &camera, const Ray &ray, uint32_t root,
                                  float z, Vec2f place)
{
  if (root == invalid_id) return {ray.tmax, 0.0f, 0.0f, invalid_id, invalid_id};
  const Transform &m = camera.camera_to_world;
  const Vec3f forward{-m.m[0][2], -m.m[1][2], -m.m[2][2]};
  return hit_of_root(s, root, place.x, place.y, 1.0f / (z * dot(ray.direction, forward)));
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
