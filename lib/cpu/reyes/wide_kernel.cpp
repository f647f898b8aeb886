// Samples' places and the sampler's loops for vectors of 512 bits; see wide_kernel.h.
#include "cpu/reyes/wide_kernel.h"

#include "core/reyes/lit_point.h"
#include "cpu/reyes/grid_light.h"
#include "cpu/reyes/place_rows.h"
#include "cpu/reyes/wide_quads.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN
namespace {

// What samples keep of a micropolygon, beside 1 / w.
enum class Kept { Places, Middles, Light };

// Micropolygon (i, j), whose first vertex is a of the grid.
struct QuadPlace {
  uint32_t i, j, a;
};

// Samples low .. low + 7 and high .. high + 7.
struct TwoRuns {
  uint32_t low, high;
};

__attribute__((noinline)) void take_one_by_one(const WideGrid &w, uint32_t i, uint32_t j, uint32_t low,
                                               uint32_t high, __m512 z, __m512 u, __m512 v, uint32_t taken)
{
  alignas(64) float of_z[num_wide_lanes], of_u[num_wide_lanes], of_v[num_wide_lanes];
  _mm512_store_ps(of_z, z);
  _mm512_store_ps(of_u, u);
  _mm512_store_ps(of_v, v);
  for (; taken != 0; taken &= taken - 1) {
    const uint32_t k = uint32_t(__builtin_ctz(taken));
    const uint32_t slot = k < num_lanes ? low + k : high + (k - num_lanes);
    if (of_z[k] > 0.0f) w.take(w.sampler, i, j, slot, of_z[k], of_u[k], of_v[k]);
  }
}

// Those samples that are nearer than what they have, and those that are as near.
template <Kept kept>
GPURT_INLINE void take(const WideGrid &w, const SampleBlock &block, QuadPlace quad, bool is_swapped,
                       TwoRuns runs, const WideCover &cover, uint32_t nearer, uint32_t equal,
                       uint64_t &num_fragments)
{
  const auto store = [&](float *to, __m512 v) {
    _mm256_mask_storeu_ps(to + runs.low, __mmask8(nearer), _mm512_castps512_ps256(v));
    _mm256_mask_storeu_ps(to + runs.high, __mmask8(nearer >> 8), _mm512_extractf32x8_ps(v, 1));
  };
  const auto store_nearer = [&](uint32_t root) {
    const __m256i roots = _mm256_set1_epi32(int(root));
    store(block.z, cover.z);
    _mm256_mask_storeu_epi32(block.root + runs.low, __mmask8(nearer), roots);
    _mm256_mask_storeu_epi32(block.root + runs.high, __mmask8(nearer >> 8), roots);
    num_fragments += uint32_t(__builtin_popcount(nearer));
  };
  __m512 u = cover.z, v = cover.z;
  if (kept == Kept::Light) {
    // Without a branch, which would often be mistaken.
    store_nearer(light_of(*w.light, quad.i, quad.j));
  } else {
    if ((nearer | equal) == 0) return;
    cover_uv(cover, is_swapped, w.grid, quad.a, u, v);
    if (w.takes_all) {
      store_nearer(w.root);
      const Vec2f middle = kept == Kept::Middles ? middle_of(*w.middles, quad.i, quad.j) : Vec2f{0.0f, 0.0f};
      store(block.u, kept == Kept::Middles ? wide(middle.x) : u);
      store(block.v, kept == Kept::Middles ? wide(middle.y) : v);
    } else {
      equal |= nearer;
    }
  }
  if (equal != 0) take_one_by_one(w, quad.i, quad.j, runs.low, runs.high, cover.z, u, v, equal);
}

// Micropolygon quad.i of sixteen.
template <Kept kept>
GPURT_INLINE void sample_quad(const WideGrid &w, const SampleBlock &block, const WideQuads &q, QuadPlace quad,
                              uint64_t &num_fragments)
{
  const uint32_t k = quad.i, cells_x = uint32_t(block.cells_x);
  const bool is_swapped = (q.is_swapped >> k & 1) != 0;
  const uint32_t *from = block.first + q.from[k], *to = block.first + q.to[k];
  for (uint32_t rows = q.num_rows[k];;) {
    // Of a row without a second one nothing is taken twice. No branch: as often as not there is one.
    const uint32_t step = rows > 1 ? cells_x : 0, has_two = 0u - uint32_t(rows > 1);
    uint32_t low = *from, num_left_low = *to - low, high = from[step],
             num_left_high = (to[step] - high) & has_two;
    for (;;) {
      const uint32_t num_low = min(num_left_low, num_lanes), num_high = min(num_left_high, num_lanes);
      // Always whole lanes: what lies behind the runs is computed and not taken.
      const uint32_t are_there = ((1u << num_low) - 1) | ((1u << num_high) - 1) << num_lanes;
      const WideCover cover =
          cover_wide(q, k, load_two(block.x + low, block.x + high), load_two(block.y + low, block.y + high));
      const __m512 old_z = load_two(block.z + low, block.z + high);
      const __mmask16 covered = _kand_mask16(cover.is_covered, __mmask16(are_there));
      const uint32_t nearer = _mm512_mask_cmp_ps_mask(covered, cover.z, old_z, _CMP_GT_OQ),
                     equal = _mm512_mask_cmp_ps_mask(covered, cover.z, old_z, _CMP_EQ_OQ);
      take<kept>(w, block, quad, is_swapped, {low, high}, cover, nearer, equal, num_fragments);
      if (num_left_low <= num_lanes && num_left_high <= num_lanes) break;
      low += num_low;
      num_left_low -= num_low;
      high += num_high;
      num_left_high -= num_high;
    }
    if (rows <= 2) return;
    rows -= 2;
    from += 2 * cells_x;
    to += 2 * cells_x;
  }
}

template <Kept kept>
uint64_t sample_rows(const WideGrid &w)
{
  const Grid &grid = w.grid;
  const SampleBlock block = w.block;
  const uint32_t width = grid.num_u + 1;
  uint64_t num_fragments = 0;
  WideQuads quads;
  for (uint32_t j = 0; j < grid.num_v; ++j) {
    if (!make_wide_quads(grid, j, block, quads)) continue;
    for (uint32_t left = quads.are_there & ~quads.are_plain; left != 0; left &= left - 1)
      w.sample_quad(w.sampler, uint32_t(__builtin_ctz(left)), j);
    const uint32_t plain = quads.are_there & quads.are_plain & quads.have_area;
    // Neighbours look at the same samples: others come between them, so that what was written is there to be read.
    for (uint32_t turn = 0; turn < 4; ++turn) {
      for (uint32_t left = plain & (0x1111u << turn); left != 0; left &= left - 1) {
        const uint32_t i = uint32_t(__builtin_ctz(left));
        sample_quad<kept>(w, block, quads, {i, j, j * width + i}, num_fragments);
      }
    }
  }
  return num_fragments;
}

uint64_t sample_grid(const WideGrid &w)
{
  if (w.light != nullptr) return sample_rows<Kept::Light>(w);
  return w.middles != nullptr ? sample_rows<Kept::Middles>(w) : sample_rows<Kept::Places>(w);
}

void place_wide_rows(const PlacedRows &rows) { place_rows<UintLanes16>(rows); }

}  // namespace

const WideKernels &wide_kernels()
{
  static constexpr WideKernels kernels = {sample_grid, place_wide_rows};
  return kernels;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
