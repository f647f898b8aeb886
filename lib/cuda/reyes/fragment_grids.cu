// Stages 'dice' and 'sample' of patches that blend: their fragments are counted, or kept, all or the nearest ones in slots.
#include "cuda/reyes/sample_quads.h"

namespace gpurt::cuda {
namespace {

template <Look look, class Walk>
__global__ void __launch_bounds__(block_size, 6) fragments_of_grids(const __grid_constant__ ReyesBatch b)
{
  sample_grids_of<look, Walk>(b);
}

}  // namespace

void launch_fragments_of_grids(const ReyesBatch &batch, Look look, cudaStream_t stream)
{
  choose_fragment_kernel(look, [&](auto kind) {
    const char *name = is_of_slots(look) ? "REYES stages 'dice' and 'sample', fragments in slots"
                                         : "REYES stages 'dice' and 'sample', fragments";
    const uint64_t n = uint64_t(batch.leaf_capacity) * 32;
    if (batch.samples.masks != nullptr)
      launch_persistent(name, fragments_of_grids<kind.value, MaskWalk>, n, stream, batch);
    else launch_persistent(name, fragments_of_grids<kind.value, TinyWalk>, n, stream, batch);
  });
}

}  // namespace gpurt::cuda
