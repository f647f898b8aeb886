// Stage 'sample' of what blends and is not a grid of tiny micropolygons. Opacity is looked up later, once for each fragment, but
// by looks of slots, which are for what shows something.
#include "cuda/reyes/sample_any.h"
#include "cuda/reyes/sample_spread.h"
#include "cuda/reyes/sample_triangles.h"

namespace gpurt::cuda {
namespace {

template <Look look>
__global__ void __launch_bounds__(block_size, 4) fragments_of_rest(const __grid_constant__ ReyesBatch b)
{
  sample_rest_of<look, false>(b);
}

template <Look look>
__global__ void __launch_bounds__(block_size) fragments_of_spread(const __grid_constant__ ReyesBatch b)
{
  sample_spread_of<look, false>(b);
}

template <Look look>
__global__ void __launch_bounds__(block_size) fragments_of_triangles(const __grid_constant__ ReyesBatch b)
{
  sample_triangles_of<look, false>(b);
}

template <Look look>
__global__ void __launch_bounds__(block_size)
    fragments_of_large(const __grid_constant__ ReyesBatch b, LargeParts parts)
{
  sample_large_of<look, false>(b, parts);
}

}  // namespace

void launch_fragments_of_rest(const ReyesBatch &batch, Look look, cudaStream_t stream)
{
  choose_fragment_kernel(look, [&](auto kind) {
    launch_persistent(is_of_slots(look)
                          ? "REYES stages 'dice' and 'sample', fragments of any micropolygons in slots"
                          : "REYES stages 'dice' and 'sample', fragments of any micropolygons",
                      fragments_of_rest<kind.value>, uint64_t(batch.leaf_capacity) * 32, stream, batch);
    launch_persistent(is_of_slots(look)
                          ? "REYES stage 'sample', fragments of micropolygons of some pixels in slots"
                          : "REYES stage 'sample', fragments of micropolygons of some pixels",
                      fragments_of_spread<kind.value>, uint64_t(batch.spread_capacity) * 32, stream, batch);
  });
}

void launch_fragments_of_triangles(const ReyesBatch &batch, Look look, cudaStream_t stream)
{
  choose_fragment_kernel(look, [&](auto kind) {
    launch_persistent(is_of_slots(look) ? "REYES stage 'sample', fragments of triangles in slots"
                                        : "REYES stage 'sample', fragments of triangles",
                      fragments_of_triangles<kind.value>, uint64_t(1) << 30, stream, batch);
  });
}

void launch_fragments_of_large(const ReyesBatch &batch, Look look, LargeParts parts, cudaStream_t stream)
{
  choose_fragment_kernel(look, [&](auto kind) {
    launch_persistent(is_of_slots(look) ? "REYES stage 'sample', fragments of large triangles in slots"
                                        : "REYES stage 'sample', fragments of large triangles",
                      fragments_of_large<kind.value>, uint64_t(parts.num) * 32, stream, batch, parts);
  });
}

}  // namespace gpurt::cuda
