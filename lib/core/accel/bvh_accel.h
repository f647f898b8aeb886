// The bvh accelerator of a scene as kernels read it: a tree for every group, and one over the placements.
#pragma once

#include "core/accel/bvh.h"
#include "core/accel/kd_accel.h"

namespace gpurt {

struct BvhGroupView {
  BvhView tree;
  const LeafTriangle *triangles;  // [i] is the triangle of reference i of the tree
};

struct BvhAccelView {
  const BvhGroupView *groups;  // as SceneView::groups
  BvhView placements;          // references are indices into SceneView::placements; empty if there are none
  uint32_t num_groups;
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE const BvhView &group_tree(const BvhAccelView &accel, uint32_t group)
{
  return accel.groups[group].tree;
}

template <EdgeRule Rule, TriangleTest Test, class OnHit>
GPURT_INLINE bool test_leaf(const BvhAccelView &accel, uint32_t group, uint32_t first, uint32_t count,
                            const TriangleRay<Test> &ray, float tmin, const float &limit,
                            const uint32_t &known, OnHit &&on_hit)
{
  return test_triangles<Rule>(accel.groups[group].triangles + first, count, ray, tmin, limit, known, on_hit);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
