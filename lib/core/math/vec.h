// Small vectors, 3x4 transforms and boxes.
#pragma once

#include "core/math/scalar.h"

namespace gpurt {

struct Vec2f {
  float x, y;
};
struct Vec3f {
  float x, y, z;
};
struct UInt3 {
  uint32_t x, y, z;
};

// Affine map, 3 rows of 4: p' = (row . (p, 1)).
struct Transform {
  float m[3][4];
};

struct Box {
  Vec3f lo, hi;  // empty: lo > hi
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE Vec3f vec3(float x) { return {x, x, x}; }
GPURT_INLINE Vec3f operator+(Vec3f a, Vec3f b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
GPURT_INLINE Vec3f operator-(Vec3f a, Vec3f b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
GPURT_INLINE Vec3f operator*(Vec3f a, Vec3f b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
GPURT_INLINE Vec3f operator*(Vec3f a, float s) { return {a.x * s, a.y * s, a.z * s}; }
GPURT_INLINE Vec3f operator*(float s, Vec3f a) { return a * s; }
GPURT_INLINE Vec3f operator/(Vec3f a, float s) { return {a.x / s, a.y / s, a.z / s}; }
GPURT_INLINE Vec3f operator-(Vec3f a) { return {-a.x, -a.y, -a.z}; }
GPURT_INLINE Vec3f &operator+=(Vec3f &a, Vec3f b) { return a = a + b; }
GPURT_INLINE Vec3f &operator*=(Vec3f &a, Vec3f b) { return a = a * b; }
GPURT_INLINE Vec3f &operator*=(Vec3f &a, float s) { return a = a * s; }
GPURT_INLINE Vec2f operator+(Vec2f a, Vec2f b) { return {a.x + b.x, a.y + b.y}; }
GPURT_INLINE Vec2f operator*(Vec2f a, float s) { return {a.x * s, a.y * s}; }

// Component by a run-time axis, without indexing past a member.
GPURT_INLINE float at(Vec3f v, int axis) { return axis == 0 ? v.x : (axis == 1 ? v.y : v.z); }
GPURT_INLINE void set(Vec3f &v, int axis, float value)
{
  if (axis == 0) v.x = value;
  else if (axis == 1) v.y = value;
  else v.z = value;
}

GPURT_INLINE float dot(Vec3f a, Vec3f b) { return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z)); }
// a*b - c*d without cancellation. Source: Jeannerod et al. 2013 (Kahan's algorithm).
GPURT_INLINE float difference_of_products(float a, float b, float c, float d)
{
  const float cd = c * d;
  const float error = fma(-c, d, cd);
  return fma(a, b, -cd) + error;
}
GPURT_INLINE Vec3f cross(Vec3f a, Vec3f b)
{
  return {difference_of_products(a.y, b.z, a.z, b.y), difference_of_products(a.z, b.x, a.x, b.z),
          difference_of_products(a.x, b.y, a.y, b.x)};
}
GPURT_INLINE float length2(Vec3f v) { return dot(v, v); }
GPURT_INLINE float length(Vec3f v) { return sqrt(length2(v)); }
// By the reciprocal: one division; the length is 1 within 2 ulp.
GPURT_INLINE Vec3f normalize(Vec3f v) { return v * (1.0f / length(v)); }
GPURT_INLINE Vec3f abs(Vec3f v) { return {abs(v.x), abs(v.y), abs(v.z)}; }
GPURT_INLINE Vec3f min(Vec3f a, Vec3f b) { return {min(a.x, b.x), min(a.y, b.y), min(a.z, b.z)}; }
GPURT_INLINE Vec3f max(Vec3f a, Vec3f b) { return {max(a.x, b.x), max(a.y, b.y), max(a.z, b.z)}; }
GPURT_INLINE float max_component(Vec3f v) { return max(v.x, max(v.y, v.z)); }
// For vectors whose square leaves the float range, as products of tiny or huge edges can.
GPURT_INLINE Vec3f normalize_any_scale(Vec3f v)
{
  const float largest = max_component(abs(v));
  if (largest < 0x1p-60f || largest > 0x1p60f) v = v / largest;
  return normalize(v);
}
GPURT_INLINE float min_component(Vec3f v) { return min(v.x, min(v.y, v.z)); }
GPURT_INLINE bool is_finite(Vec3f v) { return is_finite(v.x) && is_finite(v.y) && is_finite(v.z); }
GPURT_INLINE float luminance(Vec3f c) { return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z; }

GPURT_INLINE Vec3f transform_point(const Transform &t, Vec3f p)
{
  return {fma(t.m[0][0], p.x, fma(t.m[0][1], p.y, fma(t.m[0][2], p.z, t.m[0][3]))),
          fma(t.m[1][0], p.x, fma(t.m[1][1], p.y, fma(t.m[1][2], p.z, t.m[1][3]))),
          fma(t.m[2][0], p.x, fma(t.m[2][1], p.y, fma(t.m[2][2], p.z, t.m[2][3])))};
}
GPURT_INLINE Vec3f transform_vector(const Transform &t, Vec3f v)
{
  return {fma(t.m[0][0], v.x, fma(t.m[0][1], v.y, t.m[0][2] * v.z)),
          fma(t.m[1][0], v.x, fma(t.m[1][1], v.y, t.m[1][2] * v.z)),
          fma(t.m[2][0], v.x, fma(t.m[2][1], v.y, t.m[2][2] * v.z))};
}
// Normals transform with the inverse transpose: hand in the inverse.
GPURT_INLINE Vec3f transform_normal(const Transform &inverse, Vec3f n)
{
  return {fma(inverse.m[0][0], n.x, fma(inverse.m[1][0], n.y, inverse.m[2][0] * n.z)),
          fma(inverse.m[0][1], n.x, fma(inverse.m[1][1], n.y, inverse.m[2][1] * n.z)),
          fma(inverse.m[0][2], n.x, fma(inverse.m[1][2], n.y, inverse.m[2][2] * n.z))};
}

GPURT_INLINE Box empty_box() { return {{infinity, infinity, infinity}, {-infinity, -infinity, -infinity}}; }
GPURT_INLINE Box extend(Box b, Vec3f p) { return {min(b.lo, p), max(b.hi, p)}; }
GPURT_INLINE Box extend(Box a, Box b) { return {min(a.lo, b.lo), max(a.hi, b.hi)}; }
GPURT_INLINE bool is_empty(const Box &b)
{
  return !(b.lo.x <= b.hi.x && b.lo.y <= b.hi.y && b.lo.z <= b.hi.z);
}

// Two unit vectors that complete a unit vector to a right-handed frame.
// Source: Duff et al. 2017.
GPURT_INLINE void make_frame(Vec3f n, Vec3f &s, Vec3f &t)
{
  const float sign = copysign(1.0f, n.z);
  const float a = -1.0f / (sign + n.z);
  const float b = n.x * n.y * a;
  s = {1.0f + sign * n.x * n.x * a, sign * b, -sign * n.x};
  t = {b, sign + n.y * n.y * a, -n.y};
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
