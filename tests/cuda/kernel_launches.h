// Which kernels a device has started, and how often.
#pragma once

#include <gpurt_cuda.h>

#include "../support/gpurt_test.h"

namespace gpurt_test {

/// The kernels that the device has started.
inline std::vector<gpurt_cuda_kernel> kernels_of(gpurt_device device)
{
  uint32_t count = 0;
  GPURT_EXPECT_OK(gpurt_cuda_get_kernels(device, nullptr, 0, &count));
  std::vector<gpurt_cuda_kernel> kernels(count);
  GPURT_EXPECT_OK(gpurt_cuda_get_kernels(device, kernels.data(), count, &count));
  return kernels;
}

/// How often it has started those of the name.
inline uint64_t launches_of(gpurt_device device, const std::string &name)
{
  uint64_t n = 0;
  for (const gpurt_cuda_kernel &k : kernels_of(device)) n += name == k.name ? k.num_launches : 0;
  return n;
}

}  // namespace gpurt_test
