// A grid of photons on the host, built by all threads of the calling arena.
#pragma once

#include <memory>

#include "accel/tracked_array.h"
#include "core/photon/grid.h"
#include "core/photon/photon_source.h"

namespace gpurt {

struct PhotonGridOptions {
  float radius = 0;             // that gathers mostly have: the edge of a cell
  bool keep_rests = true;       // directions and normals
  bool keep_indices = false;    // which record a photon of the grid was
  bool ids_for_fluxes = false;  // the record's index in place of its flux
};

/// The bounds of positions. Photons that are not finite: `first_bad` is the index of the first, else num_photons.
Box photon_bounds(const PhotonSource &source, uint64_t &first_bad);

/// Immutable; used from any thread.
class CpuPhotonGrid {
 public:
  /// The same bytes for any number of threads. Positions lie within `bounds`. Throws OUT_OF_MEMORY.
  CpuPhotonGrid(const PhotonSource &source, const Box &bounds, const PhotonGridOptions &options,
                const std::shared_ptr<MemoryTracker> &memory);

  /// Valid while this lives.
  PhotonGrid view() const;
  uint64_t bytes() const { return starts_.bytes() + probes_.bytes() + rests_.bytes() + indices_.bytes(); }

 private:
  GridShape shape_;
  uint64_t num_photons_;
  TrackedArray<uint32_t> starts_;
  TrackedArray<PhotonProbe> probes_;
  TrackedArray<PhotonRest> rests_;
  TrackedArray<uint32_t> indices_;
};

}  // namespace gpurt
