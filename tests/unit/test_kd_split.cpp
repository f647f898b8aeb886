// The split search against a plain sweep.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

#include "accel/isa.h"
#include "accel/kd_split.h"

namespace gpurt {
namespace {

// Every plane through an end, in double.
double best_cost(const std::vector<KdReference> &refs, const Box &cell, const KdCost &cost, uint64_t budget)
{
  double best = infinity;
  const Vec3f e = cell.hi - cell.lo;
  const double whole = double(e.x) * e.y + double(e.y) * e.z + double(e.z) * e.x;
  for (int k = 0; k < 3; ++k) {
    std::set<float> planes;
    std::multiset<float> flat;
    std::vector<float> los, his;
    for (const KdReference &r : refs) {
      planes.insert({at(r.lo, k), at(r.hi, k)});
      los.push_back(at(r.lo, k));
      his.push_back(at(r.hi, k));
      if (los.back() == his.back()) flat.insert(los.back());
    }
    std::sort(los.begin(), los.end());
    std::sort(his.begin(), his.end());
    const double e1 = at(e, (k + 1) % 3), e2 = at(e, (k + 2) % 3);
    for (float p : planes) {
      if (!(p > at(cell.lo, k) && p < at(cell.hi, k))) continue;
      const uint64_t below = uint64_t(std::lower_bound(los.begin(), los.end(), p) - los.begin());
      const uint64_t above = uint64_t(his.end() - std::upper_bound(his.begin(), his.end(), p));
      const uint64_t planar = flat.count(p);
      if (below + above + planar > budget) continue;
      const double area_below = e1 * e2 + (double(p) - at(cell.lo, k)) * (e1 + e2);
      const double area_above = e1 * e2 + (double(at(cell.hi, k)) - p) * (e1 + e2);
      for (int side = 0; side < 2; ++side) {
        const uint64_t l = below + (side == 0 ? planar : 0), r = above + (side == 1 ? planar : 0);
        const double sum = cost.traversal_cost + (area_below * double(l) + area_above * double(r)) / whole;
        best = std::min(best, l == 0 || r == 0 ? sum * cost.empty_factor : sum);
      }
    }
  }
  return best;
}

struct Case {
  uint32_t count;
  int kind;
};

class KdSplitSearch : public testing::TestWithParam<Case> {};

TEST_P(KdSplitSearch, FindsTheBestPlaneOfASweep)
{
  const auto [count, kind] = GetParam();
  std::mt19937 rng(count * 31 + uint32_t(kind));
  const auto uniform = [&](float lo, float hi) { return lo + (hi - lo) * float(rng() >> 8) * 0x1p-24f; };
  const int rounds = count > 10000 ? 1 : count > 1000 ? 4 : 40;
  for (int round = 0; round < rounds; ++round) {
    const Box cell = {{-1, -1, -1}, {1, uniform(-0.5f, 1), 1}};
    std::vector<KdReference> refs(count);
    for (uint32_t i = 0; i < count; ++i) {
      Box b = empty_box();
      for (int k = 0; k < 3; ++k) {
        const float lo = at(cell.lo, k), hi = at(cell.hi, k);
        float x = uniform(lo, hi), y = uniform(lo, hi);
        if (kind == 1) y = x + (hi - x) * uniform(0, 0.05f);  // small
        if (kind == 2 && k == int(rng() % 3))
          y = x = lo + (hi - lo) * 0.125f * float(rng() % 9);          // flat, on few planes
        if (kind == 3) x = lo + (hi - lo) * uniform(0, 0.01f), y = x;  // crowded in a corner, flat
        if (kind == 4)
          x = uniform(lo, lo + (hi - lo) * 0.3f), y = x + uniform(0, 0.1f) * (hi - lo);  // empty space
        set(b.lo, k, std::min(x, y));
        set(b.hi, k, std::min(std::max(x, y), hi));
      }
      refs[i] = {b.lo, i, b.hi, 0};
    }
    const KdCost cost = {1.5f, 0.85f};
    for (uint64_t budget : {uint64_t(8) * count, uint64_t(count) + count / 8}) {
      const double expected = best_cost(refs, cell, cost, budget);
      for (const char *isa : {"x86_64", "x86_64_v3", "generic"}) {
        if (!can_run_isa(isa)) continue;
        KdSplitScratch scratch;
        const KdSplit split =
            find_split(kd_build_kernels(isa), refs.data(), count, cell, cost, budget, scratch);
        // No split is looked for above the cost of a leaf.
        if (expected >= double(count)) {
          EXPECT_GE(split.cost, double(count) * (1 - 1e-5));
          continue;
        }
        EXPECT_NEAR(split.cost, expected, 1e-5 * expected);  // areas are rounded in float
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Sizes, KdSplitSearch, testing::ValuesIn([] {
                           std::vector<Case> cases;
                           for (uint32_t count :
                                {1u, 2u, 3u, 9u, 33u, 64u, 65u, 200u, 1500u, 5000u, 70000u}) {
                             for (int kind = 0; kind < 5; ++kind) cases.push_back({count, kind});
                           }
                           return cases;
                         }()));

}  // namespace
}  // namespace gpurt
