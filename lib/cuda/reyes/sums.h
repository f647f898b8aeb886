// What kernels that add to films share. For .cu files alone.
#pragma once

#include "core/math/vec.h"

namespace gpurt::cuda {

// Of the lanes of a warp, into the bits of the largest of all.
__device__ inline void keep_largest(float largest, uint32_t *largest_bits)
{
  for (int offset = 16; offset != 0; offset /= 2)
    largest = max(largest, __shfl_down_sync(0xffffffffu, largest, offset));
  if (threadIdx.x % 32 == 0 && float_bits(largest) > *largest_bits)
    atomicMax(largest_bits, float_bits(largest));
}

}  // namespace gpurt::cuda
