// The one way kernels are started: a thread an item, errors checked. Only .cu files include this.
#pragma once

#include <cstdint>

#include "cuda/check.h"
#include "cuda/kernel_log.h"
#include "cuda/launch_timer.h"

namespace gpurt::cuda {

// Threads of a block. Small, so that a block's slowest ray holds up few others; four warps fill a multiprocessor with
// the fewest blocks that its limit allows.
constexpr unsigned block_size = 128;

#if defined(__CUDACC__)

/// Runs kernel(args...) in blocks of a size of their own; `name` is what an error calls it.
template <class... Parameters, class... Arguments>
void launch_blocks(const char *name, void (*kernel)(Parameters...), unsigned num_blocks,
                   unsigned block_threads, cudaStream_t stream, const Arguments &...arguments)
{
  TimedLaunch timed(stream);
  kernel<<<num_blocks, block_threads, 0, stream>>>(arguments...);
  check(cudaGetLastError(), name);
  timed.end(name);
  note_launch(name, reinterpret_cast<const void *>(kernel), block_threads);
}

/// Runs kernel(args...) with at least n threads on a stream.
template <class... Parameters, class... Arguments>
void launch(const char *name, void (*kernel)(Parameters...), uint64_t n, cudaStream_t stream,
            const Arguments &...arguments)
{
  if (n == 0) return;
  launch_blocks(name, kernel, unsigned((n + block_size - 1) / block_size), block_size, stream, arguments...);
}

/// The same for kernels of which `blocks` fit a multiprocessor, with `shared_bytes` of shared memory each: so much of it is set
/// aside, and the rest is L1. By itself the driver leaves less: 124 of an H100's 256 KB where 192 can be had.
template <class... Parameters, class... Arguments>
void launch_for_l1(const char *name, void (*kernel)(Parameters...), uint64_t n, int blocks,
                   size_t shared_bytes, cudaStream_t stream, const Arguments &...arguments)
{
#if CUDART_VERSION < 13000
  static_cast<void>(blocks), static_cast<void>(shared_bytes);  // CUDA 12.0 has no such attribute
  launch(name, kernel, n, stream, arguments...);
#else
  if (n == 0) return;
  constexpr size_t system_bytes = 1024;  // of a block, from compute capability 8 on
  int device = 0, most_shared_bytes = 0;
  check(cudaGetDevice(&device), "cudaGetDevice");
  check(cudaDeviceGetAttribute(&most_shared_bytes, cudaDevAttrMaxSharedMemoryPerMultiprocessor, device),
        "cudaDeviceGetAttribute");
  const size_t percent =
      (100 * size_t(blocks) * (shared_bytes + system_bytes) + size_t(most_shared_bytes) - 1) /
      size_t(most_shared_bytes);
  cudaLaunchAttribute attribute{};
  attribute.id = cudaLaunchAttributePreferredSharedMemoryCarveout;
  attribute.val.sharedMemCarveout = unsigned(percent < 100 ? percent : 100);
  cudaLaunchConfig_t config{};
  config.gridDim = unsigned((n + block_size - 1) / block_size);
  config.blockDim = block_size;
  config.stream = stream;
  config.attrs = &attribute;
  config.numAttrs = 1;
  TimedLaunch timed(stream);
  check(cudaLaunchKernelEx(&config, kernel, arguments...), name);
  timed.end(name);
  note_launch(name, reinterpret_cast<const void *>(kernel), block_size);
#endif
}

/// Runs kernel(args...) with as many threads as the device holds at once, but no more than n need.
template <class... Parameters, class... Arguments>
void launch_persistent(const char *name, void (*kernel)(Parameters...), uint64_t n, cudaStream_t stream,
                       const Arguments &...arguments)
{
  if (n == 0) return;
  int device = 0, num_multiprocessors = 0, blocks = 0;
  check(cudaGetDevice(&device), "cudaGetDevice");
  check(cudaDeviceGetAttribute(&num_multiprocessors, cudaDevAttrMultiProcessorCount, device),
        "cudaDeviceGetAttribute");
  check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&blocks, kernel, int(block_size), 0),
        "cudaOccupancyMaxActiveBlocksPerMultiprocessor");
  const uint64_t resident = uint64_t(num_multiprocessors) * unsigned(blocks > 0 ? blocks : 1);
  const uint64_t needed = (n + block_size - 1) / block_size;
  launch_blocks(name, kernel, unsigned(needed < resident ? needed : resident), block_size, stream,
                arguments...);
}

// The item of this thread.
__device__ __forceinline__ uint64_t thread_item() { return uint64_t(blockIdx.x) * block_size + threadIdx.x; }

#endif

}  // namespace gpurt::cuda
