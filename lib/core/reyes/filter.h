// Reconstruction filters by the places of samples: a pixel's samples are drawn in proportion to the filter, and their
// plain mean is the filtered image. So pixels stay independent of each other, as tiles and merging want it.
// Source: Ernst, Stamminger and Greiner 2006, filter importance sampling.
#pragma once

#include "core/random/sobol.h"
#include "core/reyes/reyes_scene.h"

namespace gpurt {

// Where a sample lies from the pixel's corner, and what its radiance counts: the filter's sign, over its mean.
struct FilteredPlace {
  Vec2f offset;
  float weight;
};

constexpr uint32_t filter_table_size = 64;

// One axis of a filter as a cumulative table over [-radius, radius]; the inverse is piecewise linear.
struct FilterTable {
  float cumulative[filter_table_size + 1];
  float radius;
  float scale;  // integral of |f| over that of f
};

GPURT_FUNCTIONS_BEGIN

// How far a sample may lie from its pixel's square, in whole pixels.
GPURT_INLINE int filter_reach(ReyesFilter filter)
{
  return filter == ReyesFilter::Mitchell ? 2 : (filter == ReyesFilter::Gaussian ? 1 : 0);
}

// Mitchell and Netravali 1988 with B = C = 1/3.
GPURT_INLINE float mitchell(float x)
{
  x = abs(x);
  if (x < 1.0f) return ((7.0f * x - 12.0f) * x * x + 16.0f / 3.0f) * (1.0f / 6.0f);
  if (x < 2.0f) return (((-7.0f / 3.0f * x + 12.0f) * x - 20.0f) * x + 32.0f / 3.0f) * (1.0f / 6.0f);
  return 0.0f;
}

// exp(-2 x^2) - exp(-2 r^2) for r = 1.5, by (1 - 2 x^2 / 64)^64: the same on every machine, within 2 %.
GPURT_INLINE float gaussian(float x)
{
  const auto bell = [](float y) {
    float b = 1.0f - 2.0f * y * y * (1.0f / 64.0f);
    for (int i = 0; i < 6; ++i) b *= b;
    return b;
  };
  return max(bell(x) - bell(1.5f), 0.0f);
}

GPURT_HD inline void make_filter_table(ReyesFilter filter, FilterTable &t)
{
  const bool is_mitchell = filter == ReyesFilter::Mitchell;
  t.radius = is_mitchell ? 2.0f : 1.5f;
  float absolute = 0.0f, plain = 0.0f;
  t.cumulative[0] = 0.0f;
  for (uint32_t i = 0; i < filter_table_size; ++i) {
    // The mean over a step, by its middle, also of the two in which Mitchell's sign changes, at 8/7.
    const float x = (2.0f * (float(i) + 0.5f) / float(filter_table_size) - 1.0f) * t.radius;
    const float f = is_mitchell ? mitchell(x) : gaussian(x);
    absolute += abs(f);
    plain += f;
    t.cumulative[i + 1] = absolute;
  }
  for (uint32_t i = 1; i <= filter_table_size; ++i) t.cumulative[i] = t.cumulative[i] / absolute;
  t.scale = absolute / plain;
}

// The place in [-radius, radius] for x in [0, 1), and its factor of the weight.
GPURT_HD inline float filter_place(const FilterTable &t, bool is_mitchell, float x, float &weight)
{
  uint32_t lo = 0, hi = filter_table_size;
  while (hi - lo > 1) {
    const uint32_t mid = (lo + hi) / 2;
    if (t.cumulative[mid] <= x) lo = mid;
    else hi = mid;
  }
  const float width = t.cumulative[lo + 1] - t.cumulative[lo];
  const float part = width > 0.0f ? (x - t.cumulative[lo]) / width : 0.5f;
  const float middle = (2.0f * (float(lo) + 0.5f) / float(filter_table_size) - 1.0f) * t.radius;
  weight *= t.scale * (is_mitchell && mitchell(middle) < 0.0f ? -1.0f : 1.0f);
  return (2.0f * (float(lo) + clamp(part, 0.0f, 1.0f)) / float(filter_table_size) - 1.0f) * t.radius;
}

GPURT_INLINE FilteredPlace place_sample(ReyesFilter filter, const FilterTable &table, Vec2f u)
{
  if (filter == ReyesFilter::Box) return {u, 1.0f};
  const bool is_mitchell = filter == ReyesFilter::Mitchell;
  FilteredPlace p{{0.0f, 0.0f}, 1.0f};
  // Never on the upper end, which would be one pixel further.
  const float limit = table.radius + 0.5f - 1.0f / 256.0f;
  p.offset.x = min(filter_place(table, is_mitchell, u.x, p.weight) + 0.5f, limit);
  p.offset.y = min(filter_place(table, is_mitchell, u.y, p.weight) + 0.5f, limit);
  return p;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
