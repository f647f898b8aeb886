#include "cuda/accel/near_plain.h"
#include "cuda/accel/placed_walk.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

void launch_bvh_placed_plain(const TraceScene &scene, TraceQuery query, const NearBatch &batch,
                             uint32_t width, cudaStream_t stream)
{
  dispatch_near(scene, [&]<class Kind>(Kind) {
    if constexpr (Kind::placements)
      launch_plain<PlacedBvhWalk<Kind::masks>>(scene, query, batch, width, stream);
  });
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
