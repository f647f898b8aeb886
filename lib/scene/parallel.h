// The parallel loops of a scene's compilation. All of them give the same result for any number of threads.
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cstdint>

#include "core/math/vec.h"

namespace gpurt {

constexpr uint64_t parallel_grain = 4096;

/// body(i) for all i < count, in any order.
template <class Body>
void parallel_for_each(uint64_t count, const Body &body)
{
  tbb::parallel_for(tbb::blocked_range<uint64_t>(0, count, parallel_grain),
                    [&](const tbb::blocked_range<uint64_t> &r) {
                      for (uint64_t i = r.begin(); i != r.end(); ++i) body(i);
                    });
}

/// The smallest i < count with is_bad(i), or count.
template <class Predicate>
uint64_t find_first(uint64_t count, const Predicate &is_bad)
{
  return tbb::parallel_reduce(
      tbb::blocked_range<uint64_t>(0, count, parallel_grain), count,
      [&](const tbb::blocked_range<uint64_t> &r, uint64_t found) {
        for (uint64_t i = r.begin(); i != r.end() && i < found; ++i) {
          if (is_bad(i)) return i;
        }
        return found;
      },
      [](uint64_t a, uint64_t b) { return std::min(a, b); });
}

/// Union of box(i) for all i < count.
template <class Boxes>
Box union_of_boxes(uint64_t count, const Boxes &box)
{
  return tbb::parallel_reduce(
      tbb::blocked_range<uint64_t>(0, count, parallel_grain), empty_box(),
      [&](const tbb::blocked_range<uint64_t> &r, Box b) {
        for (uint64_t i = r.begin(); i != r.end(); ++i) b = extend(b, box(i));
        return b;
      },
      [](const Box &a, const Box &b) { return extend(a, b); });
}

}  // namespace gpurt
