// A ray made ready for traversal: checked, without negative zeros, its direction in a range where no product of the
// triangle tests loses bits.
#pragma once

#include "core/accel/ray.h"

namespace gpurt {

struct TraceRay {
  Vec3f origin;
  float tmin;
  Vec3f direction;  // the ray's times 2^-exponent
  float tmax;
  int exponent;   // the caller's t is this ray's t times 2^-exponent; nearly always 0
  int main_axis;  // of the direction's largest component
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE float power_of_two(int exponent) { return float_from_bits(uint32_t(127 + exponent) << 23); }

// x * 2^exponent for |exponent| <= 252: exact unless the result leaves the range of normal numbers.
GPURT_INLINE float scale_by_power(float x, int exponent)
{
  const int half = exponent / 2;
  return x * power_of_two(half) * power_of_two(exponent - half);
}

// The caller's t of a hit at this ray's t.
GPURT_INLINE float caller_t(const TraceRay &ray, float t)
{
  return ray.exponent == 0 ? t : scale_by_power(t, -ray.exponent);
}

// Of the largest component.
GPURT_INLINE int main_axis_of(Vec3f direction)
{
  const Vec3f m = abs(direction);
  return m.x < m.y ? (m.y < m.z ? 2 : 1) : (m.x < m.z ? 2 : 0);
}

// False for a ray that misses everything: a direction that is zero or not finite, an origin that is not finite, an
// empty or unordered interval.
//
// Directions whose largest component lies beyond 2^+-40 are scaled by a power of two, which moves t by the same power
// and no bit of its mantissa: a direction of 1e-40 meets what its normalised twin meets. Adding +0 turns -0 into +0, so
// that the sign of a zero decides nothing.
GPURT_INLINE bool prepare_ray(Vec3f origin, Vec3f direction, float tmin, float tmax, TraceRay &ray)
{
  const Vec3f magnitude = abs(direction);
  const float largest = max_component(magnitude);
  // Sums of magnitudes are finite or not as their terms are, but for overflow: test the terms.
  if (!(is_finite(origin) && is_finite(direction) && largest > 0.0f && tmin <= tmax)) return false;
  ray.origin = {origin.x + 0.0f, origin.y + 0.0f, origin.z + 0.0f};
  ray.main_axis = main_axis_of(direction);
  ray.exponent = 0;
  ray.tmin = tmin;
  ray.tmax = tmax;
  if (!(largest >= 0x1p-40f && largest <= 0x1p40f)) {
    // Brings the largest component into [1, 2); denormals are made normal first.
    const int shift = largest < 0x1p-100f ? 64 : 0;
    const int exponent = int(float_bits(scale_by_power(largest, shift)) >> 23) - 127 - shift;
    ray.exponent = exponent;
    direction = {scale_by_power(direction.x, -exponent), scale_by_power(direction.y, -exponent),
                 scale_by_power(direction.z, -exponent)};
    ray.tmin = scale_by_power(tmin, exponent);
    ray.tmax = scale_by_power(tmax, exponent);
  }
  ray.direction = {direction.x + 0.0f, direction.y + 0.0f, direction.z + 0.0f};
  return true;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
