// GPURT_ACCEL_AUTO on CUDA devices: whether a kd-tree would serve a scene better than the bvh that it has.
//
// A kd-tree is built on the device, and rays are sent through both trees. What they do is counted, not timed, so that the
// choice is the same in every run. The kd-tree goes afterwards.
#pragma once

#include <string>

#include "cuda/accel/build/kd_builder.h"
#include "cuda/accel/kernels.h"
#include "scene/compiled_scene.h"

namespace gpurt::cuda {

struct TreeChoice {
  bool is_kd_tree = false;
  std::string reason;  // what the probe found, or why there was none
};

/// `bvh` is what is traced of the scene, on its device. There is no probe for scenes that the kd-tree's fast kernels do not
/// serve, for small ones, which it would hold up without a gain that counts, for very large ones, and where it would take more
/// than a quarter of the memory that is free, under the limit and on the device.
/// Throws what the device fails with, but OUT_OF_MEMORY and UNSUPPORTED of the kd-tree are reasons to go without.
TreeChoice choose_tree(const CompiledScene &scene, const TraceScene &bvh, const DeviceKdSettings &settings,
                       const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream);

}  // namespace gpurt::cuda
