// Builds the SAH kd-tree of a group's triangles, or of boxes.
//
// Source: Wald and Havran 2006: exact sweep over clipped bounds (perfect splits), empty-space bonus.
// Differs: splits are found by branch and bound over counts (kd_split.h) rather than by a sorted list of events that
// every split takes apart; the number of references is bounded by a budget that is handed down the tree.
#pragma once

#include "backend.h"

namespace gpurt {

/// What a tree is built over. References count from 0.
struct KdSource {
  uint64_t count = 0;
  const Vec3f *positions = nullptr;  // triangles: their corners are positions[indices[i]]
  const UInt3 *indices = nullptr;
  const Box *boxes = nullptr;  // or boxes
};

struct KdBuildSettings {
  uint32_t max_depth = 0;    // 0: 8 + 1.3 log2 N, at most kd_max_depth
  float traversal_cost = 0;  // of a step, in tests of a primitive; 0: the default
  float empty_bonus = 0;     // 0: the default; negative: none
};

struct KdBuildStats {
  uint32_t depth = 0;
  double sah_cost = 0;
};

// Of CPUs, where a step waits for memory and leaves test four triangles at a time: a cost of 1 traces 1 to 9 % slower there.
// The bonus matters by 1 to 3 %. See bench_trace.
constexpr float kd_default_traversal_cost = 2.0f;
constexpr float kd_default_empty_bonus = 0.2f;

/// References of a tree are at most this many times the primitives.
constexpr uint64_t kd_max_references_per_primitive = 8;

/// Builds on the threads of the calling task arena; the tree does not depend on their number.
///
/// Degenerate triangles get no reference. A tree without primitives has no nodes.
/// Errors: OUT_OF_MEMORY; UNSUPPORTED for more primitives than a tree can refer to.
HostKdTree build_kd_tree(const KdSource &source, const KdBuildSettings &settings,
                         const std::shared_ptr<MemoryTracker> &memory, KdBuildStats &stats);

/// True where the corners lie on one line, exactly.
bool is_degenerate(Vec3f a, Vec3f b, Vec3f c);

}  // namespace gpurt
