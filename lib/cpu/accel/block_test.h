// Leaves of the CPU's trees: four triangles at a time.
//
// The vector code only discards: what it keeps goes through the scalar test of lib/core, so that hits have the same bits
// in every instruction set and on every backend. It discards what the scalar test would: it computes the same edge
// functions with the same operations.
#pragma once

#include "core/accel/trace.h"
#include "cpu/accel/bvh_view.h"
#include "cpu/accel/kd_view.h"

// Vectors are passed between inlined functions alone, so that no calling convention is concerned.
#pragma GCC diagnostic ignored "-Wpsabi"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

namespace block {

typedef float Floats __attribute__((vector_size(16)));
typedef int32_t Ints __attribute__((vector_size(16)));
typedef double Doubles __attribute__((vector_size(32)));

GPURT_INLINE Floats load(const float (&x)[triangles_per_block])
{
  Floats v;
  __builtin_memcpy(&v, x, sizeof v);
  return v;
}
GPURT_INLINE void store(Floats v, float (&x)[triangles_per_block]) { __builtin_memcpy(x, &v, sizeof v); }
GPURT_INLINE Floats broadcast(float x) { return Floats{x, x, x, x}; }
GPURT_INLINE Doubles to_doubles(Floats x) { return __builtin_convertvector(x, Doubles); }

// Bit i: the lane is not 0.
GPURT_INLINE uint32_t lanes(Ints mask)
{
#if defined(__SSE__)
  return uint32_t(__builtin_ia32_movmskps(Floats(mask)));
#else
  return (mask[0] & 1) | (mask[1] & 2) | (mask[2] & 4) | (mask[3] & 8);
#endif
}

GPURT_INLINE Floats least(Floats a, Floats b) { return Floats((Ints(a) & (a < b)) | (Ints(b) & ~(a < b))); }
GPURT_INLINE Floats largest(Floats a, Floats b) { return Floats((Ints(a) & (a > b)) | (Ints(b) & ~(a > b))); }
GPURT_INLINE Floats magnitude(Floats a) { return Floats(Ints(a) & 0x7fffffff); }

GPURT_INLINE Vec3f corner_of(const TriangleBlock &block, int corner, uint32_t lane)
{
  return {block.corner[corner][0][lane], block.corner[corner][1][lane], block.corner[corner][2][lane]};
}

}  // namespace block

// A ray against one block: find() says which triangles it may hit within [tmin, limit], hit() decides on one of them.
template <TriangleTest Test>
struct BlockTest;

template <>
struct BlockTest<TriangleTest::Watertight> {
  using Ray = TriangleRay<TriangleTest::Watertight>;

  GPURT_INLINE uint32_t find(const Ray &r, const TriangleBlock &block, float tmin, float limit)
  {
    using namespace block;
    const Floats ox = broadcast(at(r.origin, r.kx)), oy = broadcast(at(r.origin, r.ky)),
                 oz = broadcast(at(r.origin, r.kz));
    const Floats sx = broadcast(r.sx), sy = broadcast(r.sy), sz = broadcast(r.sz);
    const Floats az = load(block.corner[0][r.kz]) - oz, bz = load(block.corner[1][r.kz]) - oz,
                 cz = load(block.corner[2][r.kz]) - oz;
    const Floats ax = (load(block.corner[0][r.kx]) - ox) - sx * az,
                 ay = (load(block.corner[0][r.ky]) - oy) - sy * az;
    const Floats bx = (load(block.corner[1][r.kx]) - ox) - sx * bz,
                 by = (load(block.corner[1][r.ky]) - oy) - sy * bz;
    const Floats cx = (load(block.corner[2][r.kx]) - ox) - sx * cz,
                 cy = (load(block.corner[2][r.ky]) - oy) - sy * cz;
    const Floats u = cx * by - cy * bx, v = ax * cy - ay * cx, w = bx * ay - by * ax;
    const Floats zero = {};
    const Ints u_below = u < zero, v_below = v < zero, w_below = w < zero;
    const Ints u_above = u > zero, v_above = v > zero, w_above = w > zero;
    const uint32_t kept = lanes(~((u_below | v_below | w_below) & (u_above | v_above | w_above)));
    if (kept == 0) return 0;
    decided = lanes((u_below | u_above) & (v_below | v_above) & (w_below | w_above));
    // t lies between the corners' distances along the main axis, each of which is rounded three times.
    const Floats ta = sz * az, tb = sz * bz, tc = sz * cz;
    const Floats first = least(ta, least(tb, tc)), last = largest(ta, largest(tb, tc));
    const Floats slack = broadcast(0x1p-21f);
    return kept & ~lanes(((first - magnitude(first) * slack) > broadcast(limit)) |
                         ((last + magnitude(last) * slack) < broadcast(tmin)));
  }

  template <EdgeRule Rule>
  GPURT_INLINE bool hit(const Ray &r, const TriangleBlock &block, uint32_t lane, float tmin, float limit,
                        TriangleHit &h) const
  {
    const Vec3f a = block::corner_of(block, 0, lane), b = block::corner_of(block, 1, lane),
                c = block::corner_of(block, 2, lane);
    // Where no edge function is 0 the scalar test goes straight on to measure.
    if (decided >> lane & 1u) return measure_accepted(r, a, b, c, tmin, limit, h);
    return intersect<Rule>(r, a, b, c, tmin, limit, h);
  }

  uint32_t decided;
};

template <TriangleTest Test>
struct ScalarDecision {
  template <EdgeRule Rule>
  GPURT_INLINE bool hit(const TriangleRay<Test> &r, const TriangleBlock &block, uint32_t lane, float tmin,
                        float limit, TriangleHit &h) const
  {
    return intersect<Rule>(r, block::corner_of(block, 0, lane), block::corner_of(block, 1, lane),
                           block::corner_of(block, 2, lane), tmin, limit, h);
  }
};

