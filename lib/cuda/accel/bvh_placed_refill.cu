#include "cuda/accel/near_refill.h"
#include "cuda/accel/placed_walk.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

void launch_bvh_placed_refill(const TraceScene &scene, TraceQuery query, const NearBatch &batch,
                              cudaStream_t stream)
{
  dispatch_near(scene, [&]<class Kind>(Kind) {
    if constexpr (Kind::placements) launch_refill<PlacedBvhWalk<Kind::masks>>(scene, query, batch, stream);
  });
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
