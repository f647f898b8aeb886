// The places of a bucket's samples in their own pixels, sorted by cells, a row of pixels at a time. What depends on a pixel
// alone is done for as many pixels at once as U has lanes; bits are those of sample_2d.
//
// A pixel's cells have samples of that pixel alone. So a sample's slot is where its cell begins, which sums over the row tell,
// and how many of the pixel's earlier ones are in the same cell.
#pragma once

#include "core/path/path_wave.h"
#include "core/reyes/sample.h"
#include "cpu/reyes/lanes.h"
#include "cpu/reyes/reyes_kernel.h"

namespace gpurt {

typedef uint32_t UintLanes16 __attribute__((vector_size(64)));

// What rows of pixels are placed with.
struct PlacedRows {
  const ReyesMemory &memory;
  const SampleBlock &block;
  uint64_t seed;
  uint32_t frame_index;
  uint32_t x0, y0, width, height;  // pixels: paths go by 8 x 4 of them (path_sample)
  uint64_t first_sample;
  uint32_t num_samples;  // of a pixel
  bool keeps_places;     // shading wants to know them
};

// Of a row. Counts are kept in 8 bits.
constexpr uint32_t most_row_pixels = 64, most_placed_samples = 255;

GPURT_FUNCTIONS_BEGIN

template <class U>
GPURT_INLINE U reversed_lanes(U x)
{
#if GPURT_HAS_AVX2_LANES
  // Bytes, then the halves of each by tables.
  constexpr char low[16] = {0,    char(0x80), 0x40, char(0xc0), 0x20, char(0xa0), 0x60, char(0xe0),
                            0x10, char(0x90), 0x50, char(0xd0), 0x30, char(0xb0), 0x70, char(0xf0)};
  const __m128i of_bytes = _mm_setr_epi8(3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12),
                of_low = _mm_loadu_si128(reinterpret_cast<const __m128i *>(low)),
                of_high = _mm_and_si128(_mm_srli_epi16(of_low, 4), _mm_set1_epi8(15));
#if defined(__AVX512BW__)
  if constexpr (sizeof(U) == 64) {
    const __m512i half = _mm512_set1_epi8(15),
                  v = _mm512_shuffle_epi8((__m512i)x, _mm512_broadcast_i32x4(of_bytes));
    return (U)_mm512_or_si512(_mm512_shuffle_epi8(_mm512_broadcast_i32x4(of_low), _mm512_and_si512(v, half)),
                              _mm512_shuffle_epi8(_mm512_broadcast_i32x4(of_high),
                                                  _mm512_and_si512(_mm512_srli_epi16(v, 4), half)));
  }
#endif
  if constexpr (sizeof(U) == 32) {
    const __m256i half = _mm256_set1_epi8(15),
                  v = _mm256_shuffle_epi8((__m256i)x, _mm256_broadcastsi128_si256(of_bytes));
    return (U)_mm256_or_si256(
        _mm256_shuffle_epi8(_mm256_broadcastsi128_si256(of_low), _mm256_and_si256(v, half)),
        _mm256_shuffle_epi8(_mm256_broadcastsi128_si256(of_high),
                            _mm256_and_si256(_mm256_srli_epi16(v, 4), half)));
  }
#endif
  x = ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
  x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
  x = ((x & 0x0f0f0f0fu) << 4) | ((x >> 4) & 0x0f0f0f0fu);
  x = ((x & 0x00ff00ffu) << 8) | ((x >> 8) & 0x00ff00ffu);
  return x << 16 | x >> 16;
}

template <class U>
GPURT_INLINE U scramble_reversed_lanes(U x, U seed)
{
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return x;
}

template <class U>
GPURT_INLINE U sobol_second_reversed_lanes(U index)
{
  index ^= index >> 16;
  index ^= (index & 0xff00ff00u) >> 8;
  index ^= (index & 0xf0f0f0f0u) >> 4;
  index ^= (index & 0xccccccccu) >> 2;
  index ^= (index & 0xaaaaaaaau) >> 1;
  return index;
}

// sample_2d of keys that have a sample in common, by the words of their seeds: 32 bits after the point.
template <class U>
GPURT_INLINE void sample_2d_bits(U low, U high, uint32_t reversed_index, U &x, U &y)
{
  const U index = reversed_lanes(scramble_reversed_lanes(U{} + reversed_index, low));
  x = reversed_lanes(scramble_reversed_lanes(index, high));
  y = reversed_lanes(scramble_reversed_lanes(sobol_second_reversed_lanes(index), (low ^ high) * 0x9e3779b1u));
}

template <class U>
struct RowLanes {
  static constexpr uint32_t num = sizeof(U) / sizeof(uint32_t);
  typedef float Floats __attribute__((vector_size(sizeof(U))));
  typedef int32_t Ints __attribute__((vector_size(sizeof(U))));
  typedef uint64_t Longs __attribute__((vector_size(2 * sizeof(U))));
};

template <class L>
GPURT_INLINE void mix_lanes(L &x)
{
  x ^= x >> 30;
  x *= uint64_t(0xbf58476d1ce4e5b9u);
  x ^= x >> 27;
  x *= uint64_t(0x94d049bb133111ebu);
  x ^= x >> 31;
}

template <class To, class V>
GPURT_INLINE void store_any(To *to, const V &v)
{
  __builtin_memcpy(to, &v, sizeof v);
}
template <class From, class V>
GPURT_INLINE void load_any(V &v, const From *from)
{
  __builtin_memcpy(&v, from, sizeof v);
}
// Of numbers below 2^31.
template <class U>
GPURT_INLINE typename RowLanes<U>::Floats to_floats(U v)
{
  return __builtin_convertvector((typename RowLanes<U>::Ints)v, typename RowLanes<U>::Floats);
}
template <class U>
GPURT_INLINE void scatter_lanes(float *to, U slot, typename RowLanes<U>::Floats v)
{
#if defined(__AVX512F__)
  if constexpr (sizeof(U) == 64) {
    _mm512_i32scatter_ps(to, (__m512i)slot, (__m512)v, 4);
    return;
  }
#endif
  for (uint32_t i = 0; i < RowLanes<U>::num; ++i) to[slot[i]] = v[i];
}

// Of U's lanes: eight pixels of a row, or of each of two rows, from (x, y) of the bucket. They are paths one after another.
template <class U>
struct PixelLanes {
  typename RowLanes<U>::Ints x, y;
};
template <class U>
GPURT_INLINE PixelLanes<U> pixel_lanes(uint32_t x, uint32_t y)
{
  PixelLanes<U> p;
  for (uint32_t i = 0; i < RowLanes<U>::num; ++i) {
    p.x[i] = int32_t(x + i % 8);
    p.y[i] = int32_t(y + i / 8);
  }
  return p;
}

// What is kept of a sample until its slot is known: raster units in its pixel, and how many of the pixel's are before it in
// its cell. The units' upper bits tell the cell where a pixel has four.
template <class U>
GPURT_INLINE U packed_place(U units_x, U units_y, U rank)
{
  return units_x | units_y << 8 | rank << 16;
}

// Finds the samples of pixels (x, y) .. and how many are in each of a pixel's cells, 8 bits each.
template <class U>
GPURT_INLINE void place_pixels(const PlacedRows &r, uint32_t x, uint32_t y, uint64_t path, uint32_t *counts)
{
  using Lanes = RowLanes<U>;
  using Longs = typename Lanes::Longs;
  const ReyesMemory &m = r.memory;
  const uint64_t num_pixels = uint64_t(r.width) * r.height;
  const PixelLanes<U> pixel = pixel_lanes<U>(r.x0 + x, r.y0 + y);
  U low[2], high[2];
  const uint64_t film = mix_bits(r.seed + 0x9e3779b97f4a7c15u * (uint64_t(r.frame_index) + 1));
  const Longs of_pixel = __builtin_convertvector((U)(pixel.y << 16 | pixel.x), Longs);
  for (uint64_t parity = 0; parity < 2; ++parity) {
    // sample_key, of one sequence.
    const uint64_t sequence = r.first_sample >> 33 << 33 | parity << 32;
    Longs seed = film ^ (sequence | of_pixel);
    mix_lanes(seed);
    seed += 0x9e3779b97f4a7c15u * (uint64_t(dim_pixel) + 1);
    mix_lanes(seed);
    low[parity] = __builtin_convertvector(seed, U);
    high[parity] = __builtin_convertvector(seed >> 32, U);
  }
  const bool has_quarters = r.block.cell_bits < unit_bits;
  U in_cells{};
  for (uint32_t turn = 0; turn < r.num_samples; ++turn) {
    const uint64_t sample = r.first_sample + turn, k = turn * num_pixels + path;
    U bits_x, bits_y;
    sample_2d_bits(low[sample & 1], high[sample & 1], reverse_bits(uint32_t(sample >> 1)), bits_x, bits_y);
    if (r.keeps_places) {
      const auto unit_floats = [](U bits) { return to_floats<U>(bits >> 8) * 0x1p-24f; };
      store_any(m.place_x + k, unit_floats(bits_x));
      store_any(m.place_y + k, unit_floats(bits_y));
      store_any(m.weight + k, typename Lanes::Floats{} + 1.0f);
    }
    static_assert(unit_bits == 8);
    const U shift = has_quarters ? (bits_x >> 31 << 3) | (bits_y >> 31 << 4) : U{};
    store_any(m.slot + k, packed_place<U>(bits_x >> 24, bits_y >> 24, (in_cells >> shift) & 255u));
    in_cells += (U{} + 1u) << shift;
  }
  store_any(counts, in_cells);
}

// Four rows of pixels. Lanes of a run of eight pixels lie together, row by row.
struct RowCells {
  uint32_t counts[most_row_pixels * 4];
  uint32_t starts[4][most_row_pixels * 4];  // of upper left, upper right, lower left and lower right cells
};

// Where cells of rows y .. y + 3 begin, from `first` on.
GPURT_INLINE uint32_t sum_cells(const PlacedRows &r, uint32_t y, uint32_t first, RowCells &cells)
{
  const SampleBlock &b = r.block;
  const uint32_t along = b.cell_bits < unit_bits ? 2 : 1;
  uint32_t *to = r.memory.first + y * along * uint32_t(b.cells_x);
  for (uint32_t row = 0; row < 4 * along; ++row) {
    const uint32_t j = row % along;
    for (uint32_t x = 0; x < r.width; ++x) {
      const uint32_t at = x / 8 * 32 + row / along * 8 + x % 8, count = cells.counts[at] >> 16 * j;
      cells.starts[2 * j][at] = *to++ = first;
      first += count & 255u;
      if (along == 1) continue;
      cells.starts[2 * j + 1][at] = *to++ = first;
      first += count >> 8 & 255u;
    }
  }
  return first;
}

// Puts the samples of pixels (x, y) .. into their slots.
template <class U>
GPURT_INLINE void sort_pixels(const PlacedRows &r, uint32_t x, uint32_t y, uint64_t path, uint32_t at,
                              const RowCells &cells)
{
  using Floats = typename RowLanes<U>::Floats;
  const ReyesMemory &m = r.memory;
  const SampleBlock &b = r.block;
  const uint64_t num_pixels = uint64_t(r.width) * r.height;
  const PixelLanes<U> pixel = pixel_lanes<U>(r.x0 + x, r.y0 + y);
  const Floats left = __builtin_convertvector((pixel.x << unit_bits) - b.origin_x, Floats),
               top = __builtin_convertvector((pixel.y << unit_bits) - b.origin_y, Floats);
  const bool has_quarters = b.cell_bits < unit_bits;
  U start[4];
  for (int c = 0; c < 4; ++c) load_any(start[c], cells.starts[c] + at);
  for (uint32_t turn = 0; turn < r.num_samples; ++turn) {
    const uint64_t k = turn * num_pixels + path;
    U place;
    load_any(place, m.slot + k);
    U slot = start[0];
    if (has_quarters) {
      const auto is_right = (place & 0x80u) != 0, is_low = (place & 0x8000u) != 0;
      slot = is_low ? (is_right ? start[3] : start[2]) : (is_right ? start[1] : start[0]);
    }
    slot += place >> 16;
    store_any(m.slot + k, slot);
    scatter_lanes(m.x, slot, to_floats<U>(place & 255u) + left);
    scatter_lanes(m.y, slot, to_floats<U>(place >> 8 & 255u) + top);
  }
}

template <class U>
GPURT_INLINE void place_rows(const PlacedRows &r)
{
  constexpr uint32_t rows = RowLanes<U>::num / 8;
  uint32_t first = 0;
  for (uint32_t y = 0; y < r.height; y += 4) {
    RowCells cells;
    for (uint32_t at = 0; at < r.width * 4; at += RowLanes<U>::num)
      place_pixels<U>(r, at / 32 * 8, y + at % 32 / 8, uint64_t(y) * r.width + at, cells.counts + at);
    first = sum_cells(r, y, first, cells);
    for (uint32_t at = 0; at < r.width * 4; at += RowLanes<U>::num)
      sort_pixels<U>(r, at / 32 * 8, y + at % 32 / 8, uint64_t(y) * r.width + at, at, cells);
  }
  static_assert(4 % rows == 0);
  r.memory.first[uint32_t(r.block.cells_x) * uint32_t(r.block.cells_y)] = first;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
