#pragma once

namespace gpurt::cuda {

/// The number of CUDA devices that can be used; 0 where there is no driver.
int device_count();

}  // namespace gpurt::cuda
