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
  const PatchCells &cells = s.cells[patches.first_patch + primitive];
  const CellPoint at = locate_in_cells(cells, clamp(u, 0.0f, 1.0f), clamp(v, 0.0f, 1.0f));
  const uint32_t triangle = segment.first_triangle + cells.first_triangle + at.triangle;
  return {t, segment.flips ? at.third : at.second, segment.flips ? at.second : at.third, triangle,
          range.placement};
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
