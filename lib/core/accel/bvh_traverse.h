// Walks the leaves of a bounding volume hierarchy along a ray, the nearer child first, with a stack that cannot overflow.
//
// Source: Aila and Laine 2009, while-while.
// Differs: boxes by centre and half extent, so that fused operations take the place of minima and maxima along each
// axis; every comparison of distances leaves room for rounding, by the bound derived here.
//
// What has to hold: if a triangle test accepts a triangle of a leaf, the leaf is visited, however the test and the
// distances were rounded. Let eps = 2^-24, o the origin, d the direction with largest component d_z along the main axis,
// M the largest |p - o| of any coordinate of the tree's bounds, and c and h a box's centre and half extent.
//
//   As kd_traverse.h shows, an accepted triangle has a point Q whose other two coordinates are within 7 eps M of the
//   ray's point at Q's own parameter t_Q = (Q_z - o_z)/d_z. Builders clip conservatively: Q lies in the box of a leaf
//   that holds the triangle, and so in those of all nodes above it. Hence t_Q is between
//     (c_k -+ h_k - o_k)/d_k less and more 7 eps M/|d_k|, for every axis k.
//   Computed are, with o' = o - centre of the tree and i = 1/d_k,
//     near = fma(-h, |i|, fma(c, i, -o' i - w)),  far = fma(h, |i|, fma(c, i, -o' i + w)).
//   Rounded are o', i, the product o' i, its sum with w, and the two results of fma, each by a factor within 1 +- eps.
//   First order terms times |d_k| add up to (3 |c| + 6 |o'| + 2 h) eps: c is met by the rounding of i and by those of
//   both fma, o' by all six, h by those of i and of the last fma. The box lies in the tree's bounds, whose half extent be
//   R: |c| + h <= R and |o'| + R <= M, so this is at most 6 eps M. So with w = 16 eps M/|d_k| no box that contains Q is
//   left out, and there are nearly 3 eps M to spare, for terms in eps^2 and the rounding of M and w themselves.
//   The t that the test gives is one of these t_Q, rounded to float (measure_hit), which takes one eps M of the three: leaves
//   are left out only where no triangle of theirs can be the nearest, and which one is does not depend on the tree.
//
// Where box and ray are parallel, |i| is cut to 2^30/|d_z|: the ray then moves by less than 2^-30 M, of what there is to
// spare, and a slab further from it than 16 eps M is still told apart. Where M |i| might overflow, w is made
// infinite. Where numbers become so small that they lose bits, errors are absolute: the smallest float is 2^-149, and a
// few of them are added. What is not a number, from a half extent that overflowed, leaves the interval as it is. Extra
// visits cost time and never change what is hit.
#pragma once

#include "core/accel/bvh.h"
#include "core/accel/count_step.h"
#include "core/accel/trace_ray.h"

