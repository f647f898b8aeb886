// Whole paths in one kernel.
#pragma once

#include <cuda_runtime_api.h>

#include "core/path/path_wave.h"
#include "cuda/accel/schedule/kernels.h"

namespace gpurt::cuda {

/// What the kernel counts, in device memory.
struct UberPathCounters {
  unsigned long long ray_refills, mode_switches, num_bounce_rays, num_shadow_rays;
};

/// What the kernel needs in device memory as numbers: its counters, then its pool.
constexpr uint64_t num_uber_numbers = sizeof(UberPathCounters) / sizeof(unsigned long long) + 1;

/// Follows paths first .. first + count - 1 of the unit to their ends, from the camera on, with what each needs in its
/// slot of the wave. `pool` is null for a regular launch.
void launch_uber_paths(const TraceScene &scene, const PathSettings &settings, const PathUnit &unit,
                       const PathWave &wave, uint32_t first, uint32_t count, RayPool pool,
                       UberPathCounters *counters, cudaStream_t stream);

}  // namespace gpurt::cuda
