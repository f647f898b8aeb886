#include "cuda/accel/bvh_walk.h"
#include "cuda/accel/near_refill.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

void launch_bvh_refill(const TraceScene &scene, TraceQuery query, const NearBatch &batch, cudaStream_t stream)
{
  if (scene.scene.num_placements != 0) launch_bvh_placed_refill(scene, query, batch, stream);
  else launch_refill<BvhWalk>(scene, query, batch, stream);
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
