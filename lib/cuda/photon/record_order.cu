// Sorts records of photons by their paths, and along each: where atomics put them depends on how blocks come.
#include <cub/device/device_radix_sort.cuh>

#include "cuda/launch.h"
#include "cuda/layout.h"
#include "cuda/photon/kernels.h"

namespace gpurt::cuda {
namespace {

// Bounces have a byte: max_photon_depth.
constexpr int bounce_bits = 8;

__global__ void __launch_bounds__(block_size)
    record_key_kernel(const Photon *records, uint32_t n, uint64_t *keys, uint32_t *indices)
{
  const uint64_t i = thread_item();
  if (i >= n) return;
  keys[i] = uint64_t(records[i].id) << bounce_bits | records[i].bounce;
  indices[i] = uint32_t(i);
}

__global__ void __launch_bounds__(block_size)
    move_records_kernel(const Photon *from, const uint32_t *order, uint32_t n, Photon *to)
{
  const uint64_t i = thread_item();
  if (i < n) to[i] = from[order[i]];
}

struct SortArrays {
  uint64_t *keys[2];
  uint32_t *indices[2];
  std::byte *scratch;
  size_t scratch_bytes;
  uint64_t bytes;
};

SortArrays lay_out(std::byte *base, uint64_t n)
{
  Layout layout(base);
  SortArrays a;
  for (uint64_t *&keys : a.keys) keys = layout.take<uint64_t>(n);
  for (uint32_t *&indices : a.indices) indices = layout.take<uint32_t>(n);
  cub::DoubleBuffer<uint64_t> keys(nullptr, nullptr);
  cub::DoubleBuffer<uint32_t> indices(nullptr, nullptr);
  a.scratch_bytes = 0;
  check(cub::DeviceRadixSort::SortPairs(nullptr, a.scratch_bytes, keys, indices, uint32_t(n)),
        "cub::DeviceRadixSort::SortPairs");
  a.scratch = layout.take<std::byte>(a.scratch_bytes);
  a.bytes = layout.bytes();
  return a;
}

}  // namespace

uint64_t record_order_bytes(uint64_t n) { return lay_out(nullptr, n).bytes; }

void launch_order_records(const Photon *from, uint64_t num_records, uint32_t num_paths, void *memory,
                          Photon *to, cudaStream_t stream)
{
  const uint32_t n = uint32_t(num_records);
  SortArrays a = lay_out(static_cast<std::byte *>(memory), n);
  launch("kernel that numbers records of photons", record_key_kernel, n, stream, from, n, a.keys[0],
         a.indices[0]);
  int num_bits = bounce_bits + 1;
  while (num_bits < bounce_bits + 32 && uint64_t(num_paths) >> (num_bits - bounce_bits) != 0) ++num_bits;
  cub::DoubleBuffer<uint64_t> keys(a.keys[0], a.keys[1]);
  cub::DoubleBuffer<uint32_t> indices(a.indices[0], a.indices[1]);
  check(cub::DeviceRadixSort::SortPairs(a.scratch, a.scratch_bytes, keys, indices, n, 0, num_bits, stream),
        "cub::DeviceRadixSort::SortPairs");
  launch("kernel that moves records of photons", move_records_kernel, n, stream, from,
         static_cast<const uint32_t *>(indices.Current()), n, to);
}

}  // namespace gpurt::cuda
