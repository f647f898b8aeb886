// Counts the CUDA devices. The runtime is linked statically and looks for the driver here, not at load time.
#include "cuda/device_count.h"

#include <cuda_runtime_api.h>

namespace gpurt::cuda {

int device_count()
{
  int count = 0;
  if (cudaGetDeviceCount(&count) == cudaSuccess) return count;
  (void)cudaGetLastError();  // no driver, or no device: not an error that a later call should report
  return 0;
}

}  // namespace gpurt::cuda
