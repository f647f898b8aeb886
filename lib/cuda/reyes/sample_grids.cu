// Stages 'dice', 'shade' where light is micropolygons' own, and 'sample' of patches in one kernel: a warp dices a piece into
// shared memory, and vertices never leave the multiprocessor.
#include "cuda/reyes/sample_quads.h"

namespace gpurt::cuda {
namespace {

template <Look look, class Walk>
__global__ void __launch_bounds__(block_size, 6) sample_grids(const __grid_constant__ ReyesBatch b)
{
  sample_grids_of<look, Walk>(b);
}

// All grids are for the general kernel.
__global__ void __launch_bounds__(block_size) leave_all(const __grid_constant__ ReyesBatch b, Look look)
{
  const uint32_t num_leaves = b.numbers->num_leaves;
  uint32_t num_grids = 0, num_micropolygons = 0;
  for (uint64_t leaf = thread_item(); leaf < num_leaves; leaf += uint64_t(gridDim.x) * block_size) {
    const QueuedPiece &q = b.leaves[leaf];
    const uint32_t root = b.roots[q.slot];
    if (!(look == Look::Spots ? is_wanted<Look::Spots>(b, q.slot, root)
                              : is_wanted<Look::Nearest>(b, q.slot, root)))
      continue;
    b.rest[atomicAdd(&b.numbers->num_rest, 1u)] = uint32_t(leaf) << 8 | 0xff;
    ++num_grids;
    num_micropolygons += 1u << (q.piece.grid_u + q.piece.grid_v);
  }
  if (look == Look::Spots) return;
  __syncwarp();
  add_of_lanes(&b.numbers->num_grids, num_grids);
  add_of_lanes(&b.numbers->num_micropolygons, num_micropolygons);
}

}  // namespace

void launch_sample_grids(const ReyesBatch &batch, Look look, cudaStream_t stream)
{
  const uint64_t n = uint64_t(batch.leaf_capacity) * 32;
  if (batch.has_cutouts != 0) {
    launch_persistent("REYES' grids of masked surfaces", leave_all, batch.leaf_capacity, stream, batch, look);
    return;
  }
  const auto launch_look = [&](const char *name, auto cells, auto masks) {
    if (batch.samples.masks != nullptr) launch_persistent(name, masks, n, stream, batch);
    else launch_persistent(name, cells, n, stream, batch);
  };
  if (batch.has_own_light) {
    launch_look("REYES stages 'dice', 'shade' and 'sample'", sample_grids<Look::OwnLight, TinyWalk>,
                sample_grids<Look::OwnLight, MaskWalk>);
  } else if (look == Look::Spots) {
    launch_look("REYES stages 'dice' and 'sample', places", sample_grids<Look::Spots, TinyWalk>,
                sample_grids<Look::Spots, MaskWalk>);
  } else {
    launch_look("REYES stages 'dice' and 'sample'", sample_grids<Look::Nearest, TinyWalk>,
                sample_grids<Look::Nearest, MaskWalk>);
  }
}

}  // namespace gpurt::cuda
