// CUDA devices: listing, creation, memory that runs out and what comes after it.
#include <thread>

#include "scenes.h"

namespace gpurt_test {
namespace {

std::vector<gpurt_device_properties> list_devices()
{
  uint32_t count = 0;
  GPURT_EXPECT_OK(gpurt_device_enumerate(nullptr, 0, &count));
  std::vector<gpurt_device_properties> all(count, gpurt_device_properties GPURT_DEVICE_PROPERTIES_INIT);
  GPURT_EXPECT_OK(gpurt_device_enumerate(all.data(), count, &count));
  return all;
}

// Also where there is no driver, in a build with CUDA and in one without.
TEST(Devices, AreListedWithTheCpuFirst)
{
  const auto all = list_devices();
  ASSERT_GE(all.size(), 1u);
  EXPECT_EQ(all[0].type, GPURT_DEVICE_CPU);
  for (size_t i = 1; i < all.size(); ++i) {
    EXPECT_EQ(all[i].type, GPURT_DEVICE_CUDA);
    EXPECT_EQ(all[i].ordinal, uint32_t(i - 1));
  }
}

TEST(Devices, ThatAreNotThereAreAnErrorThatSaysSo)
{
  gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
  desc.type = GPURT_DEVICE_CUDA;
  desc.ordinal = 1000;
  Device device;
  const gpurt_result result = gpurt_device_create(&desc, device.out());
  // Without a CUDA backend in the build there is nothing that could be asked.
  EXPECT_TRUE(result == GPURT_ERROR_DEVICE || result == GPURT_ERROR_UNSUPPORTED) << gpurt_result_name(result);
  EXPECT_NE(std::string(gpurt_last_error()).find("CUDA"), std::string::npos) << gpurt_last_error();
}

// The CPU works in a process whose CUDA devices were asked for in vain.
TEST(Devices, OfTheCpuWorkWithoutADriver)
{
  list_devices();
  const Device device = make_device(GPURT_DEVICE_CPU);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_mesh(scene, icosphere(1));
  commit(scene);
  const auto hits = trace_closest(scene, {{{0, 0, 3}, 0, {0, 0, -1}, 10}});
  EXPECT_NE(hits[0].primitive, GPURT_INVALID_ID);
}

TEST(CudaDevice, TellsWhatItIs)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA, 0, uint64_t(1) << 30);
  gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
  GPURT_ASSERT_OK(gpurt_device_get_properties(device, &p));
  EXPECT_EQ(p.type, GPURT_DEVICE_CUDA);
  EXPECT_EQ(p.ordinal, 0u);
  EXPECT_GE(p.compute_capability, 75u);
  EXPECT_GT(p.num_threads, 0u);
  EXPECT_GT(p.memory_bytes, uint64_t(1) << 30);
  EXPECT_EQ(p.memory_limit_bytes, uint64_t(1) << 30);
  EXPECT_EQ(p.memory_used_bytes, 0u);
  EXPECT_EQ(std::string(p.instruction_set), "sm_" + std::to_string(p.compute_capability));
  EXPECT_STRNE(p.name, "");
}

TEST(CudaDevice, IsWhatAutoMeans)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_AUTO);
  gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
  GPURT_ASSERT_OK(gpurt_device_get_properties(device, &p));
  EXPECT_EQ(p.type, GPURT_DEVICE_CUDA);
}

TEST(CudaDevice, RefusesAcceleratorsThatItHasNot)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_mesh(scene, icosphere(1));
  gpurt_build_desc desc = GPURT_BUILD_DESC_INIT;
  desc.accel = GPURT_ACCEL_EMBREE;
  EXPECT_EQ(gpurt_scene_commit(scene, &desc), GPURT_ERROR_UNSUPPORTED);
  EXPECT_NE(std::string(gpurt_last_error()).find("GPURT_ACCEL_KDTREE"), std::string::npos)
      << gpurt_last_error();
  commit(scene);
}

// A probe of a kd-tree costs a few milliseconds and memory: not of small scenes, and not where there is little of it.
TEST(CudaDevice, SaysWhyAutoTookATree)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const auto log_of = [](const Mesh &mesh, uint64_t limit_bytes) {
    std::string text;
    gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
    desc.type = GPURT_DEVICE_CUDA;
    desc.memory_limit_bytes = limit_bytes;
    desc.log = [](void *user, gpurt_log_level, const char *message) {
      *static_cast<std::string *>(user) += std::string(message) + "\n";
    };
    desc.log_user = &text;
    Device device;
    GPURT_EXPECT_OK(gpurt_device_create(&desc, device.out()));
    Scene scene;
    GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
    add_mesh(scene, mesh);
    commit(scene, GPURT_ACCEL_AUTO);
    return text;
  };
  const auto says = [](const std::string &text, const char *words) {
    EXPECT_NE(text.find(words), std::string::npos) << text;
  };
  says(log_of(icosphere(3), 0), "are probed for kd-trees");
  const Mesh large = icosphere(7);  // 327680 triangles
  says(log_of(large, 0), "of a bvh's time");
  says(log_of(large, 300u << 20), "a quarter of the memory");
}

