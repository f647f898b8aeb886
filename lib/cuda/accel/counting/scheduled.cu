// The scheduled kernels of closest hits, compiled once more to count lanes.
#include "cuda/accel/counting/lane_counts.h"
// The kernels.
#include "cuda/accel/schedule/leaf_lists.cu"
#include "cuda/accel/schedule/packets.cu"
#include "cuda/accel/schedule/persistent.cu"
#include "cuda/accel/schedule/persistent_rays.cu"
#include "cuda/accel/schedule/uber.cu"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

LaneTotals *totals_of_scheduled_kernels() { return find_totals(); }

GPURT_KERNELS_END
}  // namespace gpurt::cuda
