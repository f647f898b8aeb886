// The bounding volume hierarchy in memory: a node holds the boxes of both of its children.
//
// 48 bytes, three 16-byte loads: boxes as centres in float and half extents in bfloat16, rounded up; what a child is
// stands in its word, so that no leaf has a node of its own.
#pragma once

#include "core/math/vec.h"

namespace gpurt {

// Builders keep this depth, so that a traversal stack of as many entries cannot overflow.
constexpr int bvh_max_depth = 64;

// A child's word. Inner: the index of its node. Leaf: bvh_leaf_bit | (count - 1) << 28 | first reference.
constexpr uint32_t bvh_leaf_bit = 0x80000000u;
constexpr uint32_t bvh_max_leaf_size = 8;
constexpr uint32_t bvh_max_references = (1u << 28) - 2;
constexpr uint32_t bvh_empty = 0xffffffffu;  // no leaf has this word; it marks the end of a stack, too

struct alignas(16) BvhNode {
  Vec3f center0;  // less that of the tree
  uint32_t child0;
  Vec3f center1;
  uint32_t child1;
  uint32_t
      half[3];  // half extents along each axis: of child 0 in the upper 16 bits, of child 1 in the lower ones
  uint32_t reserved;
};

// What a tree's nodes count from. Boxes are stored larger by bvh_margin on each side, which is what traversal may be off by for a
// ray whose origin is within half of `reach` of all of the tree along each axis (near_ray.h). A ray that starts on a surface
// meets the boxes of what lies within the margin around it, so that both are no larger than they have to be.
struct BvhFrame {
  Vec3f center;       // coordinates far from the origin cost no bits
  float half_extent;  // the largest distance from the centre along an axis, or a little more
  float reach;        // 0: sizes are so large or small that products might lose bits; no ray is near
};

constexpr double bvh_margin = 0x1.4p-21;  // of reach

struct BvhView {
  const BvhNode *nodes;
  const uint32_t *references;  // by leaf; null where leaves hold their triangles
  Box bounds;
  BvhFrame frame;
  uint32_t root;  // a child's word; bvh_empty: the tree is empty
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE BvhFrame make_bvh_frame(const Box &bounds)
{
  const Vec3f center = 0.5f * bounds.lo + 0.5f * bounds.hi;
  const float half_extent =
      max(max_component(bounds.hi - center), max_component(center - bounds.lo)) * (1.0f + 0x1p-22f);
  const bool is_ordinary = half_extent >= 0x1p-50f && half_extent <= 0x1p45f;
  return {center, half_extent, is_ordinary ? 16.0f * half_extent : 0.0f};
}

GPURT_INLINE bool is_bvh_leaf(uint32_t child) { return (child & bvh_leaf_bit) != 0; }
GPURT_INLINE uint32_t leaf_first(uint32_t child) { return child & 0x0fffffffu; }
GPURT_INLINE uint32_t leaf_size(uint32_t child) { return (child >> 28 & 7u) + 1u; }
GPURT_INLINE uint32_t bvh_leaf(uint32_t first, uint32_t count)
{
  return bvh_leaf_bit | (count - 1) << 28 | first;
}

// Child 0's is read with child 1's bits below it: larger by less than the last bit of a bfloat16, which is allowed.
GPURT_INLINE float half0(uint32_t bits) { return float_from_bits(bits); }
GPURT_INLINE float half1(uint32_t bits) { return float_from_bits(bits << 16); }

GPURT_FUNCTIONS_END
}  // namespace gpurt
