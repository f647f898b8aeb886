// Deferred shading: the order of hits by material.
#pragma once

#include <cuda_runtime_api.h>

#include "core/accel/ray.h"
#include "core/scene/scene_view.h"

namespace gpurt::cuda {

/// Memory that sorting up to n hits wants.
uint64_t sort_hits_bytes(uint32_t n);

/// The indices of n hits sorted by their materials, misses last, hits of one material in their order. The result lies in
/// `memory` and is valid until it is used again.
const uint32_t *launch_sort_hits(const SceneView &scene, const Hit *hits, uint32_t n, void *memory,
                                 uint64_t memory_bytes, cudaStream_t stream);

}  // namespace gpurt::cuda
