// A ray in a kd-tree as the fast kernels carry it: fewer operations a step and a triangle than traverse_kd and intersect, and
// the same hits to the bit. Rays for which that cannot be promised, which are few, go the general way.
//
// What has to hold is what kd_traverse.h says: every leaf that holds a triangle which the watertight test accepts is visited.
// Let eps = 2^-24, M the largest distance along an axis from the origin o to a point of the tree's bounds, B the largest
// coordinate of the bounds, i = 1/d_k, and b what distances are counted from. Computed is s - w = fma(p, i, (-(o i) - b) - w).
// Off by, times |d_k|: i, by 2 eps M, since it meets p and o alike; o i by eps (M + B); b, of at most 5 M/|d_z|, by 6 eps M
// at each of two differences and 5 eps (M + B) with what they are rounded to; the result by eps (M + 5 M). That is below
// 32 eps (M + B), and 7 eps M are the triangle test's. So with w = 64 eps (M + B)/|d_k| no leaf is left out.
#pragma once

#include "core/accel/kd_accel.h"
#include "core/accel/near_ray.h"

namespace gpurt {

struct NearKdView {
  const KdNode *nodes;
  const LeafTriangle *triangles;  // by reference
  Box bounds;
  BvhFrame frame;   // reach 0: no ray is near the tree
  float magnitude;  // of the bounds' largest coordinate
};

// What a plane's distance takes along an axis: less what has to be left to rounding.
struct NearKdAxis {
  float inverse, shift;
};

// A ray in the tree, but for its axes, which lie where they can be indexed.
struct NearKdRay {
  NearKdAxis axis[3];
  float width;  // of what is left to rounding, both ways, in units of |inverse|
  float a, b;   // distances at which the ray is in the bounds; a > b: never
};

GPURT_FUNCTIONS_BEGIN

// As abs(), which compilers for GPUs make a part of the instruction that takes it only so.
GPURT_INLINE float size_of(float x)
{
#if defined(__CUDA_ARCH__)
  return fabsf(x);
#else
  return abs(x);
#endif
}

GPURT_INLINE NearKdView make_near_kd_view(const KdTreeView &tree, const LeafTriangle *triangles)
{
  NearKdView view = {tree.nodes, triangles, tree.bounds, {}, 0.0f};
  if (tree.num_nodes == 0) return view;
  view.frame = make_bvh_frame(tree.bounds);
  view.magnitude = max(max_component(abs(tree.bounds.lo)), max_component(abs(tree.bounds.hi)));
  return view;
}

// False for a ray that has to go the general way, misses among them. `r` is the ray as triangles are tested with it.
GPURT_INLINE bool make_near_kd_ray(const Ray &ray, const NearKdView &tree, NearRay &r, NearKdRay &q)
{
  const Vec3f magnitude = abs(ray.direction);
  const float largest = max_component(magnitude);
  const Vec3f distance = abs(ray.origin - tree.frame.center);
  const float farthest = max_component(distance) + tree.frame.half_extent;
  // Not a number if one of them is none, which comparisons of the largest may miss.
  const float sum = (magnitude.x + magnitude.y + magnitude.z) + (distance.x + distance.y + distance.z);
  if (!(largest >= 0x1p-40f && largest <= 0x1p40f && sum < infinity && 2.0f * farthest <= tree.frame.reach &&
        ray.tmin <= ray.tmax && abs(ray.tmin) * largest <= 4.0f * farthest))
    return false;
  r.main_axis = main_axis_of(ray.direction);
  const int kx = r.main_axis == 2 ? 0 : r.main_axis + 1, ky = kx == 2 ? 0 : kx + 1;
  r.sz = 1.0f / at(ray.direction, r.main_axis);
  r.sx = at(ray.direction, kx) * r.sz;
  r.sy = at(ray.direction, ky) * r.sz;
  r.origin = ray.origin;
  const float steepest = abs(r.sz);
  const float limit = steepest * 0x1p30f;
  const float error = (farthest + tree.magnitude) * 0x1p-18f;
  const float t_widening = error * steepest + 0x1p-146f;
  const float begin = ray.tmin - t_widening;
  r.end_offset = t_widening - begin;
  q.width = 2.0f * error * (1.0f + 0x1p-20f) + 0x1p-140f;
  q.a = 0.0f;
  q.b = ray.tmax + r.end_offset;
  const auto prepare = [&](float d, float o, float below, float above, NearKdAxis &axis) {
    const float size = min(limit, abs(fast_reciprocal(d)));
    const float inverse = d < 0.0f ? -size : size;
    const float widening = error * size + 0x1p-146f;
    axis = {inverse, (-(o * inverse) - begin) - widening};
    q.a = at_least(q.a, ((d < 0.0f ? above : below) - o) * inverse - begin - widening);
    q.b = at_most(q.b, ((d < 0.0f ? below : above) - o) * inverse - begin + widening);
  };
  prepare(ray.direction.x, ray.origin.x, tree.bounds.lo.x, tree.bounds.hi.x, q.axis[0]);
  prepare(ray.direction.y, ray.origin.y, tree.bounds.lo.y, tree.bounds.hi.y, q.axis[1]);
  prepare(ray.direction.z, ray.origin.z, tree.bounds.lo.z, tree.bounds.hi.z, q.axis[2]);
  return true;
}

// From an inner node to the child that the ray meets first, whose index it returns; where it meets the other, too, that is
// left for later. [a, b] is the interval in the node, and then in the child. axes(tag) is the ray's axis of a node.
template <class Axes, class Stack>
GPURT_INLINE uint32_t near_kd_step(KdNode node, const Axes &axes, float width, float a, float &b,
                                   Stack &stack)
{
  const NearKdAxis axis = axes(node.tag);
  const float lower = fma(plane(node), axis.inverse, axis.shift);
  const float upper = lower + size_of(axis.inverse) * width;
  const uint32_t is_down = float_bits(axis.inverse) >> 31;
  const uint32_t near = payload(node) + is_down, far = payload(node) + (is_down ^ 1u);
  const bool meets_near = a <= upper;
  if (meets_near && lower <= b) stack.push(far, at_least(a, lower), b);
  b = meets_near ? at_most(b, upper) : b;
  return meets_near ? near : far;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
