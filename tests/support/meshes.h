// Meshes of different kinds for tests of robustness: thin, needle-rich, on a grid, far from the origin, a city.
#pragma once

#include <algorithm>
#include <functional>

#include "gpurt_test.h"

namespace gpurt_test {

using Point = std::array<float, 3>;

/// A number in [0, 1), the same with every standard library.
inline double uniform(std::mt19937_64 &rng) { return double(rng() >> 11) * 0x1p-53; }
inline double uniform(std::mt19937_64 &rng, double low, double high)
{
  return low + (high - low) * uniform(rng);
}
inline size_t pick(std::mt19937_64 &rng, size_t count) { return size_t(rng() % count); }

/// Gives equal positions one index, and drops triangles that name a position twice.
inline Mesh weld(const Mesh &mesh)
{
  Mesh out;
  std::map<Point, uint32_t> index;
  std::vector<uint32_t> renamed;
  for (Point v : mesh.vertices) {
    for (float &c : v) c += 0.0f;  // -0 is 0
    const auto [it, is_new] = index.try_emplace(v, uint32_t(out.vertices.size()));
    if (is_new) out.vertices.push_back(v);
    renamed.push_back(it->second);
  }
  for (const auto &t : mesh.triangles) {
    const std::array<uint32_t, 3> r = {renamed[t[0]], renamed[t[1]], renamed[t[2]]};
    if (r[0] != r[1] && r[1] != r[2] && r[2] != r[0]) out.triangles.push_back(r);
  }
  return out;
}

/// A rotation that leaves no coordinate plane where it was, then a scale and a shift; rounded once.
inline Mesh moved(Mesh mesh, double scale = 1, std::array<double, 3> shift = {0, 0, 0}, bool rotate = true)
{
  // A rotation by 1 radian about (1, 2, 3).
  const double n = std::sqrt(14.0), a[3] = {1 / n, 2 / n, 3 / n}, c = std::cos(1.0), s = std::sin(1.0);
  mesh.map([&](Point v) {
    const double x[3] = {v[0], v[1], v[2]};
    const double along = a[0] * x[0] + a[1] * x[1] + a[2] * x[2];
    const double cross[3] = {a[1] * x[2] - a[2] * x[1], a[2] * x[0] - a[0] * x[2], a[0] * x[1] - a[1] * x[0]};
    Point out;
    for (int k = 0; k < 3; ++k) {
      const double y = rotate ? c * x[k] + s * cross[k] + (1 - c) * along * a[k] : x[k];
      out[k] = float(scale * y + shift[k]);
    }
    return out;
  });
  return mesh;
}

/// A closed box of n x n cells on top and bottom and one cell of height.
inline Mesh slab(int n, float thickness)
{
  Mesh m;
  std::map<std::array<int, 3>, uint32_t> index;
  const auto at = [&](int i, int j, int k) {
    const auto [it, is_new] = index.try_emplace({i, j, k}, uint32_t(m.vertices.size()));
    if (is_new) m.vertices.push_back({2.0f * i / n - 1, 2.0f * j / n - 1, k == 0 ? 0.0f : thickness});
    return it->second;
  };
  const auto face = [&](uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
    m.triangles.push_back({a, b, c});
    m.triangles.push_back({a, c, d});
  };
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      face(at(i, j, 1), at(i + 1, j, 1), at(i + 1, j + 1, 1), at(i, j + 1, 1));
      face(at(i, j, 0), at(i, j + 1, 0), at(i + 1, j + 1, 0), at(i + 1, j, 0));
    }
    face(at(i, 0, 0), at(i + 1, 0, 0), at(i + 1, 0, 1), at(i, 0, 1));
    face(at(i + 1, n, 0), at(i, n, 0), at(i, n, 1), at(i + 1, n, 1));
    face(at(0, i + 1, 0), at(0, i, 0), at(0, i, 1), at(0, i + 1, 1));
    face(at(n, i, 0), at(n, i + 1, 0), at(n, i + 1, 1), at(n, i, 1));
  }
  return m;
}

