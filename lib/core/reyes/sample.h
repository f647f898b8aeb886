// Stage 'sample': which samples a micropolygon covers, exactly, and what it leaves there.
//
// Vertices and samples are whole raster units, edge functions whole numbers: in float where a triangle is so small that
// they stay below 2^24, else in double, where they stay below 2^53. A sample on an edge belongs to the triangle that has
// it at its left or top. So triangles that share vertices neither leave samples out nor take them twice.
//
// Vertices that cannot be projected, behind the eye or far beside the image, stay homogeneous: the edge function of an
// edge that has one is the determinant of the sample and its two ends, and no polygon needs to be cut. Which form an edge
// takes depends on its two vertices alone, and it is evaluated alike from both sides.
// Source: Olano and Greer 1997, triangle scan conversion using 2D homogeneous coordinates.
//
// A sample keeps the nearest surface: the largest 1 / w, of equals the lowest root, and of that one's the smallest place
// (place_key). So what a sample sees depends on the scene alone, and surfaces may come in any order.
#pragma once

#include "core/reyes/dice.h"

namespace gpurt {

// The samples of a rectangle of the image, sorted by square cells: those of cell c are first[c] .. first[c + 1] - 1, and
// cells go row by row, so that a run of cells in a row is a run of samples.
struct SampleBlock {
  const float *x, *y;  // raster units from the block's origin: whole numbers
  float *z;            // 1 / w of the nearest surface; 0: none
  uint32_t *root;      // of that
  float *u, *v;  // where on it: parameters of the patch, or weights of the triangle's 2nd and 3rd corner
  const uint32_t *first;       // [cells_x * cells_y + 1]
  int32_t origin_x, origin_y;  // of cell 0, in raster units of the image
  int32_t cell_bits;           // log2 of a cell's edge in raster units
  int32_t cells_x, cells_y;
  uint32_t num_samples;
};

// A corner with what is interpolated.
struct RasterVertex {
  float x,
      y;    // raster units from the image's top left corner: whole numbers; of no meaning if not projectable
  float z;  // 1 / w
  float u, v;
  RasterPoint h;
  bool is_projectable;
};

// Triangles whose extent is at most this many units have edge functions below 2^24.
constexpr float small_extent = 2896.0f;

// A triangle of projectable vertices within small_extent, from a block's origin, turned so that its inside is positive.
struct SmallTriangle {
  float ax, ay, bx, by, cx, cy;
  float threshold_a, threshold_b, threshold_c;  // of the edges opposite to the corners
  float za, zb, zc;                             // 1 / w over twice the area
  bool is_swapped;                              // b and c are exchanged
};

// Corners of any triangle, from the image's top left corner; (x, y, 1) of those that are projected.
struct AnyTriangle {
  double x[3], y[3], w[3];
  bool is_projected[3];
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE RasterVertex raster_vertex(RasterPoint p, float u, float v, const RasterProjection &projection)
{
  const float inv_w = 1.0f / p.w;
  return {project_x(p.x, inv_w, projection),
          project_y(p.y, inv_w, projection),
          inv_w,
          u,
          v,
          p,
          is_projectable(p)};
}

// Points where this exceeds edge_threshold are inside of the edge a b.
GPURT_INLINE float edge_function(float ax, float ay, float bx, float by, float px, float py)
{
  return (bx - ax) * (py - ay) - (by - ay) * (px - ax);
}
// Whole numbers: above -1/2 includes 0. An edge and its reverse never both include their points.
GPURT_INLINE float edge_threshold(float ax, float ay, float bx, float by)
{
  return by < ay || (by == ay && bx > ax) ? -0.5f : 0.5f;
}

// False: no area, nothing is covered.
GPURT_INLINE bool make_small_triangle(float ax, float ay, float az, float bx, float by, float bz, float cx,
                                      float cy, float cz, SmallTriangle &t)
{
  const float twice_area = edge_function(ax, ay, bx, by, cx, cy);
  t.is_swapped = twice_area < 0.0f;
  const float inv_area = 1.0f / abs(twice_area);
  t.ax = ax;
  t.ay = ay;
  t.bx = t.is_swapped ? cx : bx;
  t.by = t.is_swapped ? cy : by;
  t.cx = t.is_swapped ? bx : cx;
  t.cy = t.is_swapped ? by : cy;
  t.threshold_a = edge_threshold(t.bx, t.by, t.cx, t.cy);
  t.threshold_b = edge_threshold(t.cx, t.cy, t.ax, t.ay);
  t.threshold_c = edge_threshold(t.ax, t.ay, t.bx, t.by);
  t.za = az * inv_area;
  t.zb = (t.is_swapped ? cz : bz) * inv_area;
  t.zc = (t.is_swapped ? bz : cz) * inv_area;
  return twice_area != 0.0f;
}

// 1 / w at a sample; 0: it is not covered. The shares of b and c in it are the weights in perspective times 1 / w.
GPURT_INLINE float cover(const SmallTriangle &t, float px, float py, float &share_b, float &share_c)
{
  const float ea = edge_function(t.bx, t.by, t.cx, t.cy, px, py);
  const float eb = edge_function(t.cx, t.cy, t.ax, t.ay, px, py);
  const float ec = edge_function(t.ax, t.ay, t.bx, t.by, px, py);
  share_b = eb * t.zb;
  share_c = ec * t.zc;
  const float z = ea * t.za + share_b + share_c;
  return (ea > t.threshold_a) & (eb > t.threshold_b) & (ec > t.threshold_c) ? z : 0.0f;
}

// The edge function from vertex i to vertex k: (px - ox) a + (py - oy) b + c. From k to i it has the opposite value.
struct EdgeForm {
  double ox, oy, a, b, c;
};
GPURT_HD inline EdgeForm edge_form(const AnyTriangle &t, int i, int k)
{
  const double xi = t.x[i], yi = t.y[i], wi = t.w[i], xk = t.x[k], yk = t.y[k], wk = t.w[k];
  // Through a projected vertex exactly; between two of them all numbers are whole.
  if (t.is_projected[i]) return {xi, yi, yi * wk - yk, xk - xi * wk, 0.0};
  if (t.is_projected[k]) return {xk, yk, yi - yk * wi, xk * wi - xi, 0.0};
  return {0.0, 0.0, yi * wk - wi * yk, wi * xk - xi * wk, xi * yk - yi * xk};
}
GPURT_INLINE double edge_value(const EdgeForm &e, double px, double py)
{
  return ((px - e.ox) * e.a + (py - e.oy) * e.b) + e.c;
}

struct AnyCover {
  EdgeForm edge[3];    // opposite to the corners
  double scale[3];     // what edge functions add to 1 / w
  bool takes_edge[3];  // whether points on the edge belong to the triangle
  double sign;         // of the inside
};

// False: seen from its edge, nothing is covered.
GPURT_HD inline bool make_any_cover(const RasterVertex *const (&corner)[3],
                                    const RasterProjection &projection, AnyCover &cover)
{
  AnyTriangle t;
  double z[3];
  for (int i = 0; i < 3; ++i) {
    const RasterVertex &v = *corner[i];
    t.is_projected[i] = v.is_projectable;
    if (v.is_projectable) {
      t.x[i] = double(v.x);
      t.y[i] = double(v.y);
      t.w[i] = 1.0;
      z[i] = double(v.z);
    } else {
      t.w[i] = double(v.h.w);
      t.x[i] = double(v.h.x) * double(units_per_pixel) + double(projection.centre_x) * t.w[i];
      t.y[i] = double(v.h.y) * double(units_per_pixel) + double(projection.centre_y) * t.w[i];
      z[i] = 1.0;
    }
  }
  for (int i = 0; i < 3; ++i) cover.edge[i] = edge_form(t, (i + 1) % 3, (i + 2) % 3);
  const EdgeForm &e = cover.edge[0];
  const double area = ((t.x[0] - t.w[0] * e.ox) * e.a + (t.y[0] - t.w[0] * e.oy) * e.b) + t.w[0] * e.c;
  if (area == 0.0) return false;
  cover.sign = area < 0.0 ? -1.0 : 1.0;
  for (int i = 0; i < 3; ++i) {
    const double a = cover.edge[i].a * cover.sign, b = cover.edge[i].b * cover.sign;
    cover.takes_edge[i] = a > 0.0 || (a == 0.0 && b > 0.0);
    cover.scale[i] = z[i] / area;
  }
  return true;
}

// As `cover` for small triangles, of a sample in raster units of the image.
GPURT_INLINE float cover_any(const AnyCover &t, double px, double py, float &share_b, float &share_c)
{
  const double ea = edge_value(t.edge[0], px, py), eb = edge_value(t.edge[1], px, py),
               ec = edge_value(t.edge[2], px, py);
  const double b = eb * t.scale[1], c = ec * t.scale[2];
  share_b = float(b);
  share_c = float(c);
  const double sa = ea * t.sign, sb = eb * t.sign, sc = ec * t.sign;
  const bool is_inside = (sa > 0.0 || (sa == 0.0 && t.takes_edge[0])) &&
                         (sb > 0.0 || (sb == 0.0 && t.takes_edge[1])) &&
                         (sc > 0.0 || (sc == 0.0 && t.takes_edge[2]));
  return is_inside ? float((ea * t.scale[0] + b) + c) : 0.0f;
}

// Makes [x0, x1] of a row [y0, y1] smaller where a triangle covers nothing: the box of a large one may be far larger than it is.
// Edge functions are linear; what they are largest at within the row decides. False: nothing is covered.
GPURT_HD inline bool narrow_row(const AnyCover &t, double y0, double y1, double &x0, double &x1)
{
  const double begin = x0, end = x1;
  for (const EdgeForm &e : t.edge) {
    const double a = e.a * t.sign, b = e.b * t.sign, c = e.c * t.sign;
    const double below = (y0 - e.oy) * b, above = (y1 - e.oy) * b;
    // Ten roundings, here and in cover_any, of at most 2^-53 of the largest terms: 2^-48 of a sum of them is more.
    const double terms = (abs(begin - e.ox) + abs(end - e.ox)) * abs(a) + abs(below) + abs(above) + abs(c);
    const double rest = (below > above ? below : above) + c + terms * 0x1p-48;
    if (a == 0.0) {
      if (rest < 0.0) return false;
      continue;
    }
    // A unit more for the rounding of the quotient; what is not a number leaves the range as it is.
    const double bound = e.ox - rest / a;
    if (a > 0.0 && bound - 1.0 > x0) x0 = bound - 1.0;
    if (a < 0.0 && bound + 1.0 < x1) x1 = bound + 1.0;
  }
  return x0 <= x1;
}

// What a covered sample of a triangle sees: (u, v) interpolated in perspective.
GPURT_INLINE Vec2f cover_uv(const RasterVertex &a, const RasterVertex &b, const RasterVertex &c, float z,
                            float share_b, float share_c)
{
  const float wb = share_b / z, wc = share_c / z, wa = 1.0f - wb - wc;
  return {fma(wa, a.u, fma(wb, b.u, wc * c.u)), fma(wa, a.v, fma(wb, b.v, wc * c.v))};
}

// The same of a small triangle, whose 2nd and 3rd corner may have been exchanged.
GPURT_INLINE Vec2f cover_uv(const SmallTriangle &t, const Vec2f (&corner)[3], float z, float share_b,
                            float share_c)
{
  const float wb = (t.is_swapped ? share_c : share_b) / z, wc = (t.is_swapped ? share_b : share_c) / z;
  const float wa = 1.0f - wb - wc;
  return {fma(wa, corner[0].x, fma(wb, corner[1].x, wc * corner[2].x)),
          fma(wa, corner[0].y, fma(wb, corner[1].y, wc * corner[2].y))};
}

// Where on its root a sample lies, as a number in the order of (u, v); and back.
GPURT_INLINE uint32_t ordered_bits(float x)
{
  const uint32_t bits = float_bits(x);
  return bits ^ (bits >> 31 != 0 ? 0xffffffffu : 0x80000000u);
}
GPURT_INLINE float float_from_ordered_bits(uint32_t bits)
{
  return float_from_bits(bits ^ (bits >> 31 != 0 ? 0x80000000u : 0xffffffffu));
}
GPURT_INLINE uint64_t place_key(Vec2f place)
{
  return uint64_t(ordered_bits(place.x)) << 32 | ordered_bits(place.y);
}
GPURT_INLINE Vec2f place_from_key(uint64_t key)
{
  return {float_from_ordered_bits(uint32_t(key >> 32)), float_from_ordered_bits(uint32_t(key))};
}

struct CellRange {
  int32_t x0, y0, x1, y1;
};

// The cells that a box in raster units of the image touches; false: none.
GPURT_INLINE bool cells_of_box(const SampleBlock &block, float x0, float y0, float x1, float y1,
                               CellRange &cells)
{
  const float ox = float(block.origin_x), oy = float(block.origin_y);
  const float size_x = float(block.cells_x << block.cell_bits),
              size_y = float(block.cells_y << block.cell_bits);
  const float lx = x0 - ox, hx = x1 - ox, ly = y0 - oy, hy = y1 - oy;
  if (!(lx < size_x && hx >= 0.0f && ly < size_y && hy >= 0.0f)) return false;
  cells.x0 = int32_t(max(lx, 0.0f)) >> block.cell_bits;
  cells.y0 = int32_t(max(ly, 0.0f)) >> block.cell_bits;
  cells.x1 = int32_t(min(hx, size_x - 1.0f)) >> block.cell_bits;
  cells.y1 = int32_t(min(hy, size_y - 1.0f)) >> block.cell_bits;
  return true;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
