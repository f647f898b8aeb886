// Rays and hits as the accelerators see them.
#pragma once

#include "core/math/vec.h"

namespace gpurt {

// The same layout as gpurt_ray.
struct Ray {
  Vec3f origin;
  float tmin;
  Vec3f direction;
  float tmax;
};

// A hit inside the library. `triangle` counts over all stored triangles of the scene (SceneView::indices); `placement`
// is the index into SceneView::placements of a shared geometry, or invalid_id for triangles in world space.
struct Hit {
  float t;
  float u, v;
  uint32_t triangle;  // invalid_id: a miss
  uint32_t placement;
};

// What the triangle test does at edges (gpurt_triangle_test).
enum class TriangleTest : uint32_t { Watertight = 0, MollerTrumbore = 1, Double = 2 };

}  // namespace gpurt
