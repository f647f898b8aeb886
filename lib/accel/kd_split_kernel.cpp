// The inner loops of the split search, once per instruction set.
#include "accel/kd_build_kernels.h"

// Vectors of eight floats are passed between inlined functions alone, so that no calling convention is concerned.
#pragma GCC diagnostic ignored "-Wpsabi"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

namespace {

typedef float Floats __attribute__((vector_size(32)));
typedef int32_t Ints __attribute__((vector_size(32)));
constexpr uint32_t width = 8;

GPURT_INLINE Floats broadcast(float x) { return Floats{x, x, x, x, x, x, x, x}; }
GPURT_INLINE Floats to_floats(Ints x) { return __builtin_convertvector(x, Floats); }
GPURT_INLINE Floats select(Ints mask, Floats a, Floats b)
{
  return Floats((Ints(a) & mask) | (Ints(b) & ~mask));
}

}  // namespace

// Counts, for eight candidate planes at a time, what lies below, above and in them.
KdSplit find_small_split(const KdReference *references, uint32_t count, const Box &cell, const KdCost &cost,
                         uint64_t budget)
{
  KdSplit best = {infinity, 0.0f, 0, false};
  const float unit = unit_of(cell);
  const Vec3f extent = (cell.hi - cell.lo) * unit;
  const float whole_area = half_area(extent);
  const Floats step = broadcast(cost.traversal_cost * whole_area);
  const Floats empty_factor = broadcast(cost.empty_factor);
  const Floats scale = broadcast(unit);
  const Floats no_cost = broadcast(infinity);
  const Floats room = broadcast(float(min(budget, uint64_t(4 * kd_small_count))));
  float best_cost = infinity;
  alignas(32) float candidates[2 * kd_small_count + width];
  float lo[kd_small_count], hi[kd_small_count];
  for (int k = 0; k < 3; ++k) {
    const float cell_lo = at(cell.lo, k), cell_hi = at(cell.hi, k);
    uint32_t num = 0;
    for (uint32_t i = 0; i < count; ++i) {
      lo[i] = at(references[i].lo, k);
      hi[i] = at(references[i].hi, k);
      candidates[num] = lo[i];
      num += lo[i] > cell_lo && lo[i] < cell_hi;
      candidates[num] = hi[i];
      num += hi[i] > cell_lo && hi[i] < cell_hi && hi[i] != lo[i];
    }
    if (num == 0) continue;
    for (uint32_t i = num; i % width != 0; ++i) candidates[i] = candidates[0];
    const float e1 = at(extent, k == 0 ? 1 : 0), e2 = at(extent, k == 2 ? 1 : 2);
    const Floats cap = broadcast(e1 * e2), rim = broadcast(e1 + e2);
    const Floats begin = broadcast(cell_lo), end = broadcast(cell_hi);
    for (uint32_t c = 0; c < num; c += width) {
      Floats p;
      __builtin_memcpy(&p, candidates + c, sizeof p);
      Ints below = {}, above = {}, off = {};
      for (uint32_t i = 0; i < count; ++i) {
        const Ints is_below = broadcast(lo[i])<p, is_above = broadcast(hi[i])> p;
        below -= is_below;
        above -= is_above;
        off -= is_below | is_above;
      }
      const Floats num_below = to_floats(below), num_above = to_floats(above);
      const Floats num_planar = broadcast(float(count)) - to_floats(off);
      const Floats area_below = cap + (p - begin) * scale * rim, area_above = cap + (end - p) * scale * rim;
      const Floats separate = step + area_below * num_below + area_above * num_above;
      const Floats zero = {};
      Floats cost_below = separate + area_below * num_planar;  // planar ones go to the first child
      Floats cost_above = separate + area_above * num_planar;
      cost_below = select((num_above == zero) | ((num_below + num_planar) == zero), cost_below * empty_factor,
                          cost_below);
      cost_above = select((num_below == zero) | ((num_above + num_planar) == zero), cost_above * empty_factor,
                          cost_above);
      const Ints fits = (num_below + num_above + num_planar) <= room;
      const Ints planar_first = cost_below <= cost_above;
      Floats least = select(fits, select(planar_first, cost_below, cost_above), no_cost);
      for (uint32_t i = 0; i < width; ++i) {
        if (least[i] < best_cost || (least[i] == best_cost && best.axis == k && p[i] < best.position)) {
          best_cost = least[i];
          best = {0.0f, p[i], k, planar_first[i] != 0};
        }
      }
    }
  }
  best.cost = best_cost / whole_area;
  best.position += 0.0f;
  return best;
}

void count_bins(const KdReference *references, uint64_t count, KdBins &bins)
{
  const uint32_t n = bins.num_bins;
  for (uint64_t i = 0; i < count; ++i) {
    const KdReference &r = references[i];
    for (int k = 0; k < 3; ++k) {
      ++bins.lo[k][bin_of(at(r.lo, k), bins.origin[k], bins.scale[k], n)];
      ++bins.hi[k][bin_of(at(r.hi, k), bins.origin[k], bins.scale[k], n)];
    }
  }
}

extern const KdBuildKernels build_kernels = {find_small_split, count_bins};

GPURT_FUNCTIONS_END
}  // namespace gpurt
