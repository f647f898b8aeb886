// Tessellated patches: the distance bound, shared boundaries, normals at poles.
#include <cmath>
#include <random>

#include "scene/patches.h"
#include "scene_builders.h"

namespace gpurt {
namespace {

using Net = std::array<Vec3f, 16>;

PatchData make_patches(const std::vector<Net> &nets)
{
  std::vector<Vec3f> points;
  for (const Net &net : nets) points.insert(points.end(), net.begin(), net.end());
  return {SharedArray<Vec3f>(std::move(points))};
}

Net random_net(std::mt19937 &random, float roughness)
{
  std::uniform_real_distribution<float> unit(-roughness, roughness);
  Net net;
  for (int k = 0; k < 16; ++k) {
    const float x = unit(random), y = unit(random), z = unit(random);
    net[k] = {float(k % 4) + x, float(k / 4) + y, z};
  }
  return net;
}

// The definition, in double: S(u,v) = sum B_row(v) B_column(u) P.
Vec3d evaluate(const Net &net, double u, double v)
{
  const auto weights = [](double t, double(&b)[4]) {
    b[0] = (1 - t) * (1 - t) * (1 - t);
    b[1] = 3 * t * (1 - t) * (1 - t);
    b[2] = 3 * t * t * (1 - t);
    b[3] = t * t * t;
  };
  double bu[4], bv[4];
  weights(u, bu);
  weights(v, bv);
  Vec3d p{0, 0, 0};
  for (int k = 0; k < 16; ++k) p = p + to_double(net[k]) * (bv[k / 4] * bu[k % 4]);
  return p;
}

double distance_to_triangle(Vec3d p, Vec3d a, Vec3d b, Vec3d c)
{
  // Closest point by a fine search of barycentrics around the parameter would do; the triangle's plane and edges are
  // exact and short.
  const auto segment = [&](Vec3d s, Vec3d e) {
    const Vec3d d = e - s;
    const double t = std::clamp(dot(p - s, d) / dot(d, d), 0.0, 1.0);
    return length(p - (s + d * t));
  };
  const Vec3d n = cross(b - a, c - a);
  const bool is_inside = dot(cross(b - a, p - a), n) >= 0 && dot(cross(c - b, p - b), n) >= 0 &&
                         dot(cross(a - c, p - c), n) >= 0;
  if (is_inside) return std::fabs(dot(p - a, normalize(n)));
  return std::min(segment(a, b), std::min(segment(b, c), segment(c, a)));
}

TEST(ScenePatches, TrianglesStayWithinTheTolerance)
{
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(0, 1);
  for (float roughness : {0.1f, 1.0f, 4.0f}) {
    for (float tolerance : {0.1f, 0.003f}) {
      const Net net = random_net(random, roughness);
      const PatchData patches = make_patches({net});
      const uint32_t n = tessellation_rate(patches, tolerance);
      const TessellatedPatches mesh(patches, n);
      double worst = 0;
      for (int i = 0; i < 4000; ++i) {
        const double u = unit(random), v = unit(random);
        const uint32_t cell = uint32_t(v * n) * n + uint32_t(u * n);
        double d = 1e30;
        for (uint32_t t = 2 * cell; t < 2 * cell + 2; ++t) {
          const UInt3 c = mesh.triangle(t);
          d = std::min(d, distance_to_triangle(evaluate(net, u, v), mesh.vertex(c.x), mesh.vertex(c.y),
                                               mesh.vertex(c.z)));
        }
        worst = std::max(worst, d);
      }
      EXPECT_LE(worst, tolerance);
      // The bound is of the right size: cruder by more than ten would waste a hundred times the triangles.
      if (n > 4) {
        EXPECT_GE(worst, tolerance * 0.05);
      }
    }
  }
}

TEST(ScenePatches, FlatPatchesNeedOneCell)
{
  std::mt19937 random(1);
  const PatchData flat = make_patches({random_net(random, 0)});
  EXPECT_EQ(tessellation_rate(flat, 0.0f), 1u);
  EXPECT_EQ(tessellation_rate(make_patches({Net{}}), 0.0f), 1u);
  EXPECT_EQ(tessellation_rate(make_patches({}), 0.0f), 1u);
}

TEST(ScenePatches, NamesAToleranceThatIsTooFine)
{
  std::mt19937 random(1);
  const std::string message =
      error_of([&] { tessellation_rate(make_patches({random_net(random, 1)}), 1e-12f); });
  expect_contains(message, "patch tolerance");
  expect_contains(message, "raise patch_tolerance");
}

TEST(ScenePatches, CornersAndParametersAreExact)
{
  std::mt19937 random(2);
  const Net net = random_net(random, 1);
  const PatchData patches = make_patches({net, net});
  const uint32_t n = 7;
  const TessellatedPatches mesh(patches, n);
  EXPECT_EQ(mesh.num_vertices(), 2u * 64);
  EXPECT_EQ(mesh.num_triangles(), 2u * 98);
  const uint32_t corners[4] = {0, n, n * (n + 1), (n + 1) * (n + 1) - 1};
  const int points[4] = {0, 3, 12, 15};
  for (int k = 0; k < 4; ++k) {
    const Vec3d p = mesh.vertex(64 + corners[k]);
    EXPECT_EQ(p.x, net[points[k]].x);
    EXPECT_EQ(p.y, net[points[k]].y);
    EXPECT_EQ(p.z, net[points[k]].z);
  }
  for (uint64_t i = 0; i < 64; ++i) {
    const Vec2f uv = mesh.uv(i);
    const Vec3d p = mesh.vertex(i), q = evaluate(net, uv.x, uv.y);
    EXPECT_LT(length(p - q), 1e-5);  // the parameters are floats
  }
}

// Two patches with a common edge, whichever way it runs in either: the same vertices, bit by bit.
TEST(ScenePatches, NeighboursShareTheirBoundaryExactly)
{
  std::mt19937 random(3);
  // Positions of the four boundary points of each edge, and the step between its vertices.
  const int edges[4][4] = {{0, 1, 2, 3}, {3, 7, 11, 15}, {15, 14, 13, 12}, {12, 8, 4, 0}};
  for (uint32_t n : {1u, 2u, 3u, 10u, 37u, 1000u}) {
    const auto vertex_of_edge = [n](int edge, uint32_t k) {
      const uint64_t i = edge == 0 ? k : edge == 1 ? n : edge == 2 ? n - k : 0;
      const uint64_t j = edge == 0 ? 0 : edge == 1 ? k : edge == 2 ? n : n - k;
      return j * (n + 1) + i;
    };
    for (int e = 0; e < 4; ++e) {
      for (int f = 0; f < 4; ++f) {
        for (bool reversed : {false, true}) {
          const Net a = random_net(random, 3);
          Net b = random_net(random, 3);
          for (int k = 0; k < 4; ++k) b[edges[f][reversed ? 3 - k : k]] = a[edges[e][k]];
          const PatchData pa = make_patches({a}), pb = make_patches({b});
          const TessellatedPatches ma(pa, n), mb(pb, n);
          for (uint32_t k = 0; k <= n; ++k) {
            const Vec3d p = ma.vertex(vertex_of_edge(e, k)),
                        q = mb.vertex(vertex_of_edge(f, reversed ? n - k : k));
            ASSERT_TRUE(p.x == q.x && p.y == q.y && p.z == q.z)
                << "edges " << e << ", " << f << ", rate " << n;
          }
        }
      }
    }
  }
}

TEST(ScenePatches, NormalsAreThoseOfTheSurface)
{
  std::mt19937 random(4);
  const Net net = random_net(random, 0.3f);
  const PatchData patches = make_patches({net});
  const TessellatedPatches mesh(patches, 8);
  for (uint64_t i = 0; i < mesh.num_vertices(); ++i) {
    const double u = double(i % 9) / 8, v = double(i / 9) / 8, h = 1e-5;
    const Vec3d du = evaluate(net, u + h, v) - evaluate(net, u - h, v),
                dv = evaluate(net, u, v + h) - evaluate(net, u, v - h);
    const Vec3d n = mesh.normal(i);
    EXPECT_NEAR(dot(n, normalize(cross(du, dv))), 1, 1e-8);
    EXPECT_NEAR(length(n), 1, 1e-12);
  }
}

// One row is a point, as at the top of the teapot's lid: all normals there are those of the limit, here +z.
TEST(ScenePatches, PolesHaveTheLimitsNormal)
{
  Net net;
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) {
      const float radius = float(r) / 3, angle = 1.5f * float(c) / 3;
      // The first ring leaves the pole within the plane z = 0, then the surface falls.
      net[4 * r + c] = {radius * std::cos(angle), radius * std::sin(angle), r < 2 ? 0 : -radius};
    }
  }
  const PatchData patches = make_patches({net});
  const TessellatedPatches mesh(patches, 4);
  for (uint64_t i = 0; i < 5; ++i) EXPECT_NEAR(std::fabs(mesh.normal(i).z), 1, 1e-3);
}

