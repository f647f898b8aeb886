// A photon map on the host.
#pragma once

#include <tbb/task_arena.h>

#include <vector>

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
  void find_nearest(const PhotonQuery &query) const;

  std::shared_ptr<tbb::task_arena> arena_;
  std::shared_ptr<MemoryTracker> memory_;
  PhotonMapFacts facts_;
  std::vector<CpuPhotonGrid> grids_;
  PhotonLevels levels_{};
};

}  // namespace gpurt
