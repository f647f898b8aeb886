// The kd-trees of a scene in device memory.
#pragma once

#include "accel/kd_trees.h"
#include "core/accel/kd_accel.h"
#include "cuda/accel/build/kd_builder.h"
#include "cuda/accel/device_kd_quads.h"
#include "cuda/device_memory.h"

namespace gpurt::cuda {

class DeviceKdAccel {
 public:
  /// Copies the trees of the scene's groups and the one over its placements, and gathers the triangles of the
  /// leaves on the device from `view`, which lies there. Trees of groups with more than `most_host_triangles` are built
  /// here, on the device. Throws OUT_OF_MEMORY, UNSUPPORTED.
  DeviceKdAccel(const CompiledScene &scene, const SceneView &view, const KdTrees &trees,
                uint64_t most_host_triangles, const DeviceKdSettings &settings,
                const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream);

  /// Pointers to device memory, valid while this lives.
  const KdAccelView &view() const { return view_; }
  /// Group 0, which holds what lies in world space; its frame has no reach where fast kernels do not serve the scene.
  const KdQuadView &quads() const { return quads_.view(); }
  uint64_t bytes() const;
  /// Copies the tree of a group back.
  HostKdTree download(size_t group, cudaStream_t stream) const;
  /// What was built on the device, in the order of groups.
  const std::vector<DeviceKdTree> &built() const { return built_; }

 private:
  struct Tree {
    KdTreeView view;
    uint64_t num_references, num_triangles;
  };

  std::vector<Tree> trees_;
  // The host's trees lie one behind the other in the same arrays, and the triangles of all trees' leaves.
  DeviceBuffer<KdNode> nodes_;
  DeviceBuffer<uint32_t> references_;
  DeviceBuffer<LeafTriangle> triangles_;
  DeviceBuffer<KdGroupView> groups_;
  std::vector<DeviceKdTree> built_;
  DeviceKdQuads quads_;
  KdAccelView view_{};
};

}  // namespace gpurt::cuda
