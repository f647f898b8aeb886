// Which instruction set variant of the hot loops (cmake/GpurtIsa.cmake) this machine runs.
#pragma once

namespace gpurt {

/// The best variant that this machine can run, unless the environment's GPURT_ISA names another one of those.
const char *isa_name();

/// The same of kernels that have wide variants besides. The environment is asked each time: tests compare variants.
const char *wide_isa_name();

/// Whether the build has a variant of this name and the machine can run it.
bool can_run_isa(const char *name);

}  // namespace gpurt
