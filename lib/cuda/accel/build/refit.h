// Fits a bvh to triangles that have moved: the tree stays, its boxes are made anew from the leaves up.
//
// Source: Karras 2012, for the way up: of the two that arrive at a node, the second goes on.
#pragma once

#include "cuda/accel/build/bvh_builder.h"

namespace gpurt::cuda {

/// A tree with the nodes and leaves of `old`, whose triangles are those of `view` now. `old` stays as it is. Parts of
/// triangles that were cut become whole triangles again.
///
/// `fits` is set to false, and the tree is of no use, where a triangle has lost its area: it must have no reference then.
/// (`old` must have references to all triangles of its group.)
/// Errors: OUT_OF_MEMORY.
DeviceBvh refit_bvh(const DeviceBvh &old, const SceneView &view, const std::shared_ptr<DeviceMemory> &memory,
                    cudaStream_t stream, bool &fits);

}  // namespace gpurt::cuda