template <>
struct BlockTest<TriangleTest::MollerTrumbore> : ScalarDecision<TriangleTest::MollerTrumbore> {
  GPURT_INLINE uint32_t find(const TriangleRay<TriangleTest::MollerTrumbore> &r, const TriangleBlock &block,
                             float, float)
  {
    using namespace block;
    const Floats dx = broadcast(r.direction.x), dy = broadcast(r.direction.y), dz = broadcast(r.direction.z);
    const Floats ax = load(block.corner[0][0]), ay = load(block.corner[0][1]), az = load(block.corner[0][2]);
    const Floats e1x = load(block.corner[1][0]) - ax, e1y = load(block.corner[1][1]) - ay,
                 e1z = load(block.corner[1][2]) - az;
    const Floats e2x = load(block.corner[2][0]) - ax, e2y = load(block.corner[2][1]) - ay,
                 e2z = load(block.corner[2][2]) - az;
    const Floats sx = broadcast(r.origin.x) - ax, sy = broadcast(r.origin.y) - ay,
                 sz = broadcast(r.origin.z) - az;
    const Floats px = dy * e2z - dz * e2y, py = dz * e2x - dx * e2z, pz = dx * e2y - dy * e2x;
    const Floats det = e1x * px + e1y * py + e1z * pz;
    const Floats u = sx * px + sy * py + sz * pz;
    const Floats qx = sy * e1z - sz * e1y, qy = sz * e1x - sx * e1z, qz = sx * e1y - sy * e1x;
    const Floats v = dx * qx + dy * qy + dz * qz;
    const Floats zero = {};
    const Ints front = (det > zero) & (u >= zero) & (v >= zero) & ((u + v) <= det);
    const Ints back = (det < zero) & (u <= zero) & (v <= zero) & ((u + v) >= det);
    return lanes(front | back);
  }
};

template <>
struct BlockTest<TriangleTest::Double> : ScalarDecision<TriangleTest::Double> {
  GPURT_INLINE uint32_t find(const TriangleRay<TriangleTest::Double> &r, const TriangleBlock &block, float,
                             float)
  {
    using namespace block;
    const double o[3] = {r.origin.x, r.origin.y, r.origin.z};
    const Doubles az = to_doubles(load(block.corner[0][r.kz])) - o[r.kz],
                  bz = to_doubles(load(block.corner[1][r.kz])) - o[r.kz],
                  cz = to_doubles(load(block.corner[2][r.kz])) - o[r.kz];
    const Doubles ax = (to_doubles(load(block.corner[0][r.kx])) - o[r.kx]) - r.sx * az,
                  ay = (to_doubles(load(block.corner[0][r.ky])) - o[r.ky]) - r.sy * az;
    const Doubles bx = (to_doubles(load(block.corner[1][r.kx])) - o[r.kx]) - r.sx * bz,
                  by = (to_doubles(load(block.corner[1][r.ky])) - o[r.ky]) - r.sy * bz;
    const Doubles cx = (to_doubles(load(block.corner[2][r.kx])) - o[r.kx]) - r.sx * cz,
                  cy = (to_doubles(load(block.corner[2][r.ky])) - o[r.ky]) - r.sy * cz;
    const Doubles u = cx * by - cy * bx, v = ax * cy - ay * cx, w = bx * ay - by * ax;
    const Doubles zero = {};
    const auto kept = ~(((u < zero) | (v < zero) | (w < zero)) & ((u > zero) | (v > zero) | (w > zero)));
    return lanes(__builtin_convertvector(kept, Ints));
  }
};

// Tests the triangles of a leaf, `count` of them from the first of `blocks` on; see test_triangles of kd_accel.h.
template <EdgeRule Rule, TriangleTest Test, class OnHit>
GPURT_INLINE bool test_blocks(const TriangleBlock *blocks, uint32_t count, const TriangleRay<Test> &ray,
                              float tmin, const float &limit, const uint32_t &known, OnHit &&on_hit)
{
  for (uint32_t left = count;; left -= triangles_per_block, ++blocks) {
    BlockTest<Test> test;
    uint32_t mask = test.find(ray, *blocks, tmin, limit);
    if (left < triangles_per_block) mask &= (1u << left) - 1u;
    while (mask != 0) {
      const uint32_t lane = uint32_t(__builtin_ctz(mask));
      mask &= mask - 1u;
      const uint32_t triangle = blocks->triangle[lane];
      if (triangle == known) continue;
      TriangleHit hit;
      if (test.template hit<Rule>(ray, *blocks, lane, tmin, limit, hit) && on_hit(triangle, hit)) return true;
    }
    if (left <= triangles_per_block) return false;
  }
}

GPURT_INLINE const KdTreeView &group_tree(const CpuKdView &accel, uint32_t group)
{
  return accel.groups[group].tree;
}
GPURT_INLINE const BvhView &group_tree(const CpuBvhView &accel, uint32_t group)
{
  return accel.groups[group].tree;
}

// Of either view.
template <EdgeRule Rule, TriangleTest Test, class Accel, class OnHit>
GPURT_INLINE bool test_leaf(const Accel &accel, uint32_t group, uint32_t first, uint32_t count,
                            const TriangleRay<Test> &ray, float tmin, const float &limit,
                            const uint32_t &known, OnHit &&on_hit)
{
  return test_blocks<Rule>(accel.groups[group].blocks + first, count, ray, tmin, limit, known, on_hit);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
