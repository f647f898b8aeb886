// A photon map in device memory.
#pragma once

#include <atomic>
#include <mutex>
#include <vector>

#include "cuda/lanes.h"
#include "cuda/photon/photon_grid.h"
#include "memory.h"
#include "photon_maps.h"

namespace gpurt::cuda {

/// Lists of a kd-tree's leaves in device memory.
struct DeviceNodeLists {
  float radius;
  DeviceBuffer<PhotonNode> nodes;
  DeviceBuffer<uint32_t> photons;
  NodeLists view() const { return {nodes.data(), photons.data()}; }
};

class CudaPhotonMap final : public PhotonMap, public StreamQueries {
 public:
  /// `owner` keeps lanes and memory alive. The device is current.
  CudaPhotonMap(const PhotonMapRequest &request, std::shared_ptr<void> owner,
                std::shared_ptr<DeviceMemory> memory, LanePool &lanes);
  ~CudaPhotonMap() override;

  const PhotonMapFacts &facts() const override { return facts_; }
  void query(const PhotonQuery &query) const override;
  void query_on_stream(const PhotonQuery &query, void *stream, void *wait_event,
                       void *done_event) const override;
  void read(Photon *records) const override;

 private:
  void build(const PhotonMapRequest &request, Lane &lane);
  const PhotonGrid &grid_for(const PhotonQuery &query) const;
  void check_device_pointers(const PhotonQuery &query) const;
  std::shared_ptr<const DeviceNodeLists> lists_for(float radius, Lane &lane) const;

  std::shared_ptr<void> owner_;
  std::shared_ptr<DeviceMemory> memory_;
  LanePool &lanes_;
  PhotonMapFacts facts_;
  std::vector<DevicePhotonGrid> grids_;
  PhotonLevels levels_{};
  mutable std::mutex lists_mutex_;
  mutable std::shared_ptr<const DeviceNodeLists> lists_;  // of the last radius; null: none yet
  mutable std::atomic<bool> was_queued_{false};           // on a caller's stream
};

}  // namespace gpurt::cuda
