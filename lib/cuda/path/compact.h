// Keeps the rays of a queue that are there, in order: a count for every block, a scan over the counts, a scatter.
#pragma once

#include <cuda_runtime_api.h>

#include "core/path/path_wave.h"

namespace gpurt::cuda {

/// Counts of blocks that compacting n rays needs room for.
uint32_t compact_num_blocks(uint32_t n);

/// Where a compaction works. `total` lies in pinned host memory: the number of kept rays, once the stream is there.
struct CompactScratch {
  uint32_t *block_counts;
  uint32_t *total;
};

void launch_compact_rays(const RayQueue &from, uint32_t n, const RayQueue &to, const CompactScratch &scratch,
                         cudaStream_t stream);
void launch_compact_shadows(const ShadowQueue &from, uint32_t n, const ShadowQueue &to,
                            const CompactScratch &scratch, cudaStream_t stream);

}  // namespace gpurt::cuda
