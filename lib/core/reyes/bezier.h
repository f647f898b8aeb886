// Points of bicubic Bezier patches with the same bits from both sides of a shared boundary.
//
// Parameters are whole numbers k of parameter_one: k and its complement are exact floats, so a curve that is run
// backwards has the same weights in the opposite order; products are added in pairs from both ends, so it also has the
// same sums. At the ends of the range the other control points vanish: a boundary depends on its own four points alone.
#pragma once

#include "core/reyes/transform.h"

namespace gpurt {

constexpr int parameter_bits = 22;
constexpr uint32_t parameter_one = 1u << parameter_bits;

struct CubicWeights {
  float w0, w1, w2, w3;
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE float parameter(uint32_t k) { return float(k) * (1.0f / float(parameter_one)); }

GPURT_INLINE CubicWeights cubic_weights(uint32_t k)
{
  const float a = parameter(parameter_one - k), b = parameter(k);
  return {a * a * a, 3.0f * (a * a * b), 3.0f * (b * b * a), b * b * b};
}

GPURT_INLINE float cubic(const CubicWeights &c, float p0, float p1, float p2, float p3)
{
  return (c.w0 * p0 + c.w3 * p3) + (c.w1 * p1 + c.w2 * p2);
}

// The control points along v of the curve at u, of one coordinate.
GPURT_INLINE void column_at(const float (&p)[16], const CubicWeights &u, float (&column)[4])
{
  for (int r = 0; r < 4; ++r) column[r] = cubic(u, p[4 * r], p[4 * r + 1], p[4 * r + 2], p[4 * r + 3]);
}

// Every vertex of every grid is this function of its patch and parameters.
GPURT_HD inline RasterPoint patch_point(const RasterPatch &patch, uint32_t ku, uint32_t kv)
{
  const CubicWeights u = cubic_weights(ku), v = cubic_weights(kv);
  float x[4], y[4], w[4];
  column_at(patch.x, u, x);
  column_at(patch.y, u, y);
  column_at(patch.w, u, w);
  return {cubic(v, x[0], x[1], x[2], x[3]), cubic(v, y[0], y[1], y[2], y[3]),
          cubic(v, w[0], w[1], w[2], w[3])};
}

// Control points of the part [t0, t1] of a cubic, by its blossom. Source: Ramshaw 1989.
GPURT_INLINE void sub_cubic(float p0, float p1, float p2, float p3, float t0, float t1, float &q0, float &q1,
                            float &q2, float &q3)
{
  const float s0 = 1.0f - t0, s1 = 1.0f - t1;
  const float a0 = s0 * p0 + t0 * p1, a1 = s0 * p1 + t0 * p2, a2 = s0 * p2 + t0 * p3;
  const float b0 = s1 * p0 + t1 * p1, b1 = s1 * p1 + t1 * p2, b2 = s1 * p2 + t1 * p3;
  const float aa0 = s0 * a0 + t0 * a1, aa1 = s0 * a1 + t0 * a2;
  const float ab0 = s1 * a0 + t1 * a1, ab1 = s1 * a1 + t1 * a2;
  const float bb0 = s1 * b0 + t1 * b1, bb1 = s1 * b1 + t1 * b2;
  q0 = s0 * aa0 + t0 * aa1;
  q1 = s1 * aa0 + t1 * aa1;
  q2 = s1 * ab0 + t1 * ab1;
  q3 = s1 * bb0 + t1 * bb1;
}

// One coordinate of the part [u0, u1] x [v0, v1].
GPURT_HD inline void sub_patch(const float (&p)[16], float u0, float u1, float v0, float v1, float (&q)[16])
{
  float m[16];
  for (int r = 0; r < 4; ++r) {
    sub_cubic(p[4 * r], p[4 * r + 1], p[4 * r + 2], p[4 * r + 3], u0, u1, m[4 * r], m[4 * r + 1],
              m[4 * r + 2], m[4 * r + 3]);
  }
  for (int c = 0; c < 4; ++c) {
    sub_cubic(m[c], m[4 + c], m[8 + c], m[12 + c], v0, v1, q[c], q[4 + c], q[8 + c], q[12 + c]);
  }
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
