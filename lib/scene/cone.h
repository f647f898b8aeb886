// Cones of directions, kept as cosines: no inverse trigonometry decides their bits.
#pragma once

#include <cmath>

#include "scene/affine.h"

namespace gpurt {

/// An angle in [0, 2 pi) by its cosine and sine.
struct Angle {
  double cos = 1, sin = 0;
};

inline Angle angle_from_cos(double c)
{
  c = c < -1 ? -1 : (c > 1 ? 1 : c);
  return {c, std::sqrt((1 - c) * (1 + c))};
}
inline Angle operator+(Angle a, Angle b)
{
  return {a.cos * b.cos - a.sin * b.sin, a.sin * b.cos + a.cos * b.sin};
}
inline Angle operator-(Angle a, Angle b)
{
  return {a.cos * b.cos + a.sin * b.sin, a.sin * b.cos - a.cos * b.sin};
}

/// Half of an angle in [0, 2 pi).
inline Angle half(Angle a)
{
  const double c = std::sqrt(std::fmax(0.0, 0.5 * (1 + a.cos))),
               s = std::sqrt(std::fmax(0.0, 0.5 * (1 - a.cos)));
  return {a.sin < 0 ? -c : c, s};
}

/// All directions within an angle in [0, pi] of the axis.
struct Cone {
  Vec3d axis{0, 0, 1};
  double cos_angle = 2;  // above 1: empty

  bool is_empty() const { return cos_angle > 1; }
};

/// A cone around both, the smallest up to rounding.
/// Source: Conty Estevez and Kulla 2018, Algorithm 1.
Cone join(const Cone &a, const Cone &b);

/// The angle whose cosine is c, to 7e-5: good enough for the cost of a split.
double approximate_acos(double c);

}  // namespace gpurt
