// How a bicubic patch is cut into triangles for rays, and where in them a point (u, v) of the patch lies.
//
// A patch has num_u x num_v cells of two triangles. Its rim has the vertices of its four edges, edge[k] segments each, which
// neighbours share; there are no more of these than cells along the edge. Places of the rim between them take a vertex next
// to them, so that some triangles of rim cells are nothing. Which one they take is chosen so that no triangle is wider
// than a segment of the edge: within its box of 1 / edge by 1 / edge the bound on the distance to the surface holds.
#pragma once

#include "core/math/vec.h"

namespace gpurt {

// Edges 0 and 1 run along u at the lower and upper v, edges 2 and 3 along v at the lower and upper u.
struct PatchCells {
  uint32_t first_triangle;  // of those of the segment
  uint16_t num_u, num_v;
  uint16_t edge[4];
};

constexpr uint32_t max_patch_cells = 1u << 14;  // along an axis

// A point of a triangle: weights of its second and third corner.
struct CellPoint {
  uint32_t triangle;  // of those of the patch
  float second, third;
};

GPURT_FUNCTIONS_BEGIN

// The vertex of an edge of `segments` that place k of n on the lower or left rim takes. Triangles have one side on
// the rim and a corner at k or k + 1 within, or the other way round; k segments / n is the place itself. With s(k) the vertex,
// (k + 1) segments / n - 1 <= s(k) <= k segments / n + 1 keeps all their corners within a segment.
GPURT_INLINE uint32_t lower_rim_vertex(uint32_t k, uint32_t n, uint32_t segments)
{
  return ((k + 1) * segments - 1) / n;
}
// The same of the upper and right rim, where diagonals lean the other way.
GPURT_INLINE uint32_t upper_rim_vertex(uint32_t k, uint32_t n, uint32_t segments)
{
  return segments - lower_rim_vertex(n - k, n, segments);
}

// A parameter as a fraction.
struct CellParameter {
  uint32_t step, steps;
};
GPURT_INLINE CellParameter cell_u(const PatchCells &c, uint32_t i, uint32_t j)
{
  if (j == 0) return {lower_rim_vertex(i, c.num_u, c.edge[0]), c.edge[0]};
  if (j == c.num_v) return {upper_rim_vertex(i, c.num_u, c.edge[1]), c.edge[1]};
  return {i, c.num_u};
}
GPURT_INLINE CellParameter cell_v(const PatchCells &c, uint32_t i, uint32_t j)
{
  if (i == 0) return {lower_rim_vertex(j, c.num_v, c.edge[2]), c.edge[2]};
  if (i == c.num_u) return {upper_rim_vertex(j, c.num_v, c.edge[3]), c.edge[3]};
  return {j, c.num_v};
}

// Every place of the rim is a vertex of its edge.
GPURT_INLINE bool is_regular(const PatchCells &c)
{
  return c.edge[0] == c.num_u && c.edge[1] == c.num_u && c.edge[2] == c.num_v && c.edge[3] == c.num_v;
}

// Cells are cut from their corner a = (i, j) to d = (i + 1, j + 1), with b = (i + 1, j) and c = (i, j + 1): triangles a b d and
// a d c. At two corners of a patch that is not regular the cut would pass the inner vertex on the wrong side: there it goes
// from b to c, triangles a b c and b d c.
GPURT_INLINE bool is_turned(const PatchCells &c, uint32_t i, uint32_t j)
{
  return c.num_u > 1 && c.num_v > 1 && ((i == 0 && j + 1 == c.num_v) || (i + 1 == c.num_u && j == 0)) &&
         !is_regular(c);
}

// In units of cells.
GPURT_INLINE Vec2f cell_vertex(const PatchCells &c, uint32_t i, uint32_t j)
{
  const CellParameter u = cell_u(c, i, j), v = cell_v(c, i, j);
  return {float(u.step * c.num_u) / float(u.steps), float(v.step * c.num_v) / float(v.steps)};
}

GPURT_INLINE float between(float a, float b, float t) { return (1.0f - t) * a + t * b; }

// The cell of a row of the rim, or of a patch of one row, in which a point lies; the lines between its cells never cross, and
// rounding keeps their order.
GPURT_HD inline uint32_t column_of_point(const PatchCells &c, uint32_t row, Vec2f p)
{
  const float t = clamp(p.y - float(row), 0.0f, 1.0f);
  uint32_t first = 1, last = c.num_u;
  while (first < last) {
    const uint32_t k = (first + last) / 2;
    if (between(cell_vertex(c, k, row).x, cell_vertex(c, k, row + 1).x, t) <= p.x) first = k + 1;
    else last = k;
  }
  return first - 1;
}
GPURT_HD inline uint32_t row_of_point(const PatchCells &c, uint32_t column, Vec2f p)
{
  const float t = clamp(p.x - float(column), 0.0f, 1.0f);
  uint32_t first = 1, last = c.num_v;
  while (first < last) {
    const uint32_t k = (first + last) / 2;
    if (between(cell_vertex(c, column, k).y, cell_vertex(c, column + 1, k).y, t) <= p.y) first = k + 1;
    else last = k;
  }
  return first - 1;
}

GPURT_INLINE float area_of(Vec2f a, Vec2f b, Vec2f c)
{
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

// A point of a rim cell.
GPURT_HD inline CellPoint point_of_cell(const PatchCells &c, uint32_t i, uint32_t j, Vec2f p)
{
  const Vec2f corner[4] = {cell_vertex(c, i, j), cell_vertex(c, i + 1, j), cell_vertex(c, i, j + 1),
                           cell_vertex(c, i + 1, j + 1)};
  const bool turned = is_turned(c, i, j);
  // Lower triangle: 0 1 3, or 0 1 2. Upper: 0 3 2, or 1 3 2.
  const Vec2f start = corner[turned ? 1 : 0], end = corner[turned ? 2 : 3];
  const float side = area_of(start, end, p);
  // The lower triangle is to the right of the cut, or to its left where that is turned.
  bool is_upper = turned ? side < 0.0f : side > 0.0f;
  for (uint32_t attempt = 0; attempt < 2; ++attempt, is_upper = !is_upper) {
    const Vec2f q0 = corner[is_upper && turned ? 1 : 0], q1 = corner[is_upper ? 3 : 1],
                q2 = corner[is_upper || turned ? 2 : 3];
    const float area = area_of(q0, q1, q2);
    if (!(area > 0.0f)) continue;  // nothing: the other one has the point
    const float second = clamp(area_of(q0, p, q2) / area, 0.0f, 1.0f);
    return {2 * (j * c.num_u + i) + (is_upper ? 1u : 0u), second,
            clamp(area_of(q0, q1, p) / area, 0.0f, 1.0f - second)};
  }
  // The cell is a line from a to d, both sides of which other cells have.
  const float x = corner[3].x - corner[0].x, y = corner[3].y - corner[0].y;
  const float along = ((p.x - corner[0].x) * x + (p.y - corner[0].y) * y) / (x * x + y * y);
  return {2 * (j * c.num_u + i), 0.0f, clamp(along, 0.0f, 1.0f)};
}

// Where the point (u, v) of a patch is; u and v lie within 0 and 1.
GPURT_HD inline CellPoint locate_in_cells(const PatchCells &c, float u, float v)
{
  const uint32_t num_u = c.num_u, num_v = c.num_v;
  const float x = u * float(num_u), y = v * float(num_v);
  const uint32_t i = min(uint32_t(x), num_u - 1), j = min(uint32_t(y), num_v - 1);
  const bool is_rim_u = i == 0 || i + 1 == num_u, is_rim_v = j == 0 || j + 1 == num_v;
  if (!(is_rim_u || is_rim_v) || is_regular(c)) {
    const float fx = clamp(x - float(i), 0.0f, 1.0f), fy = clamp(y - float(j), 0.0f, 1.0f);
    // The lower right triangle a b d, or the upper left one a d c.
    const bool is_upper = fy > fx;
    return {2 * (j * num_u + i) + (is_upper ? 1u : 0u), is_upper ? fx : fx - fy, is_upper ? fy - fx : fy};
  }
  const Vec2f p{x, y};
  if (num_v == 1) return point_of_cell(c, column_of_point(c, 0, p), 0, p);
  if (num_u == 1) return point_of_cell(c, 0, row_of_point(c, 0, p), p);
  // Cells of the lower and upper rim between the corners; what is beyond them belongs to the left and right rim.
  uint32_t column = i;
  if (is_rim_v) {
    column = column_of_point(c, j, p);
    if (column != 0 && column + 1 != num_u) return point_of_cell(c, column, j, p);
  }
  return point_of_cell(c, column, row_of_point(c, column, p), p);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
