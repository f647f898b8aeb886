// A map of the photons of a scene, on the device.
#pragma once

#include "backend.h"
#include "cuda/accel/kernels.h"
#include "cuda/lanes.h"
#include "photon_maps.h"

namespace gpurt::cuda {

/// As CommittedScene::photon_map; the photons never leave the device. `owner` keeps lanes and memory alive. The device is
/// current.
std::shared_ptr<const PhotonMap> photon_map_on_device(const PathSettings &settings,
                                                      const EmissionView &emission,
                                                      const ScenePhotonRequest &asked,
                                                      const TraceScene &scene, std::shared_ptr<void> owner,
                                                      const std::shared_ptr<DeviceMemory> &memory,
                                                      LanePool &lanes);

}  // namespace gpurt::cuda
