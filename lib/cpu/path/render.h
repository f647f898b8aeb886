// Path tracing of one pass on the CPU: work units over oneTBB, each on one thread.
#pragma once

#include <tbb/task_arena.h>

#include "backend.h"
#include "cpu/path/path_kernel.h"

namespace gpurt {

/// Renders the units of `pass` on the arena's threads. Returns when all are delivered or left out by cancellation.
void render_on_cpu(const RenderPass &pass, const CpuAccel &accel, const SceneView &scene, PathKernel kernel,
                   tbb::task_arena &arena, const std::shared_ptr<MemoryTracker> &memory);

/// The kernel for an instruction set variant, by its name.
PathKernel path_kernel(const char *isa_name);

}  // namespace gpurt
