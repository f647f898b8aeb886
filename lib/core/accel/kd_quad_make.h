// How two levels of a kd-tree become a node of kd_quad.h.
#pragma once

#include "core/accel/kd_quad.h"

namespace gpurt {

// What lies below a node and its children, and is not an empty leaf.
struct KdQuadChildren {
  uint32_t node[4];      // of the tree; the first `count`
  uint32_t field[2][2];  // by side of the node, then of its child: see KdQuadNode
  uint32_t count;
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE void add_kd_quad_child(const KdNode *nodes, uint32_t index, KdQuadChildren &c, uint32_t &field)
{
  const KdNode child = nodes[index];
  if (is_leaf(child) && payload(child) == 0) return;
  field = kd_quad_full | (is_leaf(child) ? kd_quad_leaf : 0u) | c.count << 2;
  c.node[c.count++] = index;
}

GPURT_INLINE KdQuadChildren kd_quad_children(const KdNode *nodes, KdNode node)
{
  KdQuadChildren c = {};
  if (is_leaf(node)) return c;
  for (uint32_t side = 0; side < 2; ++side) {
    const uint32_t index = payload(node) + side;
    const KdNode child = nodes[index];
    if (is_leaf(child)) {
      add_kd_quad_child(nodes, index, c, c.field[side][0]);
    } else {
      add_kd_quad_child(nodes, payload(child), c, c.field[side][0]);
      add_kd_quad_child(nodes, payload(child) + 1, c, c.field[side][1]);
    }
  }
  return c;
}

// `first` is the slot of its first child; places[i] that of the triangle of reference i in the list of triangles.
GPURT_INLINE KdQuadNode make_kd_quad_node(const KdNode *nodes, uint32_t index, uint32_t first,
                                          const uint32_t *places, const BvhFrame &frame)
{
  const KdNode node = nodes[index];
  KdQuadNode quad = {};
  if (is_leaf(node)) {
    const uint32_t count = payload(node);
    quad.word[0] = count;
    if (count > kd_quad_inline_triangles) {
      quad.word[1] = node.word;
    } else {
      for (uint32_t k = 0; k < count; ++k) quad.word[1 + k] = places[node.word + k];
    }
    return quad;
  }
  const KdQuadChildren c = kd_quad_children(nodes, node);
  quad.word[0] = kd_quad_plane(frame, plane(node), axis(node));
  for (uint32_t side = 0; side < 2; ++side) {
    const KdNode child = nodes[payload(node) + side];
    if (((c.field[side][0] | c.field[side][1]) & kd_quad_full) != 0) quad.word[0] |= 1u << side;
    quad.word[1 + side] =
        (is_leaf(child) ? kd_quad_no_plane : kd_quad_plane(frame, plane(child), axis(child))) |
        c.field[side][0] | c.field[side][1] << 4;
  }
  quad.word[3] = first;
  return quad;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
