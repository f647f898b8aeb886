// Sine, cosine, exponential, arc tangent and the sRGB curve with the same bits on every machine.
//
// Source: Moshier 1989, Cephes: the polynomials of sinf, cosf, expf and atanf; errors below 2 ulp on the reduced ranges.
#pragma once

#include "core/math/vec.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

// Sine and cosine of 2 pi x. Reduction in turns is exact, so there is no loss for |x| up to 2^20.
GPURT_INLINE void sincos_turns(float x, float &sine, float &cosine)
{
  const float quarter = floor(x * 4.0f + 0.5f);
  const float r = (x - quarter * 0.25f) * (2.0f * pi);  // in [-pi/4, pi/4]
  const float z = r * r;
  const float s = fma(fma(fma(-1.9515295891e-4f, z, 8.3321608736e-3f), z, -1.6666654611e-1f) * z, r, r);
  const float c =
      fma(fma(fma(2.443315711809948e-5f, z, -1.388731625493765e-3f), z, 4.166664568298827e-2f) * z, z,
          fma(-0.5f, z, 1.0f));
  const int q = int(quarter) & 3;
  sine = (q & 1) ? c : s;
  cosine = (q & 1) ? s : c;
  if (q & 2) sine = -sine;
  if (q == 1 || q == 2) cosine = -cosine;
}

// e^x for x <= 0, down to 0 for what is below the smallest float.
GPURT_INLINE float exp_of_negative(float x)
{
  if (!(x > -104.0f)) return 0.0f;
  const float n = floor(fma(x, 1.44269504088896341f, 0.5f));  // of log2 e
  // x - n ln 2, in two parts, of which the first is exact.
  const float r = fma(n, 2.12194440e-4f, fma(n, -0.693359375f, x));
  const float p =
      fma(fma(fma(fma(fma(1.9875691500e-4f, r, 1.3981999507e-3f), r, 8.3334519073e-3f), r, 4.1665795894e-2f),
              r, 1.6666665459e-1f),
          r, 5.0000001201e-1f);
  const float y = fma(p, r * r, r) + 1.0f;
  // By halves, each of which is a normal number: the product may be none.
  const int half = int(n) / 2, rest = int(n) - half;
  return y * float_from_bits(uint32_t(half + 127) << 23) * float_from_bits(uint32_t(rest + 127) << 23);
}

GPURT_INLINE float atan_positive(float x)
{
  float offset = 0.0f;
  if (x > 2.414213562373095f) {  // tan(3 pi / 8)
    offset = 0.5f * pi;
    x = -1.0f / x;
  } else if (x > 0.4142135623730950f) {  // tan(pi / 8)
    offset = 0.25f * pi;
    x = (x - 1.0f) / (x + 1.0f);
  }
  const float z = x * x;
  const float p =
      fma(fma(fma(8.05374449538e-2f, z, -1.38776856032e-1f), z, 1.99777106478e-1f), z, -3.33329491539e-1f);
  return offset + fma(p * z, x, x);
}

// In (-pi, pi]; atan2(0, 0) is 0.
GPURT_INLINE float atan2(float y, float x)
{
  if (x == 0.0f && y == 0.0f) return 0.0f;
  const float a = x == 0.0f ? 0.5f * pi : atan_positive(abs(y) / abs(x));
  const float b = x < 0.0f ? pi - a : a;
  return y < 0.0f ? -b : b;
}

// Arc cosine of a unit vector's component c whose complement sqrt(1 - c^2) is s: no cancellation at the ends.
GPURT_INLINE float acos_from_sincos(float s, float c) { return atan2(s, c); }

// Fifth root for x in [0, 1] by Newton's method; used at compile time alone.
constexpr double fifth_root(double x)
{
  double y = 1.0;
  for (int i = 0; i < 60; ++i) y = y - (y * y * y * y * y - x) / (5.0 * y * y * y * y);
  return y;
}

struct SrgbTable {
  float value[256];
};

// The sRGB decoding curve of IEC 61966-2-1; x^2.4 = x^2 (x^2)^(1/5).
constexpr SrgbTable make_srgb_table()
{
  SrgbTable table{};
  for (int i = 0; i < 256; ++i) {
    const double c = i / 255.0;
    const double a = (c + 0.055) / 1.055;
    table.value[i] = float(c <= 0.04045 ? c / 12.92 : a * a * fifth_root(a * a));
  }
  return table;
}

GPURT_INLINE float linear_from_srgb8(uint32_t code)
{
  static constexpr SrgbTable table = make_srgb_table();
  return table.value[code & 255u];
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
