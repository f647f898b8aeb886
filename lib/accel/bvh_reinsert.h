// Improves a finished hierarchy: subtrees that are badly placed are taken out and put where they cost least.
//
// Splits go from the top down, and cannot see that a primitive as wide as the scene, a floor, say, sinks to the side of small
// ones and makes all boxes above it wide. Taking it out and searching the whole tree for its best place can.
//
// Source: Bittner et al. 2013, insertion-based optimisation; Meister and Bittner 2018 for candidates.
// Differs: nodes hold their children's boxes, so that a subtree is known by the place it hangs at; the depth is bounded.
#pragma once

#include <cstdint>

#include "core/accel/bvh.h"

namespace gpurt {

/// A node while its tree is built: as BvhNode, before boxes are rounded.
struct BvhBuildNode {
  Box box[2];
  uint32_t child[2];
};

constexpr uint64_t reinsert_bytes_per_node = 5;

/// Moves the subtrees with the largest boxes to where the boxes' areas add up to least. Leaves stay what they are; no way
/// to a leaf becomes longer than bvh_max_depth. `nodes` are all of the tree's, parents before children; afterwards they are
/// in no order. The root stays at its place. One thread; takes reinsert_bytes_per_node, and a few MiB at most.
void reinsert(BvhBuildNode *nodes, uint64_t count, uint32_t root);

}  // namespace gpurt
