// Photon mapping of one pass on the CPU.
#pragma once

#include <tbb/task_arena.h>

#include "backend.h"
#include "cpu/photon/photon_kernel.h"

namespace gpurt {

/// What photon mapping runs on.
struct CpuPhotonScene {
  const CpuAccel &accel;
  const SceneView &scene;
  const PhotonKernels &kernels;
  tbb::task_arena &arena;
  const std::shared_ptr<MemoryTracker> &memory;
};

/// Renders the units of `pass`, which have one sample each, on the arena's threads: for each sample index the photons of
/// that pass are traced once, into as many maps as the memory limit asks for. Returns when all units are delivered or left
/// out by cancellation.
void render_photons_on_cpu(const RenderPass &pass, const CpuPhotonScene &scene);

PhotonPilot photon_pilot_on_cpu(const PathSettings &settings, const EmissionView &emission,
                                uint32_t num_paths, uint32_t points_per_axis, const TakePilotPhotons &take,
                                const CpuPhotonScene &scene);

}  // namespace gpurt
