// Source: the talk's deferred shading; a stable radix sort by as many bits as materials need.
#include "cuda/path/sort_hits.h"

#include <cub/device/device_radix_sort.cuh>

#include "cuda/launch.h"

namespace gpurt::cuda {
namespace {

__global__ void __launch_bounds__(block_size)
    key_kernel(const __grid_constant__ SceneView scene, const Hit *hits, uint32_t n, uint32_t *keys,
               uint32_t *indices)
{
  const uint64_t i = thread_item();
  if (i >= n) return;
  const uint32_t triangle = hits[i].triangle;
  keys[i] = triangle == invalid_id ? scene.num_materials
                                   : scene.segments[scene.triangle_segment[triangle]].material;
  indices[i] = uint32_t(i);
}

uint64_t array_bytes(uint32_t n) { return (uint64_t(n) * sizeof(uint32_t) + 255) / 256 * 256; }

}  // namespace

uint64_t sort_hits_bytes(uint32_t n)
{
  size_t bytes = 0;
  const uint32_t *from = nullptr;
  uint32_t *to = nullptr;
  check(cub::DeviceRadixSort::SortPairs(nullptr, bytes, from, to, from, to, n),
        "cub::DeviceRadixSort::SortPairs");
  return bytes + 4 * array_bytes(n);
}

const uint32_t *launch_sort_hits(const SceneView &scene, const Hit *hits, uint32_t n, void *memory,
                                 uint64_t memory_bytes, cudaStream_t stream)
{
  std::byte *base = static_cast<std::byte *>(memory);
  const uint64_t stride = array_bytes(n);
  const auto array = [&](int k) { return reinterpret_cast<uint32_t *>(base + k * stride); };
  uint32_t *keys = array(0), *sorted_keys = array(1), *indices = array(2), *sorted_indices = array(3);
  launch("kernel that looks up materials", key_kernel, n, stream, scene, hits, n, keys, indices);
  size_t bytes = memory_bytes - 4 * stride;
  int num_bits = 1;
  while (num_bits < 32 && scene.num_materials >> num_bits != 0) ++num_bits;
  check(cub::DeviceRadixSort::SortPairs(base + 4 * stride, bytes, keys, sorted_keys, indices, sorted_indices,
                                        n, 0, num_bits, stream),
        "cub::DeviceRadixSort::SortPairs");
  return sorted_indices;
}

}  // namespace gpurt::cuda
