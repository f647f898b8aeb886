// Which kernels this process has launched, for gpurt_cuda_get_kernels.
#pragma once

namespace gpurt::cuda {

/// Counts a launch; `name` lives as long as the process. Used from any thread.
void note_launch(const char *name, const void *kernel, unsigned block_threads);

}  // namespace gpurt::cuda
