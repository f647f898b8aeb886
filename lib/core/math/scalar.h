// Scalar arithmetic with the same bits on every machine: IEEE operations, explicit fma, nothing of <cmath> that rounds
// as the platform likes.
#pragma once

#include "core/platform.h"

namespace gpurt {

constexpr float pi = 3.14159265358979323846f;
constexpr float inv_pi = 0.31830988618379067154f;
constexpr float infinity = __builtin_huge_valf();
constexpr float float_epsilon = 0x1p-24f;  // half an ulp of 1: the relative error of one rounded operation

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE uint32_t float_bits(float x)
{
#if defined(__CUDA_ARCH__)
  return __float_as_uint(x);
#else
  return __builtin_bit_cast(uint32_t, x);
#endif
}

GPURT_INLINE float float_from_bits(uint32_t bits)
{
#if defined(__CUDA_ARCH__)
  return __uint_as_float(bits);
#else
  return __builtin_bit_cast(float, bits);
#endif
}

GPURT_INLINE float min(float a, float b) { return b < a ? b : a; }
GPURT_INLINE float max(float a, float b) { return a < b ? b : a; }
GPURT_INLINE int min(int a, int b) { return b < a ? b : a; }
GPURT_INLINE int max(int a, int b) { return a < b ? b : a; }
GPURT_INLINE uint32_t min(uint32_t a, uint32_t b) { return b < a ? b : a; }
GPURT_INLINE uint32_t max(uint32_t a, uint32_t b) { return a < b ? b : a; }
GPURT_INLINE uint64_t min(uint64_t a, uint64_t b) { return b < a ? b : a; }
GPURT_INLINE uint64_t max(uint64_t a, uint64_t b) { return a < b ? b : a; }
GPURT_INLINE float clamp(float x, float lo, float hi) { return x < lo ? lo : (hi < x ? hi : x); }
GPURT_INLINE float abs(float x) { return float_from_bits(float_bits(x) & 0x7fffffffu); }
GPURT_INLINE double abs(double x) { return __builtin_fabs(x); }

// The larger or smaller one; `x` where y is not a number. x is one.
GPURT_INLINE float at_least(float x, float y)
{
#if defined(__CUDA_ARCH__)
  return fmaxf(x, y);
#else
  return y > x ? y : x;
#endif
}
GPURT_INLINE float at_most(float x, float y)
{
#if defined(__CUDA_ARCH__)
  return fminf(x, y);
#else
  return y < x ? y : x;
#endif
}

// As abs(), which compilers for GPUs make a part of the instruction that takes it only so.
GPURT_INLINE float size_of(float x)
{
#if defined(__CUDA_ARCH__)
  return fabsf(x);
#else
  return abs(x);
#endif
}

GPURT_INLINE float larger_size(float x, float y)
{
#if defined(__CUDA_ARCH__)
  return fmaxf(fabsf(x), fabsf(y));
#else
  return max(abs(x), abs(y));
#endif
}
GPURT_INLINE float sqr(float x) { return x * x; }
GPURT_INLINE float copysign(float magnitude, float sign)
{
  return float_from_bits((float_bits(magnitude) & 0x7fffffffu) | (float_bits(sign) & 0x80000000u));
}
GPURT_INLINE bool sign_bit(float x) { return (float_bits(x) >> 31) != 0; }
GPURT_INLINE bool is_finite(float x) { return (float_bits(x) & 0x7f800000u) != 0x7f800000u; }

GPURT_INLINE float fma(float a, float b, float c) { return __builtin_fmaf(a, b, c); }
GPURT_INLINE double fma(double a, double b, double c) { return __builtin_fma(a, b, c); }
GPURT_INLINE float sqrt(float x) { return __builtin_sqrtf(x); }
GPURT_INLINE double sqrt(double x) { return __builtin_sqrt(x); }
GPURT_INLINE float safe_sqrt(float x) { return sqrt(max(x, 0.0f)); }
GPURT_INLINE float floor(float x) { return __builtin_floorf(x); }

// The next float above or below, for finite x.
GPURT_INLINE float next_up(float x)
{
  const uint32_t bits = float_bits(x);
  if (x == 0.0f) return float_from_bits(1u);
  return float_from_bits(x > 0.0f ? bits + 1 : bits - 1);
}
GPURT_INLINE float next_down(float x) { return -next_up(-x); }

// Bound on the relative error of n rounded operations.
// Source: Higham 2002, Section 3.1.
GPURT_INLINE constexpr float error_gamma(int n) { return (n * float_epsilon) / (1 - n * float_epsilon); }

GPURT_INLINE uint32_t reverse_bits(uint32_t x)
{
#if defined(__CUDA_ARCH__)
  return __brev(x);
#else
  x = ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
  x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
  x = ((x & 0x0f0f0f0fu) << 4) | ((x >> 4) & 0x0f0f0f0fu);
  return __builtin_bswap32(x);
#endif
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