TEST(ScenePatches, DegeneratePatchesStayFinite)
{
  Net curve, point;
  for (int k = 0; k < 16; ++k) {
    curve[k] = {float(k % 4), float(k % 4) * float(k % 4), 0};
    point[k] = {3, 4, 5};
  }
  Net tiny = curve;
  for (int k = 0; k < 16; ++k)
    tiny[k] = {1e-30f * float(k % 4), 1e-30f * float(k / 4), 1e-33f * float(k % 3)};
  for (const Net &net : {curve, point, tiny}) {
    const PatchData patches = make_patches({net});
    const TessellatedPatches mesh(patches, 3);
    for (uint64_t i = 0; i < mesh.num_vertices(); ++i) EXPECT_NEAR(length(mesh.normal(i)), 1, 1e-12);
  }
  const PatchData patches = make_patches({tiny});
  EXPECT_GT(std::fabs(TessellatedPatches(patches, 3).normal(5).z), 0.99);
}

TEST(ScenePatches, CompileToTrianglesOfTheirGeometry)
{
  std::mt19937 random(5);
  SceneData d;
  const uint32_t g = add_patches(d, make_patches({random_net(random, 1), random_net(random, 1)}), 0);
  add_instance(d, g, scaling(2, 2, 2));
  const CompiledScene s = compile_scene(d, 0.01f);
  // The tolerance is one of the world, where the patches are twice as large.
  const uint32_t n = tessellation_rate(d.geometries[g].patches, 0.01f, 2);
  EXPECT_NEAR(s.patch_error, 2 * tessellation_error(d.geometries[g].patches, n), 1e-12);
  EXPECT_LE(s.patch_error, 0.01);
  EXPECT_EQ(s.num_patches, 2u);
  EXPECT_EQ(s.indices.size(), 4u * n * n);
  EXPECT_EQ(s.segments[0].geometry, g);
  EXPECT_NE(s.segments[0].first_normal, invalid_id);
  EXPECT_EQ(s.uvs[1].x, float(1.0 / n));
  EXPECT_EQ(s.positions[0].x, 2 * d.geometries[g].patches.control_points[0].x);
}

}  // namespace
}  // namespace gpurt
