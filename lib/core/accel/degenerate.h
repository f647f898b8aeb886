// Exact test for triangles without area.
#pragma once

#include "core/math/vec.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

// A sum of doubles without rounding: components of growing magnitude that do not overlap.
// Source: Shewchuk 1997, Grow-Expansion.
class ExactSum {
 public:
  GPURT_HD void add(double b)
  {
    int kept = 0;
    for (int i = 0; i < num_; ++i) {
      const double a = part_[i], sum = a + b;
      const double b_virtual = sum - a, a_virtual = sum - b_virtual;
      const double error = (a - a_virtual) + (b - b_virtual);
      if (error != 0) part_[kept++] = error;
      b = sum;
    }
    part_[kept++] = b;
    num_ = kept;
  }
  GPURT_HD bool is_zero() const
  {
    for (int i = 0; i < num_; ++i) {
      if (part_[i] != 0) return false;
    }
    return true;
  }

 private:
  double part_[8] = {};
  int num_ = 0;
};

// The doubled signed area of a projection, as six products of floats: each is exact in double.
GPURT_HD inline bool has_no_area(double ax, double ay, double bx, double by, double cx, double cy)
{
  const double area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
  // Four rounded operations a term: far from zero, the sign is certain.
  const double size = abs((bx - ax) * (cy - ay)) + abs((by - ay) * (cx - ax));
  if (abs(area) > size * 0x1p-50) return false;
  ExactSum sum;
  sum.add(bx * cy);
  sum.add(-(bx * ay));
  sum.add(-(ax * cy));
  sum.add(-(by * cx));
  sum.add(by * ax);
  sum.add(ay * cx);
  return sum.is_zero();
}

// True where the corners lie on one line, exactly.
GPURT_HD inline bool has_no_area(Vec3f a, Vec3f b, Vec3f c)
{
  return has_no_area(a.x, a.y, b.x, b.y, c.x, c.y) && has_no_area(a.y, a.z, b.y, b.z, c.y, c.z) &&
         has_no_area(a.z, a.x, b.z, b.x, c.z, c.x);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
