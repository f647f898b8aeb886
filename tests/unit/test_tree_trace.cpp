// Ray queries through the kd-tree and the bvh against brute force over all triangles.
#include <tbb/parallel_for.h>

#include "../support/rays.h"
#include "accel/bvh_build.h"
#include "accel_test.h"
#include "core/accel/sort_hits.h"
#include "cpu/accel/kd_view.h"
#include "cpu/kernels.h"

namespace gpurt {
namespace {

using namespace test;

class TreeTrace : public ::testing::TestWithParam<Accel> {
 protected:
  static BuildOptions options(TriangleTest test = TriangleTest::Watertight)
  {
    BuildOptions o;
    o.accel = GetParam();
    o.triangle_test = test;
    return o;
  }
  static std::shared_ptr<const CpuScene> commit(std::shared_ptr<const CompiledScene> scene,
                                                const BuildOptions &o = options())
  {
    return test::commit(std::move(scene), o);
  }
  static void expect_brute_force(const std::shared_ptr<CompiledScene> &scene, const std::vector<Ray> &rays,
                                 const char *what)
  {
    const SceneView view = scene->view();
    const auto committed = commit(scene);
    const std::vector<Hit> hits = trace(*committed, rays);
    const std::vector<uint8_t> occluded = trace_occluded(*committed, rays);
    int wrong = 0;
    for (size_t i = 0; i < rays.size(); ++i) {
      const Hit expected = brute_force(view, rays[i]);
      EXPECT_EQ(occluded[i] != 0, expected.triangle != invalid_id) << what << " ray " << i;
      if (same_bits(hits[i], expected)) continue;
      ADD_FAILURE() << what << " ray " << i << ": " << text(hits[i]) << ", brute force: " << text(expected);
      if (++wrong == 5) break;
    }
  }
};

INSTANTIATE_TEST_SUITE_P(Accelerators, TreeTrace, ::testing::Values(Accel::KdTree, Accel::Bvh),
                         [](const auto &info) { return info.param == Accel::Bvh ? "bvh" : "kdtree"; });

Mesh integer_grid(int n)
{
  Mesh m;
  Random rng(4);
  for (int z = 0; z <= n; ++z) {
    for (int x = 0; x <= n; ++x) m.positions.push_back({float(x), float(rng.below(3)), float(z)});
  }
  for (uint32_t z = 0; z < uint32_t(n); ++z) {
    for (uint32_t x = 0; x < uint32_t(n); ++x) {
      const uint32_t a = z * uint32_t(n + 1) + x, b = a + uint32_t(n + 1);
      m.triangles.push_back({a, a + 1, b});
      m.triangles.push_back({a + 1, b + 1, b});
    }
  }
  return m;
}

TEST_P(TreeTrace, MeetsWhatBruteForceMeets)
{
  Random rng(11);
  Mesh needles, twice = soup(rng, 500, 0.3f, 1);
  for (int i = 0; i < 500; ++i) {
    const Vec3f p = rng.point(1), d = rng.direction();
    needles.add(p, p + d * 2.0f, p + d * 2.0f + rng.point(1e-4f));
  }
  twice.add(twice);
  expect_brute_force(scene_of(soup(rng, 2000, 0.2f, 1)), mixed_rays(rng, 6000, 1), "soup");
  expect_brute_force(scene_of(soup(rng, 100, 3, 1)), mixed_rays(rng, 6000, 1), "large triangles");
  expect_brute_force(scene_of(needles), mixed_rays(rng, 6000, 1), "needles");
  expect_brute_force(scene_of(integer_grid(20)), mixed_rays(rng, 20000, 20), "grid");
  expect_brute_force(scene_of(twice), mixed_rays(rng, 20000, 1), "every triangle twice");
  expect_brute_force(scene_of(box({-1, -1, -1}, {1, 1, 1})), mixed_rays(rng, 20000, 1), "box");
  expect_brute_force(scene_of(icosphere(3, 1)), mixed_rays(rng, 20000, 1), "icosphere");
}

// Rays that graze meet triangles by rounding alone, and pass the plane of these far from them. What is hit, and where, does not
// depend on the tree or on the order of its leaves for all that: a t is one at which the triangle is found.
TEST_P(TreeTrace, GrazingRaysMeetWhatBruteForceMeets)
{
  constexpr size_t num_rays = 6000;
  for (const char *kind : {"thin", "needles", "city"}) {
    const gpurt_test::Mesh shape = gpurt_test::mesh_of_kind(kind).mesh;
    Mesh mesh;
    for (const auto &p : shape.vertices) mesh.positions.push_back({p[0], p[1], p[2]});
    for (const auto &t : shape.triangles) mesh.triangles.push_back({t[0], t[1], t[2]});
    gpurt_test::RaySource source(shape, {}, 5);
    std::vector<Ray> rays;
    for (size_t i = 0; i < num_rays; ++i) {
      const gpurt_ray r = source(i % 4 == 0 ? gpurt_test::RayKind::Vertex : gpurt_test::RayKind::Grazing);
      rays.push_back({{r.origin[0], r.origin[1], r.origin[2]},
                      r.tmin,
                      {r.direction[0], r.direction[1], r.direction[2]},
                      r.tmax});
    }
    expect_brute_force(scene_of(mesh), rays, kind);
  }
}

// Catalogue row 20.
TEST_P(TreeTrace, EmptyTinyAndDegenerateScenes)
{
  Random rng(12);
  const std::vector<Ray> rays = mixed_rays(rng, 1000, 1);
  Mesh one, two, points;
  one.add({-1, -1, 0}, {1, -1, 0}, {0, 1, 0});
  two.add(one);
  two.add({-1, -1, 0.5f}, {1, -1, 0.5f}, {0, 1, 0.5f});
  for (int i = 0; i < 9; ++i) points.add({1, 0, 0}, {1, 0, 0}, {2, 0, 0});
  expect_brute_force(scene_of({}), rays, "empty");
  expect_brute_force(scene_of(one), rays, "one");
  expect_brute_force(scene_of(two), rays, "two");
  expect_brute_force(scene_of(points), rays, "degenerate");
  one.add(points);
  expect_brute_force(scene_of(one), rays, "one and degenerate ones");
}

// Catalogue rows 10 and 11.
TEST_P(TreeTrace, FarFromTheOriginAndAtAnyScale)
{
  Random rng(13);
  const Mesh mesh = soup(rng, 1000, 0.3f, 1);
  const std::vector<Ray> rays = mixed_rays(rng, 5000, 1);
  const auto changed = [&](float scale, Vec3f offset) {
    Mesh m = mesh;
    for (Vec3f &p : m.positions) p = p * scale + offset;
    std::vector<Ray> r = rays;
    for (Ray &x : r) {
      x.origin = x.origin * scale + offset;
      x.tmin = 0;
      x.tmax = infinity;
    }
    expect_brute_force(scene_of(m), r, fmt::format("times {} plus {}", scale, offset.x).c_str());
    return std::pair(m, r);
  };
  changed(1, {1e6f, -1e6f, 1e6f});
  changed(100, {1e6f, 1e6f, 1e6f});
  for (float scale : {1e-6f, 1e6f, 1e-12f, 1e12f, 1e-30f, 1e30f}) changed(scale, {0, 0, 0});

  const auto [base_mesh, base_rays] = changed(1, {0, 0, 0});
  const std::vector<Hit> base = trace(*commit(scene_of(base_mesh)), base_rays);
  for (int e : {-20, 20, -70, 70}) {
    const auto [m, r] = changed(std::ldexp(1.0f, e), {0, 0, 0});
    const std::vector<Hit> hits = trace(*commit(scene_of(m)), r);
    for (size_t i = 0; i < hits.size(); ++i) {
      ASSERT_EQ(hits[i].triangle, base[i].triangle);
      if (base[i].triangle != invalid_id) {
        ASSERT_EQ(hits[i].t, std::ldexp(base[i].t, e));
      }
    }
  }
}

// Catalogue rows 1 and 2. GPURT_LEAK_RAYS sets another number of rays.
TEST_P(TreeTrace, ClosedSurfacesDoNotLeak)
{
  const char *wanted = std::getenv("GPURT_LEAK_RAYS");
  const uint64_t num_rays = wanted ? std::strtoull(wanted, nullptr, 10) : 1000000;
  const Mesh sphere = icosphere(5, 1);
  const auto scene = scene_of(sphere);
  for (TriangleTest test : {TriangleTest::Watertight, TriangleTest::Double}) {
    const auto committed = commit(scene, options(test));
    std::atomic<uint64_t> misses{0};
    tbb::parallel_for(uint64_t(0), num_rays / 1000, [&](uint64_t block) {
      Random rng(uint32_t(block * 7919 + 1));
      std::vector<Ray> rays;
      for (int i = 0; i < 1000; ++i) {
        const UInt3 t = sphere.triangles[rng.below(uint32_t(sphere.triangles.size()))];
        const Vec3f a = sphere.positions[t.x], b = sphere.positions[t.y];
        const float s = i % 4 == 0 ? 0.0f : i % 4 == 1 ? 0.5f : rng.uniform(0, 1);
        const Vec3f origin = rng.point(i % 2 ? 0.5f : 0.01f);
        rays.push_back({origin, 0, a + (b - a) * s - origin, infinity});
      }
      for (const Hit &h : trace(*committed, rays)) misses += h.triangle == invalid_id;
    });
    EXPECT_EQ(misses.load(), 0u);
  }
}

// Catalogue row 3: a height field on an integer grid, and rays down its columns, edges and corners.
TEST_P(TreeTrace, IntegerGridsHaveNoPinholes)
{
  const auto scene = commit(scene_of(integer_grid(64)));
  std::vector<Ray> rays;
  for (int z = 0; z <= 256; ++z) {
    for (int x = 0; x <= 256; ++x)
      rays.push_back({{float(x) * 0.25f, 100, float(z) * 0.25f}, 0, {0, -1, 0}, infinity});
  }
  const std::vector<Hit> hits = trace(*scene, rays);
  for (size_t i = 0; i < hits.size(); ++i)
    ASSERT_NE(hits[i].triangle, invalid_id) << rays[i].origin.x << " " << rays[i].origin.z;
}

// Catalogue rows 4, 5 and 6: the tree's own planes as origins, rays along axes, both zeros.
TEST_P(TreeTrace, OriginsOnSplitPlanesAndRaysInThem)
{
  Random rng(14);
  Mesh mesh = soup(rng, 300, 0.4f, 1);
  mesh.add(box({-1, -1, -1}, {1, 1, 1}));
  mesh.add(integer_grid(4));
  const auto scene = scene_of(mesh);
  const SceneView view = scene->view();
  const auto committed = commit(scene);
  // Planes of the kd-tree are faces of boxes of triangles, and parts of them, for either tree.
  const HostKdTree tree = commit(scene, kd_options())->export_tree(0);
  std::vector<Ray> rays, twins;
  for (const KdNode &node : tree.nodes) {
    if (is_leaf(node)) continue;
    for (int i = 0; i < 4; ++i) {
      Ray r = {rng.point(1.5f), 0, rng.direction(), infinity};
      set(r.origin, axis(node), plane(node));
      if (i == 1) set(r.direction, axis(node), 0.0f);
      if (i >= 2) {
        r.direction = {0, 0, 0};
        set(r.direction, (axis(node) + i) % 3, rng.below(2) ? 1.0f : -1.0f);
      }
      rays.push_back(r);
      for (int k = 0; k < 3; ++k) {
        if (at(r.direction, k) == 0) set(r.direction, k, -0.0f);
        if (at(r.origin, k) == 0) set(r.origin, k, -0.0f);
      }
      twins.push_back(r);
    }
  }
  const std::vector<Hit> hits = trace(*committed, rays), twin_hits = trace(*committed, twins);
  for (size_t i = 0; i < rays.size(); ++i) {
    const Hit expected = brute_force(view, rays[i]);
    ASSERT_TRUE(same_bits(hits[i], expected))
        << i << ": " << text(hits[i]) << ", brute force: " << text(expected);
    ASSERT_TRUE(same_bits(hits[i], twin_hits[i])) << i;
  }
}

// Catalogue row 7.
TEST_P(TreeTrace, DenormalDirectionsMeetWhatNormalisedOnesMeet)
{
  Random rng(15);
  const auto committed = commit(scene_of(soup(rng, 500, 0.4f, 1)));
  std::vector<Ray> rays, tiny;
  for (int i = 0; i < 5000; ++i) {
    // Few bits, so that the denormal direction is the same direction.
    const auto coarse = [&] { return float(int(rng.below(2049)) - 1024); };
    Ray r = {rng.point(2), 0, {coarse(), coarse(), coarse()}, infinity};
    rays.push_back(r);
    const float scale = 0x1p-146f;  // 1024 becomes 1e-41
    r.direction = r.direction * scale;
    tiny.push_back(r);
  }
  // The directions' last bits are lost where 2^-146 times an odd number rounds: only multiples of 8 survive.
  for (size_t i = 0; i < rays.size(); ++i) {
    for (int k = 0; k < 3; ++k) {
      const float d = std::round(at(rays[i].direction, k) / 8) * 8;
      set(rays[i].direction, k, d);
      set(tiny[i].direction, k, d * 0x1p-146f);
    }
  }
  const std::vector<Hit> expected = trace(*committed, rays), hits = trace(*committed, tiny);
  int num_hits = 0;
  for (size_t i = 0; i < rays.size(); ++i) {
    ASSERT_EQ(hits[i].triangle, expected[i].triangle) << i;
    ASSERT_EQ(hits[i].u, expected[i].u);
    num_hits += hits[i].triangle != invalid_id;
  }
  EXPECT_GT(num_hits, 500);
}

// Catalogue row 13.
TEST_P(TreeTrace, NearLayersAreToldApart)
{
  Mesh both = icosphere(4, 1);
  const size_t num_inner = both.triangles.size();
  both.add(icosphere(4, 1 + 4e-5f));
  const auto committed = commit(scene_of(both));
  Random rng(16);
  std::vector<Ray> rays;
  for (int i = 0; i < 100000; ++i) rays.push_back({rng.point(0.5f), 0, rng.direction(), infinity});
  for (const Hit &h : trace(*committed, rays)) ASSERT_LT(h.triangle, num_inner);
}

// Catalogue row 14.
TEST_P(TreeTrace, OfCoincidentTrianglesTheFirstIsMet)
{
  Random rng(17);
  const Mesh mesh = soup(rng, 500, 0.4f, 1);
  SceneMaker maker;
  for (int i = 0; i < 3; ++i) maker.add_world(mesh);
  const auto committed = commit(maker.scene());
  for (const Hit &h : trace(*committed, mixed_rays(rng, 20000, 1))) {
    if (h.triangle != invalid_id) {
      ASSERT_LT(h.triangle, mesh.triangles.size());
    }
  }
}

std::vector<std::vector<Hit>> trace_all_hits(const CpuScene &scene, const std::vector<Ray> &rays,
                                             const SceneView &view)
{
  std::vector<uint64_t> offsets(rays.size() + 1);
  TraceRequest request;
  request.query = QueryKind::All;
  request.num_rays = rays.size();
  request.rays = rays.data();
  request.offsets = offsets.data();
  scene.trace(request);
  std::vector<FullHit> hits(offsets.back());
  std::vector<uint64_t> again(rays.size() + 1);
  request.hits = hits.data();
  request.hit_capacity = hits.size();
  request.offsets = again.data();
  scene.trace(request);
  EXPECT_EQ(offsets, again);
  std::vector<std::vector<Hit>> result(rays.size());
  for (size_t i = 0; i < rays.size(); ++i) {
    for (uint64_t k = offsets[i]; k < offsets[i + 1]; ++k) {
      const FullHit &f = hits[k];
      Hit h = {f.t, f.u, f.v, invalid_id, invalid_id};
      for (uint32_t t = 0; t < view.num_triangles; ++t) {
        const Segment &s = view.segments[view.triangle_segment[t]];
        if (s.geometry == f.geometry && t - s.first_triangle == f.primitive) h.triangle = t;
      }
      for (uint32_t p = 0; p < view.num_placements; ++p) {
        if (view.placements[p].instance == f.instance) h.placement = p;
      }
      result[i].push_back(h);
    }
  }
  return result;
}

// Catalogue row 15: a stack of touching boxes, and rays through faces, edges and corners.
TEST_P(TreeTrace, AllHitsAreEvenSortedAndOnce)
{
  Random rng(18);
  Mesh stack;
  for (int i = 0; i < 5; ++i) stack.add(box({-1, float(i), -1}, {1, float(i + 1), 1}));
  SceneMaker maker;
  maker.add_world(stack);
  maker.add_world(icosphere(2, 0.75f));
  const auto scene = maker.scene();
  const SceneView view = scene->view();
  std::vector<Ray> rays;
  for (int i = 0; i < 3000; ++i) {
    const auto grid = [&] { return float(int(rng.below(9)) - 4) * 0.25f; };
    Ray r = {{grid() * 8, grid() * 8 + 0.5f, 9}, 0, {0, 0, -1}, infinity};
    if (i % 3 != 0) r.direction = Vec3f{grid(), grid() * 5, grid()} - r.origin;
    if (i % 3 == 2) r.direction = scene->positions[rng.below(uint32_t(scene->positions.size()))] - r.origin;
    rays.push_back(r);
  }
  for (Accel accel : {GetParam(), Accel::Embree}) {
    BuildOptions chosen = options();
    chosen.accel = accel;
    const auto committed = commit(scene, chosen);
    const auto hits = trace_all_hits(*committed, rays, view);
    uint64_t total = 0;
    for (size_t i = 0; i < rays.size(); ++i) {
      // Embree meets one or both triangles of an edge.
      if (accel != Accel::Embree) {
        ASSERT_EQ(hits[i].size() % 2, 0u) << i;
        const std::vector<Hit> expected = brute_force_all(view, rays[i]);
        ASSERT_EQ(hits[i].size(), expected.size()) << i;
        for (size_t k = 0; k < expected.size(); ++k) ASSERT_TRUE(same_bits(hits[i][k], expected[k])) << i;
      }
      for (size_t k = 1; k < hits[i].size(); ++k) ASSERT_TRUE(hit_precedes(view, hits[i][k - 1], hits[i][k]));
      total += hits[i].size();
    }
    EXPECT_GT(total, 5000u);
  }
}

TEST_P(TreeTrace, AllHitsSayHowMuchRoomTheyNeed)
{
  Random rng(19);
  const auto committed = commit(scene_of(soup(rng, 200, 1, 1)));
  const std::vector<Ray> rays = mixed_rays(rng, 500, 1);
  std::vector<uint64_t> offsets(rays.size() + 1), counted(rays.size() + 1);
  std::vector<CompactHit> hits(3);
  TraceRequest request;
  request.query = QueryKind::All;
  request.compact = true;
  request.num_rays = rays.size();
  request.rays = rays.data();
  request.offsets = counted.data();
  committed->trace(request);
  request.offsets = offsets.data();
  request.hits = hits.data();
  request.hit_capacity = hits.size();
  try {
    committed->trace(request);
    FAIL();
  } catch (const Error &error) {
    EXPECT_EQ(error.result(), GPURT_ERROR_INVALID_ARGUMENT);
  }
  EXPECT_EQ(offsets, counted);
}

// The leaves and the sort that devices use: lists of crossings become the sorted hits, whatever their t: of directions
// so short or so long that it overflows or vanishes too.
template <class AccelView>
void expect_sorted_crossings(const AccelView &accel, const SceneView &view, Random &rng,
                             uint64_t least_repeated)
{
  uint64_t num_infinite = 0, num_repeated = 0;
  for (Ray ray : mixed_rays(rng, 3000, 1)) {
    const float scales[] = {1, 1, 0x1p-140f, 0x1p-60f, 0x1p60f, 0x1p120f};
    ray.direction = ray.direction * scales[rng.below(6)];
    ray.tmax = infinity;
    const std::vector<Hit> expected = brute_force_all(view, ray);
    std::vector<Hit> hits;
    trace_all<TriangleTest::Watertight, false, false>(accel, view, ray,
                                                      [&](const Hit &h) { hits.push_back(h); });
    num_repeated += hits.size();
    hits.resize(sort_hits(view, hits.data(), hits.size()));
    num_repeated -= hits.size();
    ASSERT_EQ(hits.size(), expected.size());
    for (size_t i = 0; i < hits.size(); ++i) {
      ASSERT_TRUE(same_bits(hits[i], expected[i]));
      num_infinite += hits[i].t == infinity;
    }
    ASSERT_TRUE(same_bits((trace_closest<TriangleTest::Watertight, false, false>(accel, view, ray)),
                          brute_force(view, ray)));
  }
  EXPECT_GT(num_infinite, 100u);
  EXPECT_GE(num_repeated, least_repeated);
}

std::vector<LeafTriangle> leaf_triangles(const SceneView &view, const std::vector<uint32_t> &references)
{
  std::vector<LeafTriangle> leaves;
  for (uint32_t t : references) {
    const UInt3 c = view.indices[t];
    leaves.push_back({view.positions[c.x], t, view.positions[c.y], 0, view.positions[c.z], 0});
  }
  return leaves;
}

TEST_P(TreeTrace, ListsOfCrossingsBecomeTheSortedHits)
{
  Random rng(20);
  const auto scene = scene_of(soup(rng, 300, 0.7f, 1));
  const SceneView view = scene->view();
  if (GetParam() == Accel::KdTree) {
    const HostKdTree tree = commit(scene)->export_tree(0);
    const std::vector<LeafTriangle> leaves = leaf_triangles(view, tree.references);
    const KdGroupView group = {
        {tree.nodes.data(), tree.references.data(), tree.bounds, uint32_t(tree.nodes.size())}, leaves.data()};
    expect_sorted_crossings(KdAccelView{&group, {}, 1}, view, rng, 100);
  } else {
    KdSource source;
    source.count = scene->indices.size();
    source.positions = scene->positions.data();
    source.indices = scene->indices.data();
    BvhBuildStats stats;
    const HostBvh tree = build_bvh(source, nullptr, stats);
    const std::vector<LeafTriangle> leaves = leaf_triangles(view, tree.references);
    const BvhGroupView group = {
        {tree.nodes.data(), tree.references.data(), tree.bounds, tree.frame, tree.root}, leaves.data()};
    expect_sorted_crossings(BvhAccelView{&group, {}, 1}, view, rng, 10);
  }
}

TEST(SortHits, ListsOfAnyLengthAreSorted)
{
  Random rng(23);
  const auto scene = scene_of(soup(rng, 400, 0.7f, 1));
  const SceneView view = scene->view();
  for (uint32_t n = 0; n < 400; n += n < 70 ? 1 : 37) {
    std::vector<Hit> hits;
    for (uint32_t i = 0; i < n; ++i) {
      // A triangle comes with the same t each time; few values, so that ids decide.
      const uint32_t triangle = rng.below(n);
      const float t = triangle % 5 == 0 ? infinity : float(triangle % 7);
      hits.push_back({t, 0.25f, 0.5f, triangle, invalid_id});
    }
    std::vector<Hit> expected = hits;
    std::sort(expected.begin(), expected.end(),
              [&](const Hit &a, const Hit &b) { return hit_precedes(view, a, b); });
    expected.erase(std::unique(expected.begin(), expected.end(),
                               [](const Hit &a, const Hit &b) { return a.triangle == b.triangle; }),
                   expected.end());
    hits.resize(sort_hits(view, hits.data(), hits.size()));
    ASSERT_EQ(hits.size(), expected.size()) << n;
    for (size_t i = 0; i < hits.size(); ++i) ASSERT_TRUE(same_bits(hits[i], expected[i])) << n;
  }
}

TEST_P(TreeTrace, InstructionSetsGiveTheSameBits)
{
  Random rng(21);
  Mesh mesh = soup(rng, 3000, 0.2f, 1);
  mesh.add(integer_grid(8));
  const auto scene = scene_of(mesh);
  const std::vector<Ray> rays = mixed_rays(rng, 30000, 2);
  for (TriangleTest test : {TriangleTest::Watertight, TriangleTest::MollerTrumbore, TriangleTest::Double}) {
    const auto committed = commit(scene, options(test));
    int num_variants = 0;
    std::vector<Hit> first;
    for (const char *isa : {"generic", "x86_64", "x86_64_v3"}) {
      const CpuKernels *kernels = cpu_kernels(isa);
      if (kernels == nullptr) continue;
      CpuAccel accel = committed->accel();
      const TraceKernels &table =
          (GetParam() == Accel::Bvh ? kernels->bvh : kernels->trace)(test, false, false);
      std::vector<Hit> hits(rays.size());
      table.closest(accel, rays.data(), hits.data(), uint32_t(rays.size()));
      std::vector<uint8_t> occluded(rays.size());
      table.occluded(accel, rays.data(), occluded.data(), uint32_t(rays.size()));
      if (num_variants++ == 0) first = hits;
      for (size_t i = 0; i < rays.size(); ++i) {
        ASSERT_TRUE(same_bits(hits[i], first[i])) << isa << " " << i;
        ASSERT_EQ(occluded[i] != 0, first[i].triangle != invalid_id);
      }
    }
    EXPECT_GE(num_variants, 1);
  }
}

TEST_P(TreeTrace, TheOtherTestsMeetWhatTheirBruteForceMeets)
{
  Random rng(22);
  const auto scene = scene_of(soup(rng, 1000, 0.3f, 1));
  const SceneView view = scene->view();
  const std::vector<Ray> rays = mixed_rays(rng, 10000, 1);
  const std::vector<Hit> moller = trace(*commit(scene, options(TriangleTest::MollerTrumbore)), rays);
  const std::vector<Hit> in_double = trace(*commit(scene, options(TriangleTest::Double)), rays);
  for (size_t i = 0; i < rays.size(); ++i) {
    ASSERT_TRUE(same_bits(moller[i], brute_force<TriangleTest::MollerTrumbore>(view, rays[i])));
    ASSERT_TRUE(same_bits(in_double[i], brute_force<TriangleTest::Double>(view, rays[i])));
  }
}

// ---- Shared geometries and alpha masks.

Transform identity() { return {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}}; }
Transform scaling_turn(float scale, float cosine, float sine, Vec3f offset)
{
  return {{{scale * cosine, 0, scale * sine, offset.x},
           {0, scale, 0, offset.y},
           {-scale * sine, 0, scale * cosine, offset.z}}};
}
Transform inverse_of(float scale, float cosine, float sine, Vec3f o)
{
  const float s = 1 / scale;
  return {{{s * cosine, 0, -s * sine, -s * (cosine * o.x - sine * o.z)},
           {0, s, 0, -s * o.y},
           {s * sine, 0, s * cosine, -s * (sine * o.x + cosine * o.z)}}};
}

std::shared_ptr<CompiledScene> scene_with_placements(Random &rng, int num_places)
{
  SceneMaker maker;
  maker.add_world(soup(rng, 200, 0.3f, 2));
  for (int g = 0; g < 3; ++g) {
    std::vector<Transform> places, inverses;
    for (int i = 0; i < num_places; ++i) {
      const float angle = rng.uniform(0, 6), scale = rng.uniform(0.1f, 0.5f);
      const Vec3f offset = rng.point(2);
      places.push_back(scaling_turn(scale, std::cos(angle), std::sin(angle), offset));
      inverses.push_back(inverse_of(scale, std::cos(angle), std::sin(angle), offset));
    }
    maker.add_shared(g == 0   ? icosphere(1, 1)
                     : g == 1 ? box({-1, -1, -1}, {1, 1, 1})
                              : soup(rng, 50, 0.5f, 1),
                     places, inverses);
  }
  maker.add_shared({}, {identity()}, {identity()});
  return maker.scene();
}

TEST_P(TreeTrace, PlacementsMeetWhatBruteForceMeets)
{
  Random rng(23);
  expect_brute_force(scene_with_placements(rng, 2), mixed_rays(rng, 5000, 2), "few placements");
  expect_brute_force(scene_with_placements(rng, 60), mixed_rays(rng, 3000, 2), "many placements");
}

TEST_P(TreeTrace, CoincidentPlacementsGiveTheSmallerInstance)
{
  const Transform one = identity();
  SceneMaker maker;
  maker.add_shared(box({-1, -1, -1}, {1, 1, 1}), {one, one, one}, {one, one, one});
  const auto scene = maker.scene();
  std::swap(scene->placements[0].instance, scene->placements[2].instance);
  const auto committed = commit(scene);
  Random rng(24);
  for (const Hit &h : trace(*committed, mixed_rays(rng, 2000, 1))) {
    if (h.triangle != invalid_id) {
      ASSERT_EQ(h.placement, 2u);
    }
  }
}

TEST_P(TreeTrace, ExtremePlacementScalesKeepHits)
{
  for (float scale : {0x1p-60f, 0x1p60f}) {
    const Transform big = scaling_turn(1 / scale, 1, 0, {0, 0, 0}),
                    small = scaling_turn(scale, 1, 0, {0, 0, 0});
    SceneMaker maker;
    maker.add_shared(icosphere(2, scale), {big, big}, {small, small});
    Random rng(25);
    const auto scene = maker.scene();
    const auto plain = commit(scene_of(icosphere(2, 1)));
    const std::vector<Ray> rays = mixed_rays(rng, 5000, 1);
    const std::vector<Hit> hits = trace(*commit(scene), rays), expected = trace(*plain, rays);
    for (size_t i = 0; i < rays.size(); ++i) {
      ASSERT_EQ(hits[i].triangle, expected[i].triangle) << i;
      ASSERT_EQ(hits[i].t, expected[i].t);
    }
  }
}

TEST_P(TreeTrace, AlphaMasksAreHoles)
{
  SceneMaker maker;
  Material hole{};
  hole.alpha = 0.25f;
  hole.alpha_cutoff = 0.5f;
  hole.base_color_texture = invalid_id;
  Material solid = hole;
  solid.alpha = 0.75f;
  const uint32_t hole_id = maker.add_material(hole), solid_id = maker.add_material(solid);
  maker.add_world(icosphere(2, 1), hole_id);
  maker.add_world(icosphere(2, 2), solid_id);
  maker.add_world(icosphere(2, 3));
  const auto scene = maker.scene();
  Random rng(26);
  std::vector<Ray> rays;
  for (int i = 0; i < 3000; ++i) rays.push_back({rng.point(0.3f), 0, rng.direction(), infinity});
  for (Accel accel : {GetParam(), Accel::Embree}) {
    BuildOptions chosen = options();
    chosen.accel = accel;
    const auto committed = commit(scene, chosen);
    for (const Hit &h : trace(*committed, rays)) {
      ASSERT_NE(h.triangle, invalid_id);
      ASSERT_EQ(scene->triangle_segment[h.triangle], 1u);
    }
    std::vector<Ray> shorter = rays;
    for (Ray &r : shorter) r.tmax = 1.5f;
    for (uint8_t occluded : trace_occluded(*committed, shorter)) ASSERT_EQ(occluded, 0);
    for (const auto &hits : trace_all_hits(*committed, {rays.begin(), rays.begin() + 50}, scene->view()))
      ASSERT_EQ(hits.size(), 2u);
  }
}

}  // namespace
}  // namespace gpurt
