// The bounding volume hierarchies of a scene in device memory.
#pragma once

#include "accel/bvh_trees.h"
#include "core/accel/bvh_accel.h"
#include "cuda/accel/build/bvh_builder.h"
#include "cuda/device_memory.h"

namespace gpurt::cuda {

class DeviceBvhAccel {
 public:
  /// Copies the host's trees of the scene's groups and the one over its placements, and gathers the triangles of the
  /// leaves on the device from `view`, which lies there. Trees of groups with more than `most_host_triangles` are built
  /// here, on the device, or, where `previous` has the tree of the same triangles, which may have moved, refitted to them,
  /// unless that has become too bad. Throws OUT_OF_MEMORY, UNSUPPORTED.
  DeviceBvhAccel(const CompiledScene &scene, const SceneView &view, const BvhTrees &trees,
                 uint64_t most_host_triangles, const DeviceBvhAccel *previous,
                 const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream);

  /// Pointers to device memory, valid while this lives.
  const BvhAccelView &view() const { return view_; }
  /// Group 0, which holds what lies in world space.
  const BvhGroupView &world() const { return world_; }
  uint64_t bytes() const;
  /// What was built or refitted on the device, in the order of groups.
  const std::vector<DeviceBvh> &built() const { return built_; }

 private:
  // The host's trees lie one behind the other in the same arrays.
  DeviceBuffer<BvhNode> nodes_;
  DeviceBuffer<LeafTriangle> triangles_;
  DeviceBuffer<uint32_t> placement_references_;
  std::vector<DeviceBvh> built_;
  DeviceBuffer<BvhGroupView> groups_;
  BvhAccelView view_{};
  BvhGroupView world_{};
};

}  // namespace gpurt::cuda
