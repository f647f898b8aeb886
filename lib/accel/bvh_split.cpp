#include "accel/bvh_split.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/accel/clipped_triangle.h"

namespace gpurt {
namespace {

constexpr int max_object_bins = 32;
constexpr int num_spatial_bins = 16;
// References that one task counts. Counts and bounds do not depend on how they are shared out.
constexpr uint64_t grain = 8192;

Box common_part(const Box &a, const Box &b) { return {max(a.lo, b.lo), min(a.hi, b.hi)}; }

// A box in two vectors, for loops that do little else than extend boxes.
typedef float Floats __attribute__((vector_size(16)));

Floats to_floats(Vec3f p) { return Floats{p.x, p.y, p.z, 0}; }
Floats smaller(Floats a, Floats b) { return a < b ? a : b; }
Floats larger(Floats a, Floats b) { return a > b ? a : b; }

struct Bounds {
  Floats lo = {infinity, infinity, infinity, infinity}, hi = {-infinity, -infinity, -infinity, -infinity};

  void add(Floats p)
  {
    lo = smaller(p, lo);
    hi = larger(p, hi);
  }
  void add(const Bounds &other)
  {
    lo = smaller(other.lo, lo);
    hi = larger(other.hi, hi);
  }
  Box box() const { return {{lo[0], lo[1], lo[2]}, {hi[0], hi[1], hi[2]}}; }
};

Bounds bounds_of(const KdReference &r)
{
  Bounds bounds;
  bounds.lo = to_floats(r.lo);
  bounds.hi = to_floats(r.hi);
  return bounds;
}

double half_area(const Bounds &bounds) { return gpurt::half_area(bounds.box()); }

Bounds together(Bounds a, const Bounds &b)
{
  a.add(b);
  return a;
}

struct ObjectBins {
  Bounds bounds[3][max_object_bins];
  uint64_t count[3][max_object_bins] = {};

  void add(const ObjectBins &other)
  {
    for (int k = 0; k < 3; ++k) {
      for (int b = 0; b < max_object_bins; ++b) {
        bounds[k][b].add(other.bounds[k][b]);
        count[k][b] += other.count[k][b];
      }
    }
  }
};

// Of references that are not cut, the first and the last slice; of the others, the parts on either side of each plane.
struct SpatialBins {
  Bounds first[3][num_spatial_bins], last[3][num_spatial_bins];
  Bounds below[3][num_spatial_bins], above[3][num_spatial_bins];  // [i]: of the plane behind slice i
  uint64_t num_first[3][num_spatial_bins] = {}, num_last[3][num_spatial_bins] = {};

