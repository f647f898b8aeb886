// Stages 'dice' and 'sample' of grids whose micropolygons are not all tiny, by a warp each. For .cu files alone.
#pragma once

#include "cuda/reyes/warp_grid.h"

namespace gpurt::cuda {

// Vertices of a grid, as numbers j * width + i.
struct Corners {
  uint32_t at[3];
};

static __device__ __noinline__ LargeTriangle large_triangle(const WarpGrid &g, const Corners &corners,
                                                            uint32_t root, RasterPoint largest, Vec2f middle)
{
  LargeTriangle t;
  const uint32_t width = (1u << g.piece.grid_u) + 1;
  for (int c = 0; c < 3; ++c) {
    const uint32_t j = corners.at[c] / width;
    uint32_t ku, kv;
    grid_parameters(g.piece, corners.at[c] - j * width, j, ku, kv);
    t.corners[c] = patch_point(g.patch, ku, kv);
    t.places[c] = {parameter(ku), parameter(kv)};
  }
  t.largest = largest;
  t.middle = middle;
  t.root = root;
  return t;
}

// A triangle of a micropolygon, from vertex `a` as the origin. False: it is not small, or covers nothing.
__device__ inline bool make_small(const WarpGrid &g, const Corners &c, int32_t ox, int32_t oy,
                                  SmallTriangle &t)
{
  const uint32_t i = c.at[0], j = c.at[1], k = c.at[2];
  return make_small_triangle(float(g.x[i] - ox), float(g.y[i] - oy), g.z[i], float(g.x[j] - ox),
                             float(g.y[j] - oy), g.z[j], float(g.x[k] - ox), float(g.y[k] - oy), g.z[k], t);
}

__device__ inline bool is_small(const WarpGrid &g, const Corners &c)
{
  const int32_t xa = g.x[c.at[0]], xb = g.x[c.at[1]], xc = g.x[c.at[2]];
  if (xa == not_projectable || xb == not_projectable || xc == not_projectable) return false;
  const int32_t ya = g.y[c.at[0]], yb = g.y[c.at[1]], yc = g.y[c.at[2]];
  return max(max(xa, xb), xc) - min(min(xa, xb), xc) <= int32_t(small_extent) &&
         max(max(ya, yb), yc) - min(min(ya, yb), yc) <= int32_t(small_extent);
}

// A micropolygon on its way through the samples.
struct AnyQuad {
  SmallTriangle t[2];
  CellRange cells;  // of their box
  int32_t ox, oy;   // their origin
  uint32_t kept;    // what samples keep: the root's number or, in its place, light
  uint32_t a;       // its first vertex
  uint32_t has;     // a bit a triangle

