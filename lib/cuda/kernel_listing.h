// The launched kernels with their registers and occupancy. Not for .cu files: backend.h is beyond nvcc.
#pragma once

#include <cuda_runtime_api.h>

#include <vector>

#include "backend.h"

namespace gpurt::cuda {

/// In the order of their first launch, as they run on the current device.
std::vector<KernelInfo> list_kernels(const cudaDeviceProp &device);

}  // namespace gpurt::cuda
