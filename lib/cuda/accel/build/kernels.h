// The kernels of the builder of bvhs as host code calls them. Each call starts kernels on the stream and returns.
#pragma once

#include <cuda_runtime_api.h>

#include "cuda/accel/build/place.h"
#include "cuda/accel/build/split_node.h"

namespace gpurt::cuda {

/// Triangles whose references are made, or references that are binned or moved, by one block.
constexpr uint32_t chunk_size = 2048;

/// A node that many blocks split together.
struct LargeSplit {
  uint32_t node;
  uint32_t first_chunk, num_chunks;
  uint32_t reserved;
  SplitState state;
  BuildBins bins;
};

/// A run of a large node's references.
struct SplitChunk {
  uint32_t large;         // index of LargeSplit
  uint32_t first, count;  // within the node
  uint32_t offset[2];     // of what it hands to the children, within them
  // How many references begin and end in each bin: of their centres, and of the parts of their triangles.
  uint32_t object_first[3][num_bins];
  uint32_t first_bin[3][num_bins], last_bin[3][num_bins];
};

/// A build in device memory.
struct BuildState {
  BuildLevel level;
  LargeSplit *large;
  SplitChunk *chunks;
};

/// Makes references[i] of triangle i, empty where that is degenerate, and gathers bounds.
void launch_make_references(const BuildScene &scene, uint32_t num_triangles, BuildReference *references,
                            BuildCounters *counters, cudaStream_t stream);
/// Bytes of scratch memory that launch_drop_empty wants.
uint64_t drop_scratch_bytes(uint32_t count);
/// Copies the references that are not empty, in their order; their number goes to *num_kept.
void launch_drop_empty(const BuildReference *from, uint32_t count, BuildReference *to, uint32_t *num_kept,
                       void *scratch, uint64_t scratch_bytes, cudaStream_t stream);
/// The first node, of all references.
void launch_make_root(const BuildState &state, uint32_t count, uint32_t spare, cudaStream_t stream);
/// Splits a level's nodes that are not small, of which there are `num_of_class`, with `num_references` in all.
void launch_split_level(const BuildState &state, const uint32_t (&num_of_class)[4], uint32_t num_references,
                        cudaStream_t stream);
/// Builds the subtrees of all small nodes.
void launch_build_small(const BuildState &state, uint32_t num_nodes, cudaStream_t stream);
/// Sums over subtrees: the levels' nodes last level first.
void launch_sum_up(const BuildState &state, uint32_t begin, uint32_t end, cudaStream_t stream);
/// Places the children of the nodes [begin, end), which are placed, and writes these: first level first.
void launch_place(const BuildState &state, uint32_t begin, uint32_t end, const BuildTarget &target,
                  cudaStream_t stream);
/// Copies the subtrees of all small nodes to their places.
void launch_place_small(const BuildState &state, uint32_t num_nodes, const BuildTarget &target,
                        cudaStream_t stream);

}  // namespace gpurt::cuda
