// Boxes to nodes: the one place that knows how a node rounds.
#pragma once

#include "core/accel/bvh.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

// The least bfloat16 that is not below x >= 0; infinity beyond the largest.
GPURT_INLINE uint32_t round_half_up(double x)
{
  float f = float(x);
  if (double(f) < x) f = next_up(f);
  return (float_bits(f) + 0xffffu) >> 16;
}

// An interval counted from `origin`, larger by `margin` on each side: its middle, and its half extent as a bfloat16,
// rounded up.
GPURT_INLINE void make_slab(float lo, float hi, float origin, double margin, float &center, uint32_t &half)
{
  // Differences of floats in double are rounded by at most 2^-53 of their size.
  const double below = double(lo) - double(origin), above = double(hi) - double(origin);
  center = float((below + above) * 0.5);
  const double rounding = (abs(below) + abs(above)) * 0x1p-52;
  const double up = above - double(center), down = double(center) - below;
  half = round_half_up((up < down ? down : up) + rounding + margin);
}

// A node over two boxes, which it contains with the frame's margin.
GPURT_HD inline BvhNode make_bvh_node(const Box &box0, uint32_t child0, const Box &box1, uint32_t child1,
                                      const BvhFrame &frame)
{
  BvhNode node = {};
  node.child0 = child0;
  node.child1 = child1;
  const double margin = double(frame.reach) * bvh_margin;
  for (int k = 0; k < 3; ++k) {
    float middle0, middle1;
    uint32_t half0, half1;
    const float origin = at(frame.center, k);
    make_slab(at(box0.lo, k), at(box0.hi, k), origin, margin, middle0, half0);
    make_slab(at(box1.lo, k), at(box1.hi, k), origin, margin, middle1, half1);
    set(node.center0, k, middle0);
    set(node.center1, k, middle1);
    node.half[k] = half0 << 16 | half1;
  }
  return node;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
