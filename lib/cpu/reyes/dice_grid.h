// Dicing a piece, eight vertices of a row at a time, with the bits of dice_piece.
#pragma once

#include "core/reyes/dice.h"
#include "cpu/reyes/lanes.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

// Control points along v of a row's vertices.
struct DiceColumns {
  float x[4][max_segments + 1], y[4][max_segments + 1], w[4][max_segments + 1], param[max_segments + 1];
};

// Where the last eight of n begin that are taken after those up to i; rows have eight vertices at least.
GPURT_INLINE uint32_t lanes_from(uint32_t i, uint32_t n) { return min(i, n - num_lanes); }

GPURT_INLINE FloatLanes cubic(const CubicWeights &c, FloatLanes p0, FloatLanes p1, FloatLanes p2,
                              FloatLanes p3)
{
  return (c.w0 * p0 + c.w3 * p3) + (c.w1 * p1 + c.w2 * p2);
}

inline void dice_columns(const RasterPatch &patch, const Piece &p, uint32_t width, DiceColumns &g)
{
  const IntLanes lane{0, 1, 2, 3, 4, 5, 6, 7};
  for (uint32_t from = 0; from < width; from += num_lanes) {
    const uint32_t i = lanes_from(from, width);
    const IntLanes k = int32_t(p.u) + ((int32_t(i) + lane) << (p.u_bits - p.grid_u));
    const float unit = 1.0f / float(parameter_one);
    const FloatLanes a = float_lanes(int32_t(parameter_one) - k) * unit, b = float_lanes(k) * unit;
    const FloatLanes w0 = a * a * a, w1 = 3.0f * (a * a * b), w2 = 3.0f * (b * b * a), w3 = b * b * b;
    store_lanes(g.param + i, b);
    for (int r = 0; r < 4; ++r) {
      const auto column = [&](const float(&c)[16]) {
        return (w0 * c[4 * r] + w3 * c[4 * r + 3]) + (w1 * c[4 * r + 1] + w2 * c[4 * r + 2]);
      };
      store_lanes(g.x[r] + i, column(patch.x));
      store_lanes(g.y[r] + i, column(patch.y));
      store_lanes(g.w[r] + i, column(patch.w));
    }
  }
}

inline void dice_grid(const RasterPatch &patch, const Piece &p, const RasterProjection &projection, Grid &g)
{
  const uint32_t width = (1u << p.grid_u) + 1;
  if (width < num_lanes) {
    dice_piece(patch, p, projection, g);
    return;
  }
  g.num_u = 1u << p.grid_u;
  g.num_v = 1u << p.grid_v;
  DiceColumns columns;
  dice_columns(patch, p, width, columns);
  for (uint32_t j = 0; j <= g.num_v; ++j) {
    const uint32_t k = p.v + (j << (p.v_bits - p.grid_v)), first = j * width;
    const CubicWeights v = cubic_weights(k);
    const FloatLanes kv = lanes(parameter(k));
    for (uint32_t from = 0; from < width; from += num_lanes) {
      const uint32_t i = lanes_from(from, width);
      const auto point = [&](const float(&c)[4][max_segments + 1]) {
        return cubic(v, load_lanes(c[0] + i), load_lanes(c[1] + i), load_lanes(c[2] + i),
                     load_lanes(c[3] + i));
      };
      store_lanes(g.hx + first + i, point(columns.x));
      store_lanes(g.hy + first + i, point(columns.y));
      store_lanes(g.hw + first + i, point(columns.w));
      store_lanes(g.u + first + i, load_lanes(columns.param + i));
      store_lanes(g.v + first + i, kv);
    }
  }
  mend_rim(patch, p, g);
  const uint32_t n = width * (g.num_v + 1);
  IntLanes in_front = IntLanes{} == 0;
  for (uint32_t from = 0; from < n; from += num_lanes) {
    const uint32_t k = lanes_from(from, n);
    const FloatLanes hx = load_lanes(g.hx + k), hy = load_lanes(g.hy + k), hw = load_lanes(g.hw + k);
    const FloatLanes inv_w = 1.0f / hw, limit = guard_band * hw;
    store_lanes(g.z + k, inv_w);
    store_lanes(g.x + k, floor(hx * inv_w * units_per_pixel + projection.centre_x));
    store_lanes(g.y + k, floor(hy * inv_w * units_per_pixel + projection.centre_y));
    in_front &= (hw >= smallest_w) & (abs(hx) <= limit) & (abs(hy) <= limit);
  }
  g.all_in_front = bits_of_mask(in_front) == (1u << num_lanes) - 1 ? 1 : 0;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
