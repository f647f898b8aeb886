#include "cuda/photon/scene_photons.h"

#include <algorithm>

#include "cuda/photon/device_emission.h"
#include "cuda/photon/photon_map.h"
#include "cuda/photon/photon_store.h"
#include "error.h"

namespace gpurt::cuda {
namespace {

// Photons in flight: as for images.
constexpr uint32_t most_in_flight = uint32_t(1) << 20, fewest_in_flight = uint32_t(1) << 10;

std::unique_ptr<PhotonStore> make_store(PassQueue &queue, uint32_t num_paths)
{
  for (uint32_t capacity = std::clamp(num_paths, fewest_in_flight, most_in_flight);; capacity /= 2) {
    try {
      return std::make_unique<PhotonStore>(queue, capacity, 1);
    } catch (const Error &e) {
      check(cudaStreamSynchronize(queue.stream), "cudaStreamSynchronize");
      if (e.result() != GPURT_ERROR_OUT_OF_MEMORY || capacity / 2 < fewest_in_flight) throw;
    }
  }
}

// All photons of a flight, in whatever order blocks came.
DeviceBuffer<Photon> trace_all(PassQueue &queue, const PhotonFlight &flight, uint32_t num_paths)
{
  std::vector<DeviceBuffer<Photon>> parts;  // of as many as the store holds at a time
  uint64_t num_photons = 0;
  {
    const std::unique_ptr<PhotonStore> store = make_store(queue, num_paths);
    const WaitAtEnd wait(queue.stream);
    queue.clock.start(queue.stream);
    store->begin(flight, num_paths, 1);
    do {
      store->trace();
      num_photons += store->num_records();
      parts.emplace_back(queue.memory, store->num_records(), "photons of a scene");
      store->read_records(parts.back().data());
    } while (!store->is_last());
  }
  if (parts.size() == 1) return std::move(parts[0]);
  DeviceBuffer<Photon> all(queue.memory, num_photons, "photons of a scene");
  const WaitAtEnd wait(queue.stream);
  Photon *to = all.data();
  for (const DeviceBuffer<Photon> &part : parts) {
    check(cudaMemcpyAsync(to, part.data(), part.bytes(), cudaMemcpyDeviceToDevice, queue.stream),
          "cudaMemcpyAsync");
    to += part.size();
  }
  check(cudaStreamSynchronize(queue.stream), "cudaStreamSynchronize");
  return all;
}

DeviceBuffer<Photon> sorted(PassQueue &queue, const DeviceBuffer<Photon> &records, uint32_t num_paths)
{
  const uint64_t n = records.size();
  DeviceBuffer<Photon> to(queue.memory, n, "photons of a scene");
  if (n == 0) return to;
  const DeviceBuffer<std::byte> work(queue.memory, record_order_bytes(n), "sorting photons of a scene");
  const WaitAtEnd wait(queue.stream);
  launch_order_records(records.data(), n, num_paths, work.data(), to.data(), queue.stream);
  check(cudaStreamSynchronize(queue.stream), "cudaStreamSynchronize");
  return to;
}

}  // namespace

std::shared_ptr<const PhotonMap> photon_map_on_device(const PathSettings &settings,
                                                      const EmissionView &emission,
                                                      const ScenePhotonRequest &asked,
                                                      const TraceScene &scene, std::shared_ptr<void> owner,
                                                      const std::shared_ptr<DeviceMemory> &memory,
                                                      LanePool &lanes)
{
  DeviceBuffer<Photon> records;
  {
    const LaneLease lane = lanes.acquire();
    auto *const numbers = static_cast<std::byte *>(lane->to_device.reserve(PassQueue::pinned_bytes));
    PassQueue queue{scene, memory, lane->stream(), numbers, nullptr, {}, {}};
    const DeviceEmission on_device(emission, memory, lane->stream());
    const PhotonPass pass =
        make_photon_pass({asked.num_paths, 1, PhotonKernel::Constant, 0}, emission, asked.pass);
    const DeviceBuffer<PhotonPass> passes =
        upload(memory, std::span<const PhotonPass>(&pass, 1), "a pass of photons", lane->stream());
    const PhotonFlight flight{scene.scene,          on_device.view(),   passes.data(),   settings.seed,
                              settings.frame_index, settings.max_depth, asked.num_paths, queue.has_near()};
    const DeviceBuffer<Photon> traced = trace_all(queue, flight, pass.num_emitted);
    if (traced.size() <= max_photons) records = sorted(queue, traced, asked.num_paths);
    else map_request(asked, emission, nullptr, traced.size());  // which says so
  }
  PhotonMapRequest request = map_request(asked, emission, records.data(), records.size());
  request.device_memory = true;
  return std::make_shared<CudaPhotonMap>(request, std::move(owner), memory, lanes);
}

}  // namespace gpurt::cuda
