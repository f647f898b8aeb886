// Ends a benchmark of a CUDA device that fails, with what failed; tells whether there is one, and opens it.
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

/// The first one. `log`: null for none; `memory_limit`: bytes, 0 for none.
inline gpurt_device create_cuda_device(gpurt_log_fn log = nullptr, uint64_t memory_limit = 0)
{
  gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
  desc.type = GPURT_DEVICE_CUDA;
  desc.log = log;
  desc.memory_limit_bytes = memory_limit;
  gpurt_device device;
  check(gpurt_device_create(&desc, &device), "gpurt_device_create");
  return device;
}
