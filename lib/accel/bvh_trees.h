// The bounding volume hierarchies of a scene, built on the host's threads for every backend.
#pragma once

#include "accel/bvh_build.h"

namespace gpurt {

struct BvhTrees {
  std::vector<HostBvh> groups;  // one for every group of the scene
  HostBvh placements;           // over the bounds of CompiledScene::placements
  AccelFacts facts;             // all but the bytes, which depend on the backend's layout
};

/// Builds the trees on the threads of the calling task arena. `memory` may be null: nothing is accounted. Trees of groups
/// with more than `most_triangles` are left empty: a backend builds them itself.
/// Throws OUT_OF_MEMORY, UNSUPPORTED.
BvhTrees build_bvh_trees(const CompiledScene &scene, TriangleTest triangle_test,
                         const std::shared_ptr<MemoryTracker> &memory, uint64_t most_triangles = UINT64_MAX);

/// What the tree exchange answers to a scene with this accelerator. Throws INVALID_ARGUMENT.
[[noreturn]] void refuse_bvh_export();

}  // namespace gpurt
