// Rays are counted before they are made: the talk's material and light kernel in two steps.
#pragma once

#include <cuda_runtime_api.h>

#include "core/path/path_wave.h"

namespace gpurt::cuda {

/// Whether each of hits begin .. end - 1 makes a shadow ray and a next ray, as flags from index 0 on.
void launch_count_rays(const ShadePathVertex &stage, uint32_t begin, uint32_t end, uint32_t *shadow_flags,
                       uint32_t *next_flags, cudaStream_t stream);

/// Shades the same hits: radiance goes to the paths, rays to their places in wave.shadow_queue and wave.next_rays.
void launch_make_rays(const ShadePathVertex &stage, uint32_t begin, uint32_t end,
                      const uint32_t *shadow_places, const uint32_t *next_places, cudaStream_t stream);

}  // namespace gpurt::cuda