// Triangles that lie across one another, each as wide as a tenth of the scene: boxes about them overlap everywhere, and planes
// keep them apart.
TEST(CudaDevice, TakesTheKdTreeWhereAProbeExpectsItToBeFaster)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  Mesh mesh;
  Random random(5);
  for (uint32_t i = 0; i < 200'000; ++i) {
    const Vec center = random.inside({-1, -1, -1}, {1, 1, 1});
    for (int k = 0; k < 3; ++k) {
      const Vec d = random.inside({-0.1f, -0.1f, -0.1f}, {0.1f, 0.1f, 0.1f});
      mesh.vertices.push_back({center[0] + d[0], center[1] + d[1], center[2] + d[2]});
    }
    mesh.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  std::string log;
  gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
  desc.type = GPURT_DEVICE_CUDA;
  desc.log = [](void *user, gpurt_log_level, const char *message) {
    *static_cast<std::string *>(user) += std::string(message) + "\n";
  };
  desc.log_user = &log;
  Device device;
  GPURT_ASSERT_OK(gpurt_device_create(&desc, device.out()));
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_mesh(scene, mesh);
  RayTargets targets{mesh};
  set_bounds(targets);
  std::vector<gpurt_ray> rays(20'000);
  for (size_t i = 0; i < rays.size(); ++i) rays[i] = make_ray(targets, i);
  gpurt_scene_facts facts[2] = {GPURT_SCENE_FACTS_INIT, GPURT_SCENE_FACTS_INIT};
  std::vector<gpurt_hit> hits[2];
  // The tree, and the hits, of a commit that asks for it.
  for (int i = 0; i < 2; ++i) {
    commit(scene, i == 0 ? GPURT_ACCEL_AUTO : GPURT_ACCEL_KDTREE);
    GPURT_ASSERT_OK(gpurt_scene_get_facts(scene, &facts[i]));
    hits[i] = trace_closest(scene, rays);
  }
  EXPECT_NE(log.find("expects a kd-tree to take 0."), std::string::npos) << log;
  EXPECT_EQ(facts[0].accel, GPURT_ACCEL_KDTREE) << log;
  EXPECT_EQ(facts[0].num_nodes, facts[1].num_nodes);
  EXPECT_EQ(facts[0].num_references, facts[1].num_references);
  EXPECT_EQ(std::memcmp(hits[0].data(), hits[1].data(), rays.size() * sizeof(gpurt_hit)), 0);
  gpurt_kdtree tree = GPURT_KDTREE_INIT;
  GPURT_EXPECT_OK(gpurt_scene_export_tree(scene, &tree));
}

TEST(CudaDevice, ChoosesTheBvhUnlessAKdTreeIsAskedFor)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_mesh(scene, icosphere(1));
  for (uint32_t max_depth : {0u, 5u}) {
    gpurt_build_desc desc = GPURT_BUILD_DESC_INIT;
    desc.max_depth = max_depth;
    GPURT_ASSERT_OK(gpurt_scene_commit(scene, &desc));
    gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
    GPURT_ASSERT_OK(gpurt_scene_get_facts(scene, &facts));
    EXPECT_EQ(facts.accel, max_depth == 0 ? GPURT_ACCEL_BVH : GPURT_ACCEL_KDTREE);
  }
}

TEST(CudaDevice, ExportsNoTreeOfABvh)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_mesh(scene, icosphere(1));
  commit(scene, GPURT_ACCEL_BVH);
  gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
  GPURT_ASSERT_OK(gpurt_scene_get_facts(scene, &facts));
  EXPECT_EQ(facts.accel, GPURT_ACCEL_BVH);
  EXPECT_GE(facts.accel_bytes, 80u * 48u);
  gpurt_kdtree tree = GPURT_KDTREE_INIT;
  EXPECT_EQ(gpurt_scene_export_tree(scene, &tree), GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_NE(std::string(gpurt_last_error()).find("kdtree"), std::string::npos) << gpurt_last_error();
}

uint64_t memory_used(gpurt_device device)
{
  gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
  GPURT_EXPECT_OK(gpurt_device_get_properties(device, &p));
  return p.memory_used_bytes;
}

bool sphere_is_hit(gpurt_scene scene)
{
  const auto hits = trace_closest(scene, {{{0, 0, 3}, 0, {0, 0, -1}, 10}});
  return hits[0].primitive != GPURT_INVALID_ID && hits[0].t > 1.9f && hits[0].t < 2.1f;
}