  void add(const SpatialBins &other)
  {
    for (int k = 0; k < 3; ++k) {
      for (int b = 0; b < num_spatial_bins; ++b) {
        first[k][b].add(other.first[k][b]);
        last[k][b].add(other.last[k][b]);
        below[k][b].add(other.below[k][b]);
        above[k][b].add(other.above[k][b]);
        num_first[k][b] += other.num_first[k][b];
        num_last[k][b] += other.num_last[k][b];
      }
    }
  }
};

// Adds the parts of a triangle within `within` on either side of a plane. In float: it only serves to compare costs.
void add_parts(const Floats (&corner)[3], const Bounds &within, int axis, float position, Bounds &below,
               Bounds &above)
{
  Bounds lower, upper;
  for (int i = 0; i < 3; ++i) {
    const Floats p = corner[i], q = corner[i == 2 ? 0 : i + 1];
    const float dp = p[axis] - position, dq = q[axis] - position;
    if (dp <= 0) lower.add(p);
    if (dp >= 0) upper.add(p);
    if ((dp < 0 && dq > 0) || (dp > 0 && dq < 0)) {
      const float s = dp / (dp - dq);
      Floats x = p + (q - p) * Floats{s, s, s, s};
      x[axis] = position;
      lower.add(x);
      upper.add(x);
    }
  }
  // What is cut away by earlier planes may leave nothing: then the part is taken as flat.
  lower.lo = larger(lower.lo, within.lo);
  lower.hi = larger(smaller(lower.hi, within.hi), lower.lo);
  upper.lo = larger(upper.lo, within.lo);
  upper.hi = larger(smaller(upper.hi, within.hi), upper.lo);
  below.add(lower);
  above.add(upper);
}

// Calls count(bins, reference) for all references, in parallel where they are many.
template <class Bins, class Count>
Bins count_all(const KdReference *references, uint64_t count, const Count &count_one)
{
  if (count <= grain) {
    Bins bins;
    for (uint64_t i = 0; i < count; ++i) count_one(bins, references[i]);
    return bins;
  }
  return tbb::parallel_reduce(
      tbb::blocked_range<uint64_t>(0, count, grain), Bins(),
      [&](const tbb::blocked_range<uint64_t> &range, Bins bins) {
        for (uint64_t i = range.begin(); i < range.end(); ++i) count_one(bins, references[i]);
        return bins;
      },
      [](Bins a, const Bins &b) {
        a.add(b);
        return a;
      });
}

// Slices of [lo, hi]; none where that is a point.
bool set_bins(BvhSplit &split, int axis, double lo, double hi, int num_bins)
{
  split.axis = axis;
  split.origin = lo;
  split.scale = num_bins / (hi - lo);
  split.num_bins = num_bins;
  return hi > lo && std::isfinite(split.scale);
}

}  // namespace

BvhExtent BvhExtent::empty()
{
  constexpr double inf = std::numeric_limits<double>::infinity();
  return {empty_box(), {inf, inf, inf}, {-inf, -inf, -inf}};
}

void BvhExtent::add(const KdReference &r)
{
  bounds = extend(bounds, Box{r.lo, r.hi});
  for (int k = 0; k < 3; ++k) {
    const double sum = double(at(r.lo, k)) + at(r.hi, k);
    lo[k] = std::min(lo[k], sum);
    hi[k] = std::max(hi[k], sum);
  }
}

void BvhExtent::add(const BvhExtent &other)
{
  bounds = extend(bounds, other.bounds);
  for (int k = 0; k < 3; ++k) {
    lo[k] = std::min(lo[k], other.lo[k]);
    hi[k] = std::max(hi[k], other.hi[k]);
  }
}

double half_area(const Box &box)
{
  if (is_empty(box)) return 0;
  const double x = double(box.hi.x) - box.lo.x, y = double(box.hi.y) - box.lo.y,
               z = double(box.hi.z) - box.lo.z;
  return x * y + y * z + z * x;
}

void cut_reference(const KdSource &source, const KdReference &r, int axis, float position, Box part[2])
{
  // By the box alone.
  part[0] = part[1] = {r.lo, r.hi};
  set(part[0].hi, axis, min(at(r.hi, axis), position));
  set(part[1].lo, axis, max(at(r.lo, axis), position));
  const UInt3 c = source.indices[r.id];
  ClippedTriangle polygon(source.positions[c.x], source.positions[c.y], source.positions[c.z]);
  polygon.clip({r.lo, r.hi});
  if (polygon.is_empty()) return;  // by rounding
  Box below, above;
  polygon.split(axis, position, below, above);
  below = common_part(part[0], below);
  above = common_part(part[1], above);
  if (is_empty(below) && is_empty(above)) return;
  part[0] = below;
  part[1] = above;
}

BvhSplit find_object_split(const KdReference *references, uint64_t count, const BvhExtent &extent,
                           Box side[2])
{
  BvhSplit slices[3], best;
  const int num_bins = int(std::min<uint64_t>(max_object_bins, 4 + count));
  bool has_slices[3];
  for (int k = 0; k < 3; ++k) has_slices[k] = set_bins(slices[k], k, extent.lo[k], extent.hi[k], num_bins);
  if (!has_slices[0] && !has_slices[1] && !has_slices[2]) return best;
  const auto all = count_all<ObjectBins>(references, count, [&](ObjectBins &bins, const KdReference &r) {
    const Bounds bounds = bounds_of(r);
    for (int k = 0; k < 3; ++k) {
      if (!has_slices[k]) continue;
      const int bin = bin_of(slices[k], double(at(r.lo, k)) + at(r.hi, k));
      bins.bounds[k][bin].add(bounds);
      ++bins.count[k][bin];
    }
  });
  for (int k = 0; k < 3; ++k) {
    if (!has_slices[k]) continue;
    Bounds above[max_object_bins], below;
    for (int b = num_bins - 1; b > 0; --b) above[b - 1] = together(above[b], all.bounds[k][b]);
    uint64_t num_below = 0;
    for (int b = 0; b + 1 < num_bins; ++b) {
      below.add(all.bounds[k][b]);
      num_below += all.count[k][b];
      if (num_below == 0 || num_below == count) continue;
      const double cost =
          half_area(below) * double(num_below) + half_area(above[b]) * double(count - num_below);
      if (best.kind != BvhSplitKind::None && !(cost < best.cost)) continue;
      best = slices[k];
      best.kind = BvhSplitKind::Object;
      best.cost = cost;
      best.bin = b;
      side[0] = below.box();
      side[1] = above[b].box();
    }
  }
  return best;
}

BvhSplit find_spatial_split(const KdSource &source, const KdReference *references, uint64_t count,
                            const BvhExtent &extent, uint64_t spare)
{
  BvhSplit slices[3], best;
  bool has_slices[3];
  float planes[3][num_spatial_bins];
  for (int k = 0; k < 3; ++k) {
    const double lo = at(extent.bounds.lo, k), hi = at(extent.bounds.hi, k);
    has_slices[k] = set_bins(slices[k], k, lo, hi, num_spatial_bins);
    for (int b = 0; b < num_spatial_bins; ++b)
      planes[k][b] = float(lo + (hi - lo) * (double(b + 1) / num_spatial_bins));
  }
  const auto all = count_all<SpatialBins>(references, count, [&](SpatialBins &bins, const KdReference &r) {
    const Bounds bounds = bounds_of(r);
    const UInt3 c = source.indices[r.id];
    const Floats corner[3] = {to_floats(source.positions[c.x]), to_floats(source.positions[c.y]),
                              to_floats(source.positions[c.z])};
    for (int k = 0; k < 3; ++k) {
      if (!has_slices[k]) continue;
      const int first = bin_of(slices[k], at(r.lo, k)), last = bin_of(slices[k], at(r.hi, k));
      ++bins.num_first[k][first];
      ++bins.num_last[k][last];
      bins.first[k][first].add(bounds);
      bins.last[k][last].add(bounds);
      for (int b = first; b < last; ++b)
        add_parts(corner, bounds, k, planes[k][b], bins.below[k][b], bins.above[k][b]);
    }
  });
  for (int k = 0; k < 3; ++k) {
    if (!has_slices[k]) continue;
    Bounds above[num_spatial_bins], below;
    for (int b = num_spatial_bins - 1; b > 0; --b) above[b - 1] = together(above[b], all.first[k][b]);
    uint64_t num_below = 0, num_above = count;
    for (int b = 0; b + 1 < num_spatial_bins; ++b) {
      below.add(all.last[k][b]);
      num_below += all.num_first[k][b];
      num_above -= all.num_last[k][b];
      // Where nothing is cut, slices of centres serve.
      if (num_below + num_above == count || num_below + num_above - count > spare) continue;
      const double cost = half_area(together(below, all.below[k][b])) * double(num_below) +
                          half_area(together(above[b], all.above[k][b])) * double(num_above);
      if (best.kind != BvhSplitKind::None && !(cost < best.cost)) continue;
      best = slices[k];
      best.kind = BvhSplitKind::Spatial;
      best.cost = cost;
      best.bin = b;
      best.position = planes[k][b];
    }
  }
  return best;
}

}  // namespace gpurt
