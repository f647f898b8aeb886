// The kd-tree accelerator of a scene as kernels read it: a tree for every group, and one over the placements.
#pragma once

#include "core/accel/count_step.h"
#include "core/accel/kd_tree.h"
#include "core/accel/ray_triangle.h"

namespace gpurt {

// A triangle as leaves hold it: three 16-byte loads, no index to follow, its public ids at hand.
struct alignas(16) LeafTriangle {
  Vec3f a;
  uint32_t triangle;  // index into SceneView::indices
  Vec3f b;
  uint32_t primitive;  // of its geometry
  Vec3f c;
  uint32_t segment;  // SceneView::segments
};

struct KdGroupView {
  KdTreeView tree;
  const LeafTriangle *triangles;  // [i] is the triangle of reference i of the tree
};

struct KdAccelView {
  const KdGroupView *groups;  // as SceneView::groups
  KdTreeView placements;      // references are indices into SceneView::placements; empty if there are none
  uint32_t num_groups;
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE const KdTreeView &group_tree(const KdAccelView &accel, uint32_t group)
{
  return accel.groups[group].tree;
}

// Tests the triangles of a leaf. on_hit(triangle, hit) returns true to stop; it may lower `limit`.
// The triangle `known` is left out.
template <EdgeRule Rule, TriangleTest Test, class OnHit>
GPURT_INLINE bool test_triangles(const LeafTriangle *triangles, uint32_t count, const TriangleRay<Test> &ray,
                                 float tmin, const float &limit, const uint32_t &known, OnHit &&on_hit)
{
  for (uint32_t i = 0; i < count; ++i) {
    count_step();
    const LeafTriangle &x = triangles[i];
    if (x.triangle == known) continue;
    TriangleHit hit;
    if (intersect<Rule>(ray, x.a, x.b, x.c, tmin, limit, hit) && on_hit(x.triangle, hit)) return true;
  }
  return false;
}

template <EdgeRule Rule, TriangleTest Test, class OnHit>
GPURT_INLINE bool test_leaf(const KdAccelView &accel, uint32_t group, uint32_t first, uint32_t count,
                            const TriangleRay<Test> &ray, float tmin, const float &limit,
                            const uint32_t &known, OnHit &&on_hit)
{
  return test_triangles<Rule>(accel.groups[group].triangles + first, count, ray, tmin, limit, known, on_hit);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
