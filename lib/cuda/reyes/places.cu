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

__device__ RasterSample raster_sample(const SamplePlaces &p, const PathSample &s, Vec2f u)
{
  const Vec2f offset = place_sample(p.filter, p.table, u).offset;
  return {int32_t(floor(offset.x * units_per_pixel)) + int32_t(s.x) * (1 << unit_bits),
          int32_t(floor(offset.y * units_per_pixel)) + int32_t(s.y) * (1 << unit_bits)};
}

__device__ RasterSample raster_sample(const SamplePlaces &p, const PathSample &s)
{
  const SampleKey key = sample_key(p.seed, p.frame_index, s.x, s.y, s.sample);
  return raster_sample(p, s, sample_2d(key, dim_pixel));
}

__device__ uint16_t place_in_pixel(const SampleGrid &grid, RasterSample s)
{
  const uint32_t mask = (1u << unit_bits) - 1;
  return uint16_t((uint32_t(s.x - grid.x0) & mask) | (uint32_t(s.y - grid.y0) & mask) << 8);
}

// Samples a pixel that a thread remembers between its two looks at them.
constexpr uint32_t most_remembered = 16;

// How many samples of a pixel lie in each of its cells, and then where the next one of each goes.
struct CoarseCells {
  uint32_t at[4] = {0, 0, 0, 0};

  __device__ void count(uint32_t cell)
  {
    for (uint32_t j = 0; j < 4; ++j) at[j] += j > cell ? 1 : 0;
  }
  __device__ void finish() {}
  // As many as there are cells: one or four.
  __device__ void store(uint32_t base, uint32_t *to, uint32_t num_cells) const
  {
    for (uint32_t c = 0; c < 4; ++c) {
      if (c < num_cells) to[c] = base + at[c];
    }
  }
  __device__ uint32_t take(uint32_t cell)
  {
    uint32_t place = 0;
    for (uint32_t j = 0; j < 4; ++j) {
      if (j == cell) place = at[j]++;
    }
    return place;
  }
};

// Sixteen bytes: a product with ones adds those before.
struct FineCells {
  uint64_t low = 0, high = 0;

  __device__ void count(uint32_t cell)
  {
    if (cell < 8) low += uint64_t(1) << 8 * cell;
    else high += uint64_t(1) << 8 * (cell - 8);
  }
  __device__ void finish()
  {
    constexpr uint64_t ones = 0x0101010101010101u;
    const uint64_t below_low = low * ones, below_high = high * ones;
    low = below_low - low;
    high = below_high - high + (below_low >> 56) * ones;
  }
  __device__ uint32_t first(uint32_t cell) const
  {
    return uint32_t((cell < 8 ? low : high) >> 8 * (cell & 7) & 255);
  }
  // first(0) .. first(15), from base on.
  __device__ void store(uint32_t base, uint32_t *to, uint32_t) const
  {
    for (uint32_t c = 0; c < 16; c += 4) {
      *reinterpret_cast<uint4 *>(to + c) =
          make_uint4(base + first(c), base + first(c + 1), base + first(c + 2), base + first(c + 3));
    }
  }
  __device__ uint32_t take(uint32_t cell)
  {
    const uint32_t place = first(cell);
    count(cell);
    return place;
  }
};

// Pixel i of the group, in the order of paths.
template <class Cells>
__global__ void __launch_bounds__(block_size)
    place_by_pixels(const __grid_constant__ SamplePlaces p, const __grid_constant__ SampleGrid grid,
                    uint32_t num_pixels, uint32_t *first, uint16_t *at, uint32_t *slots)
{
  __shared__ uint16_t remembered[most_remembered][block_size];
  const uint32_t i = uint32_t(thread_item());
  if (i >= num_pixels) return;
  PathSample s = path_sample(p.unit, i);
  const uint32_t num = uint32_t(p.num_samples), base = s.local * num, shift = uint32_t(cell_shift(grid));
  const auto cell = [&](uint32_t place) {
    return (place & 255) >> (unit_bits - shift) | place >> (2 * unit_bits - shift) << shift;
  };
  Cells cells;
  for (uint32_t k = 0; k < num; ++k, ++s.sample) {
    const uint16_t place = place_in_pixel(grid, raster_sample(p, s));
    if (k < most_remembered) remembered[k][threadIdx.x] = place;
    cells.count(cell(place));
  }
  cells.finish();
  cells.store(base, first + (s.local << 2 * shift), 1u << 2 * shift);
  if (s.local == num_pixels - 1) first[num_pixels << 2 * shift] = num_pixels * num;
  s.sample -= num;
  for (uint32_t k = 0; k < num; ++k, ++s.sample) {
    const uint16_t place =
        k < most_remembered ? remembered[k][threadIdx.x] : place_in_pixel(grid, raster_sample(p, s));
    const uint32_t slot = base + cells.take(cell(place));
    at[slot] = place;
    slots[uint64_t(k) * num_pixels + i] = slot;
  }
}

