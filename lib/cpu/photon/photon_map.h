// A photon map on the host.
#pragma once

#include <tbb/task_arena.h>

#include <mutex>
#include <vector>

#include "accel/node_lists.h"
#include "cpu/photon/photon_grid.h"
#include "photon_maps.h"

namespace gpurt {

class CpuPhotonMap final : public PhotonMap {
 public:
  /// Copies the points. Throws INVALID_ARGUMENT for points that are not allowed; OUT_OF_MEMORY.
  CpuPhotonMap(const PhotonMapRequest &request, std::shared_ptr<tbb::task_arena> arena,
               std::shared_ptr<MemoryTracker> memory);

  const PhotonMapFacts &facts() const override { return facts_; }
  void query(const PhotonQuery &query) const override;
  void read(Photon *records) const override;

 private:
  void build(const PhotonMapRequest &request);
  void gather(const PhotonQuery &query) const;
  void gather_from_node_lists(const PhotonQuery &query) const;
  void find_nearest(const PhotonQuery &query) const;
  std::shared_ptr<const HostNodeLists> lists_for(float radius) const;

  std::shared_ptr<tbb::task_arena> arena_;
  std::shared_ptr<MemoryTracker> memory_;
  PhotonMapFacts facts_;
  std::vector<CpuPhotonGrid> grids_;
  PhotonLevels levels_{};
  mutable std::mutex lists_mutex_;
  mutable std::shared_ptr<const HostNodeLists> lists_;  // of the last radius; null: none yet
};

}  // namespace gpurt
