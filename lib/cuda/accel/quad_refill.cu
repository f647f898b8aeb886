#include "cuda/accel/near_refill.h"
#include "cuda/accel/quad_walk.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

void launch_quad_refill(const TraceScene &scene, TraceQuery query, const NearBatch &batch,
                        cudaStream_t stream)
{
  launch_refill<QuadWalk>(scene, query, batch, stream);
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
