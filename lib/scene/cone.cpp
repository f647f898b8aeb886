#include "scene/cone.h"

#include <utility>

#include "scene/trigonometry.h"

namespace gpurt {

Cone join(const Cone &a_in, const Cone &b_in)
{
  if (a_in.is_empty()) return b_in;
  if (b_in.is_empty()) return a_in;
  Cone a = a_in, b = b_in;
  if (b.cos_angle < a.cos_angle) std::swap(a, b);  // a is the wider one

  const Angle wide = angle_from_cos(a.cos_angle), narrow = angle_from_cos(b.cos_angle);
  const Angle between = angle_from_cos(dot(a.axis, b.axis));
  // b lies within a: between + narrow <= wide.
  if (between.cos >= (wide - narrow).cos) return a;
  // Together all directions: wide + narrow + between >= 2 pi.
  const Angle sum = wide + narrow;
  const bool is_over_pi = wide.cos <= -narrow.cos;
  if (is_over_pi && between.cos <= sum.cos) return {a.axis, -1};

  // The new cone touches both from outside; its axis is a's, turned towards b's.
  const Angle angle = half(sum + between);
  const Angle turn = angle - wide;
  Vec3d across = b.axis - a.axis * dot(a.axis, b.axis);
  if (max_component_abs(across) < 0x1p-40) {
    // Opposite axes: any direction across will do.
    const Vec3d n = a.axis;
    across = std::fabs(n.x) < 0.5 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0};
    across = across - n * dot(n, across);
  }
  return {normalize(a.axis * turn.cos + normalize(across) * turn.sin), angle.cos};
}

// Source: Abramowitz and Stegun 1964, 4.4.45.
double approximate_acos(double c)
{
  const double x = std::fabs(c) > 1 ? 1 : std::fabs(c);
  const double a = std::sqrt(1 - x) * (1.5707288 + x * (-0.2121144 + x * (0.0742610 - x * 0.0187293)));
  return c < 0 ? pi_double - a : a;
}

}  // namespace gpurt
