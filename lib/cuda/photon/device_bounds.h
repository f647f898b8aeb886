// Bounds of points in device memory, which warps extend with atomics.
#pragma once

#include "core/math/vec.h"
#include "cuda/warp_reduce.h"

namespace gpurt::cuda {

/// How far points reach along each axis, and against it, as integers of the floats' order. All bits 0: no points.
struct DeviceBounds {
  uint32_t reach[6];
};

// Bits that are ordered as the floats are.
GPURT_INLINE uint32_t ordered_bits(float x)
{
  const uint32_t bits = float_bits(x);
  return (bits & 0x80000000u) != 0 ? ~bits : bits | 0x80000000u;
}
GPURT_INLINE float from_ordered_bits(uint32_t bits)
{
  return float_from_bits((bits & 0x80000000u) != 0 ? bits & 0x7fffffffu : ~bits);
}

inline Box bounds_of(const DeviceBounds &bounds)
{
  if (bounds.reach[0] == 0) return empty_box();
  const auto reach = [&](int k) { return from_ordered_bits(bounds.reach[k]); };
  return {{-reach(3), -reach(4), -reach(5)}, {reach(0), reach(1), reach(2)}};
}

#if defined(__CUDACC__)

// Extends `bounds` by a box of each lane of a warp, all of which must come here. Empty boxes do not matter.
__device__ __forceinline__ void extend_bounds(DeviceBounds *bounds, const Box &box)
{
  const uint32_t reach[6] = {warp_max(ordered_bits(box.hi.x)),  warp_max(ordered_bits(box.hi.y)),
                             warp_max(ordered_bits(box.hi.z)),  warp_max(ordered_bits(-box.lo.x)),
                             warp_max(ordered_bits(-box.lo.y)), warp_max(ordered_bits(-box.lo.z))};
  const unsigned lane = threadIdx.x % 32;
  uint32_t mine = 0;
  for (unsigned k = 0; k < 6; ++k) mine = lane == k ? reach[k] : mine;
  // Few warps reach farther than those before them. A look at what the multiprocessor has in its cache, which may be old, tells
  // most of them; one at what all have, most others: so many loads or atomics of one place take their time.
  if (lane >= 6 || mine <= __ldca(&bounds->reach[lane])) return;
  if (mine > __ldcg(&bounds->reach[lane])) atomicMax(&bounds->reach[lane], mine);
}

#endif

}  // namespace gpurt::cuda
