// Affine transforms and points in double precision: what a scene is placed with before it is rounded once to float.
#pragma once

#include <array>
#include <cmath>

#include "core/math/vec.h"

namespace gpurt {

/// 3 rows of 4, row by row.
using AffineDouble = std::array<double, 12>;

struct Vec3d {
  double x, y, z;
};

inline Vec3d to_double(Vec3f v) { return {v.x, v.y, v.z}; }
inline Vec3f to_float(Vec3d v) { return {float(v.x), float(v.y), float(v.z)}; }
inline Vec3d operator+(Vec3d a, Vec3d b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3d operator-(Vec3d a, Vec3d b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3d operator*(Vec3d a, double s) { return {a.x * s, a.y * s, a.z * s}; }
inline double dot(Vec3d a, Vec3d b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3d cross(Vec3d a, Vec3d b)
{
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double max_component_abs(Vec3d v)
{
  return std::fmax(std::fabs(v.x), std::fmax(std::fabs(v.y), std::fabs(v.z)));
}
inline bool is_zero(Vec3d v) { return v.x == 0 && v.y == 0 && v.z == 0; }

/// Unit vector along v, which is not zero; safe from overflow and underflow of the squares.
inline Vec3d normalize(Vec3d v)
{
  v = v * (1 / max_component_abs(v));
  return v * (1 / std::sqrt(dot(v, v)));
}
inline double length(Vec3d v)
{
  const double scale = max_component_abs(v);
  if (scale == 0) return 0;
  v = v * (1 / scale);
  return scale * std::sqrt(dot(v, v));
}

constexpr AffineDouble identity_affine{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

AffineDouble to_double(const Transform &t);
Transform to_float(const AffineDouble &t);
bool is_finite(const AffineDouble &t);

/// The map that applies b, then a.
AffineDouble multiply(const AffineDouble &a, const AffineDouble &b);
Vec3d transform_point(const AffineDouble &t, Vec3d p);
Vec3d transform_vector(const AffineDouble &t, Vec3d v);

/// Determinant of the linear part; exactly 0 where it is within rounding of 0, so that its sign can be trusted.
double determinant(const AffineDouble &t);

/// The inverse of a map whose determinant is not 0.
AffineDouble inverse(const AffineDouble &t);

/// Where normals go: the inverse transpose. Hand in the inverse.
Vec3d transform_normal(const AffineDouble &inverse, Vec3d n);

/// The factor by which the linear part makes vectors longer at most: its largest singular value, rounded up.
double largest_stretch(const AffineDouble &t);

/// A float box around the image of a box, rounding included.
Box transform_box(const AffineDouble &t, const Box &box);

}  // namespace gpurt
