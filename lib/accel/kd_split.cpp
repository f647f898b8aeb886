// Split search by branch and bound: counts in slices bound the cost of every plane from below; only in slices that may
// hold the best one are the ends sorted and swept.
// Source: Wald and Havran 2006 for the sweep; Danilewski et al. 2010 for the counts.
// Differs: the result is the exact sweep's, in linear time for all but a few slices.
#include "accel/kd_split.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <bitset>
#include <cstring>

namespace gpurt {
namespace {

constexpr uint64_t parallel_grain = 16384;

uint32_t num_bins_for(uint64_t count)
{
  return count < 256 ? 32 : count < 2048 ? 64 : count < 32768 ? 256 : kd_max_bins;
}

// Costs of planes in a cell along one axis.
struct AxisCost {
  AxisCost(const Box &cell, int k, const KdCost &c) : cost(c)
  {
    unit = unit_of(cell);
    const Vec3f extent = (cell.hi - cell.lo) * unit;
    const float e1 = at(extent, k == 0 ? 1 : 0), e2 = at(extent, k == 2 ? 1 : 2);
    cap = e1 * e2;
    rim = e1 + e2;
    lo = at(cell.lo, k);
    hi = at(cell.hi, k);
    whole = half_area(extent);
  }
  // In units of `whole`, as find_small_split.
  float operator()(float p, uint64_t num_below, uint64_t num_above) const
  {
    const float area_below = cap + (p - lo) * unit * rim, area_above = cap + (hi - p) * unit * rim;
    const float sum =
        cost.traversal_cost * whole + area_below * float(num_below) + area_above * float(num_above);
    return num_below == 0 || num_above == 0 ? sum * cost.empty_factor : sum;
  }

