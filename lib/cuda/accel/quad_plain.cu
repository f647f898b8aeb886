#include "cuda/accel/near_plain.h"
#include "cuda/accel/quad_walk.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

void launch_quad_plain(const TraceScene &scene, TraceQuery query, const NearBatch &batch, uint32_t width,
                       cudaStream_t stream)
{
  launch_plain<QuadWalk>(scene, query, batch, width, stream);
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
