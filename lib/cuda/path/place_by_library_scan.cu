// Places by the scan of the CUDA core libraries: one pass, in which blocks look back at their predecessors' sums.
//
// Source: Merrill and Garland 2016.
#include <cub/device/device_scan.cuh>

#include "cuda/launch.h"
#include "cuda/path/place.h"

namespace gpurt::cuda {
namespace {

__global__ void store_total_kernel(const uint32_t *flags, uint32_t n, const uint32_t *places, uint32_t *total)
{
  *total = places[n - 1] + flags[n - 1];
}

}  // namespace

uint64_t library_scan_bytes(uint32_t n)
{
  size_t bytes = 0;
  check(cub::DeviceScan::ExclusiveSum(nullptr, bytes, static_cast<const uint32_t *>(nullptr),
                                      static_cast<uint32_t *>(nullptr), n),
        "cub::DeviceScan::ExclusiveSum");
  return bytes;
}

void launch_place_by_library_scan(const uint32_t *flags, uint32_t n, void *memory, uint64_t memory_bytes,
                                  uint32_t *places, uint32_t *total, cudaStream_t stream)
{
  size_t bytes = memory_bytes;
  check(cub::DeviceScan::ExclusiveSum(memory, bytes, flags, places, n, stream),
        "cub::DeviceScan::ExclusiveSum");
  launch_blocks("kernel that stores a scan's total", store_total_kernel, 1, 1, stream, flags, n, places,
                total);
}

}  // namespace gpurt::cuda
