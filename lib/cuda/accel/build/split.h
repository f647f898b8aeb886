// The split of a node: by object, at the best of 15 planes between bins of centres along each axis, or, where the children
// would overlap, in space, cutting the triangles that cross a plane; by number where neither tells references apart or
// depth runs short.
//
// Source: Wald 2007, binned SAH; Stich et al. 2009, spatial splits.
#pragma once

#include "core/accel/clipped_triangle.h"
#include "cuda/accel/build/build_node.h"

namespace gpurt::cuda {

constexpr uint32_t num_bins = 16;
constexpr uint32_t num_planes = num_bins - 1;

/// Along each axis: bounds of what falls into a bin, and how many references begin and end in it. Of whole references
/// both counts agree.
struct BuildBins {
  int lo[3][num_bins][3], hi[3][num_bins][3];
  uint32_t first[3][num_bins], last[3][num_bins];
  int widest;  // bits of the largest share of the node's extent that a reference has along any axis
};

enum class SplitKind : uint32_t { Halves, Object, Spatial };

struct BuildSplit {
  SplitKind kind;
  uint32_t axis;
  uint32_t bin;     // the last one of the first child
  uint32_t num[2];  // references of the children
  float cost;       // area times number of both children
  float lo, hi;     // what the bins divide
};

/// Bins along one axis.
struct BinGrid {
  float origin, scale;
};

GPURT_GROUP BinGrid make_grid(float lo, float hi)
{
  const float scale = float(num_bins) / (hi - lo);
  return {lo, hi > lo && is_finite(scale) ? scale : 0.0f};  // 0: one bin takes all
}
/// Grows with x, for any rounding.
GPURT_GROUP uint32_t bin_of(const BinGrid &grid, float x)
{
  return uint32_t(clamp((x - grid.origin) * grid.scale, 0.0f, float(num_bins - 1)));
}
/// Where the bin ends.
GPURT_GROUP float plane_behind(uint32_t bin, float origin, float width)
{
  return origin + width * (float(bin + 1) * (1.0f / float(num_bins)));
}

template <class Group>
GPURT_GROUP void clear_bins(const Group &group, BuildBins &bins)
{
  for (uint32_t i = group.thread(); i < 3 * num_bins; i += group.size()) {
    const uint32_t k = i / num_bins, b = i % num_bins;
    for (int c = 0; c < 3; ++c) {
      bins.lo[k][b][c] = 0x7fffffff;
      bins.hi[k][b][c] = -0x7fffffff - 1;
    }
    bins.first[k][b] = bins.last[k][b] = 0;
  }
  if (group.thread() == 0) bins.widest = 0;
}

GPURT_GROUP void add_box(BuildBins &bins, uint32_t axis, uint32_t bin, const Box &box)
{
  for (int c = 0; c < 3; ++c) {
    lower_to(&bins.lo[axis][bin][c], ordered_from_float(at(box.lo, c)));
    raise_to(&bins.hi[axis][bin][c], ordered_from_float(at(box.hi, c)));
  }
}

/// References that follow one another mostly fall into the same bin: they are added together.
class BinRun {
 public:
  GPURT_GROUP_MEMBER void add(BuildBins &bins, uint32_t axis, uint32_t bin, const Box &box)
  {
    if (bin != bin_) {
      flush(bins, axis);
      bin_ = bin;
      box_ = box;
      count_ = 1;
      return;
    }
    box_ = extend(box_, box);
    ++count_;
  }
  GPURT_GROUP_MEMBER void flush(BuildBins &bins, uint32_t axis)
  {
    if (bin_ == invalid_id) return;
    add_box(bins, axis, bin_, box_);
    add_to(&bins.first[axis][bin_], count_);
    add_to(&bins.last[axis][bin_], count_);
  }

