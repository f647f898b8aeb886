// Turns errors of CUDA calls into gpurt::Error. Plain enough for .cu files: nvcc cannot read lib/error.h's formatting.
#pragma once

#include <cuda_runtime_api.h>

namespace gpurt::cuda {

/// Throws OUT_OF_MEMORY where CUDA has none left, else DEVICE, naming the call and CUDA's error. CUDA's own record of
/// the error is cleared, so that the next call does not report it again.
void check(cudaError_t status, const char *call);

/// Logs nothing and throws nothing: for destructors, where a failure was or will be reported by other calls.
inline void ignore(cudaError_t status)
{
  if (status != cudaSuccess) (void)cudaGetLastError();
}

}  // namespace gpurt::cuda
