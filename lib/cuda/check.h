// Turns errors of CUDA calls into gpurt::Error. Plain enough for .cu files: nvcc cannot read lib/error.h's formatting.
//
// Some errors, a kernel's access to memory that is not there for one, end all work of the process on that device: CUDA
// answers everything from then on with the same error. Such a device is lost, for all device objects of the process.
#pragma once

#include <cuda_runtime_api.h>

namespace gpurt::cuda {

/// Throws OUT_OF_MEMORY where CUDA has none left, else DEVICE, naming the call and CUDA's error. CUDA's own record of
/// the error is cleared, so that the next call does not report it again. Where the error ends all work on the current
/// device, it is lost from then on, and every failure tells the first one's text.
void check(cudaError_t status, const char *call);

/// Throws DEVICE, with the text of the failure, where the device is lost.
void check_is_not_lost(int ordinal);

/// Logs nothing and throws nothing: for destructors, where a failure was or will be reported by other calls.
inline void ignore(cudaError_t status)
{
  if (status != cudaSuccess) (void)cudaGetLastError();
}

}  // namespace gpurt::cuda