  KdCost cost;
  float unit, cap, rim, lo, hi, whole;
};

void count_all(const KdBuildKernels &kernels, const KdReference *references, uint64_t count, KdBins &bins)
{
  if (count < 4 * parallel_grain) {
    kernels.count_bins(references, count, bins);
    return;
  }
  struct Sum {
    const KdBuildKernels &kernels;
    const KdReference *references;
    const KdBins &frame;
    std::unique_ptr<KdBins> bins;
    Sum(const KdBuildKernels &k, const KdReference *r, const KdBins &f)
        : kernels(k), references(r), frame(f), bins(std::make_unique<KdBins>(f))
    {}
    Sum(Sum &other, tbb::split) : Sum(other.kernels, other.references, other.frame) {}
    void operator()(const tbb::blocked_range<uint64_t> &range)
    {
      kernels.count_bins(references + range.begin(), range.size(), *bins);
    }
    void join(const Sum &other)
    {
      for (int k = 0; k < 3; ++k) {
        for (uint32_t b = 0; b < bins->num_bins; ++b) {
          bins->lo[k][b] += other.bins->lo[k][b];
          bins->hi[k][b] += other.bins->hi[k][b];
        }
      }
    }
  };
  Sum sum(kernels, references, bins);
  tbb::parallel_reduce(tbb::blocked_range<uint64_t>(0, count, parallel_grain), sum);
  bins = *sum.bins;
}

using BinSet = std::bitset<kd_max_bins>;

// Lists the ends that lie in marked bins along one axis, sorted.
void list_ends(const KdReference *references, uint64_t count, const KdBins &bins, int k, const BinSet &marked,
               KdEnds &ends)
{
  const auto is_marked = [&](float x) {
    return marked[bin_of(x, bins.origin[k], bins.scale[k], bins.num_bins)];
  };
  const auto run = [&](uint64_t begin, uint64_t end, KdEnds &e) {
    for (uint64_t i = begin; i < end; ++i) {
      const float lo = at(references[i].lo, k), hi = at(references[i].hi, k);
      if (lo == hi) {
        if (is_marked(lo)) e.flat.push_back(lo);
        continue;
      }
      if (is_marked(lo)) e.lo.push_back(lo);
      if (is_marked(hi)) e.hi.push_back(hi);
    }
  };
  ends.lo.clear();
  ends.hi.clear();
  ends.flat.clear();
  if (count < 4 * parallel_grain) {
    run(0, count, ends);
    std::sort(ends.lo.begin(), ends.lo.end());
    std::sort(ends.hi.begin(), ends.hi.end());
    std::sort(ends.flat.begin(), ends.flat.end());
    return;
  }
  ends = tbb::parallel_reduce(
      tbb::blocked_range<uint64_t>(0, count, parallel_grain), KdEnds{},
      [&](const tbb::blocked_range<uint64_t> &range, KdEnds e) {
        run(range.begin(), range.end(), e);
        return e;
      },
      [](KdEnds x, const KdEnds &y) {
        x.lo.insert(x.lo.end(), y.lo.begin(), y.lo.end());
        x.hi.insert(x.hi.end(), y.hi.begin(), y.hi.end());
        x.flat.insert(x.flat.end(), y.flat.begin(), y.flat.end());
        return x;
      });
  tbb::parallel_sort(ends.lo.begin(), ends.lo.end());
  tbb::parallel_sort(ends.hi.begin(), ends.hi.end());
  tbb::parallel_sort(ends.flat.begin(), ends.flat.end());
}

// Tries the planes through the ends in marked bins, given how many references begin and end in every bin.
void sweep(const KdEnds &ends, const KdBins &bins, int k, const BinSet &marked, uint64_t count,
           uint64_t budget, const AxisCost &axis_cost, KdSplit &best)
{
  const auto bin = [&](float x) { return bin_of(x, bins.origin[k], bins.scale[k], bins.num_bins); };
  size_t lo = 0, hi = 0, flat = 0;
  uint64_t bins_below = 0, bins_ended = 0;
  for (uint32_t b = 0; b < bins.num_bins; ++b) {
    // References that begin below the plane, and that end at it or below.
    uint64_t below = bins_below, ended = bins_ended;
    bins_below += bins.lo[k][b];
    bins_ended += bins.hi[k][b];
    if (!marked[b]) continue;
    for (;;) {
      float p = infinity;
      if (lo < ends.lo.size()) p = ends.lo[lo];
      if (hi < ends.hi.size()) p = std::min(p, ends.hi[hi]);
      if (flat < ends.flat.size()) p = std::min(p, ends.flat[flat]);
      if (p == infinity || bin(p) != b) break;
      const size_t lo_first = lo, flat_first = flat;
      while (lo < ends.lo.size() && ends.lo[lo] == p) ++lo;
      while (flat < ends.flat.size() && ends.flat[flat] == p) ++flat;
      const uint64_t planar = flat - flat_first;
      ended += planar;
      for (; hi < ends.hi.size() && ends.hi[hi] == p; ++hi) ++ended;
      const uint64_t above = count - ended;
      if (p > axis_cost.lo && p < axis_cost.hi && below + above + planar <= budget) {
        const float first = axis_cost(p, below + planar, above), second = axis_cost(p, below, above + planar);
        const float least = std::min(first, second);
        if (least < best.cost) best = {least, p, k, first <= second};
      }
      below += lo - lo_first + planar;
    }
  }
}

}  // namespace

KdSplit find_split(const KdBuildKernels &kernels, const KdReference *references, uint64_t count,
                   const Box &cell, const KdCost &cost, uint64_t budget, KdSplitScratch &scratch)
{
  if (count <= kd_small_count)
    return kernels.find_small_split(references, uint32_t(count), cell, cost, budget);

  KdBins &bins = scratch.bins;
  const uint32_t n = bins.num_bins = num_bins_for(count);
  for (int k = 0; k < 3; ++k) {
    bins.origin[k] = at(cell.lo, k);
    const float extent = at(cell.hi, k) - at(cell.lo, k);
    bins.scale[k] = extent > 0 ? min(float(n) / extent, 0x1p120f) : 0.0f;
    std::memset(bins.lo[k], 0, n * sizeof(uint32_t));
    std::memset(bins.hi[k], 0, n * sizeof(uint32_t));
  }
  count_all(kernels, references, count, bins);

  // The cost at the planes between bins bounds the best from above: it is linear between ends, and counts only fall
  // where a plane moves onto an end. So does the cost of a leaf, above which no split is wanted.
  const AxisCost costs[3] = {{cell, 0, cost}, {cell, 1, cost}, {cell, 2, cost}};
  float upper = float(count) * costs[0].whole;
  for (int k = 0; k < 3; ++k) {
    if (bins.scale[k] == 0) continue;
    uint64_t below = 0, ended = 0;
    for (uint32_t b = 1; b < n; ++b) {
      below += bins.lo[k][b - 1];
      ended += bins.hi[k][b - 1];
      if (below + (count - ended) > budget) continue;
      const float p = bins.origin[k] + float(b) / bins.scale[k];
      upper = std::min(upper, costs[k](p, below, count - ended));
    }
  }
  // Rounding of the plane's position: a bin is 2^-10 of the cell, so that 2^-20 of the cost covers it amply.
  upper *= 1.0f + 0x1p-18f;

  KdSplit best = {infinity, 0, 0, false};
  for (int k = 0; k < 3; ++k) {
    if (bins.scale[k] == 0) continue;
    BinSet marked;
    const float slack = 0x1p-6f;  // of a bin: more than rounding moves its borders
    uint64_t below = 0, ended = 0;
    for (uint32_t b = 0; b < n; ++b) {
      // Least counts and least areas of any plane in the bin.
      const uint64_t above = count - ended - bins.hi[k][b];
      const float lo = bins.origin[k] + (float(b) - slack) / bins.scale[k];
      const float hi = bins.origin[k] + (float(b) + 1 + slack) / bins.scale[k];
      const AxisCost &c = costs[k];
      const float area_below = c.cap + std::max(lo - c.lo, 0.0f) * c.unit * c.rim;
      const float area_above = c.cap + std::max(c.hi - hi, 0.0f) * c.unit * c.rim;
      float bound = cost.traversal_cost * c.whole + area_below * float(below) + area_above * float(above);
      if (below == 0 || above == 0) bound *= cost.empty_factor;
      if (bound <= std::min(upper, best.cost) && (bins.lo[k][b] != 0 || bins.hi[k][b] != 0)) marked.set(b);
      below += bins.lo[k][b];
      ended += bins.hi[k][b];
    }
    if (marked.none()) continue;
    list_ends(references, count, bins, k, marked, scratch.ends);
    sweep(scratch.ends, bins, k, marked, count, budget, costs[k], best);
  }
  best.cost /= costs[0].whole;
  best.position += 0.0f;  // the order of -0 and +0 is the sort's whim
  return best;
}

}  // namespace gpurt
