// Maps from the unit square to the domains that a path samples.
#pragma once

#include "core/math/functions.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

// Cosine-weighted direction around +z; its pdf is cos / pi. Polar map: continuous in both coordinates.
GPURT_INLINE Vec3f sample_cosine_hemisphere(Vec2f u)
{
  float s, c;
  sincos_turns(u.y, s, c);
  const float r = sqrt(u.x);
  return {r * c, r * s, sqrt(1.0f - u.x)};
}

// Uniform barycentric weights (of the second and third corner). Source: Turk 1990.
GPURT_INLINE Vec2f sample_triangle(Vec2f u)
{
  const float root = sqrt(u.x);
  return {root * (1.0f - u.y), root * u.y};
}

// Weight of a strategy with density p against one with density q. Source: Veach 1997, Section 9.2.4, beta = 2.
// The ratio keeps squares in range; p > 0.
GPURT_INLINE float power_heuristic(float p, float q)
{
  const float r = q / p;
  return 1.0f / (1.0f + r * r);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