  __device__ Corners corners(int i, uint32_t width) const
  {
    return i == 0 ? Corners{{a, a + 1, a + width + 1}} : Corners{{a, a + width + 1, a + width}};
  }
};

// What another lane of the warp has.
template <class T>
__device__ __forceinline__ T of_lane(const T &x, int lane)
{
  static_assert(sizeof(T) % 4 == 0);
  constexpr int n = sizeof(T) / 4;
  uint32_t words[n];
  memcpy(words, &x, sizeof x);
#pragma unroll
  for (int i = 0; i < n; ++i) words[i] = __shfl_sync(all_lanes, words[i], lane);
  T y;
  memcpy(&y, words, sizeof y);
  return y;
}

// Pixels of a box that the lanes of a warp share; what has fewer is a lane's own. Where masks bring tiny micropolygons here too,
// and many lanes have something, it takes more.
constexpr int32_t least_shared_pixels = 4, shared_pixels = 10;
constexpr int few_lanes = 16;

__device__ __forceinline__ bool is_tiny(const WarpGrid &g, uint32_t a, uint32_t width, int32_t extent)
{
  const int32_t x[4] = {g.x[a], g.x[a + 1], g.x[a + width], g.x[a + width + 1]},
                y[4] = {g.y[a], g.y[a + 1], g.y[a + width], g.y[a + width + 1]};
  return max(max(x[0], x[1]), max(x[2], x[3])) - min(min(x[0], x[1]), min(x[2], x[3])) <= extent &&
         max(max(y[0], y[1]), max(y[2], y[3])) - min(min(y[0], y[1]), min(y[2], y[3])) <= extent;
}

// The pixels that cells lie in: how many in a row and in all.
__device__ __forceinline__ int32_t num_pixels(const SampleGrid &g, const CellRange &c, int32_t &width)
{
  const int32_t s = cell_shift(g);
  width = (c.x1 >> s) - (c.x0 >> s) + 1;
  return width * ((c.y1 >> s) - (c.y0 >> s) + 1);
}

// Sets up the triangles of micropolygon q; those that are large, or cross the eye plane, are handed on.
template <Look look, bool has_masks>
__device__ __forceinline__ void make_any_quad(const ReyesBatch &b, const WarpGrid &g, bool is_in_front,
                                              uint32_t slot, AnyQuad &quad, uint32_t &num_fragments)
{
  const uint32_t width = (1u << g.piece.grid_u) + 1, a = quad.a;
  const int32_t x[4] = {g.x[a], g.x[a + 1], g.x[a + width], g.x[a + width + 1]},
                y[4] = {g.y[a], g.y[a + 1], g.y[a + width], g.y[a + width + 1]};
  int32_t x0 = min(min(x[0], x[1]), min(x[2], x[3])), x1 = max(max(x[0], x[1]), max(x[2], x[3]));
  int32_t y0 = min(min(y[0], y[1]), min(y[2], y[3])), y1 = max(max(y[0], y[1]), max(y[2], y[3]));
  quad.ox = x[0];
  quad.oy = y[0];
  const bool is_whole = is_in_front && x1 - x0 <= int32_t(small_extent) && y1 - y0 <= int32_t(small_extent);
  if (!is_whole) {
    // One by one.
    x0 = y0 = INT32_MAX;
    x1 = y1 = INT32_MIN;
  }
  bool has[2] = {false, false};
  for (int i = 0; i < 2; ++i) {
    const Corners corners = quad.corners(i, width);
    if (is_whole || is_small(g, corners)) {
      has[i] = make_small(g, corners, quad.ox, quad.oy, quad.t[i]);
      if (is_whole) continue;
      for (const uint32_t k : corners.at) {
        x0 = min(x0, g.x[k]);
        x1 = max(x1, g.x[k]);
        y0 = min(y0, g.y[k]);
        y1 = max(y1, g.y[k]);
      }
    } else {
      const Vec2f middle = look == Look::Spots ? kept_middle(b, g, a) : no_middle();
      hand_on_large<look, has_masks>(b, large_triangle(g, corners, quad.kept, b.largest[slot], middle),
                                     num_fragments);
    }
  }
  if ((has[0] || has[1]) && !cells_of_box(b.samples, x0, y0, x1, y1, quad.cells)) has[0] = has[1] = false;
  quad.has = (has[0] ? 1 : 0) | (has[1] ? 2 : 0);
  // In the place of one that is not there stands the other.
  if (!has[0]) quad.t[0] = quad.t[1];
  if (!has[1]) quad.t[1] = quad.t[0];
  if constexpr (is_of_fragments(look)) {
    // It takes no sample twice.
    for (int i = 0; i < 2; ++i) {
      if (!has[i]) quad.t[i].threshold_a = infinity;
    }
  }
}

// Leaves micropolygons to warps of their own; false where the list of them is full, or the lane's is not to go there. All
// lanes of the warp call it.
template <Look look, bool has_masks>
__device__ __forceinline__ bool hand_on_spread(const ReyesBatch &b, const WarpGrid &g, const AnyQuad &quad,
                                               uint32_t slot, bool goes)
{
  const uint32_t lanes = __ballot_sync(all_lanes, goes), lane = threadIdx.x % 32;
  if (lanes == 0) return false;
  uint32_t at = 0;
  if (lane == 0) at = atomicAdd(&b.numbers->num_spread, uint32_t(__popc(lanes)));
  at = __shfl_sync(all_lanes, at, 0) + uint32_t(__popc(lanes & ((1u << lane) - 1)));
  if (!goes || at >= b.spread_capacity) return false;
  const uint32_t width = (1u << g.piece.grid_u) + 1;
  const uint32_t k[4] = {quad.a, quad.a + 1, quad.a + width + 1, quad.a + width};
  SpreadQuad to{};
  for (int i = 0; i < 4; ++i) {
    to.x[i] = g.x[k[i]];
    to.y[i] = g.y[k[i]];
    to.z[i] = g.z[k[i]];
    if constexpr (look == Look::Spots || look == Look::Keep || is_of_slots(look) || has_masks)
      to.places[i] = place_of_vertex(g, k[i]);
  }
  to.middle = look == Look::Spots ? kept_middle(b, g, quad.a) : no_middle();
  to.kept = quad.kept;
  to.slot = slot;
  to.has = quad.has;
  b.spread[at] = to;
  return true;
}

// Dices what the batch's grids left, and samples it.
template <Look look, bool has_masks>
__device__ __forceinline__ void sample_rest_of(const ReyesBatch &b)
{
  __shared__ WarpGrid grids[block_size / 32];
  constexpr bool may_have_light = look == Look::Nearest && !has_masks;
  __shared__ WarpLight lights[may_have_light ? block_size / 32 : 1];
  WarpGrid &g = grids[threadIdx.x / 32];
  const uint32_t lane = threadIdx.x % 32;
  const uint32_t num_rest = b.numbers->num_rest;
  uint32_t num_fragments = 0;
  for (uint32_t item; (item = next_item(&b.numbers->tickets[3], num_rest)) != num_rest;) {
    const uint32_t leaf = b.rest[item] >> 8, left = b.rest[item] & 0xff;
    const uint32_t slot = b.leaves[leaf].slot, root = b.roots[slot];
    copy_words(g.piece, b.leaves[leaf].piece, lane);
    copy_words(g.patch, b.patches[slot], lane);
    __syncwarp();
    const bool is_in_front = dice(g, b.projection, lane);
    __syncwarp();
    const uint32_t num_u = 1u << g.piece.grid_u, width = num_u + 1,
                   num_quads = 1u << (g.piece.grid_u + g.piece.grid_v);
    if constexpr (may_have_light) {
      if (b.has_own_light) shade_grid(b, g, root, lights[threadIdx.x / 32], lane);
    }
    for (uint32_t first = 0; first < num_quads; first += 32) {
      if ((left >> first / 32 & 1) == 0) continue;
      const uint32_t q = first + lane;
      AnyQuad own{};
      own.kept = root;
      own.cells = {0, 0, -1, -1};
      if (q < num_quads) {
        if constexpr (may_have_light) {
          if (b.has_own_light) own.kept = ~light_of(b, g, lights[threadIdx.x / 32], q);
        }
        own.a = (q >> g.piece.grid_u) * width + (q & (num_u - 1));
        // What is tiny was sampled before, but for masks.
        if (has_masks || !(is_in_front && is_tiny(g, own.a, width, b.tiny_extent)))
          make_any_quad<look, has_masks>(b, g, is_in_front, slot, own, num_fragments);
      }
      int32_t pixels_x;
      const int num_busy = __popc(__ballot_sync(all_lanes, own.has != 0));
      const bool is_shared =
          own.has != 0 && num_pixels(b.samples, own.cells, pixels_x) >=
                              (has_masks && num_busy >= few_lanes ? shared_pixels : least_shared_pixels);
      const bool is_handed_on = hand_on_spread<look, has_masks>(b, g, own, slot, is_shared);
      if (is_handed_on) own.has = 0;
      uint32_t shared = __ballot_sync(all_lanes, is_shared && !is_handed_on);
      // First what lanes have for themselves, then what is so large that they share its pixels, one after another.
      AnyQuad quad = own;
      bool is_there = own.has != 0 && (shared >> lane & 1) == 0;
      CellRange cells = own.cells;
      for (int32_t pixel = 0;;) {
        sample_small<look, has_masks>(
            b, quad.kept, is_there, cells, quad.ox, quad.oy, quad.t,
            [&](int i, Vec2f(&places)[3]) {
              const Corners c = quad.corners((quad.has >> i & 1) != 0 ? i : 1 - i, width);
              for (int k = 0; k < 3; ++k) places[k] = place_of_vertex(g, c.at[k]);
            },
            look == Look::Spots ? kept_middle(b, g, quad.a) : no_middle(), num_fragments);
        if (shared == 0) break;
        if (pixel == 0) quad = of_lane(own, __ffs(int(shared)) - 1);
        const int32_t s = cell_shift(b.samples), n = num_pixels(b.samples, quad.cells, pixels_x);
        const int32_t i = pixel + int32_t(lane), row = i / pixels_x;
        const int32_t x = (quad.cells.x0 >> s) + (i - row * pixels_x), y = (quad.cells.y0 >> s) + row;
        is_there = i < n;
        cells = {max(quad.cells.x0, x << s), max(quad.cells.y0, y << s),
                 min(quad.cells.x1, ((x + 1) << s) - 1), min(quad.cells.y1, ((y + 1) << s) - 1)};
        pixel += 32;
        if (pixel >= n) {
          pixel = 0;
          shared &= shared - 1;
        }
      }
    }
    __syncwarp();
  }
  if (is_counted<look>(b)) add_of_lanes(&b.numbers->num_fragments, num_fragments);
}

}  // namespace gpurt::cuda
