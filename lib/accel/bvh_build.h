// Builds the bounding volume hierarchy of a group's triangles, or of boxes.
//
// Source: Wald 2007, binned SAH; Stich et al. 2009, spatial splits.
// Differs: parts of a split triangle are bounded by what is left of its polygon, rounded outward, so that every point of
// the triangle stays in a reference's box; references are bounded by a budget that is handed down the tree; where depth
// runs short, references are halved by their number; what splits place badly is put elsewhere in the end
// (bvh_reinsert.h).
#pragma once

#include "accel/kd_build.h"
#include "core/accel/bvh_node.h"

namespace gpurt {

struct HostBvh {
  std::vector<BvhNode> nodes;        // depth first
  std::vector<uint32_t> references;  // primitives, counted from the source's first, leaf by leaf
  Box bounds = {};
  BvhFrame frame = {};
  uint32_t root = bvh_empty;
};

struct BvhBuildStats {
  uint32_t depth = 0;  // inner nodes on the longest way to a leaf
  double sah_cost = 0;
};

/// References of a tree are at most this many times the primitives.
constexpr uint64_t bvh_max_references_per_primitive = 2;

/// Builds on the threads of the calling task arena; the tree does not depend on their number.
///
/// Degenerate triangles get no reference. Boxes are not split. A tree without primitives has no nodes.
/// Errors: OUT_OF_MEMORY; UNSUPPORTED for more primitives than a tree can refer to.
HostBvh build_bvh(const KdSource &source, const std::shared_ptr<MemoryTracker> &memory, BvhBuildStats &stats);

/// Boxes of a node's children as traversal sees them; they contain those that the node was made from.
struct BvhBoxes {
  double lo[2][3], hi[2][3];
};
BvhBoxes boxes_of(const BvhNode &node, const BvhFrame &frame);

}  // namespace gpurt
