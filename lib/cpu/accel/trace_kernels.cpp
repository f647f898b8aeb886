// Ray queries over kd-trees, once per instruction set.
//
// Leaves test four triangles at a time. The vector code only discards: what it keeps goes through the scalar test of
// lib/core, so that hits have the same bits in every variant and on every backend. It discards what the scalar test
// would: it computes the same edge functions with the same operations.
#include "core/accel/trace.h"
#include "cpu/accel/cpu_accel.h"
#include "cpu/accel/kd_view.h"
#include "cpu/kernels.h"

// Vectors are passed between inlined functions alone, so that no calling convention is concerned.
#pragma GCC diagnostic ignored "-Wpsabi"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

namespace {

typedef float Floats __attribute__((vector_size(16)));
typedef int32_t Ints __attribute__((vector_size(16)));
typedef double Doubles __attribute__((vector_size(32)));

GPURT_INLINE Floats load(const float (&x)[triangles_per_block])
{
  Floats v;
  __builtin_memcpy(&v, x, sizeof v);
  return v;
}
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

// Lanes whose edge functions do not have both signs.
GPURT_INLINE Ints keep_one_sign(Floats u, Floats v, Floats w)
{
  const Floats zero = {};
  return ~(((u < zero) | (v < zero) | (w < zero)) & ((u > zero) | (v > zero) | (w > zero)));
}

// Triangles of the block that the ray may hit within [tmin, limit].
GPURT_INLINE uint32_t candidates(const TriangleRay<TriangleTest::Watertight> &r, const TriangleBlock &block,
                                 float tmin, float limit)
{
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
  const Ints kept = keep_one_sign(u, v, w);
  if (lanes(kept) == 0) return 0;
  // t lies between the corners' distances along the main axis, each of which is rounded three times.
  const Floats ta = sz * az, tb = sz * bz, tc = sz * cz;
  const Floats first = least(ta, least(tb, tc)), last = largest(ta, largest(tb, tc));
  const Floats slack = broadcast(0x1p-21f);
  const Ints outside = ((first - magnitude(first) * slack) > broadcast(limit)) |
                       ((last + magnitude(last) * slack) < broadcast(tmin));
  return lanes(kept & ~outside);
}

GPURT_INLINE uint32_t candidates(const TriangleRay<TriangleTest::MollerTrumbore> &r,
                                 const TriangleBlock &block, float, float)
{
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

GPURT_INLINE uint32_t candidates(const TriangleRay<TriangleTest::Double> &r, const TriangleBlock &block,
                                 float, float)
{
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

GPURT_INLINE Vec3f corner_of(const TriangleBlock &block, int corner, uint32_t lane)
{
  return {block.corner[corner][0][lane], block.corner[corner][1][lane], block.corner[corner][2][lane]};
}

}  // namespace

GPURT_INLINE const KdTreeView &group_tree(const CpuKdView &accel, uint32_t group)
{
  return accel.groups[group].tree;
}

template <EdgeRule Rule, TriangleTest Test, class OnHit>
GPURT_INLINE bool test_leaf(const CpuKdView &accel, uint32_t group, uint32_t first, uint32_t count,
                            const TriangleRay<Test> &ray, float tmin, const float &limit,
                            const uint32_t &known, OnHit &&on_hit)
{
  const TriangleBlock *block = accel.groups[group].blocks + first;
  for (uint32_t left = count;; left -= triangles_per_block, ++block) {
    uint32_t mask = candidates(ray, *block, tmin, limit);
    if (left < triangles_per_block) mask &= (1u << left) - 1u;
    while (mask != 0) {
      const uint32_t lane = uint32_t(__builtin_ctz(mask));
      mask &= mask - 1u;
      const uint32_t triangle = block->triangle[lane];
      if (triangle == known) continue;
      TriangleHit hit;
      if (intersect<Rule>(ray, corner_of(*block, 0, lane), corner_of(*block, 1, lane),
                          corner_of(*block, 2, lane), tmin, limit, hit) &&
          on_hit(triangle, hit)) {
        return true;
      }
    }
    if (left <= triangles_per_block) return false;
  }
}

namespace {

template <TriangleTest Test, bool Masks, bool Placements>
struct Kernels {
  static const CpuKdView &view(const CpuAccel &accel) { return *static_cast<const CpuKdView *>(accel.impl); }

  static void closest(const CpuAccel &accel, const Ray *rays, Hit *hits, uint32_t n)
  {
    const CpuKdView &v = view(accel);
    for (uint32_t i = 0; i < n; ++i) hits[i] = trace_closest<Test, Masks, Placements>(v, v.scene, rays[i]);
  }
  static void occluded(const CpuAccel &accel, const Ray *rays, uint8_t *occluded, uint32_t n)
  {
    const CpuKdView &v = view(accel);
    for (uint32_t i = 0; i < n; ++i) occluded[i] = trace_any<Test, Masks, Placements>(v, v.scene, rays[i]);
  }
  static void all(const CpuAccel &accel, const Ray &ray, void *user, void (*sink)(void *, const Hit &))
  {
    const CpuKdView &v = view(accel);
    trace_all<Test, Masks, Placements>(v, v.scene, ray, [=](const Hit &hit) { sink(user, hit); });
  }
  static constexpr TraceKernels table = {closest, occluded, all};
};

template <TriangleTest Test>
struct KernelsOfTest {
  static constexpr TraceKernels table[2][2] = {
      {Kernels<Test, false, false>::table, Kernels<Test, false, true>::table},
      {Kernels<Test, true, false>::table, Kernels<Test, true, true>::table}};
};

}  // namespace

const TraceKernels &trace_kernels(TriangleTest test, bool masks, bool placements)
{
  switch (test) {
    case TriangleTest::MollerTrumbore:
      return KernelsOfTest<TriangleTest::MollerTrumbore>::table[masks][placements];
    case TriangleTest::Double:
      return KernelsOfTest<TriangleTest::Double>::table[masks][placements];
    default:
      return KernelsOfTest<TriangleTest::Watertight>::table[masks][placements];
  }
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
