// Stage 'split': cuts a patch until every piece is one grid of micropolygons, without cracks between pieces.
//
// An isoline is where two pieces meet: a boundary of the patch, or the curve along which a piece was cut, over the range
// of that piece. The vertices on it are decided by the isoline alone: a range of it has 2^j equal segments if its length
// on the image asks for at most max_segments, else each half decides for itself. Both neighbours follow that rule with
// the same numbers, so they agree on the vertices whatever else they do. A piece that is cut across an isoline where
// that has no vertex gets the nearest one for its corner: edges may shrink to a point, and none is ever off the isoline.
//
// Source: Fisher et al. 2009, DiagSplit, for rates from edge data alone.
// Differs: rates are powers of two, so that vertices are dyadic; splits that miss an edge's vertices are moved to the
// nearest one instead of choosing the split for them.
#pragma once

#include "core/reyes/bound.h"

namespace gpurt {

constexpr uint32_t max_segment_bits = 4;  // a grid has at most 16 x 16 micropolygons
constexpr uint32_t max_segments = 1u << max_segment_bits;
// Pieces are not cut below 2^-17 of the patch an axis: what crosses the eye plane there is diced, and clipped later.
constexpr uint32_t smallest_piece_bits = 5;
// An isoline whose vertices are still to be decided; else log2 of the distance between its vertices.
constexpr uint8_t open_edge = 0;

// Edges 0 and 1 run along u at the lower and upper v, edges 2 and 3 along v at the lower and upper u. Corners: u + 2 v.
struct Piece {
  uint32_t u, v;                      // lower ends
  uint8_t u_bits, v_bits;             // the range is 2^bits
  uint8_t edge[4];                    // log2 of the distance of vertices, or open_edge
  uint8_t grid_u, grid_v;             // log2 of the micropolygons, once it is to be diced
  uint32_t corner_u[4], corner_v[4];  // where the corners are: on vertices of the isolines
};

enum class PieceAction : uint32_t { Cull, Dice, SplitU, SplitV, SplitBoth };

// Pixels that an edge is to have where it is flat; as segments come in powers of two, 1.4 to 2.8. Without an end to it, flat
// micropolygons are sampled in longer time than the small ones are that they replace: needles' boxes are mostly empty, and grids too
// few for a device. Frames of killeroo, teapot, bigguy and eye_split_tunnel, 512 x 512 pixels, light of micropolygons, flatness
// 0.25, take on a CPU with AVX2 0.78, 0.75, 0.66 and 0.63 of the time of flatness 0 if edges are to have 1 pixel, 0.70, 0.71, 0.59 and 0.55
// with 2, 0.73, 0.76, 0.63 and 0.67 with 3; of 1920 x 1080 pixels, killeroo and bigguy, on an H100 0.89 and 0.89, 0.83 and 0.82,
// 0.88 and 0.99. Pieces are the same with it and without, so that grids are as many.
constexpr float flat_edge = 2.0f;

// What decides how finely is cut.
struct DiceSettings {
  float inv_edge;                 // segments a pixel of an edge
  float half_width, half_height;  // of the image in pixels
  float flatness = 0.0f;          // pixels that larger segments may leave the surface by; 0: there are none
  float inv_flat_edge = 0.0f;     // segments a pixel of an edge that is flat; at most inv_edge
};

// The box of projected control points, and their least w.
struct ProjectedBox {
  float x0, y0, x1, y1;
  float least_w;
};
struct ProjectedHull {
  float x, y;  // its centre
  float half_x, half_y;
  float least_w;
};

// What a piece lies in the hull of: its control points, and corners that were moved out of its range. Arrays have room for whole
// lanes of eight.
struct PieceHull {
  float x[24], y[24], w[24];
  int n;
};

// The largest of raster_square of a piece's second differences.
struct SecondDifferences {
  float uu, uv, vv;
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE DiceSettings dice_settings(float shading_rate, float flatness, uint32_t width, uint32_t height)
{
  const float inv_edge = 1.0f / sqrt(shading_rate);
  return {inv_edge, 0.5f * float(width), 0.5f * float(height), flatness, min(inv_edge, 1.0f / flat_edge)};
}

GPURT_INLINE Piece whole_patch()
{
  Piece p{};
  p.u_bits = p.v_bits = parameter_bits;
  for (int k = 0; k < 4; ++k) {
    p.edge[k] = open_edge;
    p.corner_u[k] = k & 1 ? parameter_one : 0;
    p.corner_v[k] = k & 2 ? parameter_one : 0;
  }
  return p;
}

// log2 of the segments for a length of x segments, rounded to the nearest power of two; max_segment_bits + 1: too many.
GPURT_INLINE uint32_t segment_bits(float x)
{
  uint32_t bits = 0;
  // The mean of 2^j and 2^(j + 1) in proportion.
  for (float limit = 1.41421356f; bits <= max_segment_bits && !(x <= limit); limit *= 2.0f) ++bits;
  return bits;
}

GPURT_INLINE ProjectedHull projected_hull(const ProjectedBox &b)
{
  return {0.5f * (b.x0 + b.x1), 0.5f * (b.y0 + b.y1), 0.5f * (b.x1 - b.x0), 0.5f * (b.y1 - b.y0), b.least_w};
}

GPURT_HD inline ProjectedHull projected_hull(const float *x, const float *y, const float *w, int n)
{
  ProjectedBox b{infinity, infinity, -infinity, -infinity, infinity};
  for (int i = 0; i < n; ++i) {
    const float inv_w = 1.0f / w[i], px = x[i] * inv_w, py = y[i] * inv_w;
    b.x0 = min(b.x0, px);
    b.x1 = max(b.x1, px);
    b.y0 = min(b.y0, py);
    b.y1 = max(b.y1, py);
    b.least_w = min(b.least_w, w[i]);
  }
  return projected_hull(b);
}

// How far a difference of homogeneous points, of a function that vanishes at a point of the hull, moves points on the image at
// most: its distance to the line through the eye and that point. raster_length of its square: of several, the largest alone
// needs a root and a quotient.
GPURT_INLINE float raster_square(const ProjectedHull &hull, float dx, float dy, float dw)
{
  const float x = abs(dx - hull.x * dw) + hull.half_x * abs(dw),
              y = abs(dy - hull.y * dw) + hull.half_y * abs(dw);
  return x * x + y * y;
}
GPURT_INLINE float raster_length(float square, float least_w) { return sqrt(square) / least_w; }

// log2 of the least segments whose number, squared, is x; max_segment_bits + 1: too many.
GPURT_INLINE uint32_t bits_of_square(float x)
{
  uint32_t bits = 0;
  for (float limit = 1.0f; bits <= max_segment_bits && !(x <= limit); limit *= 4.0f) ++bits;
  return bits;
}

// log2 of the segments with which the range stays within `tolerance` pixels of its chords. A chord of a curve C over a
// parameter's step s is within s^2 max |C''| / 8 of it; C'' of a cubic is linear, and so largest at an end. What is measured
// is the curve's distance to the plane through the eye and the chord, over w: the distance on the image.
GPURT_HD inline uint32_t flat_segment_bits(const float (&x)[4], const float (&y)[4], const float (&w)[4],
                                           uint32_t k0, uint32_t bits, float tolerance)
{
  if (!(min(min(w[0], w[3]), min(w[1], w[2])) >= smallest_w)) return max_segment_bits + 1;
  const ProjectedHull hull = projected_hull(x, y, w, 4);
  const auto second = [](const float(&p)[4], float a, float b) {
    return ((p[0] + p[2]) - 2.0f * p[1]) * a + ((p[3] + p[1]) - 2.0f * p[2]) * b;
  };
  float largest = 0.0f;
  for (uint32_t end = 0; end < 2; ++end) {
    const uint32_t k = k0 + (end << bits);
    const float a = parameter(parameter_one - k), b = parameter(k);
    largest = max(largest, raster_square(hull, second(x, a, b), second(y, a, b), second(w, a, b)));
  }
  const float step = parameter(1u << bits);
  return bits_of_square(0.75f * step * step * raster_length(largest, hull.least_w) / tolerance);
}

// Segments that a curve C needs where it turns. Where it turns back on the image, as at an outline, it is short, and a chord of
// the length that is aimed for would cut the turn off. Steps of n segments differ by |C''| / n^2: while that is a quarter of
// an edge at most, chords stay within 1/32 of an edge of the curve. Elsewhere its length asks for more.
GPURT_INLINE float turning_segments(float second_derivative, float inv_edge)
{
  return sqrt(4.0f * second_derivative * inv_edge);
}

// The second difference of points on the image.
GPURT_INLINE float second_difference(const float *x, const float *y, int a, int b, int c)
{
  const float dx = (x[a] + x[c]) - 2.0f * x[b], dy = (y[a] + y[c]) - 2.0f * y[b];
  return sqrt(dx * dx + dy * dy);
}

// Decides the range [k0, k0 + 2^bits] of the isoline with the given control points: the distance of its vertices, or
// open_edge if the halves are to decide. A function of the isoline's curve and the range, and of the same from its other end.
GPURT_HD inline uint8_t decide_edge(const float (&x)[4], const float (&y)[4], const float (&w)[4],
                                    uint32_t k0, uint32_t bits, const DiceSettings &dice)
{
  float px[5], py[5];
  const uint32_t step = 1u << (bits - 2);
  bool is_in_front = true;
  for (uint32_t i = 0; i < 5; ++i) {
    const CubicWeights c = cubic_weights(k0 + i * step);
    const float pw = cubic(c, w[0], w[1], w[2], w[3]);
    is_in_front &= pw >= smallest_w;
    const float inv_w = 1.0f / pw;
    px[i] = cubic(c, x[0], x[1], x[2], x[3]) * inv_w;
    py[i] = cubic(c, y[0], y[1], y[2], y[3]) * inv_w;
  }
  if (!is_in_front) return bits <= smallest_piece_bits ? uint8_t(bits) : open_edge;
  float chord[4];
  for (int i = 0; i < 4; ++i) {
    const float dx = px[i + 1] - px[i], dy = py[i + 1] - py[i];
    chord[i] = sqrt(dx * dx + dy * dy);
  }
  const float longest = 4.0f * max(max(chord[0], chord[3]), max(chord[1], chord[2]));
  const float sum = (chord[0] + chord[3]) + (chord[1] + chord[2]);
  float turn = 0.0f;
  for (int i = 0; i < 3; ++i) turn = max(turn, second_difference(px, py, i, i + 1, i + 2));
  uint32_t segments =
      segment_bits(max(longest * dice.inv_edge, turning_segments(16.0f * turn, dice.inv_edge)));
  // Segments that would differ much in length: the halves can do better.
  const bool is_uneven = segments >= 2 && longest > 1.75f * sum;
  if ((segments > max_segment_bits || is_uneven) && bits > smallest_piece_bits) return open_edge;
  segments = min(segments, max_segment_bits);
  if (dice.flatness > 0.0f) {
    const uint32_t least = segment_bits(longest * dice.inv_flat_edge);
    if (least < segments)
      segments = min(segments, max(least, flat_segment_bits(x, y, w, k0, bits, 0.5f * dice.flatness)));
  }
  return uint8_t(bits - segments);
}

// Decides edge `e` of a piece.
GPURT_HD inline uint8_t decide_edge_of(const RasterPatch &patch, const Piece &p, uint32_t e,
                                       const DiceSettings &dice)
{
  const bool along_u = e < 2;
  const uint32_t at = along_u ? p.v + ((e & 1) << p.v_bits) : p.u + ((e & 1) << p.u_bits);
  // The isoline's control points: a row of the patch's at v, or a column at u.
  const uint32_t next = along_u ? 1 : 4, across = along_u ? 4 : 1;
  const CubicWeights c = cubic_weights(at);
  float x[4], y[4], w[4];
  for (uint32_t k = 0; k < 4; ++k) {
    const uint32_t i = k * next;
    x[k] = cubic(c, patch.x[i], patch.x[i + across], patch.x[i + 2 * across], patch.x[i + 3 * across]);
    y[k] = cubic(c, patch.y[i], patch.y[i + across], patch.y[i + 2 * across], patch.y[i + 3 * across]);
    w[k] = cubic(c, patch.w[i], patch.w[i + across], patch.w[i + 2 * across], patch.w[i + 3 * across]);
  }
  return decide_edge(x, y, w, along_u ? p.u : p.v, along_u ? p.u_bits : p.v_bits, dice);
}

// The vertex of an isoline nearest to k; of two the upper one.
GPURT_INLINE uint32_t nearest_vertex(uint32_t k, uint32_t distance_bits)
{
  const uint32_t d = 1u << distance_bits;
  return (k + d / 2) & ~(d - 1);
}

// Where the corner is that a cut at k makes on an edge from corner a to corner b; `at` is the other parameter there.
GPURT_INLINE void cut_edge(const Piece &p, uint32_t edge, uint32_t k, uint32_t k0, uint32_t bits, uint32_t at,
                           bool along_u, int a, int b, uint32_t &corner_u, uint32_t &corner_v)
{
  if (p.edge[edge] == open_edge || p.edge[edge] < bits) {
    corner_u = along_u ? k : at;
    corner_v = along_u ? at : k;
    return;
  }
  const int c = nearest_vertex(k, p.edge[edge]) > k0 ? b : a;
  corner_u = p.corner_u[c];
  corner_v = p.corner_v[c];
}

GPURT_HD inline void split_u(const Piece &p, Piece &low, Piece &high)
{
  const uint32_t bits = p.u_bits - 1u, m = p.u + (1u << bits), v1 = p.v + (1u << p.v_bits);
  low = p;
  low.u_bits = uint8_t(bits);
  low.edge[3] = open_edge;
  cut_edge(p, 0, m, p.u, p.u_bits, p.v, true, 0, 1, low.corner_u[1], low.corner_v[1]);
  cut_edge(p, 1, m, p.u, p.u_bits, v1, true, 2, 3, low.corner_u[3], low.corner_v[3]);
  high = p;
  high.u = m;
  high.u_bits = uint8_t(bits);
  high.edge[2] = open_edge;
  high.corner_u[0] = low.corner_u[1];
  high.corner_v[0] = low.corner_v[1];
  high.corner_u[2] = low.corner_u[3];
  high.corner_v[2] = low.corner_v[3];
}

GPURT_HD inline void split_v(const Piece &p, Piece &low, Piece &high)
{
  const uint32_t bits = p.v_bits - 1u, m = p.v + (1u << bits), u1 = p.u + (1u << p.u_bits);
  low = p;
  low.v_bits = uint8_t(bits);
  low.edge[1] = open_edge;
  cut_edge(p, 2, m, p.v, p.v_bits, p.u, false, 0, 2, low.corner_u[2], low.corner_v[2]);
  cut_edge(p, 3, m, p.v, p.v_bits, u1, false, 1, 3, low.corner_u[3], low.corner_v[3]);
  high = p;
  high.v = m;
  high.v_bits = uint8_t(bits);
  high.edge[0] = open_edge;
  high.corner_u[0] = low.corner_u[2];
  high.corner_v[0] = low.corner_v[2];
  high.corner_u[1] = low.corner_u[3];
  high.corner_v[1] = low.corner_v[3];
}

// Cuts a piece as `action`, which is one of the splits, says. Returns the number of parts.
GPURT_HD inline uint32_t split_piece(const Piece &p, PieceAction action, Piece (&parts)[4])
{
  if (action == PieceAction::SplitV) {
    split_v(p, parts[0], parts[1]);
    return 2;
  }
  split_u(p, parts[0], parts[1]);
  if (action == PieceAction::SplitU) return 2;
  Piece low = parts[0], high = parts[1];
  split_v(low, parts[0], parts[1]);
  split_v(high, parts[2], parts[3]);
  return 4;
}

GPURT_HD inline PieceHull hull_of_piece(const RasterPatch &patch, const RasterPatch &part, const Piece &p)
{
  PieceHull h;
  for (int i = 0; i < 16; ++i) {
    h.x[i] = part.x[i];
    h.y[i] = part.y[i];
    h.w[i] = part.w[i];
  }
  h.n = 16;
  for (uint32_t k = 0; k < 4; ++k) {
    const uint32_t u = k & 1 ? p.u + (1u << p.u_bits) : p.u, v = k & 2 ? p.v + (1u << p.v_bits) : p.v;
    if (p.corner_u[k] == u && p.corner_v[k] == v) continue;
    const RasterPoint q = patch_point(patch, p.corner_u[k], p.corner_v[k]);
    h.x[h.n] = q.x;
    h.y[h.n] = q.y;
    h.w[h.n++] = q.w;
  }
  return h;
}

// log2 of the segments that an edge with vertices 2^distance apart has within a range of 2^bits.
GPURT_INLINE uint32_t edge_segment_bits(uint8_t distance_bits, uint32_t bits)
{
  return distance_bits < bits ? bits - distance_bits : 0;
}

// That of the finer one of edges e and e + 1, beside each other.
GPURT_INLINE uint32_t most_edge_bits(const Piece &p, uint32_t e, uint32_t bits)
{
  return max(edge_segment_bits(p.edge[e], bits), edge_segment_bits(p.edge[e + 1], bits));
}

// How long row r of the control points of a piece is along u, and column r along v: on the image where the piece is in
// front of the eye, (x, y) then being pixels and depth_scale 0; else in raster coordinates as they are. On the image one
// that turns counts as no shorter than its turns want.
GPURT_HD inline void polygon_lengths(const float *x, const float *y, const float *w, float depth_scale, int r,
                                     float inv_edge, float &along_u, float &along_v)
{
  along_u = along_v = 0.0f;
  for (int c = 0; c < 3; ++c) {
    const int i = 4 * r + c, j = 4 * c + r;
    const float ux = x[i + 1] - x[i], uy = y[i + 1] - y[i];
    const float vx = x[j + 4] - x[j], vy = y[j + 4] - y[j];
    if (depth_scale == 0.0f) {
      along_u += sqrt(ux * ux + uy * uy);
      along_v += sqrt(vx * vx + vy * vy);
    } else {
      along_u += length(Vec3f{ux, uy, (w[i + 1] - w[i]) * depth_scale});
      along_v += length(Vec3f{vx, vy, (w[j + 4] - w[j]) * depth_scale});
    }
  }
  if (depth_scale != 0.0f) return;
  const int i = 4 * r;
  const float turn_u =
      max(second_difference(x, y, i, i + 1, i + 2), second_difference(x, y, i + 1, i + 2, i + 3));
  const float turn_v =
      max(second_difference(x, y, r, r + 4, r + 8), second_difference(x, y, r + 4, r + 8, r + 12));
  along_u = max(along_u, turning_segments(6.0f * turn_u, inv_edge) / inv_edge);
  along_v = max(along_v, turning_segments(6.0f * turn_v, inv_edge) / inv_edge);
}

// The least that a piece's grid may have along edges e and e + 1 where it is flat.
GPURT_INLINE uint32_t flat_grid_bits(const Piece &p, uint32_t e, uint32_t bits, float length,
                                     const DiceSettings &dice)
{
  return max(most_edge_bits(p, e, bits), segment_bits(length * dice.inv_flat_edge));
}

// Whether the grid of a piece in front of the eye may be coarser where it is flat. The lengths are the largest of
// polygon_lengths.
GPURT_INLINE bool may_be_coarser(const Piece &p, float length_u, float length_v, const DiceSettings &dice)
{
  return dice.flatness > 0.0f && (p.grid_u > flat_grid_bits(p, 0, p.u_bits, length_u, dice) ||
                                  p.grid_v > flat_grid_bits(p, 2, p.v_bits, length_v, dice));
}

// Makes it as coarse as its curvature allows. Between the corners of cells of 1/m by 1/n, bilinear or in two triangles, a
// surface S leaves them by at most (|Suu| / m^2 + 2 |Suv| / (m n) + |Svv| / n^2) / 8; a quarter of what is allowed for each, and
// a quarter for cells at edges that others decide.
// Source: Filip, Magedson and Markot 1986, as for tessellation; here on the image.
GPURT_INLINE void coarsen_grid(const SecondDifferences &squares, float least_w, const DiceSettings &dice,
                               float length_u, float length_v, Piece &p)
{
  const float inv_quarter = 4.0f / dice.flatness;
  const float uu = 0.75f * raster_length(squares.uu, least_w) * inv_quarter,
              uv = 2.25f * raster_length(squares.uv, least_w) * inv_quarter,
              vv = 0.75f * raster_length(squares.vv, least_w) * inv_quarter;
  const uint32_t bits_u = max(bits_of_square(max(uu, uv)), flat_grid_bits(p, 0, p.u_bits, length_u, dice)),
                 bits_v = max(bits_of_square(max(vv, uv)), flat_grid_bits(p, 2, p.v_bits, length_v, dice));
  p.grid_u = uint8_t(min(uint32_t(p.grid_u), bits_u));
  p.grid_v = uint8_t(min(uint32_t(p.grid_v), bits_v));
}

// The largest second differences that row r and column r of a piece's control points have, as squares.
GPURT_HD inline SecondDifferences second_differences(const ProjectedHull &hull, const float *x,
                                                     const float *y, const float *w, int r)
{
  SecondDifferences d{0.0f, 0.0f, 0.0f};
  for (int c = 0; c < 2; ++c) {
    const int i = 4 * r + c, j = 4 * c + r;
    d.uu = max(d.uu, raster_square(hull, x[i] - 2.0f * x[i + 1] + x[i + 2], y[i] - 2.0f * y[i + 1] + y[i + 2],
                                   w[i] - 2.0f * w[i + 1] + w[i + 2]));
    d.vv = max(d.vv, raster_square(hull, x[j] - 2.0f * x[j + 4] + x[j + 8], y[j] - 2.0f * y[j + 4] + y[j + 8],
                                   w[j] - 2.0f * w[j + 4] + w[j + 8]));
  }
  for (int c = 0; c < 3 && r < 3; ++c) {
    const int i = 4 * r + c;
    d.uv = max(d.uv,
               raster_square(hull, x[i + 5] - x[i + 4] - x[i + 1] + x[i],
                             y[i + 5] - y[i + 4] - y[i + 1] + y[i], w[i + 5] - w[i + 4] - w[i + 1] + w[i]));
  }
  return d;
}

GPURT_HD inline void coarsen_grid(const RasterPatch &part, const DiceSettings &dice, float length_u,
                                  float length_v, Piece &p)
{
  const ProjectedHull hull = projected_hull(part.x, part.y, part.w, 16);
  SecondDifferences all{0.0f, 0.0f, 0.0f};
  for (int r = 0; r < 4; ++r) {
    const SecondDifferences d = second_differences(hull, part.x, part.y, part.w, r);
    all = {max(all.uu, d.uu), max(all.uv, d.uv), max(all.vv, d.vv)};
  }
  coarsen_grid(all, hull.least_w, dice, length_u, length_v, p);
}

// What becomes of a piece whose edges are decided; for Dice, its grid. The lengths are the largest of polygon_lengths.
GPURT_HD inline PieceAction choose_action(Piece &p, bool is_in_front, float length_u, float length_v,
                                          const DiceSettings &dice)
{
  uint32_t inner_u = max_segment_bits + 1, inner_v = max_segment_bits + 1;
  if (is_in_front) {
    inner_u = segment_bits(length_u * dice.inv_edge);
    inner_v = segment_bits(length_v * dice.inv_edge);
  }
  const bool wants_u = p.edge[0] == open_edge || p.edge[1] == open_edge || inner_u > max_segment_bits;
  const bool wants_v = p.edge[2] == open_edge || p.edge[3] == open_edge || inner_v > max_segment_bits;
  const bool can_u = p.u_bits > smallest_piece_bits, can_v = p.v_bits > smallest_piece_bits;
  const bool longer_u = length_u >= length_v;
  // Both at once leaves half as many levels. Through the eye plane the longer one alone, where it is much longer: more can be
  // culled.
  const bool suits_both = is_in_front || (length_u <= 2.0f * length_v && length_v <= 2.0f * length_u);
  if (suits_both && wants_u && can_u && wants_v && can_v) return PieceAction::SplitBoth;
  if (wants_u && can_u && (longer_u || !(wants_v && can_v))) return PieceAction::SplitU;
  if (wants_v && can_v) return PieceAction::SplitV;
  p.grid_u = uint8_t(max(most_edge_bits(p, 0, p.u_bits), min(inner_u, max_segment_bits)));
  p.grid_v = uint8_t(max(most_edge_bits(p, 2, p.v_bits), min(inner_v, max_segment_bits)));
  return PieceAction::Dice;
}

// Decides what becomes of a piece, and on the way its edges and, for Dice, its grid. `part` has its control points.
GPURT_HD inline PieceAction decide_piece(const RasterPatch &patch, const RasterPatch &part,
                                         const DiceSettings &dice, Piece &p)
{
  for (uint32_t e = 0; e < 4; ++e) {
    if (p.edge[e] == open_edge) p.edge[e] = decide_edge_of(patch, p, e, dice);
  }
  float px[16], py[16];
  bool is_in_front = true;
  for (int i = 0; i < 16; ++i) {
    is_in_front &= part.w[i] >= smallest_w;
    const float inv_w = 1.0f / part.w[i];
    px[i] = part.x[i] * inv_w;
    py[i] = part.y[i] * inv_w;
  }
  float length_u = 0.0f, length_v = 0.0f;
  for (int r = 0; r < 4; ++r) {
    float along_u, along_v;
    if (is_in_front) polygon_lengths(px, py, part.w, 0.0f, r, dice.inv_edge, along_u, along_v);
    else polygon_lengths(part.x, part.y, part.w, dice.half_width, r, dice.inv_edge, along_u, along_v);
    length_u = max(length_u, along_u);
    length_v = max(length_v, along_v);
  }
  const PieceAction action = choose_action(p, is_in_front, length_u, length_v, dice);
  if (action == PieceAction::Dice && is_in_front && may_be_coarser(p, length_u, length_v, dice))
    coarsen_grid(part, dice, length_u, length_v, p);
  return action;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
