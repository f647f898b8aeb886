// The library under many threads at once.
#include <atomic>
#include <thread>

#include "abi_test.h"

namespace {

using namespace gpurt_test;

constexpr int num_threads = 8;

template <class Body>
void run_threads(Body &&body)
{
  std::vector<std::thread> threads;
  for (int i = 0; i < num_threads; ++i) threads.emplace_back(body, i);
  for (std::thread &t : threads) t.join();
}

TEST(Threads, TheLastErrorIsTheThreadsOwn)
{
  ASSERT_EQ(gpurt_scene_release(nullptr), GPURT_ERROR_INVALID_ARGUMENT);
  const std::string mine = gpurt_last_error();
  EXPECT_EQ(mine, "scene is NULL; a scene handle is needed");
  std::thread([] {
    EXPECT_STREQ(gpurt_last_error(), "") << "a thread starts without an error";
    EXPECT_EQ(gpurt_device_release(nullptr), GPURT_ERROR_INVALID_ARGUMENT);
    EXPECT_STREQ(gpurt_last_error(), "device is NULL; a device handle is needed");
  }).join();
  EXPECT_EQ(gpurt_last_error(), mine);
  EXPECT_EQ(gpurt_last_error(), mine) << "reading does not clear";
  const Device device = make_device();
  EXPECT_EQ(gpurt_last_error(), mine) << "success does not clear";
}

TEST(Threads, LongTextsAreCut)
{
  const Device device = make_device();
  const std::string path = "/nowhere/" + std::string(20000, 'x') + ".glb";
  gpurt_scene scene;
  EXPECT_NE(gpurt_scene_load(device, path.c_str(), &scene), GPURT_OK);
  const std::string text = gpurt_last_error();
  EXPECT_LT(text.size(), 20000u);
  EXPECT_EQ(text.substr(text.size() - 4), " ...");
}

TEST(Threads, RetainAndReleaseAndTraceTogether)
{
  const Device device = make_device(GPURT_DEVICE_CPU, 2);
  gpurt_scene scene;
  {
    Scene s = make_triangle_scene(device);
    scene = s;
    *s.out() = nullptr;
  }
  std::atomic<bool> stop{false};
  std::atomic<int> num_traces{0};
  // Threads hold a reference each while they trace; one more thread commits all the while.
  std::thread committer([&] {
    gpurt_build_desc desc = GPURT_BUILD_DESC_INIT;
    desc.accel = GPURT_ACCEL_KDTREE;
    while (!stop) GPURT_EXPECT_OK(gpurt_scene_commit(scene, &desc));
  });
  run_threads([&](int) {
    for (int i = 0; i < 200; ++i) {
      if (gpurt_scene_retain(scene) != GPURT_OK) ADD_FAILURE() << gpurt_last_error();
      const gpurt_ray ray = ray_at_triangle();
      gpurt_hit hit{};
      gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
      desc.num_rays = 1;
      desc.rays = &ray;
      desc.hits = &hit;
      if (gpurt_scene_trace(scene, &desc) != GPURT_OK || hit.primitive != 0 || hit.t != 1) {
        ADD_FAILURE() << gpurt_last_error() << " " << hit.primitive << " " << hit.t - 1;
      }
      if (gpurt_scene_release(scene) != GPURT_OK) ADD_FAILURE() << gpurt_last_error();
      num_traces++;
    }
  });
  stop = true;
  committer.join();
  EXPECT_EQ(num_traces, 200 * num_threads);
  GPURT_EXPECT_OK(gpurt_scene_release(scene));
  EXPECT_EQ(gpurt_scene_release(scene), GPURT_ERROR_INVALID_ARGUMENT);
}

// The last release races with lookups: each call sees the object or an error, and exactly one release is the last.
TEST(Threads, ReleaseWhileOthersUseTheHandle)
{
  const Device device = make_device(GPURT_DEVICE_CPU, 2);
  for (int round = 0; round < 50; ++round) {
    Scene owner = make_triangle_scene(device);
    const gpurt_scene scene = owner;
    *owner.out() = nullptr;
    std::atomic<int> num_released{0}, num_refused{0};
    run_threads([&](int) {
      const gpurt_ray ray = ray_at_triangle();
      gpurt_hit hit{};
      gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
      desc.num_rays = 1;
      desc.rays = &ray;
      desc.hits = &hit;
      const gpurt_result traced = gpurt_scene_trace(scene, &desc);
      EXPECT_TRUE(traced == GPURT_ERROR_INVALID_ARGUMENT || (traced == GPURT_OK && hit.primitive == 0));
      const gpurt_result released = gpurt_scene_release(scene);
      (released == GPURT_OK ? num_released : num_refused)++;
    });
    EXPECT_EQ(num_released, 1);
    EXPECT_EQ(num_refused, num_threads - 1);
  }
}

// Handles come and go in all threads: a handle never names another thread's object.
TEST(Threads, CreateAndReleaseTogether)
{
  const Device device = make_device();
  run_threads([&](int thread) {
    for (int i = 0; i < 300; ++i) {
      const uint64_t bytes = uint64_t(thread) * 1000 + uint64_t(i) + 1;
      gpurt_buffer_desc desc = GPURT_BUFFER_DESC_INIT;
      desc.size_bytes = bytes;
      gpurt_buffer buffer;
      if (gpurt_buffer_create(device, &desc, &buffer) != GPURT_OK) ADD_FAILURE() << gpurt_last_error();
      void *data = nullptr;
      uint64_t size = 0;
      if (gpurt_buffer_get_data(buffer, &data, &size) != GPURT_OK || size != bytes) ADD_FAILURE() << size;
      if (gpurt_buffer_release(buffer) != GPURT_OK) ADD_FAILURE() << gpurt_last_error();
      if (gpurt_buffer_get_data(buffer, &data, &size) != GPURT_ERROR_INVALID_ARGUMENT)
        ADD_FAILURE() << "not stale";
    }
  });
  gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
  GPURT_EXPECT_OK(gpurt_device_get_properties(device, &p));
  EXPECT_EQ(p.memory_used_bytes, 0u);
}

TEST(Threads, ChangesOfASceneExcludeEachOther)
{
  const Device device = make_device();
  const Scene scene = make_scene(device);
  run_threads([&](int) {
    for (int i = 0; i < 50; ++i) {
      gpurt_material_desc material = GPURT_MATERIAL_DESC_INIT;
      uint32_t id = 0;
      if (gpurt_scene_add_material(scene, &material, &id) != GPURT_OK) ADD_FAILURE() << gpurt_last_error();
      add_mesh(scene, {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}}, id);
      gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
      if (gpurt_scene_get_facts(scene, &facts) != GPURT_OK || facts.num_materials < id) ADD_FAILURE();
      if (i % 10 == 9 && gpurt_scene_commit(scene, nullptr) != GPURT_OK) ADD_FAILURE() << gpurt_last_error();
    }
  });
  gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
  GPURT_EXPECT_OK(gpurt_scene_get_facts(scene, &facts));
  EXPECT_EQ(facts.num_materials, 50u * num_threads);
  EXPECT_EQ(facts.num_geometries, 50u * num_threads);
}

