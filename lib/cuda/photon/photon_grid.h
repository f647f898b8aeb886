// A grid of photons in device memory.
#pragma once

#include "cuda/device_memory.h"
#include "cuda/photon/kernels.h"

namespace gpurt::cuda {

struct DevicePhotonGridOptions {
  bool keep_rests = false;      // directions and normals
  bool keep_indices = false;    // which record a photon of the grid was
  bool ids_for_fluxes = false;  // the record's index in place of its flux
};

/// Immutable once its work is done. Whoever lets go of it first waits for work that uses it.
class DevicePhotonGrid {
 public:
  /// Room for a grid; `build` fills it.
  DevicePhotonGrid(const GridShape &shape, uint64_t num_photons, const DevicePhotonGridOptions &options,
                   const std::shared_ptr<DeviceMemory> &memory);

  uint64_t build_bytes() const { return grid_build_bytes(shape_, num_photons_); }
  /// Queues the build. The source, in device memory and with records where fluxes or rests are kept, and `memory` (build_bytes) stay until it is done.
  void build(const PhotonSource &source, void *memory, cudaStream_t stream) const;

  PhotonGrid view() const;
  uint64_t bytes() const { return starts_.bytes() + probes_.bytes() + rests_.bytes() + indices_.bytes(); }

 private:
  GridTarget target() const;

  GridShape shape_;
  uint64_t num_photons_;
  bool ids_for_fluxes_;
  DeviceBuffer<uint32_t> starts_;
  DeviceBuffer<PhotonProbe> probes_;
  DeviceBuffer<PhotonRest> rests_;
  DeviceBuffer<uint32_t> indices_;
};

}  // namespace gpurt::cuda
