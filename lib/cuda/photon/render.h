// Passes of photon mapping on the device.
#pragma once

#include "backend.h"
#include "cuda/accel/kernels.h"
#include "cuda/lanes.h"

namespace gpurt::cuda {

/// Samples that a unit may have: their film goes to the host at once.
constexpr uint64_t most_photon_passes = 1024;

/// Renders the units of `pass`: for each sample the photons of its pass are traced once, into as many maps as memory asks
/// for. Returns when all units are delivered or left out by cancellation. The device is current.
void render_photons_on_device(const RenderPass &pass, const TraceScene &scene,
                              const std::shared_ptr<DeviceMemory> &memory, LanePool &lanes);

PhotonPilot photon_pilot_on_device(const PathSettings &settings, const EmissionView &emission,
                                   uint32_t num_paths, uint32_t points_per_axis, const TakePilotPhotons &take,
                                   const TraceScene &scene, const std::shared_ptr<DeviceMemory> &memory,
                                   LanePool &lanes);

}  // namespace gpurt::cuda
