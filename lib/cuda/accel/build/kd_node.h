// What threads do for one cell of a kd-tree: choose its split, and hand its references to its children.
//
// Cells of few references get the best of all planes through an end of a reference, as on the host. Of larger ones, ends are
// counted in bins, and the best border between bins moves to the end before or after it where that is better, so that planes
// lie in the surfaces that they separate.
// Source: Wald and Havran 2006; Danilewski et al. 2010 for the counts.
#pragma once

#include "core/accel/clipped_triangle.h"
#include "core/accel/kd_tree.h"
#include "cuda/accel/build/build_node.h"

namespace gpurt::cuda {

// Cells of at most this many references are split exactly, by a warp each; others by a block each.
constexpr uint32_t kd_small_cell = 64;
constexpr uint32_t kd_build_bins = 256, kd_build_few_bins = 64, kd_few_references = 2048;

/// A cell on a level of the tree.
struct KdBuildCell {
  Box box;
  uint32_t first, count;  // its references in the level's array
  uint32_t budget;        // references that its leaves may have together; never less than it has
};

/// What becomes of it.
struct KdChoice {
  float position;
  uint32_t axis : 2, planar_first : 1, is_split : 1;
  uint32_t num[2];  // of a split: references that the children have at most
};

/// Sums over the cells before one.
struct KdLevelSums {
  uint32_t splits, references, leaf_references;
};

struct KdBuildCosts {
  float traversal_cost, empty_factor;
  uint32_t max_depth;
};

struct KdSmallShared {
  float lo[3][kd_small_cell], hi[3][kd_small_cell];
  uint64_t best;
};

struct KdLargeShared {
  uint32_t lo[3][kd_build_bins], hi[3][kd_build_bins];  // references that begin and end in each bin
  uint64_t best;
  int end_below, end_above;  // nearest ends on both sides of the border, as ordered integers
  uint32_t below[3], above[3], planar[3];
};

/// Costs of planes along one axis, in units of the cell's half area: find_small_split's arithmetic.
struct KdAxisCosts {
  GPURT_GROUP_MEMBER KdAxisCosts(const Box &cell, int k, const KdBuildCosts &c)
      : empty_factor(c.empty_factor), lo(at(cell.lo, k)), hi(at(cell.hi, k))
  {
    unit = 1.0f / max_component(cell.hi - cell.lo);
    const Vec3f e = (cell.hi - cell.lo) * unit;
    const float e1 = at(e, k == 0 ? 1 : 0), e2 = at(e, k == 2 ? 1 : 2);
    cap = e1 * e2;
    rim = e1 + e2;
    whole = e.x * e.y + e.y * e.z + e.z * e.x;
    step = c.traversal_cost * whole;
  }
  /// Of the cheaper side for what lies in the plane.
  GPURT_GROUP_MEMBER float operator()(float p, uint32_t below, uint32_t above, uint32_t planar,
                                      bool &planar_first) const
  {
    const float area_below = cap + (p - lo) * unit * rim, area_above = cap + (hi - p) * unit * rim;
    const float separate = step + area_below * float(below) + area_above * float(above);
    float first = separate + area_below * float(planar), second = separate + area_above * float(planar);
    if (above == 0 || below + planar == 0) first *= empty_factor;
    if (below == 0 || above + planar == 0) second *= empty_factor;
    planar_first = first <= second;
    return planar_first ? first : second;
  }
  float empty_factor, lo, hi, unit, cap, rim, whole, step;
};

GPURT_GROUP bool may_split(const KdBuildCell &cell, uint32_t depth, const KdBuildCosts &costs)
{
  // A cell that is a line or a point has no area to weigh.
  const Vec3f e = cell.box.hi - cell.box.lo;
  return cell.count != 0 && depth < costs.max_depth && int(e.x > 0) + int(e.y > 0) + int(e.z > 0) >= 2;
}

GPURT_GROUP KdChoice no_split() { return {0.0f, 0, 0, 0, {0, 0}}; }

// Costs are not negative: their bits are ordered as they are; what is not a number comes last.
GPURT_GROUP uint64_t kd_split_key(float cost, uint32_t split)
{
  return uint64_t(float_bits(cost)) << 32 | split;
}

/// The choice of a cell of at most kd_small_cell references, which thread 0 writes.
template <class Group>
GPURT_GROUP void choose_small(const Group &group, const BuildReference *references, const KdBuildCell &cell,
                              uint32_t depth, const KdBuildCosts &costs, KdSmallShared &s, KdChoice &choice)
{
  if (!may_split(cell, depth, costs)) {
    if (group.thread() == 0) choice = no_split();
    return;
  }
  const uint32_t n = cell.count;
  for (uint32_t i = group.thread(); i < n; i += group.size()) {
    const BuildReference r = load_reference(references + i);
    for (int k = 0; k < 3; ++k) {
      s.lo[k][i] = at(r.lo, k);
      s.hi[k][i] = at(r.hi, k);
    }
  }
  if (group.thread() == 0) s.best = ~uint64_t(0);
  group.sync();
  uint64_t best = ~uint64_t(0);
  for (uint32_t c = group.thread(); c < 6 * n; c += group.size()) {
    const int k = int(c / (2 * n));
    const uint32_t i = c - uint32_t(k) * 2 * n;
    const float p = i < n ? s.lo[k][i] : s.hi[k][i - n];
    if (!(p > at(cell.box.lo, k) && p < at(cell.box.hi, k))) continue;
    uint32_t below = 0, above = 0, planar = 0;
    for (uint32_t j = 0; j < n; ++j) {
      const bool is_below = s.lo[k][j]<p, is_above = s.hi[k][j]> p;
      below += is_below;
      above += is_above;
      planar += !is_below && !is_above;
    }
    if (below + above + planar > cell.budget) continue;
    bool first;
    const float cost = KdAxisCosts(cell.box, k, costs)(p, below, above, planar, first);
    const uint32_t num0 = below + (first ? planar : 0), num1 = above + (first ? 0 : planar);
    const uint64_t key = kd_split_key(cost, c << 15 | uint32_t(first) << 14 | num0 << 7 | num1);
    best = key < best ? key : best;
  }
  lower_by_warp(&s.best, best);
  group.sync();
  if (group.thread() != 0) return;
  const uint32_t split = uint32_t(s.best), c = split >> 15;
  const float cost = float_from_bits(uint32_t(s.best >> 32));
  if (s.best == ~uint64_t(0) || !(cost < float(n) * KdAxisCosts(cell.box, 0, costs).whole)) {
    choice = no_split();
    return;
  }
  const uint32_t k = c / (2 * n), i = c - k * 2 * n;
  choice = {(i < n ? s.lo[k][i] : s.hi[k][i - n]) + 0.0f,
            k,
            split >> 14 & 1u,
            1,
            {split >> 7 & 127u, split & 127u}};
}

/// The choice of a larger one.
template <class Group>
GPURT_GROUP void choose_large(const Group &group, const BuildReference *references, const KdBuildCell &cell,
                              uint32_t depth, const KdBuildCosts &costs, KdLargeShared &s, KdChoice &choice)
{
  if (!may_split(cell, depth, costs)) {
    if (group.thread() == 0) choice = no_split();
    return;
  }
  const uint32_t n = cell.count, bins = n < kd_few_references ? kd_build_few_bins : kd_build_bins;
  const Vec3f extent = cell.box.hi - cell.box.lo;
  Vec3f scale;
  for (int k = 0; k < 3; ++k)
    set(scale, k, at(extent, k) > 0 ? min(float(bins) / at(extent, k), 0x1p120f) : 0.0f);
  const auto bin_of = [&](float x, int k) {
    const int bin = int((x - at(cell.box.lo, k)) * at(scale, k));
    return uint32_t(min(max(bin, 0), int(bins) - 1));
  };
  for (uint32_t b = group.thread(); b < 3 * bins; b += group.size())
    s.lo[b / bins][b % bins] = s.hi[b / bins][b % bins] = 0;
  if (group.thread() == 0) {
    s.best = ~uint64_t(0);
    s.end_below = -0x7fffffff - 1;
    s.end_above = 0x7fffffff;
    for (int c = 0; c < 3; ++c) s.below[c] = s.above[c] = s.planar[c] = 0;
  }
  group.sync();
  for (uint32_t i = group.thread(); i < n; i += group.size()) {
    const BuildReference r = load_reference(references + i);
    for (int k = 0; k < 3; ++k) {
      add_to(&s.lo[k][bin_of(at(r.lo, k), k)], 1u);
      add_to(&s.hi[k][bin_of(at(r.hi, k), k)], 1u);
    }
  }
  group.sync();
  uint64_t best = ~uint64_t(0);
  for (uint32_t c = group.thread(); c < 3 * bins; c += group.size()) {
    const int k = int(c / bins);
    const uint32_t border = c % bins;
    if (border == 0 || at(scale, k) == 0) continue;
    uint32_t below = 0, ended = 0;
    for (uint32_t b = 0; b < border; ++b) {
      below += s.lo[k][b];
      ended += s.hi[k][b];
    }
    if (uint64_t(below) + (n - ended) > cell.budget) continue;
    const float p = at(cell.box.lo, k) + float(border) / at(scale, k);
    bool first;
    const float cost = KdAxisCosts(cell.box, k, costs)(p, below, n - ended, 0, first);
    const uint64_t key = kd_split_key(cost, uint32_t(k) << 16 | border);
    best = key < best ? key : best;
  }
  lower_by_warp(&s.best, best);
  group.sync();
  const uint64_t found = s.best;
  if (found == ~uint64_t(0)) {
    if (group.thread() == 0) choice = no_split();
    return;
  }
  const int k = int(uint32_t(found) >> 16);
  const uint32_t border = uint32_t(found) & 0xffffu;
  // The ends next to the border.
  int end_below = -0x7fffffff - 1, end_above = 0x7fffffff;
  for (uint32_t i = group.thread(); i < n; i += group.size()) {
    const BuildReference r = load_reference(references + i);
    const float ends[2] = {at(r.lo, k), at(r.hi, k)};
    for (int e = 0; e < 2; ++e) {
      const int x = ordered_from_float(ends[e]);
      if (bin_of(ends[e], k) < border) end_below = max(end_below, x);
      else end_above = min(end_above, x);
    }
  }
  raise_to(&s.end_below, end_below);
  lower_to(&s.end_above, end_above);
  group.sync();
  const float lo = at(cell.box.lo, k), hi = at(cell.box.hi, k);
  float planes[3] = {lo + float(border) / at(scale, k), lo, hi};  // planes in the cell's border are none
  if (s.end_below != -0x7fffffff - 1) planes[1] = float_from_ordered(s.end_below);
  if (s.end_above != 0x7fffffff) planes[2] = float_from_ordered(s.end_above);
  uint32_t below[3] = {0, 0, 0}, above[3] = {0, 0, 0}, planar[3] = {0, 0, 0};
  for (uint32_t i = group.thread(); i < n; i += group.size()) {
    const BuildReference r = load_reference(references + i);
    for (int c = 0; c < 3; ++c) {
      const bool is_below = at(r.lo, k)<planes[c], is_above = at(r.hi, k)> planes[c];
      below[c] += is_below;
      above[c] += is_above;
      planar[c] += !is_below && !is_above;
    }
  }
  for (int c = 0; c < 3; ++c) {
    add_to(&s.below[c], below[c]);
    add_to(&s.above[c], above[c]);
    add_to(&s.planar[c], planar[c]);
  }
  group.sync();
  if (group.thread() != 0) return;
  const KdAxisCosts axis_costs(cell.box, k, costs);
  choice = no_split();
  float least = float(n) * axis_costs.whole;  // a leaf's
  for (int c = 0; c < 3; ++c) {
    const float p = planes[c];
    if (!(p > lo && p < hi) || uint64_t(s.below[c]) + s.above[c] + s.planar[c] > cell.budget) continue;
    bool first;
    const float cost = axis_costs(p, s.below[c], s.above[c], s.planar[c], first);
    if (!(cost < least)) continue;
    least = cost;
    choice = {p + 0.0f,
              uint32_t(k),
              uint32_t(first),
              1,
              {s.below[c] + (first ? s.planar[c] : 0), s.above[c] + (first ? 0 : s.planar[c])}};
  }
}

GPURT_GROUP Box part_of(const Box &box, const KdChoice &split, int side)
{
  Box part = box;
  set(side == 0 ? part.hi : part.lo, int(split.axis), split.position);
  return part;
}

/// Bounds of a reference on both sides of a plane that it lies across; empty where nothing of it is.
GPURT_GROUP_OUTLINE void split_reference(const BuildScene &scene, const BuildReference &r, const Box &cell,
                                         const KdChoice &split, Box &below, Box &above)
{
  const Box box = {r.lo, r.hi}, rest_below = part_of(box, split, 0), rest_above = part_of(box, split, 1);
  below = rest_below;
  above = rest_above;
  const UInt3 c = scene.indices[r.triangle];
  ClippedTriangle polygon(scene.positions[c.x], scene.positions[c.y], scene.positions[c.z]);
  polygon.clip(cell);
  if (polygon.is_empty()) return;
  Box lower, upper;
  polygon.split(int(split.axis), split.position, lower, upper);
  lower = {max(lower.lo, rest_below.lo), min(lower.hi, rest_below.hi)};
  upper = {max(upper.lo, rest_above.lo), min(upper.hi, rest_above.hi)};
  if (is_empty(lower) && is_empty(upper)) return;
  below = lower;
  above = upper;
}

/// Hands the references of a cell to its children, in their order; num[side] are their numbers, at most choice.num[side].
template <class Group>
GPURT_GROUP void partition_cell(const Group &group, const BuildScene &scene, const BuildReference *references,
                                const KdBuildCell &cell, const KdChoice &split, BuildReference *below,
                                BuildReference *above, uint32_t num[2])
{
  const int k = int(split.axis);
  num[0] = num[1] = 0;
  for (uint32_t base = 0; base < cell.count; base += group.size()) {
    const uint32_t i = base + group.thread();
    BuildReference r[2];
    bool is_there[2] = {false, false};
    if (i < cell.count) {
      r[0] = r[1] = load_reference(references + i);
      const float lo = at(r[0].lo, k), hi = at(r[0].hi, k);
      if (hi <= split.position && (lo < split.position || split.planar_first)) {
        is_there[0] = true;
      } else if (lo >= split.position) {
        is_there[1] = true;
      } else {
        Box side[2];
        split_reference(scene, r[0], cell.box, split, side[0], side[1]);
        for (int c = 0; c < 2; ++c) {
          is_there[c] = !is_empty(side[c]);
          r[c].lo = side[c].lo;
          r[c].hi = side[c].hi;
        }
      }
    }
    uint32_t total;
    const uint32_t before = group.scan(uint32_t(is_there[0]) | uint32_t(is_there[1]) << 16, total);
    if (is_there[0]) store_reference(below + num[0] + (before & 0xffffu), r[0]);
    if (is_there[1]) store_reference(above + num[1] + (before >> 16), r[1]);
    num[0] += total & 0xffffu;
    num[1] += total >> 16;
  }
}

/// What the budget leaves over the present references is shared out in their proportion.
GPURT_GROUP void make_child_cells(const KdBuildCell &cell, const KdChoice &split, const uint32_t num[2],
                                  uint32_t first_below, uint32_t first_above, KdBuildCell child[2])
{
  const uint32_t used = num[0] + num[1], spare = cell.budget - used;
  const uint32_t share = used == 0 ? 0 : uint32_t(double(spare) * (double(num[0]) / double(used)));
  const uint32_t extra = share < spare ? share : spare;
  child[0] = {part_of(cell.box, split, 0), first_below, num[0], num[0] + extra};
  child[1] = {part_of(cell.box, split, 1), first_above, num[1], num[1] + (spare - extra)};
}

}  // namespace gpurt::cuda