// Merging a into b and b into a at once must not lock each other out.
TEST(Threads, MergingBothWaysEnds)
{
  const Device device = make_device();
  const Scene scene = make_triangle_scene(device);
  for (int round = 0; round < 20; ++round) {
    gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
    desc.width = desc.height = 8;
    Frame a, b;
    GPURT_ASSERT_OK(gpurt_frame_create(scene, &desc, a.out()));
    desc.first_sample = 100;
    GPURT_ASSERT_OK(gpurt_frame_create(scene, &desc, b.out()));
    render(a, {8, 8, 1});
    render(b, {8, 8, 1});
    std::thread other([&] { gpurt_frame_merge(a, b); });
    gpurt_frame_merge(b, a);
    other.join();
  }
}

struct LogCheck {
  std::atomic<int> inside{0};
  std::atomic<int> num_messages{0};
  std::atomic<bool> overlapped{false};
  static void call(void *user, gpurt_log_level, const char *message)
  {
    auto *self = static_cast<LogCheck *>(user);
    if (self->inside++ != 0) self->overlapped = true;
    if (*message) self->num_messages++;
    std::this_thread::yield();
    self->inside--;
  }
};

TEST(Threads, LogMessagesComeOneAtATime)
{
  LogCheck check;
  gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
  desc.type = GPURT_DEVICE_CPU;
  desc.log = LogCheck::call;
  desc.log_user = &check;
  Device device;
  GPURT_ASSERT_OK(gpurt_device_create(&desc, device.out()));
  run_threads([&](int) {
    const Scene scene = make_scene(device);
    for (int i = 0; i < 20; ++i) {
      // A setting of the kd-tree for Embree: a warning.
      gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
      build.accel = GPURT_ACCEL_EMBREE;
      build.max_depth = 4;
      if (gpurt_scene_commit(scene, &build) != GPURT_OK) ADD_FAILURE() << gpurt_last_error();
    }
  });
  EXPECT_GE(check.num_messages, 20 * num_threads);
  EXPECT_FALSE(check.overlapped);
}

}  // namespace
