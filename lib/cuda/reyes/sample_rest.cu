// Stages 'dice' and 'sample' of grids that sample_grids.cu leaves: micropolygons of any size, through the eye plane, with
// alpha masks. Triangles of them that are large go on to a kernel of their own.
#include "cuda/reyes/sample_any.h"
#include "cuda/reyes/sample_spread.h"

namespace gpurt::cuda {
namespace {

template <Look look, bool has_masks>
__global__ void __launch_bounds__(block_size, 4) sample_rest(const __grid_constant__ ReyesBatch b)
{
  sample_rest_of<look, has_masks>(b);
}

template <Look look, bool has_masks>
__global__ void __launch_bounds__(block_size) sample_spread(const __grid_constant__ ReyesBatch b)
{
  sample_spread_of<look, has_masks>(b);
}

}  // namespace

void launch_sample_rest(const ReyesBatch &batch, Look look, cudaStream_t stream)
{
  choose_kernel(look, batch.has_cutouts != 0, [&](auto kind, auto masks) {
    launch_persistent("REYES stages 'dice' and 'sample', any micropolygons",
                      sample_rest<kind.value, masks.value>, uint64_t(batch.leaf_capacity) * 32, stream,
                      batch);
    launch_persistent("REYES stage 'sample', micropolygons of some pixels",
                      sample_spread<kind.value, masks.value>, uint64_t(batch.spread_capacity) * 32, stream,
                      batch);
  });
}

}  // namespace gpurt::cuda
