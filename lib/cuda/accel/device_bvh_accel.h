// The bounding volume hierarchies of a scene in device memory.
#pragma once

#include "accel/bvh_trees.h"
#include "core/accel/bvh_accel.h"
#include "cuda/device_memory.h"

namespace gpurt::cuda {

class DeviceBvhAccel {
 public:
  /// Copies the trees of the scene's groups and the one over its placements, and gathers the triangles of the leaves on
  /// the device from `view`, which lies there. Throws OUT_OF_MEMORY.
  DeviceBvhAccel(const CompiledScene &scene, const SceneView &view, const BvhTrees &trees,
                 const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream);

  /// Pointers to device memory, valid while this lives.
  const BvhAccelView &view() const { return view_; }
  uint64_t bytes() const;

 private:
  // All trees lie one behind the other in the same arrays.
  DeviceBuffer<BvhNode> nodes_;
  DeviceBuffer<LeafTriangle> triangles_;
  DeviceBuffer<uint32_t> placement_references_;
  DeviceBuffer<BvhGroupView> groups_;
  BvhAccelView view_{};
};

}  // namespace gpurt::cuda