// The i-th of n threads clears its share of what samples see, side by side with the others.
__device__ void clear_keys(const SampleGrid &grid, uint32_t i, uint32_t n)
{
  // Allocations begin at multiples of 16 bytes; of an odd number the last one is left.
  const uint32_t num_pairs = grid.num_samples / 2;
  for (uint32_t k = i; k < num_pairs; k += n) reinterpret_cast<ulonglong2 *>(grid.keys)[k] = {0, 0};
  if (i == 0 && grid.num_samples % 2 != 0) grid.keys[grid.num_samples - 1] = 0;
}

// Samples of pixel i in the order of their numbers, and which of them lie left of and above each eighth of the pixel.
__global__ void __launch_bounds__(block_size)
    place_with_masks(const __grid_constant__ SamplePlaces p, const __grid_constant__ SampleGrid grid,
                     uint32_t num_pixels, uint32_t *first, uint16_t *at, uint16_t *masks)
{
  __shared__ uint16_t found[most_masked][block_size];
  const uint32_t i = uint32_t(thread_item());
  if (i >= num_pixels) return;
  const PathSample s = path_sample(p.unit, i);
  const uint32_t num = uint32_t(p.num_samples);
  clear_keys(grid, i, num_pixels);
  constexpr uint64_t ones = 0x0001000100010001u;
  // Entries 0 .. 3 and 4 .. 7 of an axis. A sample in eighth e lies left of eighths e + 1 and on.
  uint64_t low[2] = {0, 0}, high[2] = {0, 0};
  // Even and odd samples have a sequence each, whose seed is found once (sample_key).
  const bool is_one_sequence = s.sample >> 33 == (s.sample + num - 1) >> 33;
  for (uint32_t parity = 0; parity < 2; ++parity) {
    const SampleKey key = sample_key(p.seed, p.frame_index, s.x, s.y, s.sample + parity);
    for (uint32_t k = parity; k < num; k += 2) {
      const uint64_t sample = s.sample + k;
      const Vec2f u = is_one_sequence
                          ? sample_2d({key.seed, reverse_bits(uint32_t(sample >> 1))}, dim_pixel)
                          : sample_2d(sample_key(p.seed, p.frame_index, s.x, s.y, sample), dim_pixel);
      const uint16_t place = place_in_pixel(grid, raster_sample(p, s, u));
      found[k][threadIdx.x] = place;
      for (int axis = 0; axis < 2; ++axis) {
        const uint32_t e = (axis == 0 ? place & 255u : uint32_t(place) >> 8) >> (unit_bits - 3);
        low[axis] |= (e < 3 ? ones << 16 * (e + 1) : 0) << k;
        high[axis] |= (e < 4 ? ones : (e < 7 ? ones << 16 * (e - 3) : 0)) << k;
      }
    }
  }
  for (uint32_t k = num; k < most_masked; ++k) found[k][threadIdx.x] = 0;
  first[s.local] = s.local * num;
  if (s.local == num_pixels - 1) first[num_pixels] = num_pixels * num;
  const auto pair = [&](uint32_t k) {
    return found[k][threadIdx.x] | uint32_t(found[k + 1][threadIdx.x]) << 16;
  };
  uint4 *to = reinterpret_cast<uint4 *>(at) + uint64_t(s.local) * (most_masked / 8);
  to[0] = make_uint4(pair(0), pair(2), pair(4), pair(6));
  to[1] = make_uint4(pair(8), pair(10), pair(12), pair(14));
  to = reinterpret_cast<uint4 *>(masks) + uint64_t(s.local) * (most_masked / 8);
  for (int axis = 0; axis < 2; ++axis) {
    to[axis] = make_uint4(uint32_t(low[axis]), uint32_t(low[axis] >> 32), uint32_t(high[axis]),
                          uint32_t(high[axis] >> 32));
  }
}

__device__ uint32_t cell_of(const SampleGrid &grid, RasterSample s)
{
  return cell_index(grid, (s.x - grid.x0) >> grid.cell_bits, (s.y - grid.y0) >> grid.cell_bits);
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
                          uint16_t *masks, uint32_t *slots, uint32_t *counts, void *scan_memory,
                          uint64_t scan_bytes, cudaStream_t stream)
{
  const uint32_t num_pixels = (places.unit.x1 - places.unit.x0) * (places.unit.y1 - places.unit.y0);
  if (masks != nullptr) {
    launch("REYES stage 'places', masks", place_with_masks, num_pixels, stream, places, grid, num_pixels,
           first, at, masks);
    return;
  }
  check(cudaMemsetAsync(grid.keys, 0, uint64_t(grid.num_samples) * sizeof *grid.keys, stream),
        "cudaMemsetAsync");
  if (counts == nullptr) {
    if (cell_shift(grid) == 2) {
      launch("REYES stage 'places', fine cells", place_by_pixels<FineCells>, num_pixels, stream, places, grid,
             num_pixels, first, at, slots);
    } else {
      launch("REYES stage 'places'", place_by_pixels<CoarseCells>, num_pixels, stream, places, grid,
             num_pixels, first, at, slots);
    }
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
