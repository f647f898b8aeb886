// What kernels that count lanes do at every step. Only .cu files that compile such kernels include this, first of all: it
// names the namespaces of what they compile a second time.
#pragma once

#define GPURT_COUNTS_LANES
#undef GPURT_ISA
#define GPURT_ISA counting
#define GPURT_KERNELS counting

#include <cuda_runtime_api.h>

#include "core/platform.h"
#include "cuda/accel/counting/lane_totals.h"
#include "cuda/check.h"

namespace gpurt {

// Steps of warps, and of their lanes; of this translation unit.
static __device__ cuda::LaneTotals lane_counts[cuda::num_lane_totals];

/// Counts for the lanes that are at this step together.
GPURT_INLINE void count_step(bool takes_part = true)
{
#if defined(__CUDA_ARCH__)
  const unsigned together = __activemask(), working = __ballot_sync(together, takes_part);
  if (threadIdx.x % 32 != unsigned(__ffs(int(together)) - 1)) return;
  cuda::LaneTotals &totals = lane_counts[blockIdx.x % cuda::num_lane_totals];
  atomicAdd(&totals.warp_steps, 1ull);
  atomicAdd(&totals.lane_steps, static_cast<unsigned long long>(__popc(working)));
#else
  (void)takes_part;
#endif
}

static cuda::LaneTotals *find_totals()
{
  void *totals = nullptr;
  cuda::check(cudaGetSymbolAddress(&totals, lane_counts), "cudaGetSymbolAddress");
  return static_cast<cuda::LaneTotals *>(totals);
}

}  // namespace gpurt
