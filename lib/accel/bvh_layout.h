// From a tree as it is built to the tree as it is traversed.
#pragma once

#include "accel/bvh_build.h"
#include "accel/bvh_reinsert.h"
#include "accel/tracked_array.h"

namespace gpurt {

/// A whole tree before its boxes are rounded, in any order.
struct BvhBuildTree {
  uint32_t root = bvh_empty;
  TrackedArray<BvhBuildNode> nodes;
  TrackedArray<uint32_t> references;
};

/// Fills `tree`, whose bounds and frame are known: depth first, of two children the one with the larger box first, since it is
/// met more often where the order does not matter. Uses up `whole`.
///
/// @param traversal_cost  Of a step, in tests of a primitive, for the statistics.
/// Errors: OUT_OF_MEMORY.
void lay_out_bvh(BvhBuildTree &whole, double traversal_cost, const std::shared_ptr<MemoryTracker> &memory,
                 HostBvh &tree, BvhBuildStats &stats);

}  // namespace gpurt
