#include "cuda/check.h"

#include "error.h"

namespace gpurt::cuda {

void check(cudaError_t status, const char *call)
{
  if (status == cudaSuccess) return;
  (void)cudaGetLastError();
  if (status == cudaErrorMemoryAllocation) {
    fail(GPURT_ERROR_OUT_OF_MEMORY,
         "{}: the CUDA device has not enough free memory; make the scene or batch smaller, "
         "or free memory that other programs hold on the device",
         call);
  }
  fail(GPURT_ERROR_DEVICE, "{} failed: {} ({})", call, cudaGetErrorName(status), cudaGetErrorString(status));
}

}  // namespace gpurt::cuda
