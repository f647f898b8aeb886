// The kd-trees of a scene, built on the host's threads for every backend.
#pragma once

#include "backend.h"

namespace gpurt {

struct KdTrees {
  std::vector<HostKdTree> groups;  // one for every group of the scene
  HostKdTree placements;           // over the bounds of CompiledScene::placements
  AccelFacts facts;                // all but the bytes, which depend on the backend's layout
};

/// Builds the trees, takes imported ones in their place, reads or writes the cache file, as `options` say, on the threads
/// of the calling task arena. `memory` may be null: nothing is accounted. `log` may be empty. Groups of more than
/// `most_triangles` are left without a tree, unless one is imported or the cache has it.
/// Throws INVALID_ARGUMENT, OUT_OF_MEMORY, UNSUPPORTED, IO.
KdTrees build_kd_trees(const CompiledScene &scene, const BuildOptions &options,
                       const std::shared_ptr<MemoryTracker> &memory,
                       const std::function<void(gpurt_log_level, const std::string &)> &log,
                       uint64_t most_triangles = UINT64_MAX);

/// The group that a tree of the tree exchange stands for. Throws INVALID_ARGUMENT where there is none.
size_t group_of_tree(const CompiledScene &scene, uint32_t tree);

}  // namespace gpurt
