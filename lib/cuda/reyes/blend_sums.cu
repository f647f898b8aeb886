// How many fragments there are before each sample's, in 64 bits, and which samples' have room together.
#include <cub/device/device_scan.cuh>

#include "cuda/launch.h"
#include "cuda/path/place.h"
#include "cuda/reyes/blend.h"

namespace gpurt::cuda {
namespace {

// Sums of 64 bits over counts of 32: the library adds in the type of the initial value.
void sum(void *memory, size_t &bytes, const uint32_t *counts, uint64_t *sums, uint64_t n, cudaStream_t stream)
{
  check(cub::DeviceScan::ExclusiveScan(memory, bytes, counts, sums, ::cuda::std::plus<>(), uint64_t(0), n,
                                       stream),
        "cub::DeviceScan::ExclusiveScan");
}

__global__ void store_sum(const uint64_t *first, uint32_t n, ReyesNumbers *numbers)
{
  numbers->part_fragments = first[n];
}

// One thread. Samples of a pixel are one run; those of its cells too.
__global__ void find_part(const __grid_constant__ SampleGrid grid, const uint64_t *first, uint32_t begin,
                          uint64_t capacity, uint32_t most_peeled, ReyesNumbers *numbers)
{
  uint32_t lo = begin + 1, hi = grid.num_samples;
  // The largest end whose fragments have room.
  while (lo < hi) {
    const uint32_t middle = lo + (hi - lo + 1) / 2;
    if (first[middle] - first[begin] <= capacity) lo = middle;
    else hi = middle - 1;
  }
  if (first[lo] - first[begin] > capacity) lo += min(most_peeled - 1, grid.num_samples - lo);
  const int32_t s = cell_shift(grid);
  const uint32_t num_pixels = uint32_t(grid.cells_x >> s) * uint32_t(grid.cells_y >> s);
  const auto pixel_of = [&](uint32_t slot) {
    uint32_t low = 0, high = num_pixels;
    while (high - low > 1) {
      const uint32_t middle = low + (high - low) / 2;
      if (grid.first[uint64_t(middle) << 2 * s] <= slot) low = middle;
      else high = middle;
    }
    return low;
  };
  numbers->part_end = lo;
  numbers->first_pixel = pixel_of(begin);
  numbers->last_pixel = pixel_of(lo - 1);
  numbers->part_first = first[begin];
  numbers->part_fragments = first[lo] - first[begin];
}

}  // namespace

uint64_t fragment_scan_bytes(uint64_t n)
{
  size_t wide = 0;
  sum(nullptr, wide, nullptr, nullptr, n + 1, nullptr);
  const uint64_t narrow = library_scan_bytes(uint32_t(n));
  return wide > narrow ? wide : narrow;
}

void launch_sum_fragments(const FragmentView &view, uint64_t *first, uint32_t n, void *scan_memory,
                          uint64_t scan_bytes, ReyesNumbers *numbers, cudaStream_t stream)
{
  size_t bytes = scan_bytes;
  sum(scan_memory, bytes, view.count, first, uint64_t(n) + 1, stream);
  launch_blocks("kernel that stores the number of fragments", store_sum, 1, 1, stream, first, n, numbers);
}

void launch_find_part(const SampleGrid &grid, const uint64_t *first, uint32_t begin, uint64_t capacity,
                      uint32_t most_peeled, ReyesNumbers *numbers, cudaStream_t stream)
{
  launch_blocks("REYES' samples whose fragments have room", find_part, 1, 1, stream, grid, first, begin,
                capacity, most_peeled, numbers);
}

}  // namespace gpurt::cuda
