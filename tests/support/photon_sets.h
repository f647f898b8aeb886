// Sets of points that gather structures meet: even, on surfaces, clustered, and degenerate.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

namespace photon_sets {

using Point = std::array<float, 3>;

struct Set {
  std::string name;
  std::vector<Point> points;
  float radius;  // that some points have within
};

inline Point on_sphere(std::mt19937 &random, const Point &center, float radius)
{
  std::normal_distribution<float> normal;
  const float x = normal(random), y = normal(random), z = normal(random);
  const float s = radius / std::sqrt(x * x + y * y + z * z);
  return {center[0] + s * x, center[1] + s * y, center[2] + s * z};
}

inline std::vector<Point> uniform(size_t n, unsigned seed)
{
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> unit(0, 1);
  std::vector<Point> points(n);
  for (Point &p : points) p = {unit(random), unit(random), unit(random)};
  return points;
}

inline std::vector<Point> surface(size_t n, unsigned seed)
{
  std::mt19937 random(seed), shapes(7);
  std::uniform_real_distribution<float> unit(0, 1);
  std::vector<std::pair<Point, float>> spheres(16);
  for (auto &[center, radius] : spheres)
    center = {unit(shapes), unit(shapes), unit(shapes)}, radius = 0.05f + 0.15f * unit(shapes);
  std::vector<Point> points(n);
  for (Point &p : points) {
    const auto &[center, radius] = spheres[random() % spheres.size()];
    p = on_sphere(random, center, radius);
  }
  return points;
}

/// Half of the points in a cluster of a thousandth of the size.
inline std::vector<Point> clustered(size_t n, unsigned seed)
{
  std::vector<Point> points = surface(n, seed);
  std::mt19937 random(seed + 1);
  std::normal_distribution<float> normal(0, 1e-3f);
  for (size_t i = 0; i < n; i += 2)
    points[i] = {0.3f + normal(random), 0.4f + normal(random), 0.5f + normal(random)};
  return points;
}

/// All sets, of about n points each.
inline std::vector<Set> all(size_t n, unsigned seed = 1)
{
  const float r3 = 0.8f / std::cbrt(float(n));
  std::vector<Set> sets = {
      {"uniform", uniform(n, seed), 1.3f * r3},
      {"surface", surface(n, seed), 1.0f / std::sqrt(float(n))},
      {"clustered", clustered(n, seed), 0.3f / std::sqrt(float(n))},
      {"clustered, radius of the background", clustered(n, seed), 2.0f / std::sqrt(float(n))}};
  std::vector<Point> points = uniform(n, seed);
  sets.push_back({"radius larger than the set", points, 3.0f});
  sets.push_back({"radius that meets nothing", points, 1e-9f});
  for (Point &p : points) p = {std::floor(p[0] * 4) / 4, std::floor(p[1] * 4) / 4, std::floor(p[2] * 4) / 4};
  sets.push_back({"many duplicates", points, 0.26f});
  sets.push_back({"distances equal to the radius", points, 0.25f});
  sets.push_back({"all in one point", std::vector<Point>(n, Point{0.25f, -3.0f, 1e6f}), 0.1f});
  points = uniform(n, seed);
  for (Point &p : points) p[0] += 1e6f, p[1] -= 1e6f, p[2] += 1e6f;
  sets.push_back({"far from the origin", points, 0.2f});
  points = uniform(n, seed);
  for (Point &p : points) p[0] *= 1e5f, p[1] *= 1e-3f;
  sets.push_back({"needle along x", points, 100.0f});
  for (Point &p : points) std::swap(p[0], p[2]);
  sets.push_back({"needle along z", points, 100.0f});
  points = uniform(n, seed);
  for (Point &p : points) p[1] = 2.0f;
  sets.push_back({"flat", points, 1.5f / std::sqrt(float(n))});
  points = uniform(n, seed);
  for (size_t i = 0; i < n; ++i) {
    for (float &x : points[i]) x = (x - 0.5f) * std::ldexp(1.0f, int(i % 60) - 40);
  }
  sets.push_back({"many scales", points, 1e-3f});
  sets.push_back({"one", {{1, 2, 3}}, 0.5f});
  sets.push_back({"two far apart", {{-1e15f, 0, 0}, {1e15f, 0, 0}}, 1e-6f});
  return sets;
}

/// Places to ask from: points of the set, near it, and away from it.
inline std::vector<Point> queries(const Set &set, size_t n, unsigned seed)
{
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> unit(-1, 1);
  std::vector<Point> queries(n);
  for (size_t i = 0; i < n; ++i) {
    Point &q = queries[i];
    q = set.points[random() % set.points.size()];
    const float away = i % 4 == 0 ? 0.0f : (i % 4 == 3 ? 30.0f : 1.0f);
    for (float &x : q) x += away * set.radius * unit(random);
  }
  return queries;
}

}  // namespace photon_sets
