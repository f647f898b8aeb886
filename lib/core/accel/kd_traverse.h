// Walks the leaves of a kd-tree along a ray, front to back, with a stack that cannot overflow.
//
// Source: Aila and Laine 2009, while-while; Hapala and Havran 2011 on the numerical traps of the descent.
// Differs: every comparison of distances leaves room for rounding, by the bound derived here.
//
// What has to hold: if a triangle test accepts a triangle of a leaf, the leaf is visited, however the test and the
// distances to the planes were rounded. Let eps = 2^-24, o the origin, d the direction with largest component d_z along
// the main axis, and M the largest |p - o| of any coordinate of the tree's bounds, so |p - o| <= M for all vertices.
//
//   The watertight test shears corners to x = (p_x - o_x) - (d_x/d_z)(p_z - o_z) with rounding error at most 7 eps M
//   (one rounding of each difference, two of d_x/d_z, one of the product, one of the last difference, |d_x/d_z| <= 1),
//   and its verdict is exact for the corners so displaced. An accepted triangle therefore has a point Q whose other two
//   coordinates are within 7 eps M of the ray's point at Q's own parameter t_Q = (Q_z - o_z)/d_z. Q lies in the cell
//   of a leaf that holds the triangle, since builders clip conservatively. The t that the test gives is such a t_Q, rounded
//   to float: 8 eps M in place of 7 (measure_hit), so that the nearest hit does not depend on the tree.
//   The distance to a plane, s = (plane - o_k) * (1/d_k), is rounded three times: an error of 3 eps M/|d_k|.
//   s - w and s + w are rounded once: less than 2 eps M/|d_k|.
//
// If Q is on the near side of a plane of axis k, then t_Q <= s + (8 + 3 + 2) eps M/|d_k|, and on the far side t_Q >= s
// less that. So with w_k = 16 eps M/|d_k| the interval [a, b] of every node above Q's leaf contains t_Q, when a child is
// left out only if s - w > b or s + w < a, and its interval is cut at s - w or s + w. So, too, two planes that bound a
// visited cell are passed in the wrong order by no more than (16 + 2 + 3) eps M/|d_k| each: the ray meets every leaf
// that is visited once its cell has grown by 21 eps M.
//
// The sides are told by the direction's sign, never by that of s, which may underflow; where plane and ray are parallel,
// |1/d_k| is cut to 2^60/|d_z|: the ray then moves by less than 2^-58 M, and a plane further from it than 16 eps M is
// still told apart. Overflow makes comparisons false and both children be visited. Extra visits cost time and never
// change what is hit.
#pragma once

#include "core/accel/count_step.h"
#include "core/accel/kd_tree.h"
#include "core/accel/trace_ray.h"

