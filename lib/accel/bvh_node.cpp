// Boxes to nodes and back.
#include <algorithm>
#include <cmath>

#include "accel/bvh_build.h"

namespace gpurt {
namespace {

// The least bfloat16 that is not below x >= 0; infinity beyond the largest.
uint32_t round_half_up(double x)
{
  float f = float(x);
  if (double(f) < x) f = next_up(f);
  return (float_bits(f) + 0xffffu) >> 16;
}

struct Slab {
  float center;
  uint32_t half;
};

Slab make_slab(float lo, float hi, float origin)
{
  // Differences of floats in double are rounded by at most 2^-53 of their size.
  const double below = double(lo) - origin, above = double(hi) - origin;
  const float center = float((below + above) * 0.5);
  const double margin = (std::abs(below) + std::abs(above)) * 0x1p-52;
  return {center, round_half_up(std::max(above - center, center - below) + margin)};
}

}  // namespace

BvhNode make_bvh_node(const Box &box0, uint32_t child0, const Box &box1, uint32_t child1, Vec3f center)
{
  BvhNode node = {};
  node.child0 = child0;
  node.child1 = child1;
  for (int k = 0; k < 3; ++k) {
    const Slab first = make_slab(at(box0.lo, k), at(box0.hi, k), at(center, k));
    const Slab second = make_slab(at(box1.lo, k), at(box1.hi, k), at(center, k));
    set(node.center0, k, first.center);
    set(node.center1, k, second.center);
    node.half[k] = first.half << 16 | second.half;
  }
  return node;
}

BvhBoxes boxes_of(const BvhNode &node, Vec3f center)
{
  BvhBoxes boxes;
  for (int k = 0; k < 3; ++k) {
    // The smallest that child 0 can be read as.
    const double half[2] = {float_from_bits(node.half[k] & 0xffff0000u), half1(node.half[k])};
    const double middle[2] = {double(at(node.center0, k)) + at(center, k),
                              double(at(node.center1, k)) + at(center, k)};
    for (int c = 0; c < 2; ++c) {
      boxes.lo[c][k] = middle[c] - half[c];
      boxes.hi[c][k] = middle[c] + half[c];
    }
  }
  return boxes;
}

}  // namespace gpurt
