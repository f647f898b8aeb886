#include "cuda/accel/bvh_walk.h"
#include "cuda/accel/near_masked.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

void launch_bvh_masked(const TraceScene &scene, TraceQuery query, const NearBatch &batch, uint32_t width,
                       cudaStream_t stream)
{
  const TiledRows rows(width, batch.num_rays);
  if constexpr (!counts_lanes) {
    if (query == TraceQuery::Any) {
      launch("any-hit kernel of masks", near_masked_kernel<BvhWalk, TraceQuery::Any>, rows.num_items(),
             stream, scene, batch, rows);
      return;
    }
  }
  launch("closest-hit kernel of masks", near_masked_kernel<BvhWalk, TraceQuery::Closest>, rows.num_items(),
         stream, scene, batch, rows);
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
