// Who keeps whom alive, and when the caller's memory is given back.
#include <atomic>
#include <thread>

#include "abi_test.h"

namespace {

using namespace gpurt_test;

TEST(Lifetimes, ChildrenKeepTheirParentsAlive)
{
  Device device = make_device();
  Scene scene = make_triangle_scene(device);
  Frame frame = make_frame(scene, {8, 8, 1});
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.samples_per_pixel = 2;
  Job job;
  GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
  GPURT_EXPECT_OK(gpurt_device_release(device));
  *device.out() = nullptr;
  const gpurt_ray ray = ray_at_triangle();
  EXPECT_EQ(trace_closest(scene, {ray})[0].primitive, 0u);
  GPURT_EXPECT_OK(gpurt_scene_release(scene));
  *scene.out() = nullptr;
  GPURT_EXPECT_OK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
  GPURT_EXPECT_OK(gpurt_job_release(job));
  *job.out() = nullptr;
  std::vector<uint32_t> counts(64);
  GPURT_EXPECT_OK(gpurt_frame_read(frame, GPURT_OUTPUT_SAMPLE_COUNT, counts.data(), 256));
  EXPECT_EQ(counts, std::vector<uint32_t>(64, 2));
}

TEST(Lifetimes, AJobOutlivesEverythingElse)
{
  Job job;
  {
    const Device device = make_device();
    const Scene scene = make_triangle_scene(device);
    const Frame frame = make_frame(scene, {16, 16, 1});
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.samples_per_pixel = 16;
    GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
  }
  GPURT_EXPECT_OK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
  double share = 0;
  GPURT_EXPECT_OK(gpurt_job_get_progress(job, &share));
  EXPECT_EQ(share, 1.0);
}

// A released job is cancelled even while another thread waits for it.
TEST(Lifetimes, ReleaseCancelsAJobThatRuns)
{
  const Device device = make_device();
  const Scene scene = make_triangle_scene(device);
  const Frame frame = make_frame(scene, {256, 256, 1});
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.samples_per_pixel = 1u << 20;
  gpurt_job job;
  GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, &job));
  std::atomic<bool> waits{false};
  gpurt_result waited = GPURT_OK;
  std::thread waiter([&] {
    EXPECT_EQ(gpurt_job_wait(job, 0), GPURT_ERROR_TIMEOUT);
    waits = true;
    waited = gpurt_job_wait(job, GPURT_WAIT_FOREVER);
  });
  while (!waits) std::this_thread::yield();
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  GPURT_EXPECT_OK(gpurt_job_release(job));
  waiter.join();
  // The waiting call had looked the handle up before the release, or came too late for it.
  EXPECT_TRUE(waited == GPURT_ERROR_CANCELLED || waited == GPURT_ERROR_INVALID_ARGUMENT)
      << gpurt_result_name(waited);
}

// What a C++ caller's callbacks throw ends nowhere but in a result.
TEST(Lifetimes, CallbacksThatThrow)
{
  gpurt_device_desc device_desc = GPURT_DEVICE_DESC_INIT;
  device_desc.type = GPURT_DEVICE_CPU;
  device_desc.log = [](void *, gpurt_log_level, const char *) { throw 1; };
  Device device;
  GPURT_ASSERT_OK(gpurt_device_create(&device_desc, device.out()));
  const Scene scene = make_triangle_scene(device);
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_EMBREE;
  build.max_depth = 3;  // warns
  GPURT_EXPECT_OK(gpurt_scene_commit(scene, &build));

  float data[4];
  gpurt_buffer_desc buffer_desc = GPURT_BUFFER_DESC_INIT;
  buffer_desc.data = data;
  buffer_desc.size_bytes = sizeof data;
  buffer_desc.release = [](void *, void *) { throw 2; };
  gpurt_buffer buffer;
  GPURT_ASSERT_OK(gpurt_buffer_create(device, &buffer_desc, &buffer));
  GPURT_EXPECT_OK(gpurt_buffer_release(buffer));

  const Frame frame = make_frame(scene, {8, 8, 1});
  gpurt_render_desc render_desc = GPURT_RENDER_DESC_INIT;
  render_desc.samples_per_pixel = 1;
  render_desc.progress = [](void *, double, double) { throw 3; };
  Job job;
  GPURT_ASSERT_OK(gpurt_frame_submit(frame, &render_desc, nullptr, 0, job.out()));
  EXPECT_EQ(gpurt_job_wait(job, GPURT_WAIT_FOREVER), GPURT_ERROR_INTERNAL) << gpurt_last_error();
}

struct Released {
  std::atomic<int> count{0};
  void *data = nullptr;
  static void call(void *user, void *data)
  {
    auto *self = static_cast<Released *>(user);
    self->count++;
    self->data = data;
  }
};