 private:
  uint32_t bin_ = invalid_id;
  uint32_t count_ = 0;
  Box box_{};
};

/// The references [begin, end) of this thread, of `count` that the group shares out in runs.
GPURT_GROUP void share_of_thread(uint32_t count, uint32_t thread, uint32_t size, uint32_t &begin,
                                 uint32_t &end)
{
  const uint32_t run = (count + size - 1) / size;
  begin = min(thread * run, count);
  end = min(begin + run, count);
}

/// Adds references to the bins of their centres.
template <class Group>
GPURT_GROUP void bin_objects(const Group &group, const BuildReference *references, uint32_t count,
                             const OrderedBox &bounds, const OrderedBox &centers, BuildBins &bins)
{
  const Box whole = box_of(bounds);
  const float extent_of_node = max_component(whole.hi - whole.lo);
  float widest = 0;
  const Box extent = box_of(centers);
  const BinGrid grid[3] = {make_grid(extent.lo.x, extent.hi.x), make_grid(extent.lo.y, extent.hi.y),
                           make_grid(extent.lo.z, extent.hi.z)};
  BinRun run[3];
  uint32_t begin, end;
  share_of_thread(count, group.thread(), group.size(), begin, end);
  for (uint32_t i = begin; i < end; ++i) {
    const BuildReference r = load_reference(references + i);
    const Vec3f c = center_of(r);
    const Box box = {r.lo, r.hi};
    run[0].add(bins, 0, bin_of(grid[0], c.x), box);
    run[1].add(bins, 1, bin_of(grid[1], c.y), box);
    run[2].add(bins, 2, bin_of(grid[2], c.z), box);
    widest = max(widest, max_component(r.hi - r.lo));
  }
  if (extent_of_node > 0.0f) group.raise_all(&bins.widest, int(float_bits(widest / extent_of_node)));
  for (uint32_t k = 0; k < 3; ++k) run[k].flush(bins, k);
}

/// Bounds, in float, of the part of a triangle between two planes: it only serves to compare costs.
GPURT_GROUP Box part_between(const Vec3f (&corner)[3], const Box &within, uint32_t axis, float from, float to)
{
  Box part = empty_box();
  for (int i = 0; i < 3; ++i) {
    const Vec3f p = corner[i], q = corner[i == 2 ? 0 : i + 1];
    const float x = at(p, int(axis)), y = at(q, int(axis));
    if (x >= from && x <= to) part = extend(part, p);
    if ((x < from && y > from) || (x > from && y < from))
      part = extend(part, p + (q - p) * ((from - x) / (y - x)));
    if ((x < to && y > to) || (x > to && y < to)) part = extend(part, p + (q - p) * ((to - x) / (y - x)));
  }
  // What earlier cuts took away may leave nothing: then the part is taken as flat.
  part.lo = min(max(part.lo, within.lo), within.hi);
  part.hi = max(min(part.hi, within.hi), part.lo);
  return part;
}

GPURT_GROUP_OUTLINE void bin_parts(const BuildScene &scene, const BuildReference &r, uint32_t axis,
                                   uint32_t first, uint32_t last, float origin, float width, BuildBins &bins)
{
  const UInt3 c = scene.indices[r.triangle];
  const Vec3f corner[3] = {scene.positions[c.x], scene.positions[c.y], scene.positions[c.z]};
  for (uint32_t b = first; b <= last; ++b) {
    const float from = b == 0 ? origin : plane_behind(b - 1, origin, width),
                to = plane_behind(b, origin, width);
    add_box(bins, axis, b, part_between(corner, {r.lo, r.hi}, axis, from, to));
  }
  add_to(&bins.first[axis][first], 1);
  add_to(&bins.last[axis][last], 1);
}

/// Adds references, or the parts of their triangles, to all bins that they lie in.
template <class Group>
GPURT_GROUP void bin_space(const Group &group, const BuildScene &scene, const BuildReference *references,
                           uint32_t count, const OrderedBox &bounds, BuildBins &bins)
{
  const Box extent = box_of(bounds);
  const BinGrid grid[3] = {make_grid(extent.lo.x, extent.hi.x), make_grid(extent.lo.y, extent.hi.y),
                           make_grid(extent.lo.z, extent.hi.z)};
  const Vec3f width = extent.hi - extent.lo;
  BinRun run[3];
  uint32_t begin, end;
  share_of_thread(count, group.thread(), group.size(), begin, end);
  for (uint32_t i = begin; i < end; ++i) {
    const BuildReference r = load_reference(references + i);
    GPURT_UNROLL
    for (uint32_t k = 0; k < 3; ++k) {
      const uint32_t first = bin_of(grid[k], at(r.lo, int(k))), last = bin_of(grid[k], at(r.hi, int(k)));
      if (first == last) run[k].add(bins, k, first, {r.lo, r.hi});
      else bin_parts(scene, r, k, first, last, at(extent.lo, int(k)), at(width, int(k)), bins);
    }
  }
  for (uint32_t k = 0; k < 3; ++k) run[k].flush(bins, k);
}

GPURT_GROUP Box box_of_bins(const BuildBins &bins, uint32_t axis, uint32_t begin, uint32_t end)
{
  OrderedBox box = empty_ordered_box();
  for (uint32_t b = begin; b < end; ++b) {
    for (int c = 0; c < 3; ++c) {
      box.lo[c] = min(box.lo[c], bins.lo[axis][b][c]);
      box.hi[c] = max(box.hi[c], bins.hi[axis][b][c]);
    }
  }
  return box_of(box);
}

/// Lowers `best` to the cheapest candidate: its cost's bits above, its number below. `spare`: how many references a
/// split may add; splits in space (`is_spatial`) must add at least one, since bins of centres serve where nothing is cut.
template <class Group>
GPURT_GROUP void compare_planes(const Group &group, const BuildBins &bins, uint32_t count, bool is_spatial,
                                uint32_t spare, float scale, uint64_t *best)
{
  for (uint32_t i = group.thread(); i < 3 * num_planes; i += group.size()) {
    const uint32_t axis = i / num_planes, plane = i % num_planes;
    uint32_t num0 = 0, num1 = 0;
    for (uint32_t b = 0; b <= plane; ++b) num0 += bins.first[axis][b];
    for (uint32_t b = plane + 1; b < num_bins; ++b) num1 += bins.last[axis][b];
    if (num0 == 0 || num1 == 0) continue;
    if (is_spatial && (num0 + num1 == count || num0 + num1 - count > spare)) continue;
    const float cost = scaled_half_area(box_of_bins(bins, axis, 0, plane + 1), scale) * float(num0) +
                       scaled_half_area(box_of_bins(bins, axis, plane + 1, num_bins), scale) * float(num1);
    if (cost < infinity) lower_to(best, uint64_t(float_bits(cost)) << 32 | i);
  }
}

/// What a group shares while it chooses a split.
struct SplitState {
  uint64_t best_object, best_spatial;
  BuildSplit split;
  uint64_t tries_space;  // 64 bits, so that copies read no padding, which nobody wrote
};

GPURT_GROUP void begin_split(SplitState &s, uint32_t count)
{
  s.best_object = s.best_spatial = ~uint64_t(0);
  s.split = {SplitKind::Halves, 0, 0, {count / 2, count - count / 2}, infinity, 0, 0};
  s.tries_space = 0;
}

/// Takes over the best split by object, and tells whether one in space is worth looking for. One thread does this.
GPURT_GROUP void take_object_split(SplitState &s, const BuildBins &bins, const OrderedBox &centers,
                                   uint32_t count, uint32_t spare, float scale, float root_area)
{
  s.tries_space = spare != 0 && !(float_from_bits(uint32_t(bins.widest)) < build_min_wide_share);
  if (s.best_object == ~uint64_t(0)) return;
  const uint32_t i = uint32_t(s.best_object), axis = i / num_planes, bin = i % num_planes;
  uint32_t num0 = 0;
  for (uint32_t b = 0; b <= bin; ++b) num0 += bins.first[axis][b];
  const Box extent = box_of(centers);
  s.split = {SplitKind::Object,
             axis,
             bin,
             {num0, count - num0},
             float_from_bits(uint32_t(s.best_object >> 32)),
             at(extent.lo, int(axis)),
             at(extent.hi, int(axis))};
  const Box a = box_of_bins(bins, axis, 0, bin + 1), b = box_of_bins(bins, axis, bin + 1, num_bins);
  const Box overlap = {max(a.lo, b.lo), min(a.hi, b.hi)};
  if (is_empty(overlap) || !(scaled_half_area(overlap, scale) > build_min_overlap * root_area) ||
      float_from_bits(uint32_t(bins.widest)) < build_min_wide_share)
    s.tries_space = 0;
}

GPURT_GROUP void take_spatial_split(SplitState &s, const BuildBins &bins, const OrderedBox &bounds)
{
  if (s.best_spatial == ~uint64_t(0)) return;
  const float cost = float_from_bits(uint32_t(s.best_spatial >> 32));
  if (!(cost < s.split.cost)) return;
  const uint32_t i = uint32_t(s.best_spatial), axis = i / num_planes, bin = i % num_planes;
  uint32_t num0 = 0, num1 = 0;
  for (uint32_t b = 0; b <= bin; ++b) num0 += bins.first[axis][b];
  for (uint32_t b = bin + 1; b < num_bins; ++b) num1 += bins.last[axis][b];
  const Box extent = box_of(bounds);
  s.split = {SplitKind::Spatial,      axis, bin, {num0, num1}, cost, at(extent.lo, int(axis)),
             at(extent.hi, int(axis))};
}

/// Bit 0: the reference goes to the first child, bit 1: to the second. `index` counts within the node.
GPURT_GROUP uint32_t sides_of(const BuildReference &r, uint32_t index, const BuildSplit &split)
{
  if (split.kind == SplitKind::Halves) return index < split.num[0] ? 1 : 2;
  const BinGrid grid = make_grid(split.lo, split.hi);
  const int axis = int(split.axis);
  if (split.kind == SplitKind::Object) return bin_of(grid, at(center_of(r), axis)) <= split.bin ? 1 : 2;
  return (bin_of(grid, at(r.lo, axis)) <= split.bin ? 1u : 0u) |
         (bin_of(grid, at(r.hi, axis)) > split.bin ? 2u : 0u);
}

/// Bounds of the parts of a reference on either side of a plane that it crosses: all of the triangle's points within the
/// reference's box lie in one of them.
GPURT_GROUP_OUTLINE void cut_reference(const BuildScene &scene, const BuildReference &r, uint32_t axis,
                                       float position, Box &below, Box &above)
{
  const int k = int(axis);
  // By the box alone: where a plane's rounding puts it beside the box, one part is flat.
  const float middle = clamp(position, at(r.lo, k), at(r.hi, k));
  below = above = {r.lo, r.hi};
  set(below.hi, k, middle);
  set(above.lo, k, middle);
  const UInt3 c = scene.indices[r.triangle];
  ClippedTriangle polygon(scene.positions[c.x], scene.positions[c.y], scene.positions[c.z]);
  polygon.clip({r.lo, r.hi});
  if (polygon.is_empty()) return;  // by rounding
  Box lower, upper;
  polygon.split(k, middle, lower, upper);
  lower = {max(lower.lo, below.lo), min(lower.hi, below.hi)};
  upper = {max(upper.lo, above.lo), min(upper.hi, above.hi)};
  // A part that the polygon does not reach stays as it was: counts were made with it.
  if (!is_empty(lower)) below = lower;
  if (!is_empty(upper)) above = upper;
}

/// Where a split's references go.
struct SplitTarget {
  BuildReference *references[2];
  OrderedBox *bounds[2], *centers[2];  // of the children; shared by the group
};

/// Hands `count` references, the first of which is number `first_index` of its node, to the children, in their order.
/// `Cuts`: the split may be one in space.
template <bool Cuts, class Group>
GPURT_GROUP void move_references(const Group &group, const BuildScene &scene,
                                 const BuildReference *references, uint32_t count, uint32_t first_index,
                                 const BuildSplit &split, const SplitTarget &to)
{
  uint32_t begin, end;
  share_of_thread(count, group.thread(), group.size(), begin, end);
  uint32_t num = 0;  // of the first child below, of the second above
  for (uint32_t i = begin; i < end; ++i) {
    const uint32_t sides = sides_of(load_reference(references + i), first_index + i, split);
    num += (sides & 1u) | (sides >> 1) << 16;
  }
  uint32_t total;
  const uint32_t before = group.scan(num, total);
  BuildReference *out[2] = {to.references[0] + (before & 0xffffu), to.references[1] + (before >> 16)};
  Box bounds[2] = {empty_box(), empty_box()}, centers[2] = {empty_box(), empty_box()};
  [[maybe_unused]] const float position = plane_behind(split.bin, split.lo, split.hi - split.lo);
  for (uint32_t i = begin; i < end; ++i) {
    const BuildReference r = load_reference(references + i);
    const uint32_t sides = sides_of(r, first_index + i, split);
    Box part[2] = {{r.lo, r.hi}, {r.lo, r.hi}};
    if constexpr (Cuts) {
      if (sides == 3) cut_reference(scene, r, split.axis, position, part[0], part[1]);
    }
    GPURT_UNROLL
    for (int s = 0; s < 2; ++s) {
      if ((sides >> s & 1u) == 0) continue;
      const BuildReference moved = {part[s].lo, r.triangle, part[s].hi, 0};
      store_reference(out[s]++, moved);
      bounds[s] = extend(bounds[s], part[s]);
      centers[s] = extend(centers[s], center_of(moved));
    }
  }
  for (int s = 0; s < 2; ++s) {
    extend_by_all(group, *to.bounds[s], bounds[s]);
    extend_by_all(group, *to.centers[s], centers[s]);
  }
}

/// What the budget leaves over is shared out in proportion to the references.
GPURT_GROUP uint32_t spare_of_first(uint32_t spare, uint32_t num0, uint32_t num1)
{
  return uint32_t(uint64_t(spare) * num0 / (uint64_t(num0) + num1));
}

/// Two new nodes for the references of a split, with room for these; their bounds are not known yet.
GPURT_GROUP uint32_t make_children(const BuildLevel &level, uint32_t parent, const BuildSplit &split)
{
  BuildNode &node = level.nodes[parent];
  BuildCounters &counters = *level.counters;
  const uint32_t spare = node.spare - (split.num[0] + split.num[1] - node.count);
  const uint32_t spare0 = spare_of_first(spare, split.num[0], split.num[1]);
  const uint32_t child = add_to(&counters.num_nodes, 2);
  for (uint32_t s = 0; s < 2; ++s) {
    BuildNode c = {};
    c.bounds = c.centers = empty_ordered_box();
    c.count = split.num[s];
    c.depth = node.depth + 1;
    c.spare = s == 0 ? spare0 : spare - spare0;
    c.child = invalid_id;
    const NodeClass node_class = class_of(c.count);
    const uint32_t number = add_to(&counters.num_of_class[node_class], 1);
    if (node_class == SmallNode) {
      c.subtree = add_to(&counters.num_small_references, c.count);
    } else {
      c.first = add_to(&counters.num_level_references, c.count);
      level.next_list[node_class][number] = child + s;
    }
    level.nodes[child + s] = c;
  }
  node.child = child;
  return child;
}

}  // namespace gpurt::cuda
