// The hot loops that are compiled once per instruction set, and the choice between them at run time.
#pragma once

#include "core/accel/ray.h"

namespace gpurt {

struct KdReference;
struct KdSplit;
struct KdCost;
struct KdBins;
struct TraceKernels;

// The exact best split of up to this many references is found by counting for every candidate plane.
constexpr uint32_t kd_small_count = 64;

struct KdBuildKernels {
  /// The best split of at most kd_small_count references with at most `budget` references in both children.
  KdSplit (*find_small_split)(const KdReference *references, uint32_t count, const Box &cell,
                              const KdCost &cost, uint64_t budget);
  /// Adds references to the counts.
  void (*count_bins)(const KdReference *references, uint64_t count, KdBins &bins);
};

struct CpuKernels {
  const char *isa;
  KdBuildKernels build;
  const TraceKernels &(*trace)(TriangleTest test, bool masks, bool placements);
};

/// The variant for this machine: the best one that it can run, unless GPURT_ISA names another that exists.
const CpuKernels &cpu_kernels();

/// A variant by name, or null.
const CpuKernels *cpu_kernels(const char *isa);

}  // namespace gpurt
