// Eight numbers at a time, for kernels that are compiled once per instruction set. Every lane has the bits of the scalar
// operation: the same IEEE operations in the same order, nothing contracted.
#pragma once

#include "core/math/vec.h"
#if defined(__AVX2__) && defined(__FMA__)
#include <immintrin.h>
#define GPURT_HAS_AVX2_LANES 1
#else
#define GPURT_HAS_AVX2_LANES 0
#endif

namespace gpurt {

constexpr uint32_t num_lanes = 8;
typedef float FloatLanes __attribute__((vector_size(32)));
typedef int32_t IntLanes __attribute__((vector_size(32)));  // or a mask: -1 where it holds
typedef uint32_t UintLanes __attribute__((vector_size(32)));

struct Vec3Lanes {
  FloatLanes x, y, z;
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE FloatLanes lanes(float x) { return FloatLanes{x, x, x, x, x, x, x, x}; }
GPURT_INLINE UintLanes lanes(uint32_t x) { return UintLanes{x, x, x, x, x, x, x, x}; }
GPURT_INLINE FloatLanes load_lanes(const float *p)
{
  FloatLanes v;
  __builtin_memcpy(&v, p, sizeof v);
  return v;
}
GPURT_INLINE UintLanes load_lanes(const uint32_t *p)
{
  UintLanes v;
  __builtin_memcpy(&v, p, sizeof v);
  return v;
}
GPURT_INLINE void store_lanes(float *p, FloatLanes v) { __builtin_memcpy(p, &v, sizeof v); }
GPURT_INLINE void store_lanes(uint32_t *p, UintLanes v) { __builtin_memcpy(p, &v, sizeof v); }
GPURT_INLINE void store_lanes(int32_t *p, IntLanes v) { __builtin_memcpy(p, &v, sizeof v); }

GPURT_INLINE FloatLanes float_lanes(IntLanes v) { return __builtin_convertvector(v, FloatLanes); }
// Cut towards 0.
GPURT_INLINE IntLanes int_lanes(FloatLanes v) { return __builtin_convertvector(v, IntLanes); }
GPURT_INLINE UintLanes bits_of(FloatLanes v) { return (UintLanes)v; }
GPURT_INLINE FloatLanes lanes_from_bits(UintLanes v) { return (FloatLanes)v; }

#if GPURT_HAS_AVX2_LANES
GPURT_INLINE FloatLanes min(FloatLanes a, FloatLanes b)
{
  return (FloatLanes)_mm256_min_ps((__m256)b, (__m256)a);
}
GPURT_INLINE FloatLanes max(FloatLanes a, FloatLanes b)
{
  return (FloatLanes)_mm256_max_ps((__m256)b, (__m256)a);
}
GPURT_INLINE FloatLanes fma(FloatLanes a, FloatLanes b, FloatLanes c)
{
  return (FloatLanes)_mm256_fmadd_ps((__m256)a, (__m256)b, (__m256)c);
}
GPURT_INLINE FloatLanes sqrt(FloatLanes v) { return (FloatLanes)_mm256_sqrt_ps((__m256)v); }
GPURT_INLINE FloatLanes floor(FloatLanes v) { return (FloatLanes)_mm256_floor_ps((__m256)v); }
// Bit k: the sign of lane k.
GPURT_INLINE uint32_t bits_of_mask(IntLanes mask) { return uint32_t(_mm256_movemask_ps((__m256)mask)); }
// Where no rounding takes place, fused or not.
GPURT_INLINE FloatLanes exact_fma(FloatLanes a, FloatLanes b, FloatLanes c) { return fma(a, b, c); }
#else
GPURT_INLINE FloatLanes min(FloatLanes a, FloatLanes b) { return b < a ? b : a; }
GPURT_INLINE FloatLanes max(FloatLanes a, FloatLanes b) { return a < b ? b : a; }
GPURT_INLINE FloatLanes fma(FloatLanes a, FloatLanes b, FloatLanes c)
{
  for (uint32_t k = 0; k < num_lanes; ++k) a[k] = fma(a[k], b[k], c[k]);
  return a;
}
GPURT_INLINE FloatLanes sqrt(FloatLanes v)
{
  for (uint32_t k = 0; k < num_lanes; ++k) v[k] = sqrt(v[k]);
  return v;
}
GPURT_INLINE FloatLanes floor(FloatLanes v)
{
  for (uint32_t k = 0; k < num_lanes; ++k) v[k] = floor(v[k]);
  return v;
}
GPURT_INLINE uint32_t bits_of_mask(IntLanes mask)
{
  uint32_t bits = 0;
  for (uint32_t k = 0; k < num_lanes; ++k) bits |= uint32_t(mask[k] & 1) << k;
  return bits;
}
GPURT_INLINE FloatLanes exact_fma(FloatLanes a, FloatLanes b, FloatLanes c) { return a * b + c; }
#endif

GPURT_INLINE FloatLanes abs(FloatLanes v) { return lanes_from_bits(bits_of(v) & 0x7fffffffu); }
GPURT_INLINE FloatLanes clamp(FloatLanes x, float lo, float hi)
{
  return x < lo ? lanes(lo) : (hi < x ? lanes(hi) : x);
}
GPURT_INLINE UintLanes reverse_bits(UintLanes x)
{
  x = ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
  x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
  x = ((x & 0x0f0f0f0fu) << 4) | ((x >> 4) & 0x0f0f0f0fu);
  x = ((x & 0x00ff00ffu) << 8) | ((x >> 8) & 0x00ff00ffu);
  return x << 16 | x >> 16;
}

GPURT_INLINE Vec3Lanes lanes(Vec3f v) { return {lanes(v.x), lanes(v.y), lanes(v.z)}; }
GPURT_INLINE Vec3Lanes operator+(Vec3Lanes a, Vec3Lanes b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
GPURT_INLINE Vec3Lanes operator-(Vec3Lanes a, Vec3Lanes b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
GPURT_INLINE Vec3Lanes operator-(Vec3Lanes a) { return {-a.x, -a.y, -a.z}; }
GPURT_INLINE Vec3Lanes operator*(Vec3Lanes a, Vec3Lanes b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
GPURT_INLINE Vec3Lanes operator*(Vec3Lanes a, FloatLanes s) { return {a.x * s, a.y * s, a.z * s}; }
GPURT_INLINE Vec3Lanes operator/(Vec3Lanes a, FloatLanes s) { return {a.x / s, a.y / s, a.z / s}; }
GPURT_INLINE Vec3Lanes abs(Vec3Lanes v) { return {abs(v.x), abs(v.y), abs(v.z)}; }
GPURT_INLINE Vec3Lanes select(IntLanes mask, Vec3Lanes a, Vec3Lanes b)
{
  return {mask ? a.x : b.x, mask ? a.y : b.y, mask ? a.z : b.z};
}
GPURT_INLINE FloatLanes max_component(Vec3Lanes v) { return max(v.x, max(v.y, v.z)); }
GPURT_INLINE FloatLanes dot(Vec3Lanes a, Vec3Lanes b) { return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z)); }
GPURT_INLINE FloatLanes difference_of_products(FloatLanes a, FloatLanes b, FloatLanes c, FloatLanes d)
{
  const FloatLanes cd = c * d;
  const FloatLanes error = fma(-c, d, cd);
  return fma(a, b, -cd) + error;
}
GPURT_INLINE Vec3Lanes cross(Vec3Lanes a, Vec3Lanes b)
{
  return {difference_of_products(a.y, b.z, a.z, b.y), difference_of_products(a.z, b.x, a.x, b.z),
          difference_of_products(a.x, b.y, a.y, b.x)};
}
GPURT_INLINE Vec3Lanes normalize(Vec3Lanes v) { return v * (1.0f / sqrt(dot(v, v))); }
GPURT_INLINE Vec3Lanes normalize_any_scale(Vec3Lanes v)
{
  const FloatLanes largest = max_component(abs(v));
  const IntLanes is_extreme = (largest < 0x1p-60f) | (largest > 0x1p60f);
  if (bits_of_mask(is_extreme) != 0) v = select(is_extreme, v / largest, v);
  return normalize(v);
}
GPURT_INLINE void make_frame(Vec3Lanes n, Vec3Lanes &s, Vec3Lanes &t)
{
  const FloatLanes sign = lanes_from_bits((bits_of(n.z) & 0x80000000u) | bits_of(lanes(1.0f)));
  const FloatLanes a = -1.0f / (sign + n.z);
  const FloatLanes b = n.x * n.y * a;
  s = {1.0f + sign * n.x * n.x * a, sign * b, -sign * n.x};
  t = {b, sign + n.y * n.y * a, -n.y};
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
