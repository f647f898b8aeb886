// Double to float in a stated direction.
#pragma once

#include <cmath>
#include <limits>

namespace gpurt {

inline float round_down(double x)
{
  const float f = float(x);
  return double(f) > x ? std::nextafter(f, -std::numeric_limits<float>::infinity()) : f;
}

inline float round_up(double x)
{
  const float f = float(x);
  return double(f) < x ? std::nextafter(f, std::numeric_limits<float>::infinity()) : f;
}

}  // namespace gpurt
