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

using Cells = std::vector<PatchCells>;

Cells uniform_cells(uint64_t num_patches, uint16_t n)
{
  Cells cells;
  for (uint64_t i = 0; i < num_patches; ++i) cells.push_back({uint32_t(2 * i * n * n), n, n, {n, n, n, n}});
  return cells;
}

Cells cut(const PatchData &patches, float tolerance, double stretch = 1)
{
  return cut_patches({{&patches, 0, stretch}}, tolerance)[0];
}

// n x n cells of one number for all patches, from the same bound.
double uniform_rate(const PatchData &patches, float tolerance)
{
  const double one = tessellation_error(patches, uniform_cells(patches.control_points.size() / 16, 1));
  return std::ceil(std::sqrt(one / double(tolerance)));
}

// Cells of which every edge, and so the rim, has another number of segments than the cells.
PatchCells random_cells(std::mt19937 &random, uint16_t most)
{
  const auto pick = [&](uint16_t n) { return uint16_t(1 + random() % n); };
  PatchCells c{0, pick(most), pick(most), {}};
  c.edge[0] = pick(c.num_u), c.edge[1] = c.num_u, c.edge[2] = c.num_v, c.edge[3] = pick(c.num_v);
  if (random() & 1) std::swap(c.edge[0], c.edge[1]);
  if (random() & 1) std::swap(c.edge[2], c.edge[3]);
  return c;
}

// The point of its triangle that stands for (u, v).
Vec3d point_of_mesh(const TessellatedPatches &mesh, const PatchCells &cells, float u, float v)
{
  const CellPoint at = locate_in_cells(cells, u, v);
  const UInt3 c = mesh.triangle(cells.first_triangle + at.triangle);
  return mesh.vertex(c.x) * (1.0 - double(at.second) - double(at.third)) +
         mesh.vertex(c.y) * double(at.second) + mesh.vertex(c.z) * double(at.third);
}

TEST(ScenePatches, TrianglesStayWithinTheTolerance)
{
  std::mt19937 random(1);
  std::uniform_real_distribution<float> unit(0, 1);
  for (float roughness : {0.1f, 1.0f, 4.0f}) {
    for (float tolerance : {0.1f, 0.003f}) {
      const Net net = random_net(random, roughness);
      const PatchData patches = make_patches({net});
      const Cells cells = cut(patches, tolerance);
      const TessellatedPatches mesh(patches, cells);
      double worst = 0, worst_to_point = 0;
      for (int i = 0; i < 4000; ++i) {
        const float u = unit(random), v = unit(random);
        const Vec3d p = evaluate(net, u, v);
        const UInt3 c = mesh.triangle(locate_in_cells(cells[0], u, v).triangle);
        worst =
            std::max(worst, distance_to_triangle(p, mesh.vertex(c.x), mesh.vertex(c.y), mesh.vertex(c.z)));
        worst_to_point = std::max(worst_to_point, length(p - point_of_mesh(mesh, cells[0], u, v)));
      }
      EXPECT_LE(tessellation_error(patches, cells), tolerance);
      EXPECT_LE(worst, tolerance);
      // What is proven is the distance to the point with the same parameters. These are floats: 1e-4 of a cell, whose
      // points are no further than its error's root apart.
      EXPECT_LE(worst_to_point, tolerance * 1.01 + 1e-4);
      // The bound is of the right size: cruder by more than ten would waste a hundred times the triangles.
      if (cells[0].num_u > 4) {
        EXPECT_GE(worst, tolerance * 0.05);
      }
    }
  }
}

