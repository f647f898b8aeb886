// Photon maps of points in device memory, and queries there and on streams: the bits of host memory.
#include <cuda_runtime_api.h>

#include "../support/photon_map.h"
#include "gpurt_cuda.h"

namespace gpurt_test {
namespace {

template <class T>
class OnDevice {
 public:
  explicit OnDevice(const std::vector<T> &host) : size_(host.size())
  {
    EXPECT_EQ(cudaMalloc(&data_, bytes() + 4), cudaSuccess);
    // On the default stream and without waiting: what gpurt does comes after it.
    EXPECT_EQ(cudaMemcpyAsync(data_, host.data(), bytes(), cudaMemcpyHostToDevice, nullptr), cudaSuccess);
  }
  OnDevice(const OnDevice &) = delete;
  ~OnDevice() { cudaFree(data_); }
  T *data() const { return static_cast<T *>(data_); }
  size_t bytes() const { return size_ * sizeof(T); }
  void read(std::vector<T> &host, cudaStream_t stream = nullptr) const
  {
    EXPECT_EQ(cudaMemcpyAsync(host.data(), data_, bytes(), cudaMemcpyDeviceToHost, stream), cudaSuccess);
    EXPECT_EQ(cudaStreamSynchronize(stream), cudaSuccess);
  }

 private:
  void *data_ = nullptr;
  size_t size_;
};

struct Fixture {
  Device device = make_device(GPURT_DEVICE_CUDA);
  photon_sets::Set set{"", photon_sets::clustered(30000, 4), 0.002f};
  MapPoints points{set.points, {}, {}};
  std::vector<Point> places = photon_sets::queries(set, 20000, 9);

  Fixture()
  {
    for (size_t i = 0; i < set.points.size(); ++i) points.fluxes.push_back({float(i % 7), 1, float(i % 3)});
    std::mt19937 random(5);
    for (size_t i = 0; i < set.points.size(); ++i)
      points.normals.push_back(photon_sets::on_sphere(random, {0, 0, 0}, 1));
  }
};

TEST(CudaPhotonMemory, GivesTheBitsOfHostMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Fixture f;
  const PhotonMap expected_map = make_map(f.device, f.points, f.set.radius, 2);
  const OnDevice positions(f.points.positions), fluxes(f.points.fluxes), normals(f.points.normals),
      places(f.places);
  gpurt_photon_map_desc map_desc = GPURT_PHOTON_MAP_DESC_INIT;
  map_desc.storage = GPURT_STORAGE_DEVICE;
  map_desc.num_points = f.points.positions.size();
  map_desc.positions = positions.data()->data();
  map_desc.fluxes = fluxes.data()->data();
  map_desc.normals = normals.data()->data();
  map_desc.radius = f.set.radius;
  map_desc.num_levels = 2;
  PhotonMap map;
  GPURT_ASSERT_OK(gpurt_photon_map_create(f.device, &map_desc, map.out()));
  cudaStream_t stream;
  ASSERT_EQ(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking), cudaSuccess);

  for (const gpurt_photon_query query : {GPURT_PHOTON_QUERY_COUNT, GPURT_PHOTON_QUERY_SUM,
                                         GPURT_PHOTON_QUERY_LIST, GPURT_PHOTON_QUERY_NEAREST}) {
    gpurt_photon_query_desc desc = query_desc(query, f.places, f.set.radius);
    if (query == GPURT_PHOTON_QUERY_NEAREST) desc.k = 7, desc.radius = 0;
    else desc.normals = f.places.data()->data();
    const Answers expected = ask(expected_map, desc);
    desc.storage = GPURT_STORAGE_DEVICE;
    desc.positions = places.data()->data();
    if (desc.normals != nullptr) desc.normals = places.data()->data();
    const OnDevice counts(expected.counts), ids(expected.ids);
    const OnDevice sums(expected.sums);
    const OnDevice offsets(expected.offsets);
    const OnDevice distances(expected.distances);
    if (!expected.counts.empty()) desc.counts = counts.data();
    if (!expected.sums.empty()) desc.sums = sums.data()->data();
    if (!expected.offsets.empty()) desc.offsets = offsets.data();
    if (!expected.ids.empty())
      desc.ids = ids.data(), desc.distances = distances.data(), desc.capacity = expected.ids.size();
    const auto expect_answers = [&](cudaStream_t on) {
      Answers answers = expected;
      const auto clear = [](auto &values) {
        if (!values.empty())
          std::memset(static_cast<void *>(values.data()), 0xee, values.size() * sizeof values[0]);
      };
      clear(answers.counts), clear(answers.ids), clear(answers.sums), clear(answers.offsets),
          clear(answers.distances);
      counts.read(answers.counts, on), ids.read(answers.ids, on), sums.read(answers.sums, on);
      offsets.read(answers.offsets, on), distances.read(answers.distances, on);
      EXPECT_TRUE(answers == expected) << "query " << query;
    };
    const auto clear_device = [&] {
      cudaMemset(counts.data(), 0xee, counts.bytes()), cudaMemset(ids.data(), 0xee, ids.bytes());
      cudaMemset(sums.data(), 0xee, sums.bytes()), cudaMemset(distances.data(), 0xee, distances.bytes());
      cudaDeviceSynchronize();
    };
    clear_device();
    GPURT_EXPECT_OK(gpurt_photon_map_query(map, &desc));
    expect_answers(nullptr);
    clear_device();
    const gpurt_result result = gpurt_cuda_query_photons(map, &desc, stream, nullptr, nullptr);
    if (query == GPURT_PHOTON_QUERY_LIST) {
      EXPECT_EQ(result, GPURT_ERROR_UNSUPPORTED);
    } else {
      EXPECT_EQ(result, GPURT_OK) << gpurt_last_error();
      expect_answers(stream);
    }
  }
  cudaStreamDestroy(stream);
}

TEST(CudaPhotonMemory, RefusesHostMemoryByName)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Fixture f;
  gpurt_photon_map_desc map_desc = GPURT_PHOTON_MAP_DESC_INIT;
  map_desc.storage = GPURT_STORAGE_DEVICE;
  map_desc.num_points = f.points.positions.size();
  map_desc.positions = f.points.positions.data()->data();
  map_desc.radius = 1;
  PhotonMap map;
  EXPECT_EQ(gpurt_photon_map_create(f.device, &map_desc, map.out()), GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_NE(std::string(gpurt_last_error()).find("positions is host memory"), std::string::npos);
  map = make_map(f.device, f.points, f.set.radius);
  std::vector<uint32_t> counts(f.places.size());
  gpurt_photon_query_desc desc = query_desc(GPURT_PHOTON_QUERY_COUNT, f.places, f.set.radius);
  desc.counts = counts.data();
  EXPECT_EQ(gpurt_cuda_query_photons(map, &desc, nullptr, nullptr, nullptr), GPURT_ERROR_INVALID_ARGUMENT);
  desc.storage = GPURT_STORAGE_DEVICE;
  EXPECT_EQ(gpurt_photon_map_query(map, &desc), GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_NE(std::string(gpurt_last_error()).find("positions is host memory"), std::string::npos);
}

}  // namespace
}  // namespace gpurt_test
