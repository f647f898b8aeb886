// Gives every node and reference its place in the final tree, depth first, and writes the nodes above small subtrees.
#pragma once

#include "core/accel/bvh_node.h"
#include "cuda/accel/build/build_node.h"

namespace gpurt::cuda {

/// The final arrays.
struct BuildTarget {
  BvhNode *nodes;
  uint32_t *references;
};

GPURT_GROUP bool is_small(const BuildNode &node) { return node.child == invalid_id; }

/// The children in the order of the tree: that with the larger box comes first, since it is met more often.
GPURT_GROUP void order_children(const BuildNode *nodes, const BuildNode &node, float scale,
                                uint32_t (&child)[2])
{
  const float a = scaled_half_area(box_of(nodes[node.child].bounds), scale),
              b = scaled_half_area(box_of(nodes[node.child + 1].bounds), scale);
  child[0] = node.child + (b > a ? 1 : 0);
  child[1] = node.child + (b > a ? 0 : 1);
}

/// Adds up what is below a node whose children know it.
GPURT_GROUP void sum_up(BuildNode *nodes, uint32_t index, float scale)
{
  BuildNode &node = nodes[index];
  if (is_small(node)) return;
  const BuildNode &a = nodes[node.child], &b = nodes[node.child + 1];
  node.cost = scaled_half_area(box_of(node.bounds), scale) * build_traversal_cost + a.cost + b.cost;
  node.num_inner = 1 + a.num_inner + b.num_inner;
  node.num_references = a.num_references + b.num_references;
  node.height = 1 + max(a.height, b.height);
}

/// The word by which a parent refers to a node.
GPURT_GROUP uint32_t word_of(const BuildNode &node)
{
  return node.num_inner != 0 ? node.place_node : bvh_leaf(node.place_reference, node.num_references);
}

/// Places a node's children behind it and writes the node.
GPURT_GROUP void place_children(BuildNode *nodes, uint32_t index, float scale, const BvhFrame &frame,
                                const BuildTarget &target)
{
  const BuildNode &node = nodes[index];
  if (is_small(node)) return;
  uint32_t child[2];
  order_children(nodes, node, scale, child);
  BuildNode &a = nodes[child[0]], &b = nodes[child[1]];
  a.place_node = node.place_node + 1;
  a.place_reference = node.place_reference;
  b.place_node = a.place_node + a.num_inner;
  b.place_reference = a.place_reference + a.num_references;
  target.nodes[node.place_node] =
      make_bvh_node(box_of(a.bounds), word_of(a), box_of(b.bounds), word_of(b), frame);
}

/// Copies a small subtree to its place.
template <class Group>
GPURT_GROUP void place_small(const Group &group, const BuildNode &node, const BvhNode *nodes,
                             const uint32_t *triangles, const BuildTarget &target)
{
  const auto relocated = [&](uint32_t word) {
    return word + (is_bvh_leaf(word) ? node.place_reference : node.place_node);
  };
  for (uint32_t i = group.thread(); i < node.num_inner; i += group.size()) {
    BvhNode n = nodes[node.subtree + i];
    n.child0 = relocated(n.child0);
    n.child1 = relocated(n.child1);
    target.nodes[node.place_node + i] = n;
  }
  for (uint32_t i = group.thread(); i < node.num_references; i += group.size())
    target.references[node.place_reference + i] = triangles[node.subtree + i];
}

}  // namespace gpurt::cuda