/// A closed spindle about the z axis: every triangle is a needle, and two vertices have `meridians` of them.
inline Mesh spindle(int meridians, const std::vector<std::array<double, 2>> &rings, double low, double high)
{
  Mesh m;
  m.vertices.push_back({0, 0, float(low)});
  for (const auto &[radius, z] : rings) {
    for (int i = 0; i < meridians; ++i) {
      const double phi = 6.283185307179586 * i / meridians;
      m.vertices.push_back({float(radius * std::cos(phi)), float(radius * std::sin(phi)), float(z)});
    }
  }
  m.vertices.push_back({0, 0, float(high)});
  const auto at = [&](int ring, int i) { return uint32_t(1 + ring * meridians + i % meridians); };
  const uint32_t top = uint32_t(m.vertices.size() - 1);
  const int last = int(rings.size()) - 1;
  for (int i = 0; i < meridians; ++i) {
    m.triangles.push_back({0, at(0, i + 1), at(0, i)});
    for (int r = 0; r < last; ++r) {
      m.triangles.push_back({at(r, i), at(r, i + 1), at(r + 1, i + 1)});
      m.triangles.push_back({at(r, i), at(r + 1, i + 1), at(r + 1, i)});
    }
    m.triangles.push_back({top, at(last, i), at(last, i + 1)});
  }
  return m;
}

