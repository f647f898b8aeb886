// Bounds of the part of a triangle that lies in a cell, rounded outward: perfect splits.
// Source: Wald and Havran 2006, Section 3.2; Sutherland and Hodgman 1974.
#pragma once

#include "core/math/vec.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

/// The polygon that is left of a triangle, in double.
class ClippedTriangle {
 public:
  GPURT_HD ClippedTriangle(Vec3f a, Vec3f b, Vec3f c)
  {
    const Vec3f corners[3] = {a, b, c};
    double largest = 0;
    for (int i = 0; i < 3; ++i) {
      for (int k = 0; k < 3; ++k) {
        point_[i][k] = at(corners[i], k);
        const double m = point_[i][k] < 0 ? -point_[i][k] : point_[i][k];
        if (m > largest) largest = m;
      }
    }
    num_ = 3;
    // An intersection is rounded four times; at most seven clips follow one another. 2^-53 * 4 * 7 < 2^-48.
    margin_ = largest * 0x1p-47;
  }

  GPURT_HD bool is_empty() const { return num_ == 0; }

  /// Cuts off what lies outside of a cell.
  GPURT_HD void clip(const Box &cell)
  {
    for (int k = 0; k < 3; ++k) {
      double lo = point_[0][k], hi = lo;
      for (int i = 1; i < num_; ++i) {
        if (point_[i][k] < lo) lo = point_[i][k];
        if (point_[i][k] > hi) hi = point_[i][k];
      }
      if (lo < at(cell.lo, k)) clip_half_space(k, at(cell.lo, k), 1.0);
      if (num_ == 0) return;
      if (hi > at(cell.hi, k)) clip_half_space(k, at(cell.hi, k), -1.0);
      if (num_ == 0) return;
    }
  }

  /// Bounds of the parts on either side of a plane. A side that the polygon at most touches gets an empty box: what
  /// lies in the plane belongs to the other side's closed cell.
  GPURT_HD void split(int axis, float position, Box &below, Box &above) const
  {
    Bounds lower, upper;
    bool has_below = false, has_above = false;
    for (int i = 0; i < num_; ++i) {
      const double *p = point_[i];
      const double *q = point_[i + 1 == num_ ? 0 : i + 1];
      const double dp = p[axis] - position, dq = q[axis] - position;
      if (dp <= 0) lower.add(p);
      if (dp >= 0) upper.add(p);
      has_below |= dp < 0;
      has_above |= dp > 0;
      if ((dp < 0 && dq > 0) || (dp > 0 && dq < 0)) {
        double x[3];
        intersect(p, q, dp, dq, axis, position, x);
        lower.add(x);
        upper.add(x);
      }
    }
    below = has_below || !has_above ? lower.rounded_outward(margin_) : empty_box();
    above = has_above ? upper.rounded_outward(margin_) : empty_box();
  }

 private:
  struct Bounds {
    double lo[3] = {1e300, 1e300, 1e300}, hi[3] = {-1e300, -1e300, -1e300};
    GPURT_HD void add(const double *p)
    {
      for (int k = 0; k < 3; ++k) {
        if (p[k] < lo[k]) lo[k] = p[k];
        if (p[k] > hi[k]) hi[k] = p[k];
      }
    }
    GPURT_HD Box rounded_outward(double margin) const
    {
      if (lo[0] > hi[0]) return empty_box();
      return {{round_down(lo[0] - margin), round_down(lo[1] - margin), round_down(lo[2] - margin)},
              {round_up(hi[0] + margin), round_up(hi[1] + margin), round_up(hi[2] + margin)}};
    }
    GPURT_HD static float round_down(double x)
    {
      const float f = float(x);
      return double(f) > x ? next_down(f) : f;
    }
    GPURT_HD static float round_up(double x)
    {
      const float f = float(x);
      return double(f) < x ? next_up(f) : f;
    }
  };

  GPURT_HD static void intersect(const double *p, const double *q, double dp, double dq, int axis,
                                 double position, double *x)
  {
    const double s = dp / (dp - dq);
    for (int k = 0; k < 3; ++k) x[k] = p[k] + s * (q[k] - p[k]);
    x[axis] = position;
  }

  // Keeps what has sign * (coordinate - position) >= 0.
  GPURT_HD void clip_half_space(int axis, double position, double sign)
  {
    double kept[max_points][3];
    int n = 0;
    for (int i = 0; i < num_; ++i) {
      // Rounding can make the outline wind; then it stays as it is, which is on the safe side.
      if (n > max_points - 2) return;
      const double *p = point_[i];
      const double *q = point_[i + 1 == num_ ? 0 : i + 1];
      const double dp = sign * (p[axis] - position), dq = sign * (q[axis] - position);
      if (dp >= 0) {
        for (int k = 0; k < 3; ++k) kept[n][k] = p[k];
        ++n;
      }
      if ((dp < 0 && dq > 0) || (dp > 0 && dq < 0)) intersect(p, q, dp, dq, axis, position, kept[n++]);
    }
    num_ = n;
    for (int i = 0; i < n; ++i) {
      for (int k = 0; k < 3; ++k) point_[i][k] = kept[i][k];
    }
  }

  static constexpr int max_points = 16;  // a triangle gains a corner a plane: 9, and room for rounding
  double point_[max_points][3];
  double margin_;
  int num_;
};

GPURT_FUNCTIONS_END
}  // namespace gpurt
