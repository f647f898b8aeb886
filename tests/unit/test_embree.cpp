// Embree behind the accelerator interface, compared with the kd-tree.
#include "accel_test.h"

namespace gpurt {
namespace {

using namespace test;

BuildOptions embree_options(TriangleTest test = TriangleTest::Watertight)
{
  BuildOptions options;
  options.accel = Accel::Embree;
  options.triangle_test = test;
  return options;
}

// Where our t is exact, Embree's differs by the rounding of coordinates as large as the scene, magnified where the ray
// grazes: 1e-4 is loose, and far below the distance between random triangles.
void expect_alike(const std::shared_ptr<CompiledScene> &scene, const std::vector<Ray> &rays)
{
  const std::vector<Hit> ours = trace(*commit(scene), rays);
  for (TriangleTest test : {TriangleTest::Watertight, TriangleTest::MollerTrumbore}) {
    const auto committed = commit(scene, embree_options(test));
    const std::vector<Hit> theirs = trace(*committed, rays);
    const std::vector<uint8_t> occluded = trace_occluded(*committed, rays);
    int num_different = 0;
    for (size_t i = 0; i < rays.size(); ++i) {
      num_different += ours[i].triangle != theirs[i].triangle || ours[i].placement != theirs[i].placement;
      EXPECT_EQ(occluded[i] != 0, theirs[i].triangle != invalid_id) << i;
      if (ours[i].triangle != theirs[i].triangle || ours[i].triangle == invalid_id) continue;
      EXPECT_NEAR(ours[i].t, theirs[i].t, 1e-4f * (1 + std::abs(ours[i].t)));
    }
    // Edges are met by chance alone.
    EXPECT_LE(num_different, int(rays.size() / 500));
  }
}

TEST(Embree, MeetsWhatTheKdTreeMeets)
{
  Random rng(41);
  std::vector<Ray> rays = mixed_rays(rng, 20000, 1);
  for (Ray &r : rays)
    r.direction = r.direction + rng.direction() * 1e-3f;  // off the axes, so that no edge is met exactly
  expect_alike(scene_of(soup(rng, 2000, 0.2f, 1)), rays);
  expect_alike(scene_of({}), rays);
  SceneMaker maker;
  maker.add_world(soup(rng, 300, 0.3f, 1));
  std::vector<Transform> places, inverses;
  for (int i = 0; i < 20; ++i) {
    const Vec3f o = rng.point(1);
    const float s = rng.uniform(0.1f, 0.4f);
    places.push_back({{{0, -s, 0, o.x}, {s, 0, 0, o.y}, {0, 0, s, o.z}}});
    inverses.push_back({{{0, 1 / s, 0, -o.y / s}, {-1 / s, 0, 0, o.x / s}, {0, 0, 1 / s, -o.z / s}}});
  }
  maker.add_shared(icosphere(2, 1), places, inverses);
  expect_alike(maker.scene(), rays);
}

TEST(Embree, InvalidRaysMiss)
{
  const auto committed = commit(scene_of(icosphere(2, 1)), embree_options());
  const float nan = std::nanf("");
  const std::vector<Ray> rays = {{{0, 0, 0}, 0, {0, 0, 0}, infinity},   {{nan, 0, 0}, 0, {0, 0, 1}, infinity},
                                 {{0, 0, 0}, 0, {0, nan, 1}, infinity}, {{0, 0, 0}, 2, {0, 0, 1}, 1},
                                 {{0, 0, 0}, 0, {0, 0, infinity}, 5},   {{0, 0, 0}, nan, {0, 0, 1}, 9}};
  for (const Hit &h : trace(*committed, rays)) EXPECT_EQ(h.triangle, invalid_id);
  for (uint8_t o : trace_occluded(*committed, rays)) EXPECT_EQ(o, 0);
  EXPECT_EQ(trace(*committed, rays)[4].t, 5.0f);
  // A ray may begin behind its origin, and its direction may be denormal.
  const std::vector<Hit> hits = trace(*committed, {{{0, 0, 3}, -infinity, {0, 0, 1}, infinity},
                                                   {{0, 0, 3}, -3, {0, 0, 1}, infinity},
                                                   {{0, 0, 0}, 0, {0, 0, 1e-40f}, infinity}});
  EXPECT_NEAR(hits[0].t, -4, 1e-2);
  EXPECT_NEAR(hits[1].t, -2, 1e-2);
  EXPECT_NE(hits[2].triangle, invalid_id);
}

TEST(Embree, ItsMemoryIsCountedAndGivenBack)
{
  Random rng(42);
  const uint64_t before = backend().memory()->used();
  {
    const auto committed = commit(scene_of(soup(rng, 20000, 0.1f, 1)), embree_options());
    EXPECT_GT(committed->accel_facts().accel_bytes, 20000u * 30);
    EXPECT_GE(backend().memory()->used(), before + committed->accel_facts().accel_bytes);
  }
  EXPECT_EQ(backend().memory()->used(), before);

  BackendOptions limited;
  limited.memory_limit_bytes = 1 << 20;
  CpuBackend small(limited);
  try {
    small.commit(scene_of(soup(rng, 100000, 0.1f, 1)), embree_options());
    FAIL();
  } catch (const Error &error) {
    EXPECT_EQ(error.result(), GPURT_ERROR_OUT_OF_MEMORY);
    EXPECT_NE(std::string(error.what()).find("memory_limit_bytes"), std::string::npos) << error.what();
  }
  EXPECT_EQ(small.memory()->used(), 0u);
}

TEST(Embree, HasNoTestInDouble)
{
  try {
    commit(scene_of(icosphere(0, 1)), embree_options(TriangleTest::Double));
    FAIL();
  } catch (const Error &error) {
    EXPECT_EQ(error.result(), GPURT_ERROR_UNSUPPORTED);
  }
  // Where the caller leaves the choice, the kd-tree takes it.
  BuildOptions either;
  either.triangle_test = TriangleTest::Double;
  EXPECT_EQ(commit(scene_of(icosphere(0, 1)), either)->accel_facts().accel, Accel::KdTree);
  EXPECT_EQ(commit(scene_of(icosphere(0, 1)), {})->accel_facts().accel, Accel::Embree);
  BuildOptions bvh;
  bvh.accel = Accel::Bvh;
  bvh.triangle_test = TriangleTest::Double;
  EXPECT_EQ(commit(scene_of(icosphere(0, 1)), bvh)->accel_facts().accel, Accel::Bvh);
}

TEST(CpuBackend, BatchesHaveTheSameHitsOnAnyNumberOfThreads)
{
  Random rng(43);
  const auto scene = scene_of(soup(rng, 1000, 0.2f, 1));
  const std::vector<Ray> rays = mixed_rays(rng, 10001, 1);
  const std::vector<Hit> expected = trace(*commit(scene), rays);
  for (uint32_t num_threads : {1u, 3u, 7u}) {
    BackendOptions options;
    options.num_threads = num_threads;
    CpuBackend some(options);
    EXPECT_EQ(some.info().num_threads, num_threads);
    const auto committed = some.commit(scene, kd_options());
    std::vector<FullHit> hits(rays.size());
    std::vector<CompactHit> compact(rays.size());
    std::vector<uint8_t> occluded(rays.size());
    TraceRequest request;
    request.num_rays = rays.size();
    request.rays = rays.data();
    request.hits = hits.data();
    committed->trace(request);
    request.compact = true;
    request.hits = compact.data();
    committed->trace(request);
    request.query = QueryKind::Any;
    request.occluded = occluded.data();
    committed->trace(request);
    for (size_t i = 0; i < rays.size(); ++i) {
      ASSERT_EQ(hits[i].primitive, expected[i].triangle);
      ASSERT_EQ(hits[i].t, expected[i].t);
      ASSERT_EQ(hits[i].geometry, expected[i].triangle == invalid_id ? invalid_id : 0u);
      ASSERT_EQ(compact[i].primitive, expected[i].triangle);
      ASSERT_EQ(occluded[i], expected[i].triangle != invalid_id);
    }
  }
}

}  // namespace
}  // namespace gpurt