inline Mesh torus(int around, int across, double large, double small)
{
  Mesh m;
  for (int i = 0; i < around; ++i) {
    for (int j = 0; j < across; ++j) {
      const double u = 6.283185307179586 * i / around, v = 6.283185307179586 * j / across;
      const double r = large + small * std::cos(v);
      m.vertices.push_back({float(r * std::cos(u)), float(r * std::sin(u)), float(small * std::sin(v))});
    }
  }
  const auto at = [&](int i, int j) { return uint32_t(i % around * across + j % across); };
  for (int i = 0; i < around; ++i) {
    for (int j = 0; j < across; ++j) {
      m.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      m.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  }
  return m;
}

/// The surface of the unit cubes (i, j, k) .. (i + 1, j + 1, k + 1), 0 <= i, j, k < n, that `is_solid`.
inline Mesh voxel_surface(int n, const std::function<bool(int, int, int)> &is_solid)
{
  Mesh m;
  std::map<std::array<int, 3>, uint32_t> index;
  const auto solid = [&](const std::array<int, 3> &c) {
    for (int x : c) {
      if (x < 0 || x >= n) return false;
    }
    return is_solid(c[0], c[1], c[2]);
  };
  const auto vertex = [&](const std::array<int, 3> &p) {
    const auto [it, is_new] = index.try_emplace(p, uint32_t(m.vertices.size()));
    if (is_new) m.vertices.push_back({float(p[0]), float(p[1]), float(p[2])});
    return it->second;
  };
  for (int i = 0; i < n * n * n; ++i) {
    const std::array<int, 3> cell = {i % n, i / n % n, i / n / n};
    if (!solid(cell)) continue;
    for (int axis = 0; axis < 3; ++axis) {
      for (int side = 0; side < 2; ++side) {
        std::array<int, 3> beside = cell;
        beside[axis] += side == 0 ? -1 : 1;
        if (solid(beside)) continue;
        const int u = (axis + 1) % 3, v = (axis + 2) % 3;
        std::array<int, 3> corner = cell;
        corner[axis] += side;
        uint32_t ring[4];
        for (int k = 0; k < 4; ++k) {
          std::array<int, 3> p = corner;
          p[u] += k == 1 || k == 2;
          p[v] += k >= 2;
          ring[k] = vertex(p);
        }
        if (side == 0) std::swap(ring[1], ring[3]);
        m.triangles.push_back({ring[0], ring[1], ring[2]});
        m.triangles.push_back({ring[0], ring[2], ring[3]});
      }
    }
  }
  return m;
}

/// A ball of cubes with tunnels: all its faces lie on integer planes.
inline Mesh voxel_ball(int n)
{
  return voxel_surface(n, [n](int i, int j, int k) {
    const int x = 2 * i + 1 - n, y = 2 * j + 1 - n, z = 2 * k + 1 - n;
    const bool tunnel = (i % 5 == 2 && j % 4 == 1) || (k % 6 == 3 && i % 7 == 3);
    return x * x + y * y + z * z <= n * n && !tunnel;
  });
}

/// Buildings with walls that touch or intersect, roads a hand's breadth above one large ground, in metres, Y up.
inline Mesh city(int blocks)
{
  std::mt19937_64 rng(7);
  Mesh m;
  const auto prism = [&](double x, double z, double w, double d, double h, double ridge, double angle) {
    const double c = std::cos(angle), s = std::sin(angle);
    const auto at = [&](double u, double y, double v) {
      return Point{float(x + c * u + s * v), float(y), float(z - s * u + c * v)};
    };
    // Footprint counter-clockwise seen from above; eaves at h, the ridge along u.
    Mesh p{{at(-w, 0, -d), at(-w, 0, d), at(w, 0, d), at(w, 0, -d), at(-w, h, -d), at(-w, h, d), at(w, h, d),
            at(w, h, -d), at(-w, h + ridge, 0), at(w, h + ridge, 0)},
           {{0, 3, 2},
            {0, 2, 1},
            {0, 1, 5},
            {0, 5, 4},
            {2, 3, 7},
            {2, 7, 6},
            {1, 2, 6},
            {1, 6, 5},
            {3, 0, 4},
            {3, 4, 7},
            {4, 5, 8},
            {6, 7, 9},
            {5, 6, 9},
            {5, 9, 8},
            {7, 4, 8},
            {7, 8, 9}}};
    m.append(p);
  };
  const double pitch = 80;
  for (int i = 0; i < blocks; ++i) {
    for (int j = 0; j < blocks; ++j) {
      const double x = (i - blocks / 2) * pitch, z = (j - blocks / 2) * pitch;
      const double turn = (i + j) % 3 == 0 ? 0 : uniform(rng, 0, 1.5);
      for (int k = 0; k < 4; ++k) {
        // Neighbours in a row share a wall, and some run into each other.
        prism(x + 15 * (k - 1.5) * std::cos(turn), z - 15 * (k - 1.5) * std::sin(turn),
              7.5 + (k == 2 ? 1 : 0), 10, uniform(rng, 5, 60), k % 2 == 0 ? 4 : 1e-3, turn);
      }
    }
    const float at = float((i - blocks / 2 + 0.5) * pitch), half = 2000;
    m.append(quad({at - 5, 0.1f, -half}, {at - 5, 0.1f, half}, {at + 5, 0.1f, half}, {at + 5, 0.1f, -half}));
    m.append(quad({-half, 0.1f, at - 5}, {-half, 0.1f, at + 5}, {half, 0.1f, at + 5}, {half, 0.1f, at - 5}));
  }
  m.append(quad({-2000, 0, -2000}, {-2000, 0, 2000}, {2000, 0, 2000}, {2000, 0, -2000}));
  return m;
}

struct NamedMesh {
  std::string name;
  Mesh mesh;
  bool is_closed;  // every edge is shared by triangles of opposite direction in equal numbers
};

/// The kinds that exact tests run on.
inline NamedMesh mesh_of_kind(const std::string &kind)
{
  if (kind == "convex") return {kind, icosphere(4), true};
  if (kind == "thin") return {kind, moved(slab(40, 1e-5f)), true};
  if (kind == "needles") {
    return {kind, moved(spindle(600, {{0.02, -9}, {0.03, 0}, {0.01, 9}}, -30, 30)), true};
  }
  if (kind == "grid") return {kind, voxel_ball(16), true};
  if (kind == "offset") return {kind, weld(moved(torus(96, 32, 100, 30), 1, {1e6, 1e6, -1e6})), true};
  if (kind == "city") return {kind, city(10), false};
  ADD_FAILURE() << "no mesh of kind " << kind;
  return {};
}
inline const std::vector<std::string> mesh_kinds = {"convex", "thin", "needles", "grid", "offset", "city"};

}  // namespace gpurt_test
