// The inner loops of the kd-tree builder, which are compiled once per instruction set.
#pragma once

#include "accel/kd_reference.h"

namespace gpurt {

// The exact best split of up to this many references is found by counting for every candidate plane.
constexpr uint32_t kd_small_count = 64;

struct KdBuildKernels {
  /// The best split of at most kd_small_count references with at most `budget` references in both children.
  KdSplit (*find_small_split)(const KdReference *references, uint32_t count, const Box &cell,
                              const KdCost &cost, uint64_t budget);
  /// Adds references to the counts.
  void (*count_bins)(const KdReference *references, uint64_t count, KdBins &bins);
};

/// The variant of this name (isa.h), which must exist.
const KdBuildKernels &kd_build_kernels(const char *isa);

}  // namespace gpurt
