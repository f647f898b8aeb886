// Public ids of a hit, and the order that they give to hits at the same distance.
#pragma once

#include "core/accel/ray.h"
#include "core/scene/scene_view.h"

namespace gpurt {

// The same layouts as gpurt_hit and gpurt_hit_compact.
struct FullHit {
  float t, u, v;
  uint32_t primitive, geometry, instance;
  uint32_t padding[2];
};
struct CompactHit {
  float t, u, v;
  uint32_t primitive;
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE uint32_t instance_of(const SceneView &scene, uint32_t triangle, uint32_t placement)
{
  return placement != invalid_id ? scene.placements[placement].instance
                                 : scene.segments[scene.triangle_segment[triangle]].instance;
}

GPURT_INLINE uint32_t primitive_of(const SceneView &scene, uint32_t triangle)
{
  return triangle - scene.segments[scene.triangle_segment[triangle]].first_triangle;
}

GPURT_INLINE FullHit full_hit(const SceneView &scene, const Hit &hit)
{
  if (hit.triangle == invalid_id) return {hit.t, 0.0f, 0.0f, invalid_id, invalid_id, invalid_id, {0, 0}};
  const Segment &segment = scene.segments[scene.triangle_segment[hit.triangle]];
  const uint32_t instance =
      hit.placement != invalid_id ? scene.placements[hit.placement].instance : segment.instance;
  return {hit.t, hit.u, hit.v, hit.triangle - segment.first_triangle, segment.geometry, instance, {0, 0}};
}

GPURT_INLINE CompactHit compact_hit(const SceneView &scene, const Hit &hit)
{
  if (hit.triangle == invalid_id) return {hit.t, 0.0f, 0.0f, invalid_id};
  return {hit.t, hit.u, hit.v, primitive_of(scene, hit.triangle)};
}

// The order of (instance, primitive), for hits that are not misses.
GPURT_INLINE bool ids_precede(const SceneView &scene, const Hit &x, const Hit &y)
{
  // Triangles in world space are stored in this order.
  if (x.placement == invalid_id && y.placement == invalid_id) return x.triangle < y.triangle;
  const uint32_t ix = instance_of(scene, x.triangle, x.placement),
                 iy = instance_of(scene, y.triangle, y.placement);
  if (ix != iy) return ix < iy;
  return primitive_of(scene, x.triangle) < primitive_of(scene, y.triangle);
}

// The order of (t, instance, primitive).
GPURT_INLINE bool hit_precedes(const SceneView &scene, const Hit &x, const Hit &y)
{
  if (x.t != y.t) return x.t < y.t;
  return ids_precede(scene, x, y);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