// Whatever the numbers of the cells and edges: triangles cover the square of parameters once, without folds, none is wider
// than a segment of its patch's edges, and a point is found in the triangle that has it.
TEST(ScenePatches, CellsCoverTheParametersOnce)
{
  std::mt19937 random(6);
  std::uniform_real_distribution<float> unit(0, 1);
  const PatchData patches = make_patches({random_net(random, 1)});
  for (int trial = 0; trial < 3000; ++trial) {
    const Cells cells = {random_cells(random, trial % 3 == 0 ? 40 : 6)};
    const PatchCells &c = cells[0];
    const TessellatedPatches mesh(patches, cells);
    const double width = 1.0 / std::min(c.edge[0], c.edge[1]), height = 1.0 / std::min(c.edge[2], c.edge[3]);
    const std::string what = fmt::format("{} x {}, edges {} {} {} {}", c.num_u, c.num_v, c.edge[0], c.edge[1],
                                         c.edge[2], c.edge[3]);
    double sum = 0;
    std::vector<double> area(mesh.num_triangles());
    for (uint64_t t = 0; t < mesh.num_triangles(); ++t) {
      const UInt3 k = mesh.triangle(t);
      const Vec2f a = mesh.uv(k.x), b = mesh.uv(k.y), d = mesh.uv(k.z);
      area[t] = (double(b.x) - double(a.x)) * (double(d.y) - double(a.y)) -
                (double(b.y) - double(a.y)) * (double(d.x) - double(a.x));
      sum += area[t];
      ASSERT_GE(area[t], -1e-7) << what << ", triangle " << t;  // parameters are floats
      ASSERT_LE(std::max({a.x, b.x, d.x}) - std::min({a.x, b.x, d.x}), width + 1e-6) << what;
      ASSERT_LE(std::max({a.y, b.y, d.y}) - std::min({a.y, b.y, d.y}), height + 1e-6) << what;
    }
    ASSERT_NEAR(sum, 2, 1e-5) << what;
    for (int i = 0; i < 60; ++i) {
      // At boundaries and between them.
      float u = unit(random), v = unit(random);
      if (i % 3 == 0) u = std::round(u * c.num_u) / c.num_u;
      if (i % 4 == 0) v = std::round(v * c.num_v) / c.num_v;
      if (i % 5 == 0) v /= float(c.num_v);
      if (i % 7 == 0) u = 1 - u / float(c.num_u);
      const CellPoint at = locate_in_cells(c, u, v);
      ASSERT_LT(at.triangle, mesh.num_triangles()) << what;
      const UInt3 k = mesh.triangle(at.triangle);
      const Vec2f p = mesh.uv(k.x), q = mesh.uv(k.y), r = mesh.uv(k.z);
      const float first = 1 - at.second - at.third;
      // Of 40 cells, whose coordinates are rounded to 2^-19; slivers' areas lose a few bits more.
      ASSERT_NEAR(first * p.x + at.second * q.x + at.third * r.x, u, 1e-4)
          << what << " at " << u << ", " << v;
      ASSERT_NEAR(first * p.y + at.second * q.y + at.third * r.y, v, 1e-4)
          << what << " at " << u << ", " << v;
    }
  }
}

// The bound holds in cells next to edges that have fewer vertices, or more, than the patch wants.
TEST(ScenePatches, RimsStayWithinTheBound)
{
  std::mt19937 random(7);
  std::uniform_real_distribution<float> unit(0, 1);
  double closest = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const Net net = random_net(random, 2);
    const PatchData patches = make_patches({net});
    const Cells cells = {random_cells(random, 24)};
    const TessellatedPatches mesh(patches, cells);
    const double bound = tessellation_error(patches, cells);
    for (int i = 0; i < 1000; ++i) {
      float u = unit(random), v = unit(random);
      if (i % 2) v /= float(cells[0].num_v);
      if (i % 3 == 0) u = 1 - u / float(cells[0].num_u);
      const double d = length(evaluate(net, u, v) - point_of_mesh(mesh, cells[0], u, v));
      ASSERT_LE(d, bound + 2e-4);  // as above
      closest = std::max(closest, d / bound);
    }
  }
  EXPECT_GT(closest, 0.2);
}

TEST(ScenePatches, FlatPatchesNeedOneCell)
{
  std::mt19937 random(1);
  // Coordinates are whole numbers, so that differences vanish.
  const PatchData flat = make_patches({random_net(random, 0)});
  EXPECT_EQ(cut(flat, 0.0f)[0].num_u, 1);
  EXPECT_EQ(cut(flat, 0.0f)[0].num_v, 1);
  EXPECT_EQ(cut(make_patches({Net{}}), 0.0f)[0].num_u, 1);
  EXPECT_TRUE(cut(make_patches({}), 0.0f).empty());
}

// A trough is cut across alone, and flat patches beside curved ones but at their common edges.
TEST(ScenePatches, TakeFewerTrianglesThanOneNumberForAll)
{
  Net trough{};
  for (int k = 0; k < 16; ++k)
    trough[k] = {float(k % 4), float(k / 4), k % 4 == 0 || k % 4 == 3 ? 1.0f : 0.0f};
  const PatchData one = make_patches({trough});
  const Cells across = cut(one, 1e-3f);
  EXPECT_EQ(across[0].num_v, 1);
  EXPECT_EQ(across[0].num_u, uniform_rate(one, 1e-3f));

  std::mt19937 random(8);
  std::vector<Net> nets;
  for (int i = 0; i < 16; ++i) {
    Net net = random_net(random, i == 5 ? 0.7f : 0.02f);
    for (Vec3f &p : net) p = p + Vec3f{3 * float(i % 4), 3 * float(i / 4), 0};
    nets.push_back(net);
  }
  const PatchData patches = make_patches(nets);
  for (float tolerance : {0.1f, 1e-2f, 1e-3f}) {
    const Cells cells = cut(patches, tolerance);
    EXPECT_LE(tessellation_error(patches, cells), tolerance);
    const double n = uniform_rate(patches, tolerance), uniform = 2 * n * n * 16;
    EXPECT_LT(double(TessellatedPatches(patches, cells).num_triangles()), 0.5 * uniform);
  }
}

