// Patches as rays meet them: within the bound that the commit tells, without cracks, within memory; on the CPU and on a
// CUDA device.
#include "../support/patch_shapes.h"

namespace {

using namespace gpurt_test;

class Patches : public ::testing::TestWithParam<gpurt_device_type> {
 protected:
  void SetUp() override
  {
    if (GetParam() == GPURT_DEVICE_CUDA && !has_cuda()) GTEST_SKIP() << "no CUDA device";
  }
};
INSTANTIATE_TEST_SUITE_P(Cpu, Patches, ::testing::Values(GPURT_DEVICE_CPU));
INSTANTIATE_TEST_SUITE_P(Cuda, Patches, ::testing::Values(GPURT_DEVICE_CUDA));

Point3 transformed(const std::array<float, 12> &m, const Point3 &p, double w)
{
  Point3 q;
  for (size_t i = 0; i < 3; ++i) {
    q[i] = double(m[4 * i + 3]) * w;
    for (size_t j = 0; j < 3; ++j) q[i] += double(m[4 * i + j]) * p[j];
  }
  return q;
}

gpurt_result commit_within(gpurt_scene scene, float tolerance)
{
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_BVH;
  build.patch_tolerance = tolerance;
  return gpurt_scene_commit(scene, &build);
}

gpurt_scene_facts facts_of(gpurt_scene scene)
{
  gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
  GPURT_EXPECT_OK(gpurt_scene_get_facts(scene, &facts));
  return facts;
}

// From points of the surface the triangles are no further than the bound, along the normal to either side; with one placement
// in world space, with two in their own. The bound is no larger than what was asked for, and not much too large.
TEST_P(Patches, TrianglesStayWithinTheBoundInTheWorld)
{
  Device device = make_device(GetParam());
  std::mt19937_64 rng(1);
  const std::array<float, 12> large = {3, 0, 0, 1, 0, 0, -2, 0, 0, 2, 0, 5},
                              small = {0.1f, 0, 0, -9, 0, 0.2f, 0, 0, 0, 0, 0.1f, 0};
  for (const auto &places : {std::vector{large}, std::vector{large, small}}) {
    for (const float tolerance : {0.03f, 0.001f, 0.0f}) {
      const std::vector<PatchNet> nets = closed_patches(2, 0.15, 77);
      Scene scene;
      GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
      add_patches(scene, nets, 0, places);
      GPURT_ASSERT_OK(commit_within(scene, tolerance));
      const double bound = facts_of(scene).patch_error;
      EXPECT_GT(bound, 0);
      if (tolerance > 0) {
        EXPECT_LE(bound, double(tolerance));
      }
      std::vector<gpurt_ray> rays;
      std::vector<double> share;  // of the bound, which is that of the larger placement
      for (int i = 0; i < 2000; ++i) {
        const SurfacePoint s = evaluate(nets[pick(rng, nets.size())], uniform(rng), uniform(rng));
        const size_t place = pick(rng, places.size());
        const auto &m = places[place];
        share.push_back(place == 0 ? 1 : 0.2 / 3);
        const Point3 p = transformed(m, s.p, 1), du = transformed(m, s.du, 0), dv = transformed(m, s.dv, 0);
        Point3 n;
        double length2 = 0;
        for (size_t k = 0; k < 3; ++k) {
          n[k] = du[(k + 1) % 3] * dv[(k + 2) % 3] - du[(k + 2) % 3] * dv[(k + 1) % 3];
          length2 += n[k] * n[k];
        }
        // From twice the bound on one side to twice the bound on the other.
        gpurt_ray ray{};
        for (size_t k = 0; k < 3; ++k) {
          n[k] *= 2 * bound * share.back() / std::sqrt(length2);
          ray.origin[k] = float(p[k] - n[k]);
          ray.direction[k] = float(2 * n[k]);
        }
        ray.tmax = 1;
        rays.push_back(ray);
      }
      const std::vector<gpurt_hit> hits = trace_closest(scene, rays);
      double worst = 0;
      for (size_t i = 0; i < hits.size(); ++i) {
        ASSERT_NE(hits[i].primitive, GPURT_INVALID_ID) << "point " << i;
        // Coordinates are rounded to 2^-24 of 16.
        const double distance = std::abs(double(hits[i].t) - 0.5) * 4 * bound * share[i];
        worst = std::max(worst, (distance - 2e-6) / share[i]);
      }
      std::printf("bound %.3g, largest distance %.3g\n", bound, worst);
      // A normal is a few degrees off the shortest way.
      EXPECT_LE(worst, bound * 1.02);
      EXPECT_GE(worst, bound * 0.05);
    }
  }
}

// Catalogue rows 1 and 2 for patches: rays at boundaries and corners of patches, met from either end and along either
// parameter, from within a closed surface.
TEST_P(Patches, LeaveNoCracksForRays)
{
  Device device = make_device(GetParam());
  std::mt19937_64 rng(2);
  for (const float tolerance : {0.1f, 0.01f, 0.0f}) {
    const std::vector<PatchNet> nets = closed_patches(3, 0.15, 78);
    Scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
    add_patches(scene, nets, 0, {{1.3f, 0.2f, 0, 3, -0.1f, 0.9f, 0.3f, 1, 0, 0.1f, 1.1f, -2}});
    GPURT_ASSERT_OK(commit_within(scene, tolerance));
    std::vector<gpurt_ray> rays;
    for (int i = 0; i < 20000; ++i) {
      const double along = i % 7 == 0 ? double(rng() & 1) : uniform(rng);
      const double side = double(rng() & 1);
      const bool is_row = rng() & 1;
      const SurfacePoint s =
          evaluate(nets[pick(rng, nets.size())], is_row ? along : side, is_row ? side : along);
      const Point3 p = transformed({1.3f, 0.2f, 0, 3, -0.1f, 0.9f, 0.3f, 1, 0, 0.1f, 1.1f, -2}, s.p, 1);
      gpurt_ray ray{};
      const double center[3] = {3, 1, -2};
      for (size_t k = 0; k < 3; ++k) {
        ray.origin[k] = float(center[k] + uniform(rng, -0.3, 0.3));
        ray.direction[k] = float(p[k] - double(ray.origin[k]));
      }
      ray.tmax = 1e30f;
      rays.push_back(ray);
    }
    size_t num_missed = 0;
    for (const gpurt_hit &hit : trace_closest(scene, rays)) num_missed += hit.primitive == GPURT_INVALID_ID;
    EXPECT_EQ(num_missed, 0u) << "tolerance " << tolerance;
  }
}

// The same of a surface whose patches want very different numbers of triangles, half of them in one geometry and half in
// another: along every boundary they have the same vertices.
TEST_P(Patches, LeaveNoCracksBetweenFlatAndCurved)
{
  Device device = make_device(GetParam());
  std::mt19937_64 rng(3);
  for (const float tolerance : {0.1f, 0.01f, 0.001f}) {
    std::vector<PatchNet> nets = closed_patches(3, 0.1, 80);
    // Inner points are a patch's own.
    for (size_t i = 0; i < nets.size(); i += 3) {
      for (size_t k : {5, 6, 9, 10}) {
        for (float &c : nets[i][k]) c *= float(uniform(rng, 0.7, 1.6));
      }
    }
    Scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
    std::vector<PatchNet> halves[2];
    for (size_t i = 0; i < nets.size(); ++i) halves[i % 2].push_back(nets[i]);
    for (const auto &half : halves) add_patches(scene, half);
    GPURT_ASSERT_OK(commit_within(scene, tolerance));
    std::vector<gpurt_ray> rays;
    for (int i = 0; i < 30000; ++i) {
      // At boundaries, and at the rim's triangles beside them.
      const double side = double(rng() & 1), off = i % 3 == 0 ? uniform(rng, 0, 0.2) : 0;
      const double across = side + (side > 0 ? -off : off),
                   along = i % 7 == 0 ? double(rng() & 1) : uniform(rng);
      const bool is_row = rng() & 1;
      const SurfacePoint s =
          evaluate(nets[pick(rng, nets.size())], is_row ? along : across, is_row ? across : along);
      gpurt_ray ray{};
      for (size_t k = 0; k < 3; ++k) {
        ray.origin[k] = float(uniform(rng, -0.2, 0.2));
        ray.direction[k] = float(s.p[k] - double(ray.origin[k]));
      }
      ray.tmax = 1e30f;
      rays.push_back(ray);
    }
    size_t num_missed = 0;
    for (const gpurt_hit &hit : trace_closest(scene, rays)) num_missed += hit.primitive == GPURT_INVALID_ID;
    EXPECT_EQ(num_missed, 0u) << "tolerance " << tolerance;
  }
}

// What a commit takes is known before it is allocated: it fails at once, says why, and leaves the scene as it was.
TEST_P(Patches, SayWhatTheyTakeBeforeTheyTakeIt)
{
  Device device = make_device(GetParam(), 0, uint64_t(64) << 20);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_patches(scene, closed_patches(2, 0.15, 79));
  GPURT_ASSERT_OK(commit_within(scene, 0.01f));
  const gpurt_scene_facts before = facts_of(scene);
  // Twenty million triangles.
  const float fine = 0.01f * float(before.num_triangles) / 2e7f;
  EXPECT_EQ(commit_within(scene, fine), GPURT_ERROR_OUT_OF_MEMORY);
  EXPECT_NE(std::string(gpurt_last_error()).find("patch_tolerance"), std::string::npos) << gpurt_last_error();
  const gpurt_scene_facts after = facts_of(scene);
  EXPECT_EQ(before.num_triangles, after.num_triangles);
  EXPECT_EQ(before.patch_error, after.patch_error);
  gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
  GPURT_EXPECT_OK(gpurt_device_get_properties(device, &p));
  EXPECT_LE(p.memory_peak_bytes, uint64_t(64) << 20);
}

}  // namespace
