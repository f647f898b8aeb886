// The oracle itself: its filtered decisions against CGAL's AABB_tree with an exact kernel, triangle by triangle.
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Exact_predicates_exact_constructions_kernel.h>

#include "../support/exact_oracle.h"

namespace {

using namespace gpurt_test;
using Kernel = CGAL::Exact_predicates_exact_constructions_kernel;
using Triangles = std::vector<Kernel::Triangle_3>;
using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::const_iterator>;
using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

Kernel::Point_3 point(const float *p) { return {p[0], p[1], p[2]}; }

class Oracle : public ::testing::TestWithParam<std::string> {};

// Along rays without ends, the triangles that are met outside of their planes are the same, and so is the nearest.
TEST_P(Oracle, AgreesWithCgal)
{
  const NamedMesh m = mesh_of_kind(GetParam());
  const ExactOracle oracle(m.mesh);
  Triangles triangles;
  std::vector<uint32_t> ids;
  for (uint32_t i = 0; i < m.mesh.triangles.size(); ++i) {
    if (oracle.is_degenerate(i)) continue;
    triangles.emplace_back(point(m.mesh.corner(i, 0).data()), point(m.mesh.corner(i, 1).data()),
                           point(m.mesh.corner(i, 2).data()));
    ids.push_back(i);
  }
  const Tree tree(triangles.begin(), triangles.end());

  RaySource source(m.mesh, {}, 3);
#if defined(__SANITIZE_ADDRESS__)
  const int num_rays = 80;
#else
  const int num_rays = 2400;
#endif
  size_t num_met = 0, num_nearest = 0, num_within_planes = 0;
  for (int i = 0; i < num_rays; ++i) {
    const RayKind kind = RayKind(i % int(RayKind::Count));
    const gpurt_ray ray = source(kind);
    const Kernel::Vector_3 direction(ray.direction[0], ray.direction[1], ray.direction[2]);
    const Kernel::Point_3 origin = point(ray.origin);
    std::vector<Tree::Intersection_and_primitive_id<Kernel::Ray_3>::Type> found;
    tree.all_intersections(Kernel::Ray_3(origin, direction), std::back_inserter(found));

    std::map<uint32_t, Kernel::FT> met;  // triangle to t
    for (const auto &f : found) {
      const Kernel::Point_3 *p = boost::get<Kernel::Point_3>(&f.first);
      const Kernel::Triangle_3 &triangle = *f.second;
      // A ray within the triangle's plane meets it in a segment, or touches it in a point.
      if (p == nullptr || triangle.supporting_plane().orthogonal_vector() * direction == 0) {
        ++num_within_planes;
        continue;
      }
      const uint32_t id = ids[size_t(f.second - triangles.cbegin())];
      met[id] = (*p - origin) * direction / direction.squared_length();
    }

    const RayTruth truth = oracle(ray, double_precision);
    std::map<uint32_t, const Candidate *> ours;
    for (const Candidate &c : truth.candidates) {
      if (c.is_met) ours[c.triangle] = &c;
    }
    for (const auto &[id, t] : met) {
      ++num_met;
      ASSERT_TRUE(ours.count(id)) << "triangle " << id << " is not met, says the oracle";
      // The bound on the library's t holds for the exact t as well, up to half an ulp of a float.
      const float t_float = float(CGAL::to_double(CGAL::exact(t)));
      EXPECT_GE(t_float, std::nextafter(ours[id]->t_low, -infinite));
      EXPECT_LE(t_float, std::nextafter(ours[id]->t_high, infinite));
    }
    // CGAL's ray begins at its origin; the oracle tells of the whole line.
    uint32_t nearest = GPURT_INVALID_ID;
    Kernel::FT nearest_t = 0;
    bool is_clear = true;
    for (const auto &[id, candidate] : ours) {
      if (met.count(id) == 0) {
        EXPECT_LE(candidate->t_low, 0) << "triangle " << id << " is not met, says CGAL";
        continue;
      }
      is_clear = is_clear && !candidate->is_near && candidate->t_low > 0;
      if (nearest == GPURT_INVALID_ID || met[id] < nearest_t) nearest = id, nearest_t = met[id];
    }
    if (!is_clear) continue;
    ++num_nearest;
    EXPECT_EQ(truth.nearest, nearest);
  }
  EXPECT_GT(num_met, size_t(num_rays) / 4);
  EXPECT_GT(num_nearest, size_t(num_rays) / 20);
  std::printf("%s: %d rays, %zu triangles met, %zu within their planes; nearest compared for %zu rays\n",
              m.name.c_str(), num_rays, num_met, num_within_planes, num_nearest);
}

INSTANTIATE_TEST_SUITE_P(Meshes, Oracle, ::testing::ValuesIn(mesh_kinds),
                         [](const auto &info) { return info.param; });

// Decisions that no filter can take: an edge exactly at the bound, a ray exactly along an edge.
TEST(Oracle, DecidesWhatIntervalsCannot)
{
  const Mesh mesh = quad({-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0});
  const ExactOracle oracle(mesh);
  // Through the diagonal, exactly: both triangles, one cluster, whose outline winds once.
  const RayTruth truth = oracle(make_ray({0, 0, 1}, {0, 0, -1}), float_precision);
  ASSERT_EQ(truth.candidates.size(), 2u);
  ASSERT_EQ(truth.clusters.size(), 1u);
  EXPECT_FALSE(truth.clusters[0].is_open);
  EXPECT_EQ(std::abs(truth.clusters[0].winding), 1);
  // Through the rim: nothing is demanded there.
  const RayTruth rim = oracle(make_ray({1, 0, 1}, {0, 0, -1}), float_precision);
  ASSERT_EQ(rim.clusters.size(), 1u);
  EXPECT_TRUE(rim.clusters[0].is_open);
  // In the plane: met by none.
  const RayTruth within = oracle(make_ray({-3, 0.25f, 0}, {1, 0, 0}), float_precision);
  for (const Candidate &c : within.candidates) EXPECT_FALSE(c.is_met);
}

TEST(Oracle, KnowsDegenerateTriangles)
{
  Mesh mesh = quad({0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
  mesh.vertices.push_back({0.25f, 0.25f, 0});
  mesh.vertices.push_back({0.75f, 0.75f, 0x1p-126f});
  mesh.triangles.push_back({0, 4, 2});  // collinear
  mesh.triangles.push_back({0, 1, 1});
  mesh.triangles.push_back({0, 5, 2});  // not quite
  const ExactOracle oracle(mesh);
  EXPECT_EQ(oracle.num_degenerate(), 2u);
  EXPECT_TRUE(oracle.is_degenerate(2));
  EXPECT_TRUE(oracle.is_degenerate(3));
}

}  // namespace
