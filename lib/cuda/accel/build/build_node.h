// What the builder of bvhs works on: references to triangles, and nodes that are to be split.
#pragma once

#include "core/accel/bvh.h"
#include "cuda/accel/build/group.h"

namespace gpurt::cuda {

/// Bounds of a triangle, or of the part of one.
struct alignas(16) BuildReference {
  Vec3f lo;
  uint32_t triangle;  // counted from the group's first
  Vec3f hi;
  uint32_t reserved;
};

/// A box as ordered integers, for atomic minima and maxima.
struct OrderedBox {
  int lo[3], hi[3];
};

/// A node from its making to its place in the tree. Nodes of a level follow one another; children are made in pairs.
struct BuildNode {
  OrderedBox bounds, centers;  // of its references; centres: (lo + hi) / 2
  uint32_t first, count;       // its references in the level's array; small: see BuildLevel::small_nodes
  uint32_t depth;
  uint32_t spare;    // references that splits in space may add below it
  uint32_t child;    // and child + 1, once it is split; invalid_id: a small node, which a warp has built
  uint32_t subtree;  // small: where its nodes and references begin among those of all small nodes
  // What is below.
  float cost;  // in triangle tests times area
  uint32_t num_inner, num_references;
  uint32_t height;  // inner nodes on the longest way to a leaf
  // Where it begins in the final tree.
  uint32_t place_node, place_reference;
};

/// What all kernels of a build know.
struct BuildScene {
  const Vec3f *positions;
  const UInt3 *indices;  // of the group's triangles
};

/// Counters of a build, in device memory.
struct BuildCounters {
  OrderedBox bounds, centers;  // of all references
  uint32_t num_degenerate;
  uint32_t num_small_references;  // of all small nodes
  uint32_t num_nodes;
  // Of the level that is being made.
  uint32_t num_level_references;
  uint32_t num_of_class[4];
  // Of the level that is being split.
  uint32_t num_large, num_chunks;
  uint32_t num_spatial;  // nodes that blocks of one node each left to those that try splits in space
};

// Nodes of at most this size are built by one warp, larger ones split by one block or another, the largest ones by many.
constexpr uint32_t small_size = 32, medium_size = 512, block_node_size = 4096;
enum NodeClass : uint32_t { SmallNode, MediumNode, BlockNode, LargeNode };
// Of a step, in triangle tests, and the least overlap, as a share of the root's area, for which splits in space are tried:
// as the builder on the host has them.
constexpr float build_traversal_cost = 1.0f;
constexpr float build_min_overlap = 1e-4f;
// They are not where no reference spans this share of the node: there is hardly anything to cut. Trees of regular meshes
// take half the time by it, and no others change.
constexpr float build_min_wide_share = 0.3f;

/// A level's nodes on their way to the next one.
struct BuildLevel {
  BuildScene scene;
  const BuildReference *from;  // of this level's nodes
  BuildReference *to;          // of the next one's
  BuildNode *nodes;
  const uint32_t *list[4];  // this level's nodes by class, and the next one's; small ones are not listed
  uint32_t *next_list[4];
  uint32_t *spatial_list;  // see BuildCounters::num_spatial
  // Nodes and references of small nodes. Before it is built, a small node's references lie where its nodes will: from its
  // first one on, with room for as many nodes as there are references.
  BvhNode *small_nodes;
  uint32_t *small_references;
  BuildCounters *counters;
  float scale, root_area;
  BvhFrame frame;
};

/// Where a node's references lie, in an array that `level_array` is for all but small nodes.
GPURT_GROUP BuildReference *references_of(const BuildNode &node, BuildReference *level_array,
                                          BvhNode *small_nodes)
{
  static_assert(sizeof(BvhNode) >= sizeof(BuildReference) && alignof(BvhNode) >= alignof(BuildReference));
  return node.count <= small_size ? reinterpret_cast<BuildReference *>(small_nodes + node.subtree)
                                  : level_array + node.first;
}

GPURT_GROUP OrderedBox empty_ordered_box()
{
  constexpr int most = 0x7fffffff, least = -0x7fffffff - 1;
  return {{most, most, most}, {least, least, least}};
}
GPURT_GROUP Box box_of(const OrderedBox &b)
{
  return {{float_from_ordered(b.lo[0]), float_from_ordered(b.lo[1]), float_from_ordered(b.lo[2])},
          {float_from_ordered(b.hi[0]), float_from_ordered(b.hi[1]), float_from_ordered(b.hi[2])}};
}
GPURT_GROUP void extend_shared(OrderedBox &b, const Box &by)
{
  for (int k = 0; k < 3; ++k) {
    lower_to(&b.lo[k], ordered_from_float(at(by.lo, k)));
    raise_to(&b.hi[k], ordered_from_float(at(by.hi, k)));
  }
}
/// Every thread of the group brings a box, which may be empty.
template <class Group>
GPURT_GROUP void extend_by_all(const Group &group, OrderedBox &b, const Box &by)
{
  for (int k = 0; k < 3; ++k) {
    group.lower_all(&b.lo[k], ordered_from_float(at(by.lo, k)));
    group.raise_all(&b.hi[k], ordered_from_float(at(by.hi, k)));
  }
}

GPURT_GROUP NodeClass class_of(uint32_t count)
{
  return count <= small_size        ? SmallNode
         : count <= medium_size     ? MediumNode
         : count <= block_node_size ? BlockNode
                                    : LargeNode;
}

/// Half the area of a box, measured in units that keep it in range: `scale` is a power of two.
GPURT_GROUP float scaled_half_area(const Box &b, float scale)
{
  const float x = b.hi.x * scale - b.lo.x * scale, y = b.hi.y * scale - b.lo.y * scale,
              z = b.hi.z * scale - b.lo.z * scale;
  return x * y + y * z + z * x;
}
/// Brings the largest extent of the bounds to 1/4 to 1.
GPURT_GROUP float area_scale(const Box &bounds)
{
  const float largest = max_component(0.5f * bounds.hi - 0.5f * bounds.lo);
  const int exponent = int(float_bits(largest) >> 23) - 127;
  return float_from_bits(uint32_t(127 + max(-126, min(127, -2 - exponent))) << 23);
}

/// Halving by number alone still reaches single references from here, and depth does not allow more.
GPURT_GROUP bool must_halve(uint32_t count, uint32_t depth)
{
  const uint32_t left = uint32_t(bvh_max_depth) - depth;
  return left < 32 && count > 1 && (uint64_t(count - 1) >> (left - (left != 0))) != 0;
}

GPURT_GROUP BuildReference load_reference(const BuildReference *p)
{
#if defined(__CUDA_ARCH__)
  const float4 *q = reinterpret_cast<const float4 *>(p);
  const float4 a = q[0], b = q[1];
  return {{a.x, a.y, a.z}, __float_as_uint(a.w), {b.x, b.y, b.z}, 0};
#else
  return *p;
#endif
}
GPURT_GROUP void store_reference(BuildReference *p, const BuildReference &r)
{
#if defined(__CUDA_ARCH__)
  float4 *q = reinterpret_cast<float4 *>(p);
  q[0] = make_float4(r.lo.x, r.lo.y, r.lo.z, __uint_as_float(r.triangle));
  q[1] = make_float4(r.hi.x, r.hi.y, r.hi.z, 0.0f);
#else
  *p = r;
#endif
}
GPURT_GROUP Vec3f center_of(const BuildReference &r) { return 0.5f * r.lo + 0.5f * r.hi; }

}  // namespace gpurt::cuda
