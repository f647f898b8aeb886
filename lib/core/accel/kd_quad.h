// A kd-tree with two levels in a node of 16 bytes, one load: what the fast kernels of CUDA walk.
//
// A node's three planes are kept to 22 bits of the tree's extent, each with its axis and with what lies on its sides; what
// is empty is known without being read, and has no node. Children that are not empty lie one behind the other. Leaves name
// triangles by their places in a list that has each triangle once, in the order of leaves.
//
// Source: Aila and Laine 2009 on what a step costs; Wald and Havran 2006 for the trees.
//
// What has to hold is what kd_traverse.h says: every leaf that holds a triangle which the watertight test accepts is
// visited. Let eps = 2^-24, M the largest distance along an axis from the origin o to a point of the tree's bounds, R half
// their extent, E = 2 R the unit of planes, o' = o less the bounds' centre, i = 1/d_k, and b what distances are counted from.
// A plane is stored as f, 1 <= f < 2, and computed is s - w = fma(f, E i, w' - (o' + 3/2 E) i - b). Off by, times |d_k|:
// f by eps E / 2 from the code's steps of 2^-22 and its rounding; i by 2 eps of |p - o|; E i by eps 2 E; o' and its sum by
// 2 eps (|o'| + 3/2 E), the product by as much as half of that; b, of at most 5 M/|d_z|, by 5 eps M at each of two sums; the
// result by eps (M + 5 M). With |o'| + R <= M and R <= M that is below 44 eps M, and 8 eps M are the triangle test's. So
// with w = 64 eps M/|d_k| no leaf is left out.
#pragma once

#include "core/accel/kd_accel.h"
#include "core/accel/near_ray.h"

