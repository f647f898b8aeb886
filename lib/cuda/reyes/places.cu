// Where samples lie: sorted by cells of the image, so that a micropolygon looks at few of them.
//
// Under a box every pixel sorts its own samples into its quarters, and cells begin where they must. Under a filter that
// reaches beyond the pixel, samples are counted, summed and put into their places.
#include "cuda/launch.h"
#include "cuda/path/place.h"
#include "cuda/reyes/stages.h"

namespace gpurt::cuda {
namespace {

// A sample in raster units of the image.
struct RasterSample {
  int32_t x, y;
};

__device__ RasterSample raster_sample(const SamplePlaces &p, const PathSample &s)
{
  const SampleKey key = sample_key(p.seed, p.frame_index, s.x, s.y, s.sample);
  const Vec2f offset = place_sample(p.filter, p.table, sample_2d(key, dim_pixel)).offset;
  return {int32_t(floor(offset.x * units_per_pixel)) + int32_t(s.x) * (1 << unit_bits),
          int32_t(floor(offset.y * units_per_pixel)) + int32_t(s.y) * (1 << unit_bits)};
}

__device__ uint16_t place_in_pixel(const SampleGrid &grid, RasterSample s)
{
  const uint32_t mask = (1u << unit_bits) - 1;
  return uint16_t((uint32_t(s.x - grid.x0) & mask) | (uint32_t(s.y - grid.y0) & mask) << 8);
}

// Pixel i of the group, in the order of paths.
__global__ void __launch_bounds__(block_size)
    place_by_pixels(const __grid_constant__ SamplePlaces p, const __grid_constant__ SampleGrid grid,
                    uint32_t num_pixels, uint32_t *first, uint16_t *at, uint32_t *slots)
{
  const uint32_t i = uint32_t(thread_item());
  if (i >= num_pixels) return;
  PathSample s = path_sample(p.unit, i);
  const uint32_t num = uint32_t(p.num_samples), base = s.local * num;
  uint32_t offset[4] = {0, 0, 0, 0};
  const bool has_quarters = grid.cell_bits < unit_bits;
  const auto quarter = [&](RasterSample r) {
    return has_quarters ? uint32_t(r.x) >> grid.cell_bits & 1 | (uint32_t(r.y) >> grid.cell_bits & 1) << 1
                        : 0;
  };
  for (uint32_t k = 0; k < num; ++k, ++s.sample) {
    const uint32_t q = quarter(raster_sample(p, s));
    for (uint32_t j = 0; j < 4; ++j) offset[j] += j > q ? 1 : 0;
  }
  if (has_quarters) {
    for (uint32_t j = 0; j < 4; ++j) first[s.local * 4 + j] = base + offset[j];
  } else {
    first[s.local] = base;
  }
  if (s.local == num_pixels - 1) first[has_quarters ? num_pixels * 4 : num_pixels] = num_pixels * num;
  s.sample -= num;
  for (uint32_t k = 0; k < num; ++k, ++s.sample) {
    const RasterSample r = raster_sample(p, s);
    const uint32_t q = quarter(r);
    uint32_t slot = 0;
    for (uint32_t j = 0; j < 4; ++j) {
      if (j == q) slot = base + offset[j]++;
    }
    at[slot] = place_in_pixel(grid, r);
    slots[uint64_t(k) * num_pixels + i] = slot;
  }
}

__device__ uint32_t cell_of(const SampleGrid &grid, RasterSample s)
{
  const int32_t cx = (s.x - grid.x0) >> grid.cell_bits, cy = (s.y - grid.y0) >> grid.cell_bits;
  if (grid.cell_bits == unit_bits) return uint32_t(cy) * uint32_t(grid.cells_x) + uint32_t(cx);
  return (uint32_t(cy >> 1) * uint32_t(grid.cells_x >> 1) + uint32_t(cx >> 1)) * 4 + uint32_t(cx & 1) +
         2 * uint32_t(cy & 1);
}

// Path k takes the next place of its cell.
__global__ void __launch_bounds__(block_size)
    count_cells(const __grid_constant__ SamplePlaces p, const __grid_constant__ SampleGrid grid,
                uint32_t *counts, uint32_t *slots)
{
  const uint64_t k = thread_item();
  if (k >= grid.num_samples) return;
  slots[k] = atomicAdd(counts + cell_of(grid, raster_sample(p, path_sample(p.unit, uint32_t(k)))), 1u);
}

__global__ void __launch_bounds__(block_size)
    place_by_counts(const __grid_constant__ SamplePlaces p, const __grid_constant__ SampleGrid grid,
                    const uint32_t *first, uint16_t *at, uint32_t *slots)
{
  const uint64_t k = thread_item();
  if (k >= grid.num_samples) return;
  const RasterSample s = raster_sample(p, path_sample(p.unit, uint32_t(k)));
  const uint32_t slot = first[cell_of(grid, s)] + slots[k];
  at[slot] = place_in_pixel(grid, s);
  slots[k] = slot;
}

}  // namespace

uint64_t place_scan_bytes(uint32_t n) { return library_scan_bytes(n); }

void launch_place_samples(const SamplePlaces &places, const SampleGrid &grid, uint32_t *first, uint16_t *at,
                          uint32_t *slots, uint32_t *counts, void *scan_memory, uint64_t scan_bytes,
                          cudaStream_t stream)
{
  if (counts == nullptr) {
    const uint32_t num_pixels = (places.unit.x1 - places.unit.x0) * (places.unit.y1 - places.unit.y0);
    launch("REYES stage 'places'", place_by_pixels, num_pixels, stream, places, grid, num_pixels, first, at,
           slots);
    return;
  }
  const uint32_t num_cells = uint32_t(grid.cells_x) * uint32_t(grid.cells_y);
  check(cudaMemsetAsync(counts, 0, uint64_t(num_cells) * sizeof *counts, stream), "cudaMemsetAsync");
  launch("REYES stage 'places', counted", count_cells, grid.num_samples, stream, places, grid, counts, slots);
  launch_place_by_library_scan(counts, num_cells, scan_memory, scan_bytes, first, first + num_cells, stream);
  launch("REYES stage 'places', filled", place_by_counts, grid.num_samples, stream, places, grid, first, at,
         slots);
}

}  // namespace gpurt::cuda
