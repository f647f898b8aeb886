// A compiled scene's arrays in device memory.
#pragma once

#include "cuda/device_memory.h"
#include "scene/compiled_scene.h"

namespace gpurt::cuda {

class DeviceScene {
 public:
  /// Copies the arrays. Throws OUT_OF_MEMORY.
  DeviceScene(const CompiledScene &scene, const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream);

  /// Pointers to device memory, valid while this lives.
  const SceneView &view() const { return view_; }
  const ReyesScene &reyes_view() const { return reyes_; }
  uint64_t bytes() const { return bytes_; }

 private:
  template <class T>
  const T *keep(const std::vector<T> &values, const char *what);

  std::shared_ptr<DeviceMemory> memory_;
  cudaStream_t stream_;
  std::vector<DeviceBuffer<std::byte>> buffers_;
  SceneView view_{};
  ReyesScene reyes_{};
  uint64_t bytes_ = 0;
};

}  // namespace gpurt::cuda
