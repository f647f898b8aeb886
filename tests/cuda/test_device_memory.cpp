// Rays and results in device memory: the same bits as through host memory, at any alignment, and pointers that cannot
// be right are refused by name.
#include <cuda_runtime_api.h>

#include "gpurt_cuda.h"
#include "scenes.h"

namespace gpurt_test {
namespace {

class DeviceBytes {
 public:
  explicit DeviceBytes(size_t size) { EXPECT_EQ(cudaMalloc(&data_, size), cudaSuccess); }
  ~DeviceBytes() { cudaFree(data_); }
  DeviceBytes(const DeviceBytes &) = delete;
  char *data() const { return static_cast<char *>(data_); }

 private:
  void *data_ = nullptr;
};

struct Fixture {
  Device device;
  Scene scene;
  std::vector<gpurt_ray> rays;
};

Fixture make_fixture(size_t num_rays)
{
  Fixture f;
  f.device = make_device(GPURT_DEVICE_CUDA);
  GPURT_EXPECT_OK(gpurt_scene_create(f.device, f.scene.out()));
  RayTargets targets = fill_city(f.scene);
  commit(f.scene);
  f.rays.resize(num_rays);
  for (size_t i = 0; i < num_rays; ++i) f.rays[i] = make_ray(targets, i);
  return f;
}

// `offset` bytes into an allocation: 16-byte and 4-byte alignment take different paths.
template <class T>
std::vector<T> trace_in_device_memory(const Fixture &f, gpurt_query query, gpurt_hit_format format,
                                      size_t offset)
{
  const size_t n = f.rays.size();
  const DeviceBytes rays(n * sizeof(gpurt_ray) + offset), results(n * sizeof(T) + offset);
  // On the default stream and without waiting: a query comes after what was started there.
  EXPECT_EQ(cudaMemcpyAsync(rays.data() + offset, f.rays.data(), n * sizeof(gpurt_ray),
                            cudaMemcpyHostToDevice, nullptr),
            cudaSuccess);
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = query;
  desc.format = format;
  desc.storage = GPURT_STORAGE_DEVICE;
  desc.num_rays = n;
  desc.rays = reinterpret_cast<const gpurt_ray *>(rays.data() + offset);
  if (query == GPURT_QUERY_ANY) desc.occluded = reinterpret_cast<uint8_t *>(results.data() + offset);
  else desc.hits = results.data() + offset;
  GPURT_EXPECT_OK(gpurt_scene_trace(f.scene, &desc));
  std::vector<T> host(n);
  EXPECT_EQ(cudaMemcpy(host.data(), results.data() + offset, n * sizeof(T), cudaMemcpyDeviceToHost),
            cudaSuccess);
  return host;
}

template <class T>
std::vector<T> trace_in_host_memory(const Fixture &f, gpurt_query query, gpurt_hit_format format)
{
  std::vector<T> results(f.rays.size());
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = query;
  desc.format = format;
  desc.num_rays = f.rays.size();
  desc.rays = f.rays.data();
  if (query == GPURT_QUERY_ANY) desc.occluded = reinterpret_cast<uint8_t *>(results.data());
  else desc.hits = results.data();
  GPURT_EXPECT_OK(gpurt_scene_trace(f.scene, &desc));
  return results;
}

template <class T>
bool same(const std::vector<T> &a, const std::vector<T> &b)
{
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

TEST(CudaPointers, GiveTheHitsOfHostMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Fixture f = make_fixture(amount(1'000'003, 10'003));
  for (size_t offset : {size_t(0), size_t(4), size_t(16)}) {
    SCOPED_TRACE(offset);
    EXPECT_TRUE(same(trace_in_device_memory<gpurt_hit>(f, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL, offset),
                     trace_in_host_memory<gpurt_hit>(f, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL)));
    EXPECT_TRUE(
        same(trace_in_device_memory<gpurt_hit_compact>(f, GPURT_QUERY_CLOSEST, GPURT_HIT_COMPACT, offset),
             trace_in_host_memory<gpurt_hit_compact>(f, GPURT_QUERY_CLOSEST, GPURT_HIT_COMPACT)));
    EXPECT_TRUE(same(trace_in_device_memory<uint8_t>(f, GPURT_QUERY_ANY, GPURT_HIT_FULL, offset),
                     trace_in_host_memory<uint8_t>(f, GPURT_QUERY_ANY, GPURT_HIT_FULL)));
  }
}

TEST(CudaPointers, GiveAllHitsOfHostMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Fixture f = make_fixture(amount(400'000, 10'000));  // more than a chunk
  const size_t n = f.rays.size();
  std::vector<uint64_t> offsets(n + 1), device_offsets(n + 1);
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = GPURT_QUERY_ALL;
  desc.num_rays = n;
  desc.rays = f.rays.data();
  desc.offsets = offsets.data();
  GPURT_ASSERT_OK(gpurt_scene_trace(f.scene, &desc));
  const uint64_t num_hits = offsets.back();
  ASSERT_GT(num_hits, 0u);
  std::vector<gpurt_hit> hits(num_hits), device_hits(num_hits);
  desc.hits = hits.data();
  desc.hit_capacity = num_hits - 1;
  EXPECT_EQ(gpurt_scene_trace(f.scene, &desc), GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(offsets.back(), num_hits);
  desc.hit_capacity = num_hits;
  GPURT_ASSERT_OK(gpurt_scene_trace(f.scene, &desc));

  const DeviceBytes d_rays(n * sizeof(gpurt_ray)), d_offsets((n + 1) * sizeof(uint64_t)),
      d_hits(num_hits * sizeof(gpurt_hit));
  ASSERT_EQ(cudaMemcpy(d_rays.data(), f.rays.data(), n * sizeof(gpurt_ray), cudaMemcpyHostToDevice),
            cudaSuccess);
  desc.storage = GPURT_STORAGE_DEVICE;
  desc.rays = reinterpret_cast<const gpurt_ray *>(d_rays.data());
  desc.offsets = reinterpret_cast<uint64_t *>(d_offsets.data());
  desc.hits = d_hits.data();
  GPURT_ASSERT_OK(gpurt_scene_trace(f.scene, &desc));
  ASSERT_EQ(
      cudaMemcpy(device_offsets.data(), d_offsets.data(), (n + 1) * sizeof(uint64_t), cudaMemcpyDeviceToHost),
      cudaSuccess);
  ASSERT_EQ(
      cudaMemcpy(device_hits.data(), d_hits.data(), num_hits * sizeof(gpurt_hit), cudaMemcpyDeviceToHost),
      cudaSuccess);
  EXPECT_EQ(offsets, device_offsets);
  EXPECT_TRUE(same(hits, device_hits));
}

TEST(CudaPointers, ToHostMemoryAreRefusedByName)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  Fixture f = make_fixture(16);
  std::vector<gpurt_hit> hits(16);
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.storage = GPURT_STORAGE_DEVICE;
  desc.num_rays = 16;
  desc.rays = f.rays.data();
  desc.hits = hits.data();
  EXPECT_EQ(gpurt_scene_trace(f.scene, &desc), GPURT_ERROR_INVALID_ARGUMENT);
  const std::string error = gpurt_last_error();
  EXPECT_NE(error.find("rays"), std::string::npos) << error;
  EXPECT_NE(error.find("GPURT_STORAGE_HOST"), std::string::npos) << error;
  desc.storage = GPURT_STORAGE_HOST;
  GPURT_EXPECT_OK(gpurt_scene_trace(f.scene, &desc));
}

TEST(CudaPointers, OfGpurtBuffersAreZeroAtFirst)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  gpurt_buffer_desc desc = GPURT_BUFFER_DESC_INIT;
  desc.storage = GPURT_STORAGE_DEVICE;
  desc.size_bytes = 4099;
  gpurt_buffer buffer = nullptr;
  GPURT_ASSERT_OK(gpurt_buffer_create(device, &desc, &buffer));
  void *data = nullptr;
  uint64_t size = 0;
  GPURT_ASSERT_OK(gpurt_buffer_get_data(buffer, &data, &size));
  EXPECT_EQ(size, 4099u);
  std::vector<char> host(size, 1);
  EXPECT_EQ(cudaMemcpy(host.data(), data, size, cudaMemcpyDeviceToHost), cudaSuccess);
  EXPECT_EQ(host, std::vector<char>(size, 0));
  GPURT_ASSERT_OK(gpurt_buffer_release(buffer));
}

// On a stream of the caller, after what it queued there and after an event of another stream, without any waiting between.
TEST(CudaStreams, CarryQueriesInOrder)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Fixture f = make_fixture(amount(1'000'000, 10'000));
  const size_t n = f.rays.size();
  const auto expected = trace_in_host_memory<gpurt_hit>(f, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL);
  const DeviceBytes rays(n * sizeof(gpurt_ray)), hits(n * sizeof(gpurt_hit));
  std::vector<gpurt_hit> host(n);
  cudaStream_t copies, queries;
  cudaEvent_t copied, traced;
  ASSERT_EQ(cudaStreamCreateWithFlags(&copies, cudaStreamNonBlocking), cudaSuccess);
  ASSERT_EQ(cudaStreamCreateWithFlags(&queries, cudaStreamNonBlocking), cudaSuccess);
  ASSERT_EQ(cudaEventCreate(&copied), cudaSuccess);
  ASSERT_EQ(cudaEventCreate(&traced), cudaSuccess);
  ASSERT_EQ(
      cudaMemcpyAsync(rays.data(), f.rays.data(), n * sizeof(gpurt_ray), cudaMemcpyHostToDevice, copies),
      cudaSuccess);
  ASSERT_EQ(cudaEventRecord(copied, copies), cudaSuccess);
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.storage = GPURT_STORAGE_DEVICE;
  desc.num_rays = n;
  desc.rays = reinterpret_cast<const gpurt_ray *>(rays.data());
  desc.hits = hits.data();
  GPURT_ASSERT_OK(gpurt_cuda_trace(f.scene, &desc, queries, copied, traced));
  ASSERT_EQ(cudaStreamWaitEvent(copies, traced, 0), cudaSuccess);
  ASSERT_EQ(cudaMemcpyAsync(host.data(), hits.data(), n * sizeof(gpurt_hit), cudaMemcpyDeviceToHost, copies),
            cudaSuccess);
  ASSERT_EQ(cudaStreamSynchronize(copies), cudaSuccess);
  EXPECT_TRUE(same(host, expected));

  std::vector<uint64_t> offsets(n + 1);
  desc.query = GPURT_QUERY_ALL;
  desc.hits = nullptr;
  desc.offsets = offsets.data();
  EXPECT_NE(gpurt_cuda_trace(f.scene, &desc, queries, nullptr, nullptr), GPURT_OK);
  cudaEventDestroy(copied);
  cudaEventDestroy(traced);
  cudaStreamDestroy(copies);
  cudaStreamDestroy(queries);
}

// What a caller without a CUDA runtime of its own has: buffers that are written and read, and order between streams.
TEST(CudaStreams, AreOrderedByTheLibrary)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Fixture f = make_fixture(amount(1'000'000, 10'000));
  const uint64_t ray_bytes = f.rays.size() * sizeof(gpurt_ray), hit_bytes = f.rays.size() * sizeof(gpurt_hit);
  const auto expected = trace_in_host_memory<gpurt_hit>(f, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL);
  void *places[3];
  gpurt_buffer buffers[3];
  for (int i = 0; i < 3; ++i) {
    gpurt_buffer_desc desc = GPURT_BUFFER_DESC_INIT;
    desc.storage = GPURT_STORAGE_DEVICE;
    desc.size_bytes = i < 2 ? ray_bytes : hit_bytes;
    GPURT_ASSERT_OK(gpurt_buffer_create(f.device, &desc, &buffers[i]));
    uint64_t size = 0;
    GPURT_ASSERT_OK(gpurt_buffer_get_data(buffers[i], &places[i], &size));
  }
  GPURT_ASSERT_OK(gpurt_buffer_write(buffers[0], 0, f.rays.data(), ray_bytes));
  cudaStream_t copies, queries;
  ASSERT_EQ(cudaStreamCreateWithFlags(&copies, cudaStreamNonBlocking), cudaSuccess);
  ASSERT_EQ(cudaStreamCreateWithFlags(&queries, cudaStreamNonBlocking), cudaSuccess);
  for (int round = 0; round < 3; ++round) {
    ASSERT_EQ(cudaMemcpyAsync(places[1], places[0], ray_bytes, cudaMemcpyDeviceToDevice, copies),
              cudaSuccess);
    GPURT_ASSERT_OK(gpurt_cuda_order(f.device, 0, queries, copies));
    gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
    desc.storage = GPURT_STORAGE_DEVICE;
    desc.num_rays = f.rays.size();
    desc.rays = static_cast<const gpurt_ray *>(places[1]);
    desc.hits = places[2];
    GPURT_ASSERT_OK(gpurt_cuda_trace(f.scene, &desc, queries, nullptr, nullptr));
    GPURT_ASSERT_OK(gpurt_cuda_order(f.device, 0, nullptr, queries));  // which reading comes after
    GPURT_ASSERT_OK(gpurt_cuda_order(f.device, 0, copies, queries));
    std::vector<gpurt_hit> hits(f.rays.size());
    GPURT_ASSERT_OK(gpurt_buffer_read(buffers[2], 0, hits.data(), hit_bytes));
    EXPECT_TRUE(same(hits, expected));
    ASSERT_EQ(cudaMemsetAsync(places[1], 0, ray_bytes, copies), cudaSuccess);
    ASSERT_EQ(cudaMemsetAsync(places[2], 0, hit_bytes, copies), cudaSuccess);
  }
  GPURT_ASSERT_OK(gpurt_cuda_wait(f.device, 0, copies));
  EXPECT_EQ(cudaStreamQuery(copies), cudaSuccess);
  gpurt_hit hit;
  GPURT_EXPECT_OK(gpurt_buffer_read(buffers[2], hit_bytes - sizeof hit, &hit, sizeof hit));
  EXPECT_EQ(hit.t, 0.0f);
  EXPECT_EQ(gpurt_buffer_read(buffers[2], hit_bytes - 1, &hit, 2), GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(gpurt_cuda_wait(f.device, 1, copies), GPURT_ERROR_INVALID_ARGUMENT);
  for (gpurt_buffer buffer : buffers) GPURT_EXPECT_OK(gpurt_buffer_release(buffer));
  cudaStreamDestroy(copies);
  cudaStreamDestroy(queries);
}

// The caller's device memory is what a scene is made from; it is given back when nothing reads it any more.
TEST(CudaPointers, AreMemoryOfMeshes)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  const Mesh mesh = icosphere(4);
  const uint64_t vertex_bytes = mesh.vertices.size() * sizeof mesh.vertices[0],
                 index_bytes = mesh.triangles.size() * sizeof mesh.triangles[0], offset = 12;
  const DeviceBytes vertices(vertex_bytes + offset), indices(index_bytes);
  ASSERT_EQ(cudaMemcpyAsync(vertices.data() + offset, mesh.vertices.data(), vertex_bytes,
                            cudaMemcpyHostToDevice, nullptr),
            cudaSuccess);
  ASSERT_EQ(
      cudaMemcpyAsync(indices.data(), mesh.triangles.data(), index_bytes, cudaMemcpyHostToDevice, nullptr),
      cudaSuccess);
  static int num_released;
  num_released = 0;
  const auto wrap = [&](void *data, uint64_t size) {
    gpurt_buffer_desc desc = GPURT_BUFFER_DESC_INIT;
    desc.storage = GPURT_STORAGE_DEVICE;
    desc.size_bytes = size;
    desc.data = data;
    desc.release = [](void *, void *) { ++num_released; };
    gpurt_buffer buffer = nullptr;
    GPURT_EXPECT_OK(gpurt_buffer_create(device, &desc, &buffer));
    return buffer;
  };
  const gpurt_buffer vertex_buffer = wrap(vertices.data(), vertex_bytes + offset),
                     index_buffer = wrap(indices.data(), index_bytes);
  Scene plain, tested;
  GPURT_ASSERT_OK(gpurt_scene_create(device, plain.out()));
  GPURT_ASSERT_OK(gpurt_scene_create(device, tested.out()));
  add_mesh(plain, mesh);
  gpurt_mesh_desc desc = GPURT_MESH_DESC_INIT;
  desc.vertices.buffer = vertex_buffer;
  desc.vertices.offset_bytes = offset;
  desc.vertices.count = mesh.vertices.size();
  desc.indices.buffer = index_buffer;
  desc.indices.count = mesh.triangles.size();
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  uint32_t id;
  GPURT_ASSERT_OK(gpurt_scene_add_mesh(tested, &desc, &instance.geometry));
  GPURT_ASSERT_OK(gpurt_scene_add_instance(tested, &instance, &id));
  GPURT_ASSERT_OK(gpurt_buffer_release(vertex_buffer));
  GPURT_ASSERT_OK(gpurt_buffer_release(index_buffer));
  commit(plain);
  commit(tested);
  RayTargets targets{mesh};
  set_bounds(targets);
  std::vector<gpurt_ray> rays(10'000);
  for (size_t i = 0; i < rays.size(); ++i) rays[i] = make_ray(targets, i);
  EXPECT_TRUE(same(trace_closest(plain, rays), trace_closest(tested, rays)));
  tested = Scene();
  EXPECT_EQ(num_released, 2);
}

TEST(CudaPair, TracesRaysWhereTheyAre)
{
  if (num_cuda_devices() < 2) GTEST_SKIP() << "no two CUDA devices";
  Fixture f = make_fixture(1'000'003);
  const auto closest = trace_in_host_memory<gpurt_hit>(f, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL);
  const auto any = trace_in_host_memory<uint8_t>(f, GPURT_QUERY_ANY, GPURT_HIT_FULL);
  Fixture pair;
  pair.rays = f.rays;
  pair.device = make_cuda_devices({0, 1});
  GPURT_ASSERT_OK(gpurt_scene_create(pair.device, pair.scene.out()));
  fill_city(pair.scene);
  commit(pair.scene);
  for (int ordinal : {0, 1}) {
    ASSERT_EQ(cudaSetDevice(ordinal), cudaSuccess);
    EXPECT_TRUE(
        same(trace_in_device_memory<gpurt_hit>(pair, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL, 0), closest));
    const DeviceBytes rays(pair.rays.size() * sizeof(gpurt_ray)), hits(pair.rays.size() * sizeof(gpurt_hit));
    ASSERT_EQ(cudaMemcpy(rays.data(), pair.rays.data(), pair.rays.size() * sizeof(gpurt_ray),
                         cudaMemcpyHostToDevice),
              cudaSuccess);
    gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
    desc.storage = GPURT_STORAGE_DEVICE;
    desc.num_rays = pair.rays.size();
    desc.rays = reinterpret_cast<const gpurt_ray *>(rays.data());
    desc.hits = hits.data();
    cudaStream_t stream;
    ASSERT_EQ(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking), cudaSuccess);
    GPURT_ASSERT_OK(gpurt_cuda_trace(pair.scene, &desc, stream, nullptr, nullptr));
    GPURT_ASSERT_OK(gpurt_cuda_wait(pair.device, uint32_t(ordinal), stream));
    std::vector<gpurt_hit> host(pair.rays.size());
    ASSERT_EQ(cudaMemcpy(host.data(), hits.data(), host.size() * sizeof(gpurt_hit), cudaMemcpyDeviceToHost),
              cudaSuccess);
    EXPECT_TRUE(same(host, closest));
    ASSERT_EQ(cudaStreamDestroy(stream), cudaSuccess);
  }
  ASSERT_EQ(cudaSetDevice(0), cudaSuccess);
  // Rays in host memory are shared out.
  EXPECT_TRUE(same(trace_in_host_memory<gpurt_hit>(pair, GPURT_QUERY_CLOSEST, GPURT_HIT_FULL), closest));
  EXPECT_TRUE(same(trace_in_host_memory<uint8_t>(pair, GPURT_QUERY_ANY, GPURT_HIT_FULL), any));
  std::vector<uint64_t> offsets[2];
  std::vector<gpurt_hit> hits[2];
  for (int i = 0; i < 2; ++i) {
    gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
    desc.query = GPURT_QUERY_ALL;
    desc.num_rays = f.rays.size();
    desc.rays = f.rays.data();
    offsets[i].resize(f.rays.size() + 1);
    desc.offsets = offsets[i].data();
    const gpurt_scene scene = i == 0 ? f.scene : pair.scene;
    GPURT_ASSERT_OK(gpurt_scene_trace(scene, &desc));
    hits[i].resize(offsets[i].back());
    desc.hits = hits[i].data();
    desc.hit_capacity = hits[i].size();
    GPURT_ASSERT_OK(gpurt_scene_trace(scene, &desc));
  }
  EXPECT_EQ(offsets[0], offsets[1]);
  EXPECT_TRUE(same(hits[0], hits[1]));
}

}  // namespace
}  // namespace gpurt_test
