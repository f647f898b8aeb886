// Kd-trees in a file, to save building them again.
//
// Little endian: the eight bytes "gpurtkd\1"; uint64 key, number of trees; for every tree uint64 primitives, nodes,
// references, float[6] bounds, double SAH cost, the nodes, the references; uint64 checksum of all before it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "backend.h"

namespace gpurt {

struct CachedTree {
  HostKdTree tree;
  double sah_cost = 0;
};

/// What a tree is made from: a scene and the options of its build.
uint64_t kd_cache_key(uint64_t scene_hash, const BuildOptions &options);

/// The trees of a file that was written for this key; nothing, with the reason, if there is no such file, if it is of
/// another scene, or damaged. The trees' structure is not checked here.
std::optional<std::vector<CachedTree>> read_kd_cache(const std::string &path, uint64_t key,
                                                     std::string &reason);

/// Writes under a temporary name beside the file, then renames. Throws IO.
void write_kd_cache(const std::string &path, uint64_t key, const std::vector<CachedTree> &trees);

}  // namespace gpurt
