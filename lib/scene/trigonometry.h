// Sine, cosine and logarithm in double precision with the same bits on every machine: what a scene is compiled to must not depend
// on the C library.
#pragma once

#include <cmath>

namespace gpurt {

constexpr double pi_double = 3.14159265358979323846;

/// For |x| <= pi/2; the error is below 3e-16. Taylor's series, summed from its small end.
constexpr double sine(double x)
{
  const double z = x * x;
  double sum = 1;
  for (int n = 20; n >= 2; n -= 2) sum = 1 - sum * z / (n * (n + 1));
  return x * sum;
}

/// For x in [0, pi].
constexpr double cosine(double x)
{
  const double s = sine(0.5 * x);
  return 1 - 2 * s * s;
}

/// Natural logarithm of a positive, finite number; the error is below 1e-15 of it, or 3e-16 near 1. The series of the
/// area tangent, summed from its small end.
inline double natural_logarithm(double x)
{
  constexpr double ln_2 = 0.69314718055994530942, root_of_half = 0.70710678118654752440;
  int exponent;
  double m = std::frexp(x, &exponent);  // exact
  if (m < root_of_half) {
    m *= 2;
    --exponent;
  }
  const double z = (m - 1) / (m + 1), z2 = z * z;
  double sum = 0;
  for (int n = 25; n >= 1; n -= 2) sum = sum * z2 + 1.0 / n;
  return exponent * ln_2 + 2 * z * sum;
}

}  // namespace gpurt
