// Ends a benchmark of a CUDA device that fails, with what failed.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdio>
#include <cstdlib>

#include "gpurt.h"

inline void check(gpurt_result result, const char *what)
{
  if (result == GPURT_OK) return;
  std::fprintf(stderr, "error: %s: %s\n", what, gpurt_last_error());
  std::exit(1);
}
inline void check(cudaError_t status, const char *what)
{
  if (status == cudaSuccess) return;
  std::fprintf(stderr, "error: %s: %s\n", what, cudaGetErrorString(status));
  std::exit(1);
}
