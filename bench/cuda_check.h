// Ends a benchmark of a CUDA device that fails, with what failed.
#pragma once

#include <cuda_runtime_api.h>

#include "check.h"

inline void check(cudaError_t status, const char *what)
{
  if (status == cudaSuccess) return;
  std::fprintf(stderr, "error: %s: %s\n", what, cudaGetErrorString(status));
  std::exit(1);
}
