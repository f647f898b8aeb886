// Stages 'dice' and 'sample' of grids that sample_grids.cu leaves: micropolygons of any size, through the eye plane, with
// alpha masks. Triangles of them that are large go on to a kernel of their own.
#include <type_traits>

#include "cuda/reyes/warp_grid.h"

namespace gpurt::cuda {
namespace {

// Vertices of a grid, as numbers j * width + i.
struct Corners {
  uint32_t at[3];
};

__device__ __noinline__ LargeTriangle large_triangle(const WarpGrid &g, const Corners &corners, uint32_t root,
                                                     RasterPoint largest)
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
  t.root = root;
  return t;
}

// A triangle of a micropolygon, from vertex `a` as the origin. False: it is not small, or covers nothing.
__device__ bool make_small(const WarpGrid &g, const Corners &c, int32_t ox, int32_t oy, SmallTriangle &t)
{
  const uint32_t i = c.at[0], j = c.at[1], k = c.at[2];
  return make_small_triangle(float(g.x[i] - ox), float(g.y[i] - oy), g.z[i], float(g.x[j] - ox),
                             float(g.y[j] - oy), g.z[j], float(g.x[k] - ox), float(g.y[k] - oy), g.z[k], t);
}

__device__ bool is_small(const WarpGrid &g, const Corners &c)
{
  const int32_t xa = g.x[c.at[0]], xb = g.x[c.at[1]], xc = g.x[c.at[2]];
  if (xa == not_projectable || xb == not_projectable || xc == not_projectable) return false;
  const int32_t ya = g.y[c.at[0]], yb = g.y[c.at[1]], yc = g.y[c.at[2]];
  return max(max(xa, xb), xc) - min(min(xa, xb), xc) <= int32_t(small_extent) &&
         max(max(ya, yb), yc) - min(min(ya, yb), yc) <= int32_t(small_extent);
}

template <bool finds_spots, bool has_masks>
__global__ void __launch_bounds__(block_size) sample_rest(const __grid_constant__ ReyesBatch b)
{
  __shared__ WarpGrid grids[block_size / 32];
  constexpr bool may_have_light = !finds_spots && !has_masks;
  __shared__ WarpLight lights[may_have_light ? block_size / 32 : 1];
  WarpGrid &g = grids[threadIdx.x / 32];
  const uint32_t lane = threadIdx.x % 32;
  const uint32_t num_rest = b.numbers->num_rest;
  uint32_t num_fragments = 0;
  for (uint32_t item; (item = next_item(&b.numbers->tickets[3], num_rest)) != num_rest;) {
    const uint32_t leaf = b.rest[item] / 8, slot = b.leaves[leaf].slot, root = b.roots[slot];
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
    for (uint32_t first = b.rest[item] % 8 * 32; first < num_quads; first += 32) {
      const uint32_t q = first + lane;
      const bool is_quad = q < num_quads;
      // What samples keep: the root's number or, in its place, light.
      uint32_t kept = root;
      if constexpr (may_have_light) {
        if (b.has_own_light) kept = ~light_of(b, g, lights[threadIdx.x / 32], is_quad ? q : 0);
      }
      const uint32_t a = is_quad ? (q >> g.piece.grid_u) * width + (q & (num_u - 1)) : 0;
      const Corners corners[2] = {{{a, a + 1, a + width + 1}}, {{a, a + width + 1, a + width}}};
      SmallTriangle t[2];
      bool has[2] = {false, false};
      CellRange cells{0, 0, -1, -1};
      int32_t ox = 0, oy = 0;
      if (is_quad) {
        const int32_t x[4] = {g.x[a], g.x[a + 1], g.x[a + width], g.x[a + width + 1]},
                      y[4] = {g.y[a], g.y[a + 1], g.y[a + width], g.y[a + width + 1]};
        int32_t x0 = min(min(x[0], x[1]), min(x[2], x[3])), x1 = max(max(x[0], x[1]), max(x[2], x[3]));
        int32_t y0 = min(min(y[0], y[1]), min(y[2], y[3])), y1 = max(max(y[0], y[1]), max(y[2], y[3]));
        ox = x[0];
        oy = y[0];
        const bool is_whole =
            is_in_front && x1 - x0 <= int32_t(small_extent) && y1 - y0 <= int32_t(small_extent);
        if (!is_whole) {
          // One by one.
          x0 = y0 = INT32_MAX;
          x1 = y1 = INT32_MIN;
        }
        for (int i = 0; i < 2; ++i) {
          if (is_whole || is_small(g, corners[i])) {
            has[i] = make_small(g, corners[i], ox, oy, t[i]);
            if (is_whole) continue;
            for (const uint32_t k : corners[i].at) {
              x0 = min(x0, g.x[k]);
              x1 = max(x1, g.x[k]);
              y0 = min(y0, g.y[k]);
              y1 = max(y1, g.y[k]);
            }
          } else {
            hand_on_large<finds_spots, has_masks>(b, large_triangle(g, corners[i], kept, b.largest[slot]),
                                                  num_fragments);
          }
        }
        if ((has[0] || has[1]) && !cells_of_box(b.samples, x0, y0, x1, y1, cells)) has[0] = has[1] = false;
      }
      // In the place of one that is not there stands the other.
      if (!has[0]) t[0] = t[1];
      if (!has[1]) t[1] = t[0];
      sample_small<finds_spots, has_masks>(
          b, kept, has[0] || has[1], cells, ox, oy, t,
          [&](int i, Vec2f(&places)[3]) {
            const Corners &c = corners[has[i] ? i : 1 - i];
            for (int k = 0; k < 3; ++k) places[k] = place_of_vertex(g, c.at[k]);
          },
          num_fragments);
    }
    __syncwarp();
  }
  if (!finds_spots) add_of_lanes(&b.numbers->num_fragments, num_fragments);
}

}  // namespace

void launch_sample_rest(const ReyesBatch &batch, bool finds_spots, cudaStream_t stream)
{
  choose_kernel(finds_spots, batch.scene.scene.has_alpha_masks != 0, [&](auto spots, auto masks) {
    launch_persistent("REYES stages 'dice' and 'sample', any micropolygons",
                      sample_rest<spots.value, masks.value>, uint64_t(batch.leaf_capacity) * 32, stream,
                      batch);
  });
}

}  // namespace gpurt::cuda