gpurt_buffer_desc shared_desc(void *data, uint64_t bytes, Released &released)
{
  gpurt_buffer_desc desc = GPURT_BUFFER_DESC_INIT;
  desc.size_bytes = bytes;
  desc.data = data;
  desc.release = Released::call;
  desc.release_user = &released;
  return desc;
}

TEST(Buffers, OfGpurtAreZero)
{
  const Device device = make_device();
  for (const gpurt_storage storage : {GPURT_STORAGE_HOST, GPURT_STORAGE_DEVICE}) {
    gpurt_buffer_desc desc = GPURT_BUFFER_DESC_INIT;
    desc.size_bytes = 1001;
    desc.storage = storage;
    Buffer buffer;
    GPURT_ASSERT_OK(gpurt_buffer_create(device, &desc, buffer.out()));
    void *data = nullptr;
    uint64_t size = 0;
    GPURT_ASSERT_OK(gpurt_buffer_get_data(buffer, &data, &size));
    EXPECT_EQ(size, 1001u);
    EXPECT_EQ(reinterpret_cast<uintptr_t>(data) % 16, 0u);
    for (int i = 0; i < 1001; ++i) ASSERT_EQ(static_cast<unsigned char *>(data)[i], 0);
    std::memset(data, 1, 1001);
  }
}

TEST(Buffers, AreWrittenAndReadInParts)
{
  const Device device = make_device();
  for (const gpurt_storage storage : {GPURT_STORAGE_HOST, GPURT_STORAGE_DEVICE}) {
    gpurt_buffer_desc desc = GPURT_BUFFER_DESC_INIT;
    desc.size_bytes = 10;
    desc.storage = storage;
    Buffer buffer;
    GPURT_ASSERT_OK(gpurt_buffer_create(device, &desc, buffer.out()));
    char text[11] = {};
    GPURT_EXPECT_OK(gpurt_buffer_write(buffer, 0, "0123456789", 10));
    GPURT_EXPECT_OK(gpurt_buffer_write(buffer, 4, "abc", 3));
    GPURT_EXPECT_OK(gpurt_buffer_read(buffer, 0, text, 10));
    EXPECT_STREQ(text, "0123abc789");
    GPURT_EXPECT_OK(gpurt_buffer_read(buffer, 8, text, 2));
    EXPECT_STREQ(text, "8923abc789");
    GPURT_EXPECT_OK(gpurt_buffer_read(buffer, 10, nullptr, 0));
    GPURT_EXPECT_OK(gpurt_buffer_write(buffer, 0, nullptr, 0));
    for (const auto &[offset, size] :
         {std::pair<uint64_t, uint64_t>{11, 0}, {8, 3}, {UINT64_MAX, 2}, {2, UINT64_MAX}}) {
      expect_invalid("leave the buffer", "read",
                     [&] { return gpurt_buffer_read(buffer, offset, text, size); });
      expect_invalid("which has 10", "write", [&] { return gpurt_buffer_write(buffer, offset, text, size); });
    }
    EXPECT_STREQ(text, "8923abc789");
  }
}

