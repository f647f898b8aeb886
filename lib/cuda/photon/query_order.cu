// Sorts queries by the cells that they lie in, so that neighbours in a warp share what they load. And sums up counts.
#include <cub/device/device_radix_sort.cuh>
#include <cub/device/device_scan.cuh>

#include "cuda/launch.h"
#include "cuda/photon/kernels.h"

namespace gpurt::cuda {
namespace {

constexpr uint64_t align(uint64_t bytes) { return (bytes + 255) / 256 * 256; }

__global__ void __launch_bounds__(block_size)
    query_key_kernel(const __grid_constant__ GridShape shape, const Vec3f *positions, uint32_t n,
                     uint32_t *keys, uint32_t *indices)
{
  const uint64_t i = thread_item();
  if (i >= n) return;
  keys[i] = query_entry(shape, positions[i]);
  indices[i] = uint32_t(i);
}

struct Plus {
  __host__ __device__ uint64_t operator()(uint64_t a, uint64_t b) const { return a + b; }
};

__global__ void store_first_kernel(uint64_t *offsets, uint64_t first) { *offsets = first; }

size_t sort_bytes(uint32_t n)
{
  size_t bytes = 0;
  const uint32_t *from = nullptr;
  uint32_t *to = nullptr;
  check(cub::DeviceRadixSort::SortPairs(nullptr, bytes, from, to, from, to, n),
        "cub::DeviceRadixSort::SortPairs");
  return bytes;
}

}  // namespace

uint64_t query_order_bytes(uint64_t num_queries)
{
  return 4 * align(num_queries * sizeof(uint32_t)) + align(sort_bytes(uint32_t(num_queries)));
}

const uint32_t *launch_query_order(const GridShape &shape, const Vec3f *positions, uint32_t n, void *memory,
                                   uint64_t memory_bytes, cudaStream_t stream)
{
  if (memory == nullptr || n == 0) return nullptr;
  std::byte *const base = static_cast<std::byte *>(memory);
  const uint64_t stride = align(uint64_t(n) * sizeof(uint32_t));
  const auto array = [&](int k) { return reinterpret_cast<uint32_t *>(base + k * stride); };
  launch("kernel that numbers the cells of queries", query_key_kernel, n, stream, shape, positions, n,
         array(0), array(1));
  int num_bits = 1;
  while (num_bits < 32 && (shape.table_size - 1) >> num_bits != 0) ++num_bits;
  size_t bytes = memory_bytes - 4 * stride;
  check(cub::DeviceRadixSort::SortPairs(base + 4 * stride, bytes, array(0), array(2), array(1), array(3), n,
                                        0, num_bits, stream),
        "cub::DeviceRadixSort::SortPairs");
  return array(3);
}

uint64_t offsets_bytes(uint32_t n)
{
  size_t bytes = 0;
  check(cub::DeviceScan::InclusiveScanInit(nullptr, bytes, static_cast<const uint32_t *>(nullptr),
                                           static_cast<uint64_t *>(nullptr), Plus{}, uint64_t(0), n),
        "cub::DeviceScan::InclusiveScanInit");
  return bytes;
}

void launch_offsets(const uint32_t *counts, uint32_t n, uint64_t first, uint64_t *offsets, void *memory,
                    uint64_t memory_bytes, cudaStream_t stream)
{
  launch_blocks("kernel that begins offsets", store_first_kernel, 1, 1, stream, offsets, first);
  if (n == 0) return;
  size_t bytes = memory_bytes;
  check(cub::DeviceScan::InclusiveScanInit(memory, bytes, counts, offsets + 1, Plus{}, first, n, stream),
        "cub::DeviceScan::InclusiveScanInit");
}

}  // namespace gpurt::cuda
