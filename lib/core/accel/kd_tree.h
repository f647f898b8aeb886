// The kd-tree in memory: eight-byte nodes, children side by side.
#pragma once

#include "core/math/vec.h"

namespace gpurt {

// Builders and import keep this depth, so that a traversal stack of as many entries cannot overflow.
constexpr int kd_max_depth = 48;

// The layout of gpurt_kdtree_node. Inner: `word` is the bits of the plane, `tag` = first child << 2 | axis; the child
// below the plane is first, the one above follows it. Leaf: `word` is the first reference, `tag` = count << 2 | 3.
// Aligned, so that one load reads it.
struct alignas(8) KdNode {
  uint32_t word;
  uint32_t tag;
};

struct KdTreeView {
  const KdNode *nodes;         // the root is node 0; no nodes: the tree is empty
  const uint32_t *references;  // triangles, counted from the group's first
  Box bounds;
  uint32_t num_nodes;
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE bool is_leaf(KdNode n) { return (n.tag & 3u) == 3u; }
GPURT_INLINE int axis(KdNode n) { return int(n.tag & 3u); }
GPURT_INLINE uint32_t payload(KdNode n) { return n.tag >> 2; }  // first child, or number of references
GPURT_INLINE float plane(KdNode n) { return float_from_bits(n.word); }

GPURT_FUNCTIONS_END
}  // namespace gpurt
