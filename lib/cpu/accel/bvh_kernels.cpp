// Ray queries over bounding volume hierarchies, once per instruction set.
#include "cpu/accel/trace_table.h"
#include "cpu/kernels.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

const TraceKernels &bvh_kernels(TriangleTest test, bool masks, bool placements)
{
  return kernels_of<CpuBvhView>(test, masks, placements);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
