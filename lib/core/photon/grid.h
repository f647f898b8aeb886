// Photons sorted into the cells of a uniform grid, and the gather over it.
//
// Cells are as large as the gather radius, so that a gather meets about 3 x 3 rows of 3 cells. Photons lie in the order of
// (row, cell along x, index of the photon), so that the cells of a row are one range of photons, which is trimmed to the
// chord of the sphere. Where a table of all cells would be too large, its indices are taken modulo a power of two along
// each long axis: photons of other periods are met as well and fall out by their distance.
//
// Nothing here depends on how coordinates round: ranges of cells are widened by proven bounds, and what decides is the
// test d^2 < r^2 alone.
#pragma once

#include "core/photon/photon.h"

namespace gpurt {

/// How space is cut into cells, and cells are numbered.
struct GridShape {
  Vec3f origin;        // lower corner of the photons' bounds
  float cell;          // edge
  float inverse_cell;  // 1 / cell, rounded
  UInt3 num_cells;     // that the bounds reach over, along each axis; at most 2^20
  UInt3 mask;   // of cell indices: the period - 1, or all bits where a table holds all cells of the axis
  UInt3 width;  // entries of the table along each axis: the period, or num_cells
  uint32_t table_size;
};

struct PhotonGrid {
  GridShape shape;
  const uint32_t *starts;     // [table_size + 1]: the first photon of each entry
  const PhotonProbe *probes;  // [num_photons]
  const PhotonRest *rests;    // [num_photons], or null
  const uint32_t *indices;    // [num_photons]: of the records, or null
  uint64_t num_photons;
};

GPURT_FUNCTIONS_BEGIN

constexpr uint32_t max_cells_of_axis = 1u << 20;

// Chooses a shape for photons within `bounds` that are gathered within about `radius`. Where the grid would be too fine
// for the range of indices, its cells are larger than the radius: gathers stay exact. Empty bounds: no photons.
inline GPURT_HD GridShape make_grid_shape(const Box &bounds, float radius, uint64_t num_photons)
{
  GridShape shape;
  const bool is_grid = !is_empty(bounds);
  shape.origin = is_grid ? bounds.lo : Vec3f{0, 0, 0};
  const Vec3f extent = is_grid ? bounds.hi - bounds.lo : Vec3f{0, 0, 0};
  // A little fewer cells than the limit, for what the division rounds; and 1 / cell stays in range.
  shape.cell = max(max(radius, max_component(extent) * 0x1.01p-20f), 0x1p-120f);
  shape.inverse_cell = 1.0f / shape.cell;
  const auto cells = [&](float e) { return min(uint32_t(e * shape.inverse_cell) + 1, max_cells_of_axis); };
  shape.num_cells = {cells(extent.x), cells(extent.y), cells(extent.z)};
  // About two entries a photon: more would cost more to fill than candidates of other periods do.
  const uint64_t budget = min(max(num_photons * 5 / 2, uint64_t(4096)), uint64_t(1) << 31);
  uint32_t period[3] = {max_cells_of_axis, max_cells_of_axis, max_cells_of_axis};
  const uint32_t num[3] = {shape.num_cells.x, shape.num_cells.y, shape.num_cells.z};
  uint32_t width[3];
  for (int axis = 2;; axis = axis == 0 ? 2 : axis - 1) {
    for (int k = 0; k < 3; ++k) width[k] = min(num[k], period[k]);
    if (uint64_t(width[0]) * width[1] * width[2] <= budget) break;
    period[axis] /= 2;
  }
  const auto mask = [&](int k) { return num[k] <= period[k] ? ~0u : period[k] - 1; };
  shape.mask = {mask(0), mask(1), mask(2)};
  shape.width = {width[0], width[1], width[2]};
  shape.table_size = width[0] * width[1] * width[2];
  return shape;
}

// The entry of a cell.
GPURT_INLINE uint32_t grid_entry(const GridShape &shape, uint32_t x, uint32_t y, uint32_t z)
{
  return ((z & shape.mask.z) * shape.width.y + (y & shape.mask.y)) * shape.width.x + (x & shape.mask.x);
}

// A position in units of cells from the grid's corner. Each coordinate is off by less than 2.1 float_epsilon of itself,
// and monotone: so a photon of the grid has its cell within num_cells.
GPURT_INLINE Vec3f grid_position(const GridShape &shape, Vec3f p)
{
  return (p - shape.origin) * shape.inverse_cell;
}

// The entry of a photon of the grid.
GPURT_INLINE uint32_t photon_entry(const GridShape &shape, Vec3f p)
{
  const Vec3f u = grid_position(shape, p);
  return grid_entry(shape, uint32_t(u.x), uint32_t(u.y), uint32_t(u.z));
}

// The entry of any point, by which gathers are sorted: that of the nearest cell. NaN: some entry.
GPURT_INLINE uint32_t query_entry(const GridShape &shape, Vec3f p)
{
  const Vec3f u = grid_position(shape, p);
  const auto cell = [](float x, uint32_t n) { return x > 0.0f ? uint32_t(min(x, float(n - 1))) : 0u; };
  return grid_entry(shape, cell(u.x, shape.num_cells.x), cell(u.y, shape.num_cells.y),
                    cell(u.z, shape.num_cells.z));
}

// Cells [first, last] of an axis; none where first > last.
struct CellRange {
  int first, last;
};

// The cells of an axis that reach into [u - reach, u + reach].
GPURT_INLINE CellRange cell_range(float u, float reach, uint32_t num_cells)
{
  const float lo = u - reach, hi = u + reach, n = float(num_cells);
  if (!(hi >= 0.0f && lo < n)) return {0, -1};  // NaN as well
  return {lo > 0.0f ? int(lo) : 0, hi < n ? int(hi) : int(num_cells) - 1};
}

// A gather's way through the grid.
struct GridWalk {
  Vec3f u;      // the point in units of cells
  Vec3f slack;  // bound on how far the units of the point and of a photon are off
  float reach;  // the radius in those units, widened
  CellRange y, z;
  bool y_wraps, z_wraps;  // all entries of the axis are visited: its cells then say nothing about a distance
};

// The radius is widened by more than all roundings of reach, chord and d^2 < r^2 together, which are below 2^-19 of it.
constexpr float reach_widening = 1.0f + 0x1p-16f;

// Distance, in cells, of all photons in cell i of an axis: at least.
GPURT_INLINE float cell_gap(float u, float slack, int i)
{
  return max(max(float(i) - u, u - float(i + 1)) - slack, 0.0f);
}

GPURT_INLINE GridWalk begin_walk(const GridShape &shape, Vec3f p, float radius)
{
  GridWalk walk;
  walk.u = grid_position(shape, p);
  const auto slack = [](float u, uint32_t n) { return (abs(u) + float(n)) * 0x1p-21f; };
  walk.slack = {slack(walk.u.x, shape.num_cells.x), slack(walk.u.y, shape.num_cells.y),
                slack(walk.u.z, shape.num_cells.z)};
  walk.reach = radius * shape.inverse_cell * reach_widening;
  walk.y = cell_range(walk.u.y, walk.reach + walk.slack.y, shape.num_cells.y);
  walk.z = cell_range(walk.u.z, walk.reach + walk.slack.z, shape.num_cells.z);
  const auto wraps = [](CellRange &range, uint32_t width, uint32_t num_cells) {
    if (range.last - range.first < int(width) || width == num_cells) return false;
    range = {0, int(width) - 1};
    return true;
  };
  walk.y_wraps = wraps(walk.y, shape.width.y, shape.num_cells.y);
  walk.z_wraps = wraps(walk.z, shape.width.z, shape.num_cells.z);
  return walk;
}

// A square root within 2^-20, for bounds alone: which photons are looked at may differ from device to device, but not which
// are within the radius, nor their order.
GPURT_INLINE float rough_sqrt(float x)
{
#if defined(__CUDA_ARCH__)
  float root;
  asm("sqrt.approx.f32 %0, %1;" : "=f"(root) : "f"(x));
  return root;
#else
  return sqrt(x);
#endif
}

// Photons [begin, end) and [begin2, end2) of a row: the second range is the part of a row that starts over.
struct RowRanges {
  uint32_t begin, end, begin2, end2;
};

GPURT_INLINE uint32_t load_start(const PhotonGrid &grid, uint32_t entry)
{
#if defined(__CUDA_ARCH__)
  return __ldg(grid.starts + entry);
#else
  return grid.starts[entry];
#endif
}

// The photons of row (y, z) that the gather's sphere may contain.
GPURT_INLINE RowRanges row_ranges(const PhotonGrid &grid, const GridWalk &walk, int y, int z)
{
  const GridShape &shape = grid.shape;
  const float gap_y = walk.y_wraps ? 0.0f : cell_gap(walk.u.y, walk.slack.y, y);
  const float gap_z = walk.z_wraps ? 0.0f : cell_gap(walk.u.z, walk.slack.z, z);
  const float chord2 = fma(walk.reach, walk.reach, -fma(gap_y, gap_y, gap_z * gap_z));
  if (!(chord2 >= 0.0f)) return {0, 0, 0, 0};
  const CellRange x =
      cell_range(walk.u.x, rough_sqrt(chord2) * reach_widening + walk.slack.x, shape.num_cells.x);
  if (x.first > x.last) return {0, 0, 0, 0};
  const uint32_t row = grid_entry(shape, 0, uint32_t(y), uint32_t(z));
  if (x.last - x.first >= int(shape.width.x))
    return {load_start(grid, row), load_start(grid, row + shape.width.x), 0, 0};
  const uint32_t first = uint32_t(x.first) & shape.mask.x, last = uint32_t(x.last) & shape.mask.x;
  if (first <= last) return {load_start(grid, row + first), load_start(grid, row + last + 1), 0, 0};
  return {load_start(grid, row + first), load_start(grid, row + shape.width.x), load_start(grid, row),
          load_start(grid, row + last + 1)};
}

GPURT_INLINE PhotonProbe load_probe(const PhotonGrid &grid, uint64_t i)
{
#if defined(__CUDA_ARCH__)
  const float4 v = __ldg(reinterpret_cast<const float4 *>(grid.probes + i));
  return {{v.x, v.y, v.z}, __float_as_uint(v.w)};
#else
  return grid.probes[i];
#endif
}

GPURT_INLINE PhotonRest load_rest(const PhotonGrid &grid, uint64_t i)
{
#if defined(__CUDA_ARCH__)
  const uint2 v = __ldg(reinterpret_cast<const uint2 *>(grid.rests + i));
  return {v.x, v.y};
#else
  return grid.rests[i];
#endif
}

// Calls range(begin, end) for the ranges of photons that the sphere may contain, in an order of their own.
template <class Range>
GPURT_INLINE void for_each_range(const PhotonGrid &grid, Vec3f p, float radius, Range &&range)
{
  const GridWalk walk = begin_walk(grid.shape, p, radius);
  for (int z = walk.z.first; z <= walk.z.last; ++z) {
    for (int y = walk.y.first; y <= walk.y.last; ++y) {
      const RowRanges row = row_ranges(grid, walk, y, z);
      range(row.begin, row.end);
      if (row.begin2 < row.end2) range(row.begin2, row.end2);
    }
  }
}

// Calls visit(i, d2, probe) for all photons with d^2 < r^2 of a point, where d2 is d^2 in single precision and i counts
// within the grid. The order depends on the grid and the point alone: it is the same on every device.
template <class Visit>
GPURT_INLINE void gather(const PhotonGrid &grid, Vec3f p, float radius, Visit &&visit)
{
  const float radius2 = radius * radius;
  for_each_range(grid, p, radius, [&](uint32_t begin, uint32_t end) {
    for (uint32_t i = begin; i < end; ++i) {
      const PhotonProbe probe = load_probe(grid, i);
      const float d2 = length2(probe.position - p);
      if (d2 < radius2) visit(i, d2, probe);
    }
  });
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
