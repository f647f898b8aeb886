// Triangle meshes made by code.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <vector>

namespace cli::scenes {

constexpr double pi = 3.14159265358979323846;

struct Vec3 {
  double x = 0, y = 0, z = 0;
};
inline Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3 operator*(Vec3 a, double s) { return {a.x * s, a.y * s, a.z * s}; }
inline Vec3 operator*(double s, Vec3 a) { return a * s; }
inline double dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3 cross(Vec3 a, Vec3 b)
{
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double length(Vec3 v) { return std::sqrt(dot(v, v)); }
inline Vec3 normalize(Vec3 v) { return v * (1 / length(v)); }
/// 0 up to a, 1 from b on, smooth between.
inline double smooth_step(double a, double b, double x)
{
  const double t = std::fmin(std::fmax((x - a) / (b - a), 0), 1);
  return t * t * (3 - 2 * t);
}
inline Vec3 mix(Vec3 a, Vec3 b, double t) { return a * (1 - t) + b * t; }

/// 3 rows of 4.
struct Matrix {
  double m[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};
};
Vec3 transform_point(const Matrix &m, Vec3 p);
Vec3 transform_vector(const Matrix &m, Vec3 v);
Matrix translation(Vec3 t);
Matrix scaling(Vec3 s);
Matrix rotation(Vec3 axis, double angle_rad);
Matrix operator*(const Matrix &a, const Matrix &b);
/// Looks from `eye` to `target` along -Z with +Y up: for cameras, and for lights that shine along -Z.
Matrix look_at(Vec3 eye, Vec3 target, Vec3 up = {0, 1, 0});

struct Mesh {
  std::vector<Vec3> positions;
  std::vector<Vec3> normals;                       // empty: flat
  std::vector<std::array<double, 2>> uvs;          // empty: none
  std::vector<std::array<uint32_t, 3>> triangles;  // counter-clockwise seen from the front

  void add_quad(Vec3 a, Vec3 b, Vec3 c, Vec3 d);  // counter-clockwise, uv from (0, 1) at a to (1, 0) at c
  void append(const Mesh &other, const Matrix &matrix = {});
};

Mesh quad(Vec3 a, Vec3 b, Vec3 c, Vec3 d);
/// A closed box; its corners are numbered by bits x, y, z of lo (0) and hi (1).
Mesh box(Vec3 lo, Vec3 hi);
/// The unit sphere: an icosahedron whose triangles are split into four `subdivisions` times.
Mesh icosphere(int subdivisions, bool smooth);
/// A profile (radius, height) turned around the Y axis, from bottom to top on the outside. Closed where the profile
/// starts and ends on the axis; smooth, except where the profile turns by more than 40 degrees.
Mesh lathe(const std::vector<std::array<double, 2>> &profile, int segments);
/// A tube along a path, open at both ends, with `sides` sides; u runs around, v along, one unit a metre.
Mesh tube(const std::vector<Vec3> &path, const std::vector<double> &radii, int sides);
/// height(x, z) over a rectangle of n x n cells, smooth, with uvs in [0, 1].
Mesh height_field(double x0, double z0, double x1, double z1, int n,
                  const std::function<double(double, double)> &height);

/// The triangles whose first corner `is_in` says yes to, with the vertices that they need.
Mesh part_of(const Mesh &mesh, const std::function<bool(Vec3)> &is_in);

/// Smooth noise with values in [-1, 1] and cells of size 1, and a sum of octaves of it, each half as large and high.
double noise(Vec3 p, uint32_t seed = 0);
double fractal_noise(Vec3 p, int octaves, uint32_t seed = 0);

/// A fixed sequence of numbers in [0, 1).
class Sequence {
 public:
  explicit Sequence(uint64_t seed) : state_(seed) {}
  double next();
  double range(double lo, double hi) { return lo + (hi - lo) * next(); }

 private:
  uint64_t state_;
};

}  // namespace cli::scenes