namespace gpurt {

// A ray before it enters a tree.
struct BvhRay {
  Vec3f inverse;
  Vec3f enter, leave;  // -o'/d less and more what has to be left to rounding
  float begin;         // of the interval of interest
  float t_widening;    // of distances along the ray; finite
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE BvhRay make_bvh_ray(const TraceRay &ray, const BvhView &tree)
{
  constexpr float few_smallest = 0x1p-146f, largest = 0x1.fffffep127f;
  const Vec3f below = tree.bounds.lo - ray.origin, above = tree.bounds.hi - ray.origin;
  const float reach = max(max_component(abs(below)), max_component(abs(above)));
  const float steepest = abs(1.0f / at(ray.direction, ray.main_axis));
  const float limit = steepest * 0x1p30f;
  // Not finite: overflow, and all is visited.
  const float error = reach * limit < 0x1p120f ? reach * 0x1p-20f + few_smallest : infinity;
  BvhRay r;
  r.t_widening = min(largest, error * steepest + few_smallest);
  r.begin = ray.tmin - r.t_widening;
  for (int k = 0; k < 3; ++k) {
    const float d = at(ray.direction, k);
    const float magnitude = min(limit, abs(1.0f / d));
    const float inverse = d < 0.0f ? -magnitude : magnitude;
    const float shift = (at(ray.origin, k) - at(tree.frame.center, k)) * inverse;
    const float widening = error * magnitude + few_smallest;
    set(r.inverse, k, inverse);
    set(r.enter, k, -shift - widening);
    set(r.leave, k, widening - shift);
  }
  return r;
}

// The interval in which the ray may meet a box, within [enter, leave].
GPURT_INLINE void clip_to_box(const BvhRay &r, Vec3f center, float half_x, float half_y, float half_z,
                              float &enter, float &leave)
{
  const float size_x = abs(r.inverse.x), size_y = abs(r.inverse.y), size_z = abs(r.inverse.z);
  enter = at_least(enter, fma(-half_x, size_x, fma(center.x, r.inverse.x, r.enter.x)));
  leave = at_most(leave, fma(half_x, size_x, fma(center.x, r.inverse.x, r.leave.x)));
  enter = at_least(enter, fma(-half_y, size_y, fma(center.y, r.inverse.y, r.enter.y)));
  leave = at_most(leave, fma(half_y, size_y, fma(center.y, r.inverse.y, r.leave.y)));
  enter = at_least(enter, fma(-half_z, size_z, fma(center.z, r.inverse.z, r.enter.z)));
  leave = at_most(leave, fma(half_z, size_z, fma(center.z, r.inverse.z, r.leave.z)));
}

GPURT_INLINE BvhNode load_node(const BvhNode *nodes, uint32_t index)
{
#if defined(__CUDA_ARCH__)
  const float4 *p = reinterpret_cast<const float4 *>(nodes + index);
  const float4 a = __ldg(p), b = __ldg(p + 1), c = __ldg(p + 2);
  return {{a.x, a.y, a.z},
          __float_as_uint(a.w),
          {b.x, b.y, b.z},
          __float_as_uint(b.w),
          {__float_as_uint(c.x), __float_as_uint(c.y), __float_as_uint(c.z)},
          0};
#else
  return nodes[index];
#endif
}

// Calls leaf(first, count) for the leaves that the ray may meet, until it returns true: nearer ones first, or, where
// order does not matter, those of the larger box first, which are hit more often.
//
// t_limit is the largest t of interest. The leaf action may lower it, as closest hits do.
template <bool Ordered, class LeafAction>
GPURT_HD inline void traverse_bvh(const BvhView &tree, const TraceRay &ray, float &t_limit, LeafAction &&leaf)
{
  if (tree.root == bvh_empty) return;
  const BvhRay r = make_bvh_ray(ray, tree);
  float end = t_limit + r.t_widening;
  uint32_t todo[bvh_max_depth + 1];
  todo[0] = bvh_empty;
  int num_todo = 1;
  uint32_t current = tree.root;
  for (;;) {
    // Descend to a leaf; postpone second children.
    while (!is_bvh_leaf(current)) {
      count_step();
      const BvhNode node = load_node(tree.nodes, current);
      float enter0 = r.begin, leave0 = end, enter1 = r.begin, leave1 = end;
      clip_to_box(r, node.center0, half0(node.half[0]), half0(node.half[1]), half0(node.half[2]), enter0,
                  leave0);
      clip_to_box(r, node.center1, half1(node.half[0]), half1(node.half[1]), half1(node.half[2]), enter1,
                  leave1);
      const bool meets0 = enter0 <= leave0, meets1 = enter1 <= leave1;
      if (meets0 && meets1) {
        const bool second_first = Ordered && enter1 < enter0;
        todo[num_todo++] = second_first ? node.child0 : node.child1;
        current = second_first ? node.child1 : node.child0;
      } else if (meets0 || meets1) {
        current = meets0 ? node.child0 : node.child1;
      } else {
        current = todo[--num_todo];
      }
    }
    if (current == bvh_empty) return;
    if (leaf(leaf_first(current), leaf_size(current))) return;
    end = t_limit + r.t_widening;
    current = todo[--num_todo];
  }
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
