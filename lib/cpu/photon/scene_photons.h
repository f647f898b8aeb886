// A map of the photons of a scene, on the host.
#pragma once

#include "cpu/photon/render.h"
#include "photon_maps.h"

namespace gpurt {

/// As CommittedScene::photon_map. The map keeps the arena.
std::shared_ptr<const PhotonMap> photon_map_on_cpu(const PathSettings &settings, const EmissionView &emission,
                                                   const ScenePhotonRequest &asked,
                                                   const CpuPhotonScene &scene,
                                                   const std::shared_ptr<tbb::task_arena> &arena);

}  // namespace gpurt