namespace gpurt {

// What the descent needs of a ray along one axis.
struct KdAxis {
  float origin;
  float inverse;
  float widening;
  uint32_t far_first;  // 1: the ray points down the axis, so that the child above the plane is the near one
};

// A ray before it enters a tree.
struct KdRay {
  KdAxis axis[3];
  float a, b;        // the interval within the tree's bounds; a > b: the ray misses them
  float t_widening;  // of distances along the ray
};

// A postponed far child.
struct KdEntry {
  uint32_t index;
  float a;       // where its interval begins
  float near_b;  // where that of the near side ends, and of all that is postponed within it
};

// Where a ray stands in a tree: a node, the interval within its cell, and what is postponed. Cursors that keep their stack
// elsewhere have the same members, `todo` with an operator[].
struct KdCursor {
  uint32_t index;
  int num_todo;
  float a, b;
  KdEntry todo[kd_max_depth];
};

GPURT_FUNCTIONS_BEGIN

// Indexing by a run-time axis: memory on the CPU, selects in registers on the GPU.
GPURT_INLINE KdAxis axis_of(const KdRay &r, int k)
{
#if defined(__CUDA_ARCH__)
  const KdAxis &x = r.axis[0], &y = r.axis[1], &z = r.axis[2];
  return {k == 0 ? x.origin : (k == 1 ? y.origin : z.origin),
          k == 0 ? x.inverse : (k == 1 ? y.inverse : z.inverse),
          k == 0 ? x.widening : (k == 1 ? y.widening : z.widening),
          k == 0 ? x.far_first : (k == 1 ? y.far_first : z.far_first)};
#else
  return r.axis[k];
#endif
}

GPURT_INLINE KdRay make_kd_ray(const TraceRay &ray, const Box &bounds, float t_limit)
{
  KdRay r;
  const Vec3f below = bounds.lo - ray.origin, above = bounds.hi - ray.origin;
  const float reach = max(max_component(abs(below)), max_component(abs(above)));
  const float error = next_up(reach * 0x1p-20f);  // 16 eps M; never 0
  const float steepest = abs(1.0f / at(ray.direction, ray.main_axis));
  const float limit = steepest * 0x1p60f;
  r.t_widening = error * steepest;
  r.a = ray.tmin - r.t_widening;
  r.b = t_limit + r.t_widening;
  for (int k = 0; k < 3; ++k) {
    const float d = at(ray.direction, k);
    const float inverse = min(abs(1.0f / d), limit);
    const bool is_negative = d < 0.0f;
    KdAxis &x = r.axis[k];
    x.origin = at(ray.origin, k);
    x.inverse = is_negative ? -inverse : inverse;
    x.widening = error * inverse;
    x.far_first = is_negative ? 1u : 0u;
    const float enter = at(is_negative ? above : below, k) * x.inverse - x.widening;
    const float leave = at(is_negative ? below : above, k) * x.inverse + x.widening;
    // NaN, from overflow, leaves the interval as it is.
    if (enter > r.a) r.a = enter;
    if (leave < r.b) r.b = leave;
  }
  return r;
}

template <class Cursor>
GPURT_INLINE void kd_begin(const KdRay &r, Cursor &at)
{
  at.index = 0;
  at.num_todo = 0;
  at.a = r.a;
  at.b = r.b;
}

// Resumes with the nearest postponed subtree that does not begin beyond the limit; false if there is none. Its interval
// ends where that of the near side of the entry below it on the stack ends.
template <class Cursor>
GPURT_INLINE bool kd_resume(const KdRay &r, float t_limit, Cursor &at)
{
  const float end = t_limit + r.t_widening;
  do {
    if (at.num_todo == 0) return false;
    const KdEntry e = at.todo[--at.num_todo];
    at.index = e.index;
    at.a = e.a;
  } while (at.a > end);
  at.b = min(at.num_todo != 0 ? at.todo[at.num_todo - 1].near_b : r.b, end);
  return true;
}

// Descends to the leaf at the near end of the interval and returns it; far children are postponed.
template <class Cursor>
GPURT_INLINE KdNode kd_descend(const KdTreeView &tree, const KdRay &r, Cursor &at)
{
  KdNode node = tree.nodes[at.index];
  while (!is_leaf(node)) {
    count_step();
    const KdAxis x = axis_of(r, axis(node));
    const float s = (plane(node) - x.origin) * x.inverse;
    const float begin = s - x.widening, end = s + x.widening;
    const uint32_t near = payload(node) + x.far_first;
    const uint32_t far = payload(node) + (x.far_first ^ 1u);
    if (begin > at.b) {
      at.index = near;
    } else if (end < at.a) {
      at.index = far;
    } else {
      // Both ends only narrow the interval: a plane almost parallel to the ray, whose widening is large, must not
      // undo what the planes above it have cut off. A NaN leaves them as they are.
      at.b = min(at.b, end);
      at.todo[at.num_todo++] = {far, max(at.a, begin), at.b};
      at.index = near;
    }
    node = tree.nodes[at.index];
  }
  return node;
}

// Calls leaf(first, count) for the leaves that the ray may meet, nearest first, until it returns true.
//
// t_limit is the largest t of interest. The leaf action may lower it, as closest hits do: a leaf that begins beyond it
// is left out, so that a hit found early but lying in a later cell does not hide a nearer one.
template <class LeafAction>
GPURT_HD inline void traverse_kd(const KdTreeView &tree, const TraceRay &ray, float &t_limit,
                                 LeafAction &&leaf)
{
  if (tree.num_nodes == 0) return;
  const KdRay r = make_kd_ray(ray, tree.bounds, t_limit);
  if (!(r.a <= r.b)) return;
  KdCursor at;
  kd_begin(r, at);
  do {
    const KdNode node = kd_descend(tree, r, at);
    if (payload(node) != 0 && leaf(node.word, payload(node))) return;
  } while (kd_resume(r, t_limit, at));
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
