// Stage 'dice': a piece becomes a grid of micropolygons whose rim consists of the vertices of its isolines.
//
// A grid has 2^grid_u x 2^grid_v cells. Its rim has at least as many places as the isolines there have vertices; places
// in between take the nearest vertex, so that some micropolygons are triangles, or nothing. What neighbours share are the
// isolines' vertices, which have the same bits in both.
#pragma once

#include "core/reyes/split.h"

namespace gpurt {

constexpr uint32_t max_grid_vertices = (max_segments + 1) * (max_segments + 1);

// Vertices row by row, u fastest.
struct Grid {
  uint32_t num_u, num_v;  // cells
  uint32_t all_in_front;  // 1: no micropolygon needs clipping
  float hx[max_grid_vertices], hy[max_grid_vertices], hw[max_grid_vertices];  // homogeneous raster
  float x[max_grid_vertices], y[max_grid_vertices];  // raster units, whole numbers, where w > 0
  float z[max_grid_vertices];                        // 1 / w: linear on the image
  float u[max_grid_vertices], v[max_grid_vertices];  // parameters of the patch
};

// Vertices that are projected lie within this many pixels of the image's centre; what leaves it is clipped.
constexpr float guard_band = 0x1p17f;

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE bool is_projectable(RasterPoint p)
{
  const float limit = guard_band * p.w;
  return p.w >= smallest_w && abs(p.x) <= limit && abs(p.y) <= limit;
}

// To raster units; for projectable points. Rounded down, as sample positions are.
GPURT_INLINE float project_x(float x, float inv_w, const RasterProjection &p)
{
  return floor(x * inv_w * units_per_pixel + p.centre_x);
}
GPURT_INLINE float project_y(float y, float inv_w, const RasterProjection &p)
{
  return floor(y * inv_w * units_per_pixel + p.centre_y);
}

// The parameters of a place on the rim: those of the nearest vertex of its isoline.
GPURT_INLINE void rim_parameters(const Piece &p, uint32_t edge, uint32_t k, uint32_t k0, uint32_t bits,
                                 uint32_t at, bool along_u, int a, int b, uint32_t &ku, uint32_t &kv)
{
  const uint32_t k1 = k0 + (1u << bits);
  const uint32_t q = nearest_vertex(k, p.edge[edge]);
  if (q > k0 && q < k1) {
    ku = along_u ? q : at;
    kv = along_u ? at : q;
    return;
  }
  const int corner = q <= k0 ? a : b;
  ku = p.corner_u[corner];
  kv = p.corner_v[corner];
}

// The parameters of vertex (i, j) of a piece's grid.
GPURT_INLINE void grid_parameters(const Piece &p, uint32_t i, uint32_t j, uint32_t &ku, uint32_t &kv)
{
  const uint32_t num_u = 1u << p.grid_u, num_v = 1u << p.grid_v;
  ku = p.u + (i << (p.u_bits - p.grid_u));
  kv = p.v + (j << (p.v_bits - p.grid_v));
  const bool is_low_u = i == 0, is_high_u = i == num_u, is_low_v = j == 0, is_high_v = j == num_v;
  if ((is_low_u || is_high_u) && (is_low_v || is_high_v)) {
    const int corner = (is_high_u ? 1 : 0) + (is_high_v ? 2 : 0);
    ku = p.corner_u[corner];
    kv = p.corner_v[corner];
  } else if (is_low_v) rim_parameters(p, 0, ku, p.u, p.u_bits, p.v, true, 0, 1, ku, kv);
  else if (is_high_v) rim_parameters(p, 1, ku, p.u, p.u_bits, p.v + (1u << p.v_bits), true, 2, 3, ku, kv);
  else if (is_low_u) rim_parameters(p, 2, kv, p.v, p.v_bits, p.u, false, 0, 2, ku, kv);
  else if (is_high_u) rim_parameters(p, 3, kv, p.v, p.v_bits, p.u + (1u << p.u_bits), false, 1, 3, ku, kv);
}

GPURT_INLINE bool is_nominal(const Piece &p, uint32_t i, uint32_t j, uint32_t ku, uint32_t kv)
{
  return ku == p.u + (i << (p.u_bits - p.grid_u)) && kv == p.v + (j << (p.v_bits - p.grid_v));
}

// Moves the places of the rim that are not vertices of their isolines. Where an isoline has as many vertices as the grid has
// places, only its ends may be elsewhere.
GPURT_HD inline void mend_rim(const RasterPatch &patch, const Piece &p, Grid &g)
{
  const auto mend = [&](uint32_t i, uint32_t j) {
    uint32_t ku, kv;
    grid_parameters(p, i, j, ku, kv);
    if (is_nominal(p, i, j, ku, kv)) return;
    const uint32_t k = j * (g.num_u + 1) + i;
    const RasterPoint q = patch_point(patch, ku, kv);
    g.hx[k] = q.x;
    g.hy[k] = q.y;
    g.hw[k] = q.w;
    g.u[k] = parameter(ku);
    g.v[k] = parameter(kv);
  };
  for (uint32_t e = 0; e < 4; ++e) {
    const bool along_u = e < 2;
    const uint32_t n = along_u ? g.num_u : g.num_v,
                   step = along_u ? p.u_bits - p.grid_u : p.v_bits - p.grid_v;
    const uint32_t at = (e & 1) == 0 ? 0 : (along_u ? g.num_v : g.num_u);
    // Corners belong to the edges along u.
    if (along_u) {
      mend(0, at);
      mend(n, at);
    }
    if (p.edge[e] <= step) continue;
    for (uint32_t k = 1; k < n; ++k) mend(along_u ? k : at, along_u ? at : k);
  }
}

// All vertices of a piece, one after another: what a warp does side by side.
GPURT_HD inline void dice_piece(const RasterPatch &patch, const Piece &p, const RasterProjection &projection,
                                Grid &g)
{
  g.num_u = 1u << p.grid_u;
  g.num_v = 1u << p.grid_v;
  const uint32_t width = g.num_u + 1;
  // The columns' control points, by column.
  float cx[4][max_segments + 1], cy[4][max_segments + 1], cw[4][max_segments + 1];
  float param[max_segments + 1];
  for (uint32_t i = 0; i < width; ++i) {
    const uint32_t k = p.u + (i << (p.u_bits - p.grid_u));
    const CubicWeights u = cubic_weights(k);
    param[i] = parameter(k);
    for (int r = 0; r < 4; ++r) {
      cx[r][i] = cubic(u, patch.x[4 * r], patch.x[4 * r + 1], patch.x[4 * r + 2], patch.x[4 * r + 3]);
      cy[r][i] = cubic(u, patch.y[4 * r], patch.y[4 * r + 1], patch.y[4 * r + 2], patch.y[4 * r + 3]);
      cw[r][i] = cubic(u, patch.w[4 * r], patch.w[4 * r + 1], patch.w[4 * r + 2], patch.w[4 * r + 3]);
    }
  }
  for (uint32_t j = 0; j <= g.num_v; ++j) {
    const uint32_t k = p.v + (j << (p.v_bits - p.grid_v)), first = j * width;
    const CubicWeights v = cubic_weights(k);
    const float kv = parameter(k);
    for (uint32_t i = 0; i < width; ++i) {
      g.hx[first + i] = cubic(v, cx[0][i], cx[1][i], cx[2][i], cx[3][i]);
      g.hy[first + i] = cubic(v, cy[0][i], cy[1][i], cy[2][i], cy[3][i]);
      g.hw[first + i] = cubic(v, cw[0][i], cw[1][i], cw[2][i], cw[3][i]);
      g.u[first + i] = param[i];
      g.v[first + i] = kv;
    }
  }
  mend_rim(patch, p, g);
  const uint32_t n = width * (g.num_v + 1);
  uint32_t in_front = 1;
  for (uint32_t k = 0; k < n; ++k) {
    const float inv_w = 1.0f / g.hw[k];
    g.z[k] = inv_w;
    g.x[k] = project_x(g.hx[k], inv_w, projection);
    g.y[k] = project_y(g.hy[k], inv_w, projection);
    const float limit = guard_band * g.hw[k];
    in_front &=
        uint32_t(g.hw[k] >= smallest_w) & uint32_t(abs(g.hx[k]) <= limit) & uint32_t(abs(g.hy[k]) <= limit);
  }
  g.all_in_front = in_front;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
