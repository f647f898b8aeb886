// A group's kd-tree in device memory as the fast kernels walk it.
#pragma once

#include "core/accel/kd_quad.h"
#include "core/scene/scene_view.h"
#include "cuda/device_memory.h"

namespace gpurt::cuda {

class DeviceKdQuads {
 public:
  DeviceKdQuads() = default;
  /// Makes it from a tree in device memory, and waits. Stays empty where the tree is, or has more nodes or references than
  /// fit. Throws OUT_OF_MEMORY.
  DeviceKdQuads(const SceneView &view, const Group &group, const KdTreeView &tree, uint64_t num_references,
                const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream);

  const KdQuadView &view() const { return view_; }
  uint64_t bytes() const { return nodes_.bytes() + places_.bytes() + triangles_.bytes(); }

 private:
  DeviceBuffer<KdQuadNode> nodes_;
  DeviceBuffer<uint32_t> places_;
  DeviceBuffer<LeafTriangle> triangles_;
  KdQuadView view_{};
};

}  // namespace gpurt::cuda
