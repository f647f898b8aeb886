// The kernels of closest hits that walk a tree in one loop, and the fast ones, compiled once more to count lanes.
#include "cuda/accel/counting/lane_counts.h"
// The kernels.
#include "cuda/accel/bvh_masked.cu"
#include "cuda/accel/bvh_placed_plain.cu"
#include "cuda/accel/bvh_placed_refill.cu"
#include "cuda/accel/bvh_plain.cu"
#include "cuda/accel/bvh_refill.cu"
#include "cuda/accel/closest.cu"
#include "cuda/accel/near.cu"
#include "cuda/accel/quad_plain.cu"
#include "cuda/accel/quad_refill.cu"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

LaneTotals *totals_of_fused_kernels() { return find_totals(); }

GPURT_KERNELS_END
}  // namespace gpurt::cuda
