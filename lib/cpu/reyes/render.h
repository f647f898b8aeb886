// REYES of one pass on the CPU: buckets of the image over oneTBB, each on one thread.
#pragma once

#include <tbb/task_arena.h>

#include "backend.h"
#include "cpu/reyes/reyes_kernel.h"

namespace gpurt {

/// Renders the units of `pass` on the arena's threads. Returns when all are delivered or left out by cancellation.
/// `wide`: null, or what goes beside the kernels. Throws OUT_OF_MEMORY, and INVALID_ARGUMENT for more primitives than ids.
void render_reyes_on_cpu(const RenderPass &pass, const CpuAccel &accel, const ReyesScene &scene,
                         const ReyesKernels &kernels, const WideKernels *wide, tbb::task_arena &arena,
                         const std::shared_ptr<MemoryTracker> &memory);

}  // namespace gpurt
