// Sine and cosine in double precision with the same bits on every machine: what a scene is compiled to must not depend
// on the C library.
#pragma once

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

}  // namespace gpurt
