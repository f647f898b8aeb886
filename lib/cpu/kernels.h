// The hot loops that are compiled once per instruction set, as this machine runs them.
#pragma once

#include "cpu/accel/kernel_table.h"

namespace gpurt {

struct CpuKernels {
  const char *isa;                                                               // accel/isa.h
  const TraceKernels &(*trace)(TriangleTest test, bool masks, bool placements);  // over kd-trees
  const TraceKernels &(*bvh)(TriangleTest test, bool masks, bool placements);
};

const CpuKernels &cpu_kernels();

/// A variant by name; null where the build has none or the machine cannot run it.
const CpuKernels *cpu_kernels(const char *isa);

}  // namespace gpurt
