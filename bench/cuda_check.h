// Ends a benchmark of a CUDA device that fails, with what failed; tells whether there is one.
#pragma once

#include <cuda_runtime_api.h>

#include "check.h"

inline void check(cudaError_t status, const char *what)
{
  if (status == cudaSuccess) return;
  std::fprintf(stderr, "error: %s: %s\n", what, cudaGetErrorString(status));
  std::exit(1);
}

/// False, with a word about it, where there is nothing to measure on.
inline bool is_cuda_there()
{
  int count = 0;
  const bool found = cudaGetDeviceCount(&count) == cudaSuccess && count != 0;
  (void)cudaGetLastError();  // that there is none is no failure of the next call
  if (found) return true;
  std::fprintf(stderr, "no CUDA device: nothing to measure\n");
  return false;
}
