// Samples' places and the sampler's loops for vectors of 512 bits; see wide_kernel.h.
#include "cpu/reyes/wide_kernel.h"

#include "core/reyes/lit_point.h"
#include "cpu/reyes/grid_light.h"
#include "cpu/reyes/place_rows.h"
#include "cpu/reyes/wide_quads.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN
namespace {

// Of a micropolygon: what its samples keep.
struct KeptQuad {
  uint32_t i, j;
  uint32_t root;  // or its light
  Vec2f middle;
};

// Samples low .. low + 7 and high .. high + 7.
struct TwoRuns {
  uint32_t low, high;
};

__attribute__((noinline)) void take_one_by_one(const WideGrid &w, const KeptQuad &quad, TwoRuns runs,
                                               __m512 z, __m512 u, __m512 v, uint32_t taken)
{
  alignas(64) float of_z[num_wide_lanes], of_u[num_wide_lanes], of_v[num_wide_lanes];
  _mm512_store_ps(of_z, z);
  _mm512_store_ps(of_u, u);
  _mm512_store_ps(of_v, v);
  for (; taken != 0; taken &= taken - 1) {
    const uint32_t k = uint32_t(__builtin_ctz(taken));
    const uint32_t slot = k < num_lanes ? runs.low + k : runs.high + (k - num_lanes);
    if (of_z[k] > 0.0f) w.take(w.sampler, quad.i, quad.j, slot, of_z[k], of_u[k], of_v[k]);
  }
}

// Those samples that are nearer than what they have, and those that are as near.
template <bool has_light>
GPURT_INLINE void take(const WideGrid &w, const SampleBlock &block, const KeptQuad &quad, uint32_t a,
                       bool is_swapped, TwoRuns runs, const WideCover &cover, uint32_t nearer, uint32_t equal,
                       uint64_t &num_fragments)
{
  const auto store = [&](float *to, __m512 v) {
    _mm256_mask_storeu_ps(to + runs.low, __mmask8(nearer), _mm512_castps512_ps256(v));
    _mm256_mask_storeu_ps(to + runs.high, __mmask8(nearer >> 8), _mm512_extractf32x8_ps(v, 1));
  };
  const auto store_nearer = [&] {
    const __m256i root = _mm256_set1_epi32(int(quad.root));
    store(block.z, cover.z);
    _mm256_mask_storeu_epi32(block.root + runs.low, __mmask8(nearer), root);
    _mm256_mask_storeu_epi32(block.root + runs.high, __mmask8(nearer >> 8), root);
    num_fragments += uint32_t(__builtin_popcount(nearer));
  };
  __m512 u = cover.z, v = cover.z;
  if (has_light) {
    // Without a branch, which would often be mistaken.
    store_nearer();
  } else {
    if ((nearer | equal) == 0) return;
    cover_uv(cover, is_swapped, w.grid, a, u, v);
    if (w.takes_all) {
      store_nearer();
      store(block.u, w.middles != nullptr ? wide(quad.middle.x) : u);
      store(block.v, w.middles != nullptr ? wide(quad.middle.y) : v);
    } else {
      equal |= nearer;
    }
  }
  if (equal != 0) take_one_by_one(w, quad, runs, cover.z, u, v, equal);
}

// Micropolygon k of sixteen, whose first vertex is a of the grid.
template <bool has_light>
GPURT_INLINE void sample_quad(const WideGrid &w, const SampleBlock &block, const WideQuads &q, uint32_t k,
                              uint32_t a, const KeptQuad &quad, uint64_t &num_fragments)
{
  const uint32_t cells_x = uint32_t(block.cells_x);
  const bool is_swapped = (q.is_swapped >> k & 1) != 0;
  const uint32_t *from = block.first + q.from[k], *to = block.first + q.to[k];
  for (uint32_t rows = q.num_rows[k];;) {
    uint32_t low = *from, low_end = *to, high = low, high_end = low;
    if (rows > 1) {
      high = from[cells_x];
      high_end = to[cells_x];
    }
    for (;;) {
      const uint32_t num_low = min(low_end - low, num_lanes), num_high = min(high_end - high, num_lanes);
      // Always whole lanes: what lies behind the runs is computed and not taken.
      const uint32_t are_there = ((1u << num_low) - 1) | ((1u << num_high) - 1) << num_lanes;
      const WideCover cover =
          cover_wide(q, k, load_two(block.x + low, block.x + high), load_two(block.y + low, block.y + high));
      const __m512 old_z = load_two(block.z + low, block.z + high);
      const __mmask16 covered = _kand_mask16(cover.is_covered, __mmask16(are_there));
      const uint32_t nearer = _mm512_mask_cmp_ps_mask(covered, cover.z, old_z, _CMP_GT_OQ),
                     equal = _mm512_mask_cmp_ps_mask(covered, cover.z, old_z, _CMP_EQ_OQ);
      take<has_light>(w, block, quad, a, is_swapped, {low, high}, cover, nearer, equal, num_fragments);
      low += num_low;
      high += num_high;
      if ((low == low_end) & (high == high_end)) break;
    }
    if (rows <= 2) return;
    rows -= 2;
    from += 2 * cells_x;
    to += 2 * cells_x;
  }
}

template <bool has_light>
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
        KeptQuad quad{i, j, w.root, {0.0f, 0.0f}};
        if (has_light) quad.root = light_of(*w.light, i, j);
        else if (w.middles != nullptr) quad.middle = middle_of(*w.middles, i, j);
        sample_quad<has_light>(w, block, quads, i, j * width + i, quad, num_fragments);
      }
    }
  }
  return num_fragments;
}

uint64_t sample_grid(const WideGrid &w)
{
  return w.light != nullptr ? sample_rows<true>(w) : sample_rows<false>(w);
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
