// Eight micropolygons of a grid's row, set up together; and a micropolygon against eight samples.
//
// Micropolygons are tiny: from one of their own vertices all numbers of their edges are whole and stay below 2^24 in whatever
// order they are added, so that coverage and depth have the bits of `cover`.
#pragma once

#include "core/reyes/sample.h"
#include "cpu/reyes/lanes.h"

namespace gpurt {

// Of a micropolygon's box. Samples of its cells lie up to a pixel beyond: 3 * 2048 * (2048 + 256) < 2^24.
constexpr float tiny_extent = 2048.0f;

// Triangles from their vertex a, turned so that their insides are positive: edges a x + b y + c opposite to each corner.
struct TinyTriangles {
  FloatLanes aa, ab, ac, ba, bb, ca, cb;  // those of b and c go through a
  FloatLanes za, zb, zc;
  FloatLanes threshold_a, threshold_b, threshold_c;
  IntLanes is_swapped;  // b and c are exchanged
};

// What eight samples have of a triangle: 1 / w, or 0 where it does not cover them, and the shares of b and c in it.
struct TinyCover {
  FloatLanes z, share_b, share_c;
};

// Micropolygons a b c d as triangles a b c and a c d.
struct TinyQuads {
  FloatLanes ax, ay;  // from the block's origin
  TinyTriangles s, t;
  uint32_t are_there;  // bits of lanes that touch the block
  uint32_t are_tiny;   // of those that may be sampled this way
  uint32_t have_area;  // of those that may cover something
  int32_t x0[num_lanes], y0[num_lanes], x1[num_lanes], y1[num_lanes];  // cells
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE FloatLanes edge_threshold(FloatLanes ax, FloatLanes ay, FloatLanes bx, FloatLanes by)
{
  return (by < ay) | ((by == ay) & (bx > ax)) ? lanes(-0.5f) : lanes(0.5f);
}

// As make_small_triangle; what has no area covers nothing. Returns where there is some.
GPURT_INLINE IntLanes make_tiny_triangles(FloatLanes az, FloatLanes bx, FloatLanes by, FloatLanes bz,
                                          FloatLanes cx, FloatLanes cy, FloatLanes cz, TinyTriangles &t)
{
  const FloatLanes twice_area = bx * cy - by * cx;
  const IntLanes is_swapped = twice_area < 0.0f, has_area = twice_area != 0.0f;
  const FloatLanes inv_area = 1.0f / abs(twice_area);
  const FloatLanes px = is_swapped ? cx : bx, py = is_swapped ? cy : by, qx = is_swapped ? bx : cx,
                   qy = is_swapped ? by : cy, zero = lanes(0.0f);
  t.is_swapped = is_swapped;
  t.aa = py - qy;
  t.ab = qx - px;
  t.ac = (qy - py) * px - (qx - px) * py;
  t.ba = qy;
  t.bb = -qx;
  t.ca = -py;
  t.cb = px;
  t.threshold_a = has_area ? edge_threshold(px, py, qx, qy) : lanes(infinity);
  t.threshold_b = edge_threshold(qx, qy, zero, zero);
  t.threshold_c = edge_threshold(zero, zero, px, py);
  t.za = az * inv_area;
  t.zb = (is_swapped ? cz : bz) * inv_area;
  t.zc = (is_swapped ? bz : cz) * inv_area;
  return has_area;
}

// As `cover`, of lane k's triangle, of samples (x, y) from its vertex a.
GPURT_INLINE TinyCover cover_tiny(const TinyTriangles &t, uint32_t k, FloatLanes x, FloatLanes y)
{
  const FloatLanes ea = exact_fma(lanes(t.aa[k]), x, exact_fma(lanes(t.ab[k]), y, lanes(t.ac[k])));
  const FloatLanes eb = exact_fma(lanes(t.ba[k]), x, t.bb[k] * y);
  const FloatLanes ec = exact_fma(lanes(t.ca[k]), x, t.cb[k] * y);
  const FloatLanes share_b = eb * t.zb[k], share_c = ec * t.zc[k];
  const FloatLanes z = ea * t.za[k] + share_b + share_c;
  const IntLanes is_inside = (ea > t.threshold_a[k]) & (eb > t.threshold_b[k]) & (ec > t.threshold_c[k]);
  return {lanes_from_bits((UintLanes)is_inside & bits_of(z)), share_b, share_c};
}

// As cover_uv, of corners b and c as they were before they were exchanged.
GPURT_INLINE void cover_uv(const TinyCover &cover, bool is_swapped, Vec2f a, Vec2f b, Vec2f c, FloatLanes &u,
                           FloatLanes &v)
{
  const FloatLanes wb = (is_swapped ? cover.share_c : cover.share_b) / cover.z,
                   wc = (is_swapped ? cover.share_b : cover.share_c) / cover.z, wa = 1.0f - wb - wc;
  u = fma(wa, lanes(a.x), fma(wb, lanes(b.x), wc * c.x));
  v = fma(wa, lanes(a.y), fma(wb, lanes(b.y), wc * c.y));
}

// Micropolygons first .. first + 7 of row j of a grid that is in front of the eye; `n` of them exist. Vertices that are read
// beyond the grid's are of no consequence. False: none touches the block.
GPURT_INLINE bool make_tiny_quads(const Grid &g, uint32_t j, uint32_t first, uint32_t n,
                                  const SampleBlock &block, TinyQuads &q)
{
  const uint32_t width = g.num_u + 1, a = j * width + first, d = a + width;
  const float ox = float(block.origin_x), oy = float(block.origin_y);
  const float size_x = float(block.cells_x << block.cell_bits),
              size_y = float(block.cells_y << block.cell_bits);
  const FloatLanes ax = load_lanes(g.x + a), bx = load_lanes(g.x + a + 1), cx = load_lanes(g.x + d + 1),
                   dx = load_lanes(g.x + d);
  const FloatLanes ay = load_lanes(g.y + a), by = load_lanes(g.y + a + 1), cy = load_lanes(g.y + d + 1),
                   dy = load_lanes(g.y + d);
  const FloatLanes x0 = min(min(ax, bx), min(cx, dx)), x1 = max(max(ax, bx), max(cx, dx));
  const FloatLanes y0 = min(min(ay, by), min(cy, dy)), y1 = max(max(ay, by), max(cy, dy));
  // As cells_of_box.
  const FloatLanes lx = x0 - ox, hx = x1 - ox, ly = y0 - oy, hy = y1 - oy;
  const IntLanes lane{0, 1, 2, 3, 4, 5, 6, 7};
  q.are_there =
      bits_of_mask((lx < size_x) & (hx >= 0.0f) & (ly < size_y) & (hy >= 0.0f) & (lane < int32_t(n)));
  if (q.are_there == 0) return false;
  q.are_tiny = bits_of_mask((x1 - x0 <= tiny_extent) & (y1 - y0 <= tiny_extent));
  // Within the block, for lanes that are not there too.
  const int32_t bits = block.cell_bits;
  const FloatLanes zero = lanes(0.0f), last_x = lanes(size_x - 1.0f), last_y = lanes(size_y - 1.0f);
  store_lanes(q.x0, int_lanes(min(max(lx, zero), last_x)) >> bits);
  store_lanes(q.y0, int_lanes(min(max(ly, zero), last_y)) >> bits);
  store_lanes(q.x1, int_lanes(max(min(hx, last_x), zero)) >> bits);
  store_lanes(q.y1, int_lanes(max(min(hy, last_y), zero)) >> bits);
  q.ax = ax - ox;
  q.ay = ay - oy;
  const FloatLanes az = load_lanes(g.z + a), bz = load_lanes(g.z + a + 1), cz = load_lanes(g.z + d + 1),
                   dz = load_lanes(g.z + d);
  const FloatLanes rcx = cx - ax, rcy = cy - ay;
  q.have_area = bits_of_mask(make_tiny_triangles(az, bx - ax, by - ay, bz, rcx, rcy, cz, q.s) |
                             make_tiny_triangles(az, rcx, rcy, cz, dx - ax, dy - ay, dz, q.t));
  return true;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
