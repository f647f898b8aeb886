// The kd-trees of a scene in device memory.
#pragma once

#include "accel/kd_trees.h"
#include "core/accel/kd_accel.h"
#include "cuda/device_memory.h"

namespace gpurt::cuda {

class DeviceKdAccel {
 public:
  /// Copies the trees of the scene's groups and the one over its placements, and gathers the triangles of the
  /// leaves on the device from `view`, which lies there. Throws OUT_OF_MEMORY.
  DeviceKdAccel(const CompiledScene &scene, const SceneView &view, const KdTrees &trees,
                const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream);

  /// Pointers to device memory, valid while this lives.
  const KdAccelView &view() const { return view_; }
  uint64_t bytes() const;
  /// Copies the tree of a group back.
  HostKdTree download(size_t group, cudaStream_t stream) const;

 private:
  // All trees lie one behind the other in the same arrays.
  struct Tree {
    uint64_t first_node, num_nodes, first_reference, num_references;
    uint64_t num_triangles;
    Box bounds;
  };
  KdTreeView tree_view(const Tree &tree) const;

  std::vector<Tree> trees_;
  DeviceBuffer<KdNode> nodes_;
  DeviceBuffer<uint32_t> references_;
  DeviceBuffer<LeafTriangle> triangles_;
  DeviceBuffer<KdGroupView> groups_;
  KdAccelView view_{};
};

}  // namespace gpurt::cuda
