// The one way kernels are started: a thread an item, errors checked. Only .cu files include this.
#pragma once

#include <cstdint>

#include "cuda/check.h"

namespace gpurt::cuda {

// Threads of a block. Small, so that a block's slowest ray holds up few others; four warps fill a multiprocessor with
// the fewest blocks that its limit allows.
constexpr unsigned block_size = 128;

#if defined(__CUDACC__)

/// Runs kernel(args...) with at least n threads on a stream; `name` is what an error calls it.
template <class... Parameters, class... Arguments>
void launch(const char *name, void (*kernel)(Parameters...), uint64_t n, cudaStream_t stream,
            const Arguments &...arguments)
{
  if (n == 0) return;
  kernel<<<unsigned((n + block_size - 1) / block_size), block_size, 0, stream>>>(arguments...);
  check(cudaGetLastError(), name);
}

// The item of this thread.
__device__ __forceinline__ uint64_t thread_item() { return uint64_t(blockIdx.x) * block_size + threadIdx.x; }

#endif

}  // namespace gpurt::cuda
