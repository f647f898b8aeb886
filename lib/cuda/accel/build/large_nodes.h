// Splits the large ones of a level's nodes.
#pragma once

#include "cuda/accel/build/kernels.h"

namespace gpurt::cuda {

/// There are `num_large`, with at most `num_references` references.
void launch_split_large(const BuildState &state, uint32_t num_large, uint32_t num_references,
                        cudaStream_t stream);

}  // namespace gpurt::cuda
