// Builds the bvh of a group's triangles in device memory.
//
// Source: Wald 2007, binned SAH; Stich et al. 2009, spatial splits; as the builder on the host (lib/accel/bvh_build.h) does.
// Differs: breadth first, the nodes of a level side by side: the largest ones by many blocks, others by one block each, and
// subtrees of at most 32 references whole, by one warp, with planes between all of their centres. The tree is the same in
// every run: threads combine integers alone, and where memory is handed out in the order of arrival, that order does not
// reach the tree.
#pragma once

#include "core/accel/bvh_accel.h"
#include "core/scene/scene_view.h"
#include "cuda/device_memory.h"

namespace gpurt::cuda {

struct DeviceBvh {
  DeviceBuffer<BvhNode> nodes;           // depth first
  DeviceBuffer<LeafTriangle> triangles;  // leaf by leaf
  Box bounds = {};
  BvhFrame frame = {};
  uint32_t root = bvh_empty;
  // Facts of the build.
  uint32_t depth = 0;
  double sah_cost = 0;
  double built_sah_cost = 0;  // when it was last built, rather than refitted
  bool is_complete = true;    // no triangle was left out as degenerate
  bool is_refitted = false;
  double seconds = 0;
  double reference_seconds = 0, split_seconds = 0, layout_seconds = 0;  // of these, on the device
  uint64_t peak_bytes = 0;  // of the largest share of memory that was held at a time, the tree included
};

/// Builds the tree of the group's triangles, which `view` has in device memory, and waits for it.
///
/// Degenerate triangles get no reference. A tree without triangles has no nodes.
/// Errors: OUT_OF_MEMORY; UNSUPPORTED for more triangles than a tree can refer to.
DeviceBvh build_bvh_on_device(const SceneView &view, const Group &group,
                              const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream);

}  // namespace gpurt::cuda
