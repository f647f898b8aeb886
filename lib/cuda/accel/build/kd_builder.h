// Builds the kd-tree of a group's triangles in device memory.
//
// Source: Wald and Havran 2006, SAH and clipped triangles; Zhou et al. 2008, Wu et al. 2011 for building breadth first.
// Differs: cells of at most 64 references are split exactly, one by each warp; larger ones by counts in bins, with the plane
// moved to the nearest end of a reference. The tree is the same in every run: cells follow one another in the order of their
// parents, and threads combine integers alone.
#pragma once

#include "core/accel/kd_tree.h"
#include "core/scene/scene_view.h"
#include "cuda/device_memory.h"

namespace gpurt::cuda {

/// As KdBuildSettings of the builder on the host; 0: the same defaults.
struct DeviceKdSettings {
  uint32_t max_depth = 0;
  float traversal_cost = 0, empty_bonus = 0;
};

struct DeviceKdTree {
  DeviceBuffer<KdNode> nodes;  // level by level
  DeviceBuffer<uint32_t> references;
  uint64_t num_nodes = 0, num_references = 0;  // the arrays may be larger
  Box bounds = {};
  // Facts of the build.
  uint32_t depth = 0;
  double sah_cost = 0;
  double seconds = 0;
  uint64_t peak_bytes = 0;  // of the largest share of memory that was held at a time, the tree included
};

/// Builds the tree of the group's triangles, which `view` has in device memory, and waits for it.
///
/// Degenerate triangles get no reference. A tree without triangles has no nodes.
/// Errors: OUT_OF_MEMORY; UNSUPPORTED for more triangles or nodes than a tree can have.
DeviceKdTree build_kd_tree_on_device(const SceneView &view, const Group &group,
                                     const DeviceKdSettings &settings,
                                     const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream);

}  // namespace gpurt::cuda
