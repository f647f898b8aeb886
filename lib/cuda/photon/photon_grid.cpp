#include "cuda/photon/photon_grid.h"

namespace gpurt::cuda {

DevicePhotonGrid::DevicePhotonGrid(const GridShape &shape, uint64_t num_photons,
                                   const DevicePhotonGridOptions &options,
                                   const std::shared_ptr<DeviceMemory> &memory)
    : shape_(shape),
      num_photons_(num_photons),
      ids_for_fluxes_(options.ids_for_fluxes),
      starts_(memory, uint64_t(shape.table_size) + 1, "a photon grid's cells"),
      probes_(memory, num_photons, "a photon grid's photons"),
      rests_(memory, options.keep_rests ? num_photons : 0, "a photon grid's photons"),
      indices_(memory, options.keep_indices ? num_photons : 0, "a photon grid's photons")
{}

GridTarget DevicePhotonGrid::target() const
{
  return {starts_.data(), probes_.data(), rests_.data(), indices_.data(), ids_for_fluxes_};
}

void DevicePhotonGrid::build(const PhotonSource &source, void *memory, cudaStream_t stream) const
{
  launch_build_grid(shape_, source, target(), memory, stream);
}

PhotonGrid DevicePhotonGrid::view() const
{
  return {shape_, starts_.data(), probes_.data(), rests_.data(), indices_.data(), num_photons_};
}

}  // namespace gpurt::cuda