namespace gpurt {

// Inner node: word[0] is the plane and axis of the node itself, and two bits, of what lies below and above it: not empty.
// word[1] and word[2] are the same of its children below and above, with two fields of four bits, of what lies below and
// above their planes: kd_quad_full | kd_quad_leaf | place << 2, counted from slot word[3]. A child that is a leaf has axis 3
// and lies below it.
// Leaf: word[0] is the number of triangles; word[1] to word[3] are up to three triangles, else word[1] the first reference.
struct alignas(16) KdQuadNode {
  uint32_t word[4];
};

constexpr uint32_t kd_quad_full = 1, kd_quad_leaf = 2;
constexpr uint32_t kd_quad_inline_triangles = 3;

// Where a ray goes on: the index of a slot; whether that is a leaf; of an inner node, whether all of it, or the side below
// or above its plane.
constexpr uint32_t kd_quad_leaf_bit = 0x80000000u, kd_quad_above = 0x40000000u, kd_quad_below = 0x20000000u,
                   kd_quad_index = 0x0fffffffu;
constexpr uint32_t kd_quad_end = 0xffffffffu;
constexpr uint64_t kd_quad_max_nodes = kd_quad_index;

struct KdQuadView {
  const KdQuadNode *nodes;
  const uint32_t *references;  // of leaves with more than three triangles
  const LeafTriangle *triangles;
  Box bounds;
  BvhFrame frame;  // reach 0: there are no nodes, or no ray is near them
  uint32_t root;   // slot 0, a leaf or not
};

// What a plane's distance takes along an axis: less what has to be left to rounding.
struct KdQuadAxis {
  float scale, shift;
};

// A ray in the tree, but for its axes, which lie where they can be indexed: axis 3 is of planes that leave all below them.
struct KdQuadRay {
  KdQuadAxis axis[4];
  float width;  // of what is left to rounding, both ways, in units of |scale|
  float b;      // distances at which the ray is in the bounds are 0 to b, or a to b; a > b: never
  float a;
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE float kd_quad_unit(const BvhFrame &frame)
{
  return 2.0f * (frame.half_extent * (1.0f + 0x1p-20f));
}

GPURT_INLINE uint32_t kd_quad_plane(const BvhFrame &frame, float position, int axis)
{
  // The axis takes the lowest bit of the mantissa: planes come to the nearest one that has it.
  const double x = (double(position) - double(at(frame.center, axis))) / double(kd_quad_unit(frame)) + 0.5;
  const double code = (x * 0x1p23 - double(axis >> 1) + 1.0) * 0.5;
  const uint32_t last = (1u << 22) - 1;
  const uint32_t plane = code <= 0 ? 0 : code >= double(last) ? last : uint32_t(code);
  return plane << 10 | uint32_t(axis) << 8;
}
constexpr uint32_t kd_quad_no_plane = 3u << 8;

GPURT_INLINE float kd_quad_position(uint32_t word) { return float_from_bits(word >> 9 | 0x3f800000u); }
GPURT_INLINE uint32_t kd_quad_axis(uint32_t word) { return word >> 8 & 3u; }

// What rounding takes from the distance of a plane, and of the bounds.
GPURT_INLINE float kd_quad_widening(float inverse, const NearBegin &n)
{
  return n.farthest * 0x1p-18f * size_of(inverse) + 0x1p-146f;
}

// The part of a ray that is in the tree's bounds; a > b: none.
GPURT_INLINE void clip_to_bounds(const Ray &ray, const KdQuadView &tree, const NearRay &r, const NearBegin &n,
                                 float &a, float &b)
{
  a = 0.0f;
  b = ray.tmax + r.end_offset;
  const auto clip = [&](float inverse, float o, float below, float above) {
    const float widening = kd_quad_widening(inverse, n);
    const bool is_down = inverse < 0.0f;
    a = at_least(a, ((is_down ? above : below) - o) * inverse - n.begin - widening);
    b = at_most(b, ((is_down ? below : above) - o) * inverse - n.begin + widening);
  };
  const Vec3f below = tree.bounds.lo - tree.frame.center, above = tree.bounds.hi - tree.frame.center;
  clip(r.inverse.x, n.offset.x, below.x, above.x);
  clip(r.inverse.y, n.offset.y, below.y, above.y);
  clip(r.inverse.z, n.offset.z, below.z, above.z);
}

GPURT_INLINE KdQuadAxis kd_quad_axis_of(float inverse, float o, float unit, const NearBegin &n)
{
  return {inverse * unit, (-((o + 1.5f * unit) * inverse) - n.begin) - kd_quad_widening(inverse, n)};
}
// Of what is left to rounding, both ways, in units of |scale|.
GPURT_INLINE float kd_quad_width(float unit, const NearBegin &n)
{
  return n.farthest * 0x1p-17f * (1.0f + 0x1p-20f) * fast_reciprocal(unit);
}

// False for a ray that has to go the general way, misses among them. `r` is the ray as triangles are tested with it.
GPURT_INLINE bool make_kd_quad_ray(const Ray &ray, const KdQuadView &tree, NearRay &r, KdQuadRay &q)
{
  NearBegin n;
  if (!start_near_ray(ray, tree.frame, tree.frame.reach, r, n)) return false;
  begin_near_ray(ray.tmin, kd_quad_t_share, r, n);
  const float unit = kd_quad_unit(tree.frame);
  q.width = kd_quad_width(unit, n);
  clip_to_bounds(ray, tree, r, n, q.a, q.b);
  q.axis[0] = kd_quad_axis_of(r.inverse.x, n.offset.x, unit, n);
  q.axis[1] = kd_quad_axis_of(r.inverse.y, n.offset.y, unit, n);
  q.axis[2] = kd_quad_axis_of(r.inverse.z, n.offset.z, unit, n);
  q.axis[3] = {0.0f, infinity};
  return true;
}

// Where a plane cuts the ray: before `lower` all of it is near, beyond `upper` far.
struct KdQuadCut {
  float lower, upper;
  uint32_t is_down;  // 1: the ray points down the axis, near is above
};
GPURT_INLINE KdQuadCut kd_quad_cut(uint32_t word, KdQuadAxis axis, float width)
{
  const float lower = fma(kd_quad_position(word), axis.scale, axis.shift);
  return {lower, lower + size_of(axis.scale) * width, float_bits(axis.scale) >> 31};
}

GPURT_INLINE uint32_t kd_quad_child(uint32_t first, uint32_t field)
{
  return (first + (field >> 2 & 3u)) | (field << 30 & kd_quad_leaf_bit);
}

// Two levels: from a node, or one side of it, with the interval [a, b] to the nearest of its children that the ray meets;
// others are left for later. False where it meets none. axes(word) is the ray's axis of a plane.
template <class Axes, class Stack>
GPURT_INLINE bool kd_quad_step(const KdQuadNode &node, const Axes &axes, float width, uint32_t &current,
                               float &a, float &b, Stack &stack)
{
  uint32_t side = current >> 30;
  if ((current & (kd_quad_below | kd_quad_above)) == 0) {
    const KdQuadCut cut = kd_quad_cut(node.word[0], axes(node.word[0]), width);
    const bool near = a <= cut.upper && (node.word[0] >> cut.is_down & 1u) != 0;
    const bool far = cut.lower <= b && (node.word[0] >> (cut.is_down ^ 1u) & 1u) != 0;
    const float begin = at_least(a, cut.lower);
    if (near && far) stack.push(current | (cut.is_down != 0 ? kd_quad_below : kd_quad_above), begin, b);
    if (!near && !far) return false;
    a = near ? a : begin;
    b = near ? at_most(b, cut.upper) : b;
    side = near ? cut.is_down : cut.is_down ^ 1u;
  }
  const uint32_t word = side != 0 ? node.word[2] : node.word[1];
  const KdQuadCut cut = kd_quad_cut(word, axes(word), width);
  const uint32_t near_field = word >> 4 * cut.is_down, far_field = word >> (4 - 4 * cut.is_down);
  const bool near = a <= cut.upper && (near_field & kd_quad_full) != 0;
  const bool far = cut.lower <= b && (far_field & kd_quad_full) != 0;
  const float begin = at_least(a, cut.lower);
  if (near && far) stack.push(kd_quad_child(node.word[3], far_field), begin, b);
  if (!near && !far) return false;
  current = kd_quad_child(node.word[3], near ? near_field : far_field);
  a = near ? a : begin;
  b = near ? at_most(b, cut.upper) : b;
  return true;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
