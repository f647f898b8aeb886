#pragma once

namespace gpurt::cuda {

/// Whether this build holds kernels that the current device can run.
bool has_kernels_for_current_device();

}  // namespace gpurt::cuda
