// Sixteen micropolygons of a grid's row, set up together; and a micropolygon against sixteen samples, eight of each of two
// rows of cells. As tiny_quads.h, with the same bits, for files that are compiled for vectors of 512 bits.
//
// Where both triangles of a micropolygon a b c d have the same turn, the diagonal a c tells which of them a sample can be
// in, and its edge function is that of both. So edges are taken in the order in which the inside is positive: with p, q for b, d
// or for d, b the triangles are a p c and a c q.
#pragma once

#include <immintrin.h>

#include "cpu/reyes/tiny_quads.h"

namespace gpurt {

constexpr uint32_t num_wide_lanes = 16;

// Of sixteen micropolygons, from their vertices a.
struct alignas(64) WideQuads {
  float ax[num_wide_lanes], ay[num_wide_lanes];  // from the block's origin
  float diagonal_x[num_wide_lanes], diagonal_y[num_wide_lanes], diagonal_threshold[num_wide_lanes];
  // Of a p c: edges opposite to a, x a + y b + c, and to c, and 1 / w over twice the area.
  float pa_x[num_wide_lanes], pa_y[num_wide_lanes], pa_1[num_wide_lanes], pa_threshold[num_wide_lanes];
  float pc_x[num_wide_lanes], pc_y[num_wide_lanes], pc_threshold[num_wide_lanes];
  float p_za[num_wide_lanes], p_zp[num_wide_lanes], p_zc[num_wide_lanes];
  // Of a c q: edges opposite to a and to c; of q the negative of 1 / w over twice the area.
  float qa_x[num_wide_lanes], qa_y[num_wide_lanes], qa_1[num_wide_lanes], qa_threshold[num_wide_lanes];
  float qc_x[num_wide_lanes], qc_y[num_wide_lanes], qc_threshold[num_wide_lanes];
  float q_za[num_wide_lanes], q_zc[num_wide_lanes], q_minus_zq[num_wide_lanes];
  uint32_t from[num_wide_lanes], to[num_wide_lanes], num_rows[num_wide_lanes];  // cells: of the first row
  uint32_t are_there;   // bits of lanes that touch the block
  uint32_t are_plain;   // of those that may be sampled this way
  uint32_t have_area;   // of those that may cover something
  uint32_t is_swapped;  // p is d, and q is b
};

// What sixteen samples have of a micropolygon: 1 / w, and the shares of a triangle's 2nd and 3rd corner in it.
struct WideCover {
  __m512 z, share_2, share_3;
  __mmask16 is_covered, in_p;  // in_p: on the side of the triangle a p c
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE __m512 wide(float x) { return _mm512_set1_ps(x); }

GPURT_INLINE __m512 edge_threshold(__m512 ax, __m512 ay, __m512 bx, __m512 by)
{
  const __mmask16 includes =
      _mm512_cmp_ps_mask(by, ay, _CMP_LT_OQ) |
      _mm512_mask_cmp_ps_mask(_mm512_cmp_ps_mask(by, ay, _CMP_EQ_OQ), bx, ax, _CMP_GT_OQ);
  return _mm512_mask_blend_ps(includes, wide(0.5f), wide(-0.5f));
}

// Micropolygons of row j of a grid that is in front of the eye. Vertices that are read beyond the grid's are of no
// consequence. False: none touches the block.
GPURT_INLINE bool make_wide_quads(const Grid &g, uint32_t j, const SampleBlock &block, WideQuads &q)
{
  const uint32_t width = g.num_u + 1, a = j * width, d = a + width;
  const auto load = [](const float *p) { return _mm512_loadu_ps(p); };
  const __m512 ax = load(g.x + a), ay = load(g.y + a), az = load(g.z + a);
  __m512 bx = load(g.x + a + 1), by = load(g.y + a + 1), cx = load(g.x + d + 1), cy = load(g.y + d + 1),
         dx = load(g.x + d), dy = load(g.y + d);
  const __m512 x0 = _mm512_min_ps(_mm512_min_ps(ax, bx), _mm512_min_ps(cx, dx)),
               x1 = _mm512_max_ps(_mm512_max_ps(ax, bx), _mm512_max_ps(cx, dx)),
               y0 = _mm512_min_ps(_mm512_min_ps(ay, by), _mm512_min_ps(cy, dy)),
               y1 = _mm512_max_ps(_mm512_max_ps(ay, by), _mm512_max_ps(cy, dy));
  // As cells_of_box.
  const __m512 ox = wide(float(block.origin_x)), oy = wide(float(block.origin_y)), zero = wide(0.0f);
  const __m512 size_x = wide(float(block.cells_x << block.cell_bits)),
               size_y = wide(float(block.cells_y << block.cell_bits));
  const __m512 lx = x0 - ox, hx = x1 - ox, ly = y0 - oy, hy = y1 - oy;
  q.are_there = _mm512_cmp_ps_mask(lx, size_x, _CMP_LT_OQ) & _mm512_cmp_ps_mask(hx, zero, _CMP_GE_OQ) &
                _mm512_cmp_ps_mask(ly, size_y, _CMP_LT_OQ) & _mm512_cmp_ps_mask(hy, zero, _CMP_GE_OQ) &
                ((1u << g.num_u) - 1);
  if (q.are_there == 0) return false;
  const __m512 most = wide(tiny_extent);
  q.are_plain = _mm512_cmp_ps_mask(x1 - x0, most, _CMP_LE_OQ) & _mm512_cmp_ps_mask(y1 - y0, most, _CMP_LE_OQ);
  // Within the block, for lanes that are not there too.
  const __m512 last_x = size_x - wide(1.0f), last_y = size_y - wide(1.0f);
  const auto cell = [&](__m512 at, __m512 last) {
    return _mm512_srli_epi32(_mm512_cvttps_epi32(_mm512_min_ps(_mm512_max_ps(at, zero), last)),
                             uint32_t(block.cell_bits));
  };
  const __m512i row = cell(ly, last_y), first = _mm512_mullo_epi32(row, _mm512_set1_epi32(block.cells_x)),
                one = _mm512_set1_epi32(1);
  _mm512_store_si512(q.from, _mm512_add_epi32(first, cell(lx, last_x)));
  _mm512_store_si512(q.to, _mm512_add_epi32(_mm512_add_epi32(first, cell(hx, last_x)), one));
  _mm512_store_si512(q.num_rows, _mm512_add_epi32(_mm512_sub_epi32(cell(hy, last_y), row), one));

  bx -= ax, by -= ay, cx -= ax, cy -= ay, dx -= ax, dy -= ay;
  const __m512 area_b = bx * cy - by * cx, area_d = cx * dy - cy * dx;
  const __mmask16 swapped = _mm512_cmp_ps_mask(area_b + area_d, zero, _CMP_LT_OQ);
  const __m512 area_p = _mm512_mask_blend_ps(swapped, area_b, zero - area_d),
               area_q = _mm512_mask_blend_ps(swapped, area_d, zero - area_b);
  const __mmask16 has_p = _mm512_cmp_ps_mask(area_p, zero, _CMP_GT_OQ),
                  has_q = _mm512_cmp_ps_mask(area_q, zero, _CMP_GT_OQ);
  q.is_swapped = swapped;
  q.have_area = _mm512_cmp_ps_mask(area_b, zero, _CMP_NEQ_OQ) | _mm512_cmp_ps_mask(area_d, zero, _CMP_NEQ_OQ);
  q.are_plain &= _mm512_cmp_ps_mask(_mm512_min_ps(area_p, area_q), zero, _CMP_GE_OQ);
  const __m512 px = _mm512_mask_blend_ps(swapped, bx, dx), py = _mm512_mask_blend_ps(swapped, by, dy),
               qx = _mm512_mask_blend_ps(swapped, dx, bx), qy = _mm512_mask_blend_ps(swapped, dy, by);
  const __m512 bz = load(g.z + a + 1), cz = load(g.z + d + 1), dz = load(g.z + d);
  const auto store = [](float *p, __m512 v) { _mm512_store_ps(p, v); };
  store(q.ax, ax - ox);
  store(q.ay, ay - oy);
  store(q.diagonal_x, cy);
  store(q.diagonal_y, zero - cx);
  store(q.diagonal_threshold, edge_threshold(cx, cy, zero, zero));
  const __m512 none = wide(infinity);
  store(q.pa_x, py - cy);
  store(q.pa_y, cx - px);
  store(q.pa_1, (cy - py) * px - (cx - px) * py);
  store(q.pa_threshold, _mm512_mask_blend_ps(has_p, none, edge_threshold(px, py, cx, cy)));
  store(q.pc_x, zero - py);
  store(q.pc_y, px);
  store(q.pc_threshold, edge_threshold(zero, zero, px, py));
  const __m512 inv_p = wide(1.0f) / area_p, inv_q = wide(1.0f) / area_q;
  store(q.p_za, az * inv_p);
  store(q.p_zp, _mm512_mask_blend_ps(swapped, bz, dz) * inv_p);
  store(q.p_zc, cz * inv_p);
  store(q.qa_x, cy - qy);
  store(q.qa_y, qx - cx);
  store(q.qa_1, (qy - cy) * cx - (qx - cx) * cy);
  store(q.qa_threshold, _mm512_mask_blend_ps(has_q, none, edge_threshold(cx, cy, qx, qy)));
  store(q.qc_x, qy);
  store(q.qc_y, zero - qx);
  store(q.qc_threshold, edge_threshold(qx, qy, zero, zero));
  store(q.q_za, az * inv_q);
  store(q.q_zc, cz * inv_q);
  store(q.q_minus_zq, zero - _mm512_mask_blend_ps(swapped, dz, bz) * inv_q);
  return true;
}

// Eight numbers from each of two places.
GPURT_INLINE __m512 load_two(const float *low, const float *high)
{
  return _mm512_insertf32x8(_mm512_castps256_ps512(_mm256_loadu_ps(low)), _mm256_loadu_ps(high), 1);
}

// As `cover`, of micropolygon k, of samples (x, y) of the block.
GPURT_INLINE WideCover cover_wide(const WideQuads &q, uint32_t k, __m512 x, __m512 y)
{
  x -= wide(q.ax[k]);
  y -= wide(q.ay[k]);
  // Nothing is rounded in edge functions, fused or not.
  const auto edge = [&](float along_x, float along_y) {
    return _mm512_fmadd_ps(wide(along_x), x, wide(along_y) * y);
  };
  const auto far_edge = [&](float along_x, float along_y, float c) {
    return _mm512_fmadd_ps(wide(along_x), x, _mm512_fmadd_ps(wide(along_y), y, wide(c)));
  };
  const __m512 diagonal = edge(q.diagonal_x[k], q.diagonal_y[k]);
  const __m512 pa = far_edge(q.pa_x[k], q.pa_y[k], q.pa_1[k]), pc = edge(q.pc_x[k], q.pc_y[k]);
  const __m512 qa = far_edge(q.qa_x[k], q.qa_y[k], q.qa_1[k]), qc = edge(q.qc_x[k], q.qc_y[k]);
  WideCover cover;
  // A sample on the diagonal belongs to one of the two.
  cover.in_p = _mm512_cmp_ps_mask(diagonal, wide(q.diagonal_threshold[k]), _CMP_GT_OQ);
  const __mmask16 in_q = _knot_mask16(cover.in_p);
  const __mmask16 p =
      _mm512_mask_cmp_ps_mask(_mm512_mask_cmp_ps_mask(cover.in_p, pa, wide(q.pa_threshold[k]), _CMP_GT_OQ),
                              pc, wide(q.pc_threshold[k]), _CMP_GT_OQ);
  const __mmask16 c =
      _mm512_mask_cmp_ps_mask(_mm512_mask_cmp_ps_mask(in_q, qa, wide(q.qa_threshold[k]), _CMP_GT_OQ), qc,
                              wide(q.qc_threshold[k]), _CMP_GT_OQ);
  cover.is_covered = _kor_mask16(p, c);
  const __m512 share_1 = _mm512_mask_mul_ps(qa * wide(q.q_za[k]), cover.in_p, pa, wide(q.p_za[k]));
  cover.share_2 = _mm512_mask_mul_ps(qc * wide(q.q_zc[k]), cover.in_p, diagonal, wide(q.p_zp[k]));
  cover.share_3 = _mm512_mask_mul_ps(diagonal * wide(q.q_minus_zq[k]), cover.in_p, pc, wide(q.p_zc[k]));
  cover.z = share_1 + cover.share_2 + cover.share_3;
  return cover;
}

// As cover_uv, of micropolygon k whose first vertex is a of the grid.
GPURT_INLINE void cover_uv(const WideCover &cover, bool is_swapped, const Grid &g, uint32_t a, __m512 &u,
                           __m512 &v)
{
  const uint32_t b = a + 1, c = a + g.num_u + 2, d = c - 1;
  const __m512 share_2 = cover.share_2 / cover.z, share_3 = cover.share_3 / cover.z;
  // The corners of a b c and a c d in this order.
  const __mmask16 in_b = is_swapped ? _knot_mask16(cover.in_p) : cover.in_p;
  const __m512 w2 = is_swapped ? share_3 : share_2, w3 = is_swapped ? share_2 : share_3;
  const __m512 w1 = wide(1.0f) - w2 - w3;
  const auto at = [&](const float *f) {
    const __m512 second = _mm512_mask_blend_ps(in_b, wide(f[c]), wide(f[b])),
                 third = _mm512_mask_blend_ps(in_b, wide(f[d]), wide(f[c]));
    return _mm512_fmadd_ps(w1, wide(f[a]), _mm512_fmadd_ps(w2, second, w3 * third));
  };
  u = at(g.u);
  v = at(g.v);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