TEST(ScenePatches, NamesAToleranceThatIsTooFine)
{
  std::mt19937 random(1);
  const PatchData patches = make_patches({random_net(random, 1)});
  const std::string message = error_of([&] { cut(patches, 1e-12f); });
  expect_contains(message, "geometry 0: a patch tolerance");
  expect_contains(message, "raise patch_tolerance");
}

TEST(ScenePatches, CornersAndParametersAreExact)
{
  std::mt19937 random(2);
  const Net net = random_net(random, 1);
  const PatchData patches = make_patches({net, net});
  const uint32_t n = 7;
  const Cells cells = uniform_cells(2, n);
  const TessellatedPatches mesh(patches, cells);
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
          const Cells cells = uniform_cells(1, uint16_t(n));
          const TessellatedPatches ma(pa, cells), mb(pb, cells);
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

// Two geometries whose patches want different numbers, with a common edge that runs along u in one and backwards along v
// in the other: as many vertices, with the same bits.
TEST(ScenePatches, GeometriesShareTheirBoundary)
{
  std::mt19937 random(9);
  Net curved = random_net(random, 2), flat{};
  const int points[4] = {0, 4, 8, 12}, others[4] = {15, 14, 13, 12};
  for (int k = 0; k < 16; ++k) flat[k] = {-float(k / 4), float(k % 4), 0};
  for (int k = 0; k < 4; ++k) flat[others[k]] = curved[points[k]];
  SceneData d;
  add_instance(d, add_patches(d, make_patches({curved}), 0), identity_affine);
  add_instance(d, add_patches(d, make_patches({flat}), 0), identity_affine);
  const CompiledScene s = compile_scene(d, 2e-3f);
  const PatchCells a = s.patch_cells[0], b = s.patch_cells[1];
  ASSERT_EQ(a.edge[2], b.edge[1]);
  EXPECT_GT(a.edge[2], 4);
  // All vertices on the edge, once each.
  const auto along = [&](const Segment &segment, const PatchCells &c, bool left) {
    std::vector<std::array<float, 3>> found;
    const uint32_t n = left ? c.num_v : c.num_u;
    for (uint32_t k = 0; k <= n; ++k) {
      const uint32_t local = left ? k * (c.num_u + 1u) : c.num_v * (c.num_u + 1u) + n - k;
      const Vec3f p = s.positions[segment.first_vertex + local];
      const std::array<float, 3> v = {p.x, p.y, p.z};
      if (found.empty() || found.back() != v) found.push_back(v);
    }
    return found;
  };
  const auto one = along(s.segments[0], a, true), other = along(s.segments[1], b, false);
  EXPECT_EQ(one.size(), a.edge[2] + 1u);
  EXPECT_EQ(one, other);
}

TEST(ScenePatches, NormalsAreThoseOfTheSurface)
{
  std::mt19937 random(4);
  const Net net = random_net(random, 0.3f);
  const PatchData patches = make_patches({net});
  const Cells cells = uniform_cells(1, 8);
  const TessellatedPatches mesh(patches, cells);
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
  const Cells cells = uniform_cells(1, 4);
  const TessellatedPatches mesh(patches, cells);
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
    const Cells cells = uniform_cells(1, 3);
    const TessellatedPatches mesh(patches, cells);
    for (uint64_t i = 0; i < mesh.num_vertices(); ++i) EXPECT_NEAR(length(mesh.normal(i)), 1, 1e-12);
  }
  const PatchData patches = make_patches({tiny});
  const Cells cells = uniform_cells(1, 3);
  EXPECT_GT(std::fabs(TessellatedPatches(patches, cells).normal(5).z), 0.99);
}

TEST(ScenePatches, CompileToTrianglesOfTheirGeometry)
{
  std::mt19937 random(5);
  SceneData d;
  const uint32_t g = add_patches(d, make_patches({random_net(random, 1), random_net(random, 1)}), 0);
  add_instance(d, g, scaling(2, 2, 2));
  const CompiledScene s = compile_scene(d, 0.01f);
  // The tolerance is one of the world, where the patches are twice as large.
  const Cells cells = cut(d.geometries[g].patches, 0.01f, 2);
  EXPECT_NEAR(s.patch_error, 2 * tessellation_error(d.geometries[g].patches, cells), 1e-12);
  EXPECT_LE(s.patch_error, 0.01);
  EXPECT_EQ(s.num_patches, 2u);
  EXPECT_EQ(s.indices.size(), TessellatedPatches(d.geometries[g].patches, cells).num_triangles());
  EXPECT_EQ(patch_of_triangle(cells, cells[1].first_triangle - 1), 0u);
  EXPECT_EQ(patch_of_triangle(cells, cells[1].first_triangle), 1u);
  EXPECT_EQ(s.segments[0].geometry, g);
  EXPECT_NE(s.segments[0].first_normal, invalid_id);
  EXPECT_EQ(s.uvs[cells[0].num_u].x, 1.0f);
  EXPECT_EQ(s.positions[0].x, 2 * d.geometries[g].patches.control_points[0].x);
}

}  // namespace
}  // namespace gpurt
