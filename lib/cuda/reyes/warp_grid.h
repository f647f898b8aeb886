// Stage 'dice' by a warp: the vertices of a piece's grid in shared memory. For .cu files alone.
#pragma once

#include "cuda/reyes/sampler.h"

namespace gpurt::cuda {

// A warp's grid.
struct WarpGrid {
  RasterPatch patch;
  Piece piece;
  float columns[3][4][max_segments + 1];  // control points along v of x, y and w at the vertices' u
  int32_t x[max_grid_vertices], y[max_grid_vertices];  // raster units; not_projectable
  float z[max_grid_vertices];
};
constexpr int32_t not_projectable = INT32_MIN;

// Copies by words: T consists of them.
template <class T>
__device__ inline void copy_words(T &to, const T &from, uint32_t lane)
{
  static_assert(sizeof(T) % 4 == 0);
  for (uint32_t i = lane; i < sizeof(T) / 4; i += 32)
    reinterpret_cast<uint32_t *>(&to)[i] = reinterpret_cast<const uint32_t *>(&from)[i];
}

// (u, v) of a grid's vertices on their root.
struct WarpPlaces {
  float u[max_grid_vertices], v[max_grid_vertices];
};

// Vertex k lies at h; whether it can be projected.
__device__ __forceinline__ bool put_vertex(WarpGrid &g, uint32_t k, RasterPoint h,
                                           const RasterProjection &projection)
{
  const bool is_here = is_projectable(h);
  const float inv_w = 1.0f / h.w;
  g.z[k] = inv_w;
  g.x[k] = is_here ? int32_t(project_x(h.x, inv_w, projection)) : not_projectable;
  g.y[k] = is_here ? int32_t(project_y(h.y, inv_w, projection)) : 0;
  return is_here;
}

// As mend_rim, a lane a place of an edge, of edges alone whose isolines have fewer vertices. Whether all that were moved can be
// projected.
__device__ __forceinline__ bool mend_rim(WarpGrid &g, const RasterProjection &projection, uint32_t lane,
                                         WarpPlaces *places)
{
  const Piece &p = g.piece;
  const uint32_t num_u = 1u << p.grid_u, num_v = 1u << p.grid_v;
  // Lanes 0 .. 3 look at an edge each, lanes 4 .. 7 at a corner.
  bool is_off = false;
  if (lane < 4) is_off = p.edge[lane] > (lane < 2 ? p.u_bits - p.grid_u : p.v_bits - p.grid_v);
  else if (lane < 8) {
    is_off = p.corner_u[lane - 4] != p.u + ((lane & 1) << p.u_bits) ||
             p.corner_v[lane - 4] != p.v + ((lane >> 1 & 1) << p.v_bits);
  }
  const uint32_t off = __ballot_sync(all_lanes, is_off);
  constexpr uint32_t corners = 4;
  bool is_in_front = true;
  for (uint32_t left = (off & 15) | (off > 15 ? 1u << corners : 0); left != 0; left &= left - 1) {
    const uint32_t e = uint32_t(__ffs(int(left))) - 1;
    const bool along_u = e < 2;
    const uint32_t n = along_u ? num_u : num_v, at = (e & 1) == 0 ? 0 : (along_u ? num_v : num_u);
    uint32_t i = along_u ? lane : at, j = along_u ? at : lane;
    bool is_place = lane > 0 && lane < n;
    if (e == corners) {
      i = (lane & 1) != 0 ? num_u : 0;
      j = (lane & 2) != 0 ? num_v : 0;
      is_place = lane < 4;
    }
    if (!is_place) continue;
    uint32_t ku, kv;
    grid_parameters(p, i, j, ku, kv);
    if (is_nominal(p, i, j, ku, kv)) continue;
    const uint32_t k = j * (num_u + 1) + i;
    is_in_front &= put_vertex(g, k, patch_point(g.patch, ku, kv), projection);
    if (places != nullptr) {
      places->u[k] = parameter(ku);
      places->v[k] = parameter(kv);
    }
  }
  return is_in_front;
}

// As dice_piece, a lane a vertex; `places` may be null. Whether all of them can be projected, and all that were moved could be
// where they were before.
__device__ __forceinline__ bool dice(WarpGrid &g, const RasterProjection &projection, uint32_t lane,
                                     WarpPlaces *places = nullptr)
{
  const Piece &p = g.piece;
  const RasterPatch &patch = g.patch;
  const uint32_t num_u = 1u << p.grid_u, num_v = 1u << p.grid_v, width = num_u + 1;
  for (uint32_t k = lane; k < width * 4; k += 32) {
    const uint32_t i = k / 4, r = k % 4;
    const CubicWeights u = cubic_weights(p.u + (i << (p.u_bits - p.grid_u)));
    g.columns[0][r][i] = cubic(u, patch.x[4 * r], patch.x[4 * r + 1], patch.x[4 * r + 2], patch.x[4 * r + 3]);
    g.columns[1][r][i] = cubic(u, patch.y[4 * r], patch.y[4 * r + 1], patch.y[4 * r + 2], patch.y[4 * r + 3]);
    g.columns[2][r][i] = cubic(u, patch.w[4 * r], patch.w[4 * r + 1], patch.w[4 * r + 2], patch.w[4 * r + 3]);
  }
  __syncwarp();
  // k / width for k < 2^9.
  const uint32_t reciprocal = 65536 / width + 1;
  bool is_in_front = true;
  for (uint32_t k = lane; k < width * (num_v + 1); k += 32) {
    const uint32_t j = k * reciprocal >> 16, i = k - j * width;
    const uint32_t kv = p.v + (j << (p.v_bits - p.grid_v));
    const CubicWeights v = cubic_weights(kv);
    const auto coordinate = [&](int c) {
      return cubic(v, g.columns[c][0][i], g.columns[c][1][i], g.columns[c][2][i], g.columns[c][3][i]);
    };
    is_in_front &= put_vertex(g, k, {coordinate(0), coordinate(1), coordinate(2)}, projection);
    if (places != nullptr) {
      places->u[k] = parameter(p.u + (i << (p.u_bits - p.grid_u)));
      places->v[k] = parameter(kv);
    }
  }
  // The rim last: few grids have places there that are no vertices, and lanes that look for them would hold up the others.
  __syncwarp();
  is_in_front &= mend_rim(g, projection, lane, places);
  return __all_sync(all_lanes, is_in_front);
}

// The light of a warp's micropolygons, or of blocks of them.
struct WarpLight {
  ShadingColumns columns;
  uint32_t packed[max_segments * max_segments];
};

// Stage 'shade' of a grid's micropolygons; how many points that were.
__device__ __forceinline__ uint32_t shade_grid(const ReyesBatch &b, const WarpGrid &g, uint32_t root,
                                               WarpLight &light, uint32_t lane)
{
  const Piece &p = g.piece;
  const uint32_t bits_u = shaded_bits(p.grid_u, b.own.block_bits),
                 bits_v = shaded_bits(p.grid_v, b.own.block_bits);
  for (uint32_t k = lane; k < 4u << bits_u; k += 32)
    make_shading_column(g.patch, middle_of_part(p.u, p.u_bits, bits_u, k / 4), k / 4, k % 4, light.columns);
  const SceneView &scene = b.scene.scene;
  const Material &material = scene.materials[scene.segments[range_of_root(b.scene, root).segment].material];
  __syncwarp();
  const uint32_t n = 1u << (bits_u + bits_v);
  for (uint32_t k = lane; k < n; k += 32) {
    const uint32_t i = k & ((1u << bits_u) - 1), j = k >> bits_u;
    light.packed[k] =
        shade_point(scene, material, b.own, light.columns, root, i, middle_of_part(p.u, p.u_bits, bits_u, i),
                    middle_of_part(p.v, p.v_bits, bits_v, j));
  }
  __syncwarp();
  return n;
}

// That of micropolygon q.
__device__ __forceinline__ uint32_t light_of(const ReyesBatch &b, const WarpGrid &g, const WarpLight &light,
                                             uint32_t q)
{
  const uint32_t bits_u = shaded_bits(g.piece.grid_u, b.own.block_bits),
                 bits_v = shaded_bits(g.piece.grid_v, b.own.block_bits);
  const uint32_t i = q & ((1u << g.piece.grid_u) - 1), j = q >> g.piece.grid_u;
  return light.packed[(j >> (g.piece.grid_v - bits_v)) << bits_u | i >> (g.piece.grid_u - bits_u)];
}

// What samples keep in place of where on the micropolygon they lie whose first vertex is k, if anything.
__device__ inline Vec2f kept_middle(const ReyesBatch &b, const WarpGrid &g, uint32_t k)
{
  if (b.keeps_middles == 0) return no_middle();
  const uint32_t width = (1u << g.piece.grid_u) + 1, j = k / width;
  return middle_of(middles_of(g.piece, b.own.block_bits), k - j * width, j);
}

// The parameters of vertex k of a grid.
__device__ inline Vec2f place_of_vertex(const WarpGrid &g, uint32_t k)
{
  const uint32_t width = (1u << g.piece.grid_u) + 1, j = k / width;
  uint32_t ku, kv;
  grid_parameters(g.piece, k - j * width, j, ku, kv);
  return {parameter(ku), parameter(kv)};
}

}  // namespace gpurt::cuda
