// The kernels of the builder of kd-trees as host code calls them. Each call starts kernels on the stream and returns.
#pragma once

#include <cuda_runtime_api.h>

#include "cuda/accel/build/kd_node.h"

namespace gpurt::cuda {

/// A level's cells on their way to the next one.
struct KdLevel {
  BuildScene scene;
  KdBuildCosts costs;
  uint32_t depth;
  uint32_t num_cells, num_large;
  const BuildReference *from;
  BuildReference *to;
  const KdBuildCell *cells;
  KdBuildCell *next_cells;
  const uint32_t *large;  // cells of more than kd_small_cell references, and the next level's
  uint32_t *next_large;
  uint32_t *num_next_large;
  KdChoice *choices;
  KdLevelSums *sums;  // num_cells + 1 of them
  // Where the level's nodes and the references of its leaves begin in the tree.
  KdNode *nodes;
  uint32_t *references;
  uint32_t first_node, first_reference;
};

/// Chooses the splits of all cells.
void launch_kd_choose(const KdLevel &level, cudaStream_t stream);
/// Bytes of scratch memory for launch_kd_sum.
uint64_t kd_sum_bytes(uint32_t num_cells);
/// Sums what the cells need on the next level.
void launch_kd_sum(const KdLevel &level, void *scratch, uint64_t scratch_bytes, cudaStream_t stream);
/// Writes the level's nodes and the references of its leaves, and makes the next level's cells.
void launch_kd_partition(const KdLevel &level, cudaStream_t stream);
/// The expected cost of the level, in triangle tests of a ray that meets the root: a sum for every kd_cost_block cells.
constexpr uint32_t kd_cost_block = 128;
void launch_kd_cost(const KdLevel &level, double root_area, double *sums, cudaStream_t stream);

}  // namespace gpurt::cuda
