// Exact sums of floats: 128-bit fixed point, so that a film has the same bits for any order of its samples.
//
// The unit is 2^-64, the range +-2^62. A float from 2^-41 up is added without rounding; smaller ones are cut to the unit.
// Differs from the usual float or double film: it costs 16 bytes a sum, and makes tiles, passes, devices and merged files
// additive to the bit.
#pragma once

#include "core/math/scalar.h"

namespace gpurt {

struct FixedSum {
  uint64_t low;
  int64_t high;
};

GPURT_FUNCTIONS_BEGIN

// Largest magnitude that a single value may have; sums of 2^32 of them stay in range.
constexpr float fixed_sum_limit = 0x1p30f;

GPURT_INLINE FixedSum fixed_sum_from(float x)
{
  const uint32_t bits = float_bits(x);
  const int exponent = int((bits >> 23) & 0xffu);
  const uint64_t mantissa = (bits & 0x7fffffu) | (exponent != 0 ? 0x800000u : 0u);
  // x = mantissa * 2^(exponent - 150); in units of 2^-64 the mantissa moves by exponent - 86.
  const int shift = (exponent != 0 ? exponent : 1) - 86;
  FixedSum s{0, 0};
  if (shift >= 64) s.high = int64_t(mantissa << (shift - 64));
  else if (shift > 0) {
    s.low = mantissa << shift;
    s.high = int64_t(shift > 40 ? mantissa >> (64 - shift) : 0);
  } else if (shift > -24) s.low = mantissa >> -shift;
  if (bits >> 31) {
    s.low = ~s.low + 1;
    s.high = ~s.high + (s.low == 0 ? 1 : 0);
  }
  return s;
}

GPURT_INLINE void add(FixedSum &sum, FixedSum x)
{
  const uint64_t low = sum.low + x.low;
  sum.high = int64_t(uint64_t(sum.high) + uint64_t(x.high) + (low < x.low ? 1u : 0u));
  sum.low = low;
}

GPURT_INLINE double to_double(FixedSum s)
{
  // Both parts are rounded once and added: within an ulp of the exact value.
  return double(s.high) + double(s.low) * 0x1p-64;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
