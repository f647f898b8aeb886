// Whether a ray meets one given triangle of the world.
#pragma once

#include "core/accel/ray_triangle.h"
#include "core/scene/scene_view.h"

namespace gpurt {

GPURT_FUNCTIONS_BEGIN

// As traversal with the watertight test finds it, to the bit, in whichever leaf the triangle lies.
GPURT_HD inline bool meets_triangle(const SceneView &scene, const Ray &ray, uint32_t triangle)
{
  TraceRay r;
  if (!prepare_ray(ray.origin, ray.direction, ray.tmin, ray.tmax, r)) return false;
  TriangleRay<TriangleTest::Watertight> triangle_ray;
  make_triangle_ray(r, triangle_ray);
  const UInt3 corner = scene.indices[triangle];
  TriangleHit hit;
  return intersect<EdgeRule::Inclusive>(triangle_ray, scene.positions[corner.x], scene.positions[corner.y],
                                        scene.positions[corner.z], r.tmin, r.tmax, hit);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
