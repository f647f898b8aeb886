// Bicubic patches that share boundary points exactly, for tests of REYES.
#pragma once

#include <cmath>
#include <random>

#include "gpurt_test.h"
#include "meshes.h"

namespace gpurt_test {

using Point = std::array<float, 3>;
using PatchNet = std::array<Point, 16>;  // point 4 * row + column
using Point3 = std::array<double, 3>;

// A point of a patch and its derivatives, by the definition.
struct SurfacePoint {
  Point3 p{}, du{}, dv{};
};
inline SurfacePoint evaluate(const PatchNet &net, double u, double v)
{
  const auto weights = [](double t, double(&b)[4], double(&d)[4]) {
    const double s = 1 - t;
    b[0] = s * s * s, b[1] = 3 * t * s * s, b[2] = 3 * t * t * s, b[3] = t * t * t;
    d[0] = -3 * s * s, d[1] = 3 * s * s - 6 * t * s, d[2] = 6 * t * s - 3 * t * t, d[3] = 3 * t * t;
  };
  double bu[4], bv[4], su[4], sv[4];
  weights(u, bu, su);
  weights(v, bv, sv);
  SurfacePoint s;
  for (size_t k = 0; k < 16; ++k) {
    for (size_t c = 0; c < 3; ++c) {
      s.p[c] += bv[k / 4] * bu[k % 4] * double(net[k][c]);
      s.du[c] += bv[k / 4] * su[k % 4] * double(net[k][c]);
      s.dv[c] += sv[k / 4] * bu[k % 4] * double(net[k][c]);
    }
  }
  return s;
}

inline uint32_t add_patches(gpurt_scene scene, const std::vector<PatchNet> &nets, uint32_t material = 0,
                            const std::vector<std::array<float, 12>> &places = {
                                {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}})
{
  gpurt_patches_desc desc = GPURT_PATCHES_DESC_INIT;
  desc.material = material;
  desc.control_points.data = nets.data();
  desc.control_points.count = nets.size() * 16;
  uint32_t geometry = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_patches(scene, &desc, &geometry));
  for (const auto &place : places) {
    gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
    instance.geometry = geometry;
    for (int i = 0; i < 12; ++i) instance.transform[i] = place[size_t(i)];
    uint32_t id;
    GPURT_EXPECT_OK(gpurt_scene_add_instance(scene, &instance, &id));
  }
  return geometry;
}

/// A closed surface about the origin of n x n patches on each face of a cube, dented at random by up to `dent`. A control
/// point is a function of its place on the cube alone, so that neighbours share theirs, and runs of neighbours are turned at
/// random: shared boundaries are met from either end and along either parameter.
inline std::vector<PatchNet> closed_patches(int n, double dent, uint64_t seed)
{
  std::mt19937_64 turns(seed);
  const int steps = 3 * n;
  const auto point = [&](int axis, int side, int i, int j) {
    int place[3];
    place[axis] = side ? steps : 0;
    place[(axis + 1) % 3] = i;
    place[(axis + 2) % 3] = j;
    std::mt19937_64 rng(seed * 1000003 + uint64_t(place[0] + 64 * (place[1] + 64 * place[2])));
    double p[3], length = 0;
    for (int k = 0; k < 3; ++k) {
      p[k] = 2.0 * place[k] / steps - 1;
      length += p[k] * p[k];
    }
    const double scale = (1 + dent * uniform(rng, -1, 1)) / std::sqrt(length);
    return Point{float(p[0] * scale), float(p[1] * scale), float(p[2] * scale)};
  };
  std::vector<PatchNet> nets;
  for (int axis = 0; axis < 3; ++axis) {
    for (int side = 0; side < 2; ++side) {
      for (int a = 0; a < n; ++a) {
        for (int b = 0; b < n; ++b) {
          PatchNet net;
          const uint64_t turn = turns();
          for (int r = 0; r < 4; ++r) {
            for (int c = 0; c < 4; ++c) {
              int i = turn & 1 ? 3 - r : r, j = turn & 2 ? 3 - c : c;
              if (turn & 4) std::swap(i, j);
              net[size_t(4 * r + c)] = point(axis, side, 3 * a + i, 3 * b + j);
            }
          }
          nets.push_back(net);
        }
      }
    }
  }
  return nets;
}

/// A sphere-like surface of `meridians` patches whose upper and lower edges are points.
inline std::vector<PatchNet> poles(int meridians)
{
  std::vector<PatchNet> nets;
  const double height[4] = {-1, -1, 1, 1}, radius[4] = {0, 1.4, 1.4, 0};
  for (int m = 0; m < meridians; ++m) {
    PatchNet net;
    for (int r = 0; r < 4; ++r) {
      for (int c = 0; c < 4; ++c) {
        // Columns of neighbours are the same one.
        const double turn = 6.283185307179586 * ((3 * m + c) % (3 * meridians)) / (3 * meridians);
        net[size_t(4 * r + c)] = {float(radius[r] * std::cos(turn)), float(height[r]),
                                  float(radius[r] * std::sin(turn))};
      }
    }
    nets.push_back(net);
  }
  return nets;
}

/// A flat patch from a corner along two edges.
inline PatchNet flat_patch(Point corner, Point u, Point v)
{
  PatchNet net;
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) {
      for (size_t k = 0; k < 3; ++k)
        net[size_t(4 * r + c)][k] = corner[k] + u[k] * float(c) / 3 + v[k] * float(r) / 3;
    }
  }
  return net;
}

/// A camera at a point that looks along a direction, turned about it at random.
inline void add_turned_camera(gpurt_scene scene, const std::array<double, 3> &eye, std::mt19937_64 &rng,
                              float yfov)
{
  double z[3], x[3], y[3];
  const auto unit = [](double(&v)[3]) {
    const double l = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (double &c : v) c /= l;
  };
  for (double &c : z) c = uniform(rng, -1, 1);
  for (double &c : x) c = uniform(rng, -1, 1);
  unit(z);
  const double along = x[0] * z[0] + x[1] * z[1] + x[2] * z[2];
  for (int i = 0; i < 3; ++i) x[i] -= along * z[i];
  unit(x);
  for (int i = 0; i < 3; ++i) y[i] = z[(i + 1) % 3] * x[(i + 2) % 3] - z[(i + 2) % 3] * x[(i + 1) % 3];
  gpurt_camera_desc desc = GPURT_CAMERA_DESC_INIT;
  for (int i = 0; i < 3; ++i) {
    desc.transform[4 * i] = float(x[i]);
    desc.transform[4 * i + 1] = float(y[i]);
    desc.transform[4 * i + 2] = float(z[i]);
    desc.transform[4 * i + 3] = float(eye[size_t(i)]);
  }
  desc.yfov_rad = yfov;
  uint32_t id;
  GPURT_EXPECT_OK(gpurt_scene_add_camera(scene, &desc, &id));
}

}  // namespace gpurt_test
