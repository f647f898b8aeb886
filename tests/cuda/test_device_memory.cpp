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

}  // namespace
}  // namespace gpurt_test