TEST(CudaMemory, RunsOutAtTheLimitAndLeavesTheDeviceUsable)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA, 0, uint64_t(16) << 20);
  Scene small, large;
  GPURT_ASSERT_OK(gpurt_scene_create(device, small.out()));
  add_mesh(small, icosphere(2));
  commit(small);
  EXPECT_TRUE(sphere_is_hit(small));
  const uint64_t before = memory_used(device);
  EXPECT_GT(before, 0u);
  // 327,680 triangles: 4 MB of indices, and 48 bytes for every reference of the tree.
  GPURT_ASSERT_OK(gpurt_scene_create(device, large.out()));
  add_mesh(large, icosphere(7));
  EXPECT_EQ(gpurt_scene_commit(large, nullptr), GPURT_ERROR_OUT_OF_MEMORY);
  EXPECT_NE(std::string(gpurt_last_error()).find("memory"), std::string::npos) << gpurt_last_error();
  EXPECT_TRUE(sphere_is_hit(small));
  commit(small);
  EXPECT_TRUE(sphere_is_hit(small));
}

// Room for a part of what travels together: the same hits, in smaller parts.
TEST(CudaMemory, OfLittleSizeIsEnoughForManyRays)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const uint64_t limit = uint64_t(3) << 20;
  const Device roomy = make_device(GPURT_DEVICE_CUDA), tight = make_device(GPURT_DEVICE_CUDA, 0, limit);
  std::vector<gpurt_hit> hits[2];
  for (int i = 0; i < 2; ++i) {
    Scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(i == 0 ? roomy : tight, scene.out()));
    RayTargets targets{icosphere(3)};
    add_mesh(scene, targets.mesh);
    set_bounds(targets);
    commit(scene);
    std::vector<gpurt_ray> rays(amount(700'000, 70'000));
    for (size_t k = 0; k < rays.size(); ++k) rays[k] = make_ray(targets, k);
    hits[i] = trace_closest(scene, rays);
  }
  EXPECT_EQ(std::memcmp(hits[0].data(), hits[1].data(), hits[0].size() * sizeof(gpurt_hit)), 0);
  gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
  GPURT_ASSERT_OK(gpurt_device_get_properties(tight, &p));
  EXPECT_LE(p.memory_peak_bytes, limit);
}

// Where the device itself has none left, the driver's error must not stick.
TEST(CudaMemory, RunsOutOnTheDeviceAndLeavesItUsable)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_mesh(scene, icosphere(2));
  commit(scene);
  const uint64_t before = memory_used(device);
  gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
  GPURT_ASSERT_OK(gpurt_device_get_properties(device, &p));
  gpurt_buffer_desc desc = GPURT_BUFFER_DESC_INIT;
  desc.storage = GPURT_STORAGE_DEVICE;
  desc.size_bytes = 2 * p.memory_bytes;
  gpurt_buffer buffer = nullptr;
  EXPECT_EQ(gpurt_buffer_create(device, &desc, &buffer), GPURT_ERROR_OUT_OF_MEMORY);
  EXPECT_NE(std::string(gpurt_last_error()).find("memory"), std::string::npos) << gpurt_last_error();
  EXPECT_EQ(memory_used(device), before);
  EXPECT_TRUE(sphere_is_hit(scene));
  desc.size_bytes = 1 << 20;
  GPURT_ASSERT_OK(gpurt_buffer_create(device, &desc, &buffer));
  EXPECT_EQ(memory_used(device), before + (1 << 20));
  GPURT_ASSERT_OK(gpurt_buffer_release(buffer));
  EXPECT_EQ(memory_used(device), before);
}

TEST(CudaMemory, IsGivenBack)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  for (gpurt_accel accel : {GPURT_ACCEL_KDTREE, GPURT_ACCEL_BVH}) {
    Scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
    add_mesh(scene, icosphere(4));
    add_camera(scene, {0, 0, 4}, 0.7f);
    set_environment(scene, 1);
    commit(scene, accel);
    RenderOptions options;
    options.spp = uint32_t(amount(options.spp, 2));
    const Frame frame = make_frame(scene, options);
    render(frame, options);
    EXPECT_GT(memory_used(device), 0u);
  }
  EXPECT_EQ(memory_used(device), 0u);
}

// Two threads build, trace and render their own scenes on one device object, and on one each.
TEST(CudaThreads, ShareADevice)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device shared = make_device(GPURT_DEVICE_CUDA);
  const auto work = [&](gpurt_device device, std::vector<float> &color) {
    for (uint64_t round = 0; round < amount(3, 2); ++round) {
      Scene scene;
      GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
      add_mesh(scene, icosphere(3));
      add_camera(scene, {0, 0, 4}, 0.7f);
      set_environment(scene, 1);
      commit(scene);
      EXPECT_TRUE(sphere_is_hit(scene));
      RenderOptions options;
      options.spp = uint32_t(amount(options.spp, 2));
      const Frame frame = make_frame(scene, options);
      render(frame, options);
      color = read_color(frame, options);
    }
  };
  std::vector<float> alone, a, b, c;
  work(shared, alone);
  const Device own = make_device(GPURT_DEVICE_CUDA);
  std::thread threads[] = {std::thread([&] { work(shared, a); }), std::thread([&] { work(shared, b); }),
                           std::thread([&] { work(own, c); })};
  for (std::thread &t : threads) t.join();
  EXPECT_EQ(a, alone);
  EXPECT_EQ(b, alone);
  EXPECT_EQ(c, alone);
}

}  // namespace
}  // namespace gpurt_test