TEST(Buffers, GiveTheCallersMemoryBackOnce)
{
  const Device device = make_device();
  float data[4];
  Released released;
  const gpurt_buffer_desc desc = shared_desc(data, sizeof data, released);
  gpurt_buffer buffer;
  GPURT_ASSERT_OK(gpurt_buffer_create(device, &desc, &buffer));
  void *address = nullptr;
  uint64_t size = 0;
  GPURT_EXPECT_OK(gpurt_buffer_get_data(buffer, &address, &size));
  EXPECT_EQ(address, data);
  GPURT_EXPECT_OK(gpurt_buffer_retain(buffer));
  GPURT_EXPECT_OK(gpurt_buffer_release(buffer));
  EXPECT_EQ(released.count, 0);
  GPURT_EXPECT_OK(gpurt_buffer_release(buffer));
  EXPECT_EQ(released.count, 1);
  EXPECT_EQ(released.data, data);
  EXPECT_EQ(gpurt_buffer_release(buffer), GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(released.count, 1);
}

TEST(Buffers, LeaveMemoryWithTheCallerWhereCreationFails)
{
  const Device device = make_device();
  float data[4];
  Released released;
  gpurt_buffer_desc desc = shared_desc(data, sizeof data, released);
  gpurt_buffer buffer;
  desc.storage = gpurt_storage(5);
  EXPECT_EQ(gpurt_buffer_create(device, &desc, &buffer), GPURT_ERROR_INVALID_ARGUMENT);
  desc = shared_desc(data, 0, released);
  EXPECT_EQ(gpurt_buffer_create(device, &desc, &buffer), GPURT_ERROR_INVALID_ARGUMENT);
  desc = shared_desc(data, UINT64_MAX, released);
  EXPECT_EQ(gpurt_buffer_create(device, &desc, &buffer), GPURT_ERROR_INVALID_ARGUMENT);
  desc = shared_desc(nullptr, 16, released);
  EXPECT_EQ(gpurt_buffer_create(device, &desc, &buffer), GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(released.count, 0);
}

TEST(Buffers, AreKeptForAsLongAsAnybodyReadsThem)
{
  Released released;
  std::vector<float> vertices = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  {
    const Device device = make_device();
    Scene scene = make_scene(device);
    {
      const gpurt_buffer_desc desc = shared_desc(vertices.data(), 36, released);
      Buffer buffer;
      GPURT_ASSERT_OK(gpurt_buffer_create(device, &desc, buffer.out()));
      gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
      mesh.vertices.buffer = buffer;
      mesh.vertices.count = 3;
      uint32_t geometry = 9, instance_id = 9;
      GPURT_ASSERT_OK(gpurt_scene_add_mesh(scene, &mesh, &geometry));
      const gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
      GPURT_ASSERT_OK(gpurt_scene_add_instance(scene, &instance, &instance_id));
    }
    EXPECT_EQ(released.count, 0) << "the scene still needs the buffer";
    commit(scene);
    EXPECT_EQ(trace_closest(scene, {ray_at_triangle()})[0].primitive, 0u);
    EXPECT_EQ(released.count, 0) << "the next commit needs the buffer too";
  }
  EXPECT_EQ(released.count, 1);
}

TEST(Buffers, OfFailedMeshesAreNotKept)
{
  Released released;
  std::vector<float> vertices = {0, 0, 0, 1, 0, 0, 0, 1, std::nanf("")};
  const Device device = make_device();
  const Scene scene = make_scene(device);
  {
    const gpurt_buffer_desc desc = shared_desc(vertices.data(), 36, released);
    Buffer buffer;
    GPURT_ASSERT_OK(gpurt_buffer_create(device, &desc, buffer.out()));
    gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
    mesh.vertices.buffer = buffer;
    mesh.vertices.count = 3;
    uint32_t geometry;
    EXPECT_EQ(gpurt_scene_add_mesh(scene, &mesh, &geometry), GPURT_ERROR_INVALID_ARGUMENT);
  }
  EXPECT_EQ(released.count, 1);
}

// Memory that the caller spoils after it was checked gives an error, not a crash.
TEST(Buffers, ThatChangeAreCheckedAgain)
{
  const Device device = make_device();
  const Scene scene = make_triangle_scene(device);
  float vertices[9] = {0, 0, -1, 1, 0, -1, 0, 1, -1};
  uint32_t indices[3] = {0, 1, 2};
  Released released;
  Buffer vertex_buffer, index_buffer;
  gpurt_buffer_desc desc = shared_desc(vertices, sizeof vertices, released);
  GPURT_ASSERT_OK(gpurt_buffer_create(device, &desc, vertex_buffer.out()));
  desc = shared_desc(indices, sizeof indices, released);
  GPURT_ASSERT_OK(gpurt_buffer_create(device, &desc, index_buffer.out()));
  gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
  mesh.vertices = {nullptr, vertex_buffer, 0, 0, 3};
  mesh.indices = {nullptr, index_buffer, 0, 0, 1};
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  uint32_t id;
  GPURT_ASSERT_OK(gpurt_scene_add_mesh(scene, &mesh, &instance.geometry));
  GPURT_ASSERT_OK(gpurt_scene_add_instance(scene, &instance, &id));
  indices[1] = 4000000000u;
  expect_invalid("geometry 1", "commit", [&] { return gpurt_scene_commit(scene, nullptr); });
  EXPECT_EQ(trace_closest(scene, {ray_at_triangle()})[0].geometry, 0u) << "the commit of before is gone";
  indices[1] = 1;
  commit(scene);
}

// Elements may be apart, unaligned and overlapping; the array ends with the last element, not with its stride.
TEST(Arrays, AreReadWithTheirStride)
{
  const Device device = make_device();
  const Scene scene = make_scene(device);
  const float corners[3][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  std::vector<unsigned char> bytes(1 + 2 * 17 + 12);  // exactly to the end: a sanitizer sees a byte more
  for (int i = 0; i < 3; ++i) std::memcpy(bytes.data() + 1 + 17 * i, corners[i], 12);
  gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
  mesh.vertices.data = bytes.data();
  mesh.vertices.offset_bytes = 1;
  mesh.vertices.stride_bytes = 17;
  mesh.vertices.count = 3;
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  uint32_t id;
  GPURT_ASSERT_OK(gpurt_scene_add_mesh(scene, &mesh, &instance.geometry));
  GPURT_ASSERT_OK(gpurt_scene_add_instance(scene, &instance, &id));
  // Host memory was copied during the call.
  std::fill(bytes.begin(), bytes.end(), 0xff);
  commit(scene);
  const gpurt_hit hit = trace_closest(scene, {ray_at_triangle()})[0];
  EXPECT_EQ(hit.primitive, 0u);
  EXPECT_EQ(hit.t, 1.0f);
  EXPECT_EQ(hit.u, 0.25f);
  EXPECT_EQ(hit.v, 0.25f);
}

}  // namespace
