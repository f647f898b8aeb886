#include "cuda/accel/bvh_walk.h"
#include "cuda/accel/near_plain.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

void launch_bvh_plain(const TraceScene &scene, TraceQuery query, const NearBatch &batch, uint32_t width,
                      cudaStream_t stream)
{
  if (scene.scene.num_placements != 0) launch_bvh_placed_plain(scene, query, batch, width, stream);
  else launch_plain<BvhWalk>(scene, query, batch, width, stream);
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
