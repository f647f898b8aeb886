// Stages 'dice', 'shade' where light is micropolygons' own, and 'sample' of patches in one kernel: a warp dices a piece into
// shared memory, and vertices never leave the multiprocessor.
#include "cuda/reyes/sample_quads.h"

namespace gpurt::cuda {
namespace {

template <Look look, class Walk>
__global__ void __launch_bounds__(block_size, 6) sample_grids(const __grid_constant__ ReyesBatch b)
{
  constexpr bool finds_spots = look == Look::Spots, has_light = look == Look::OwnLight;
  __shared__ WarpLight lights[has_light ? block_size / 32 : 1];
  __shared__ WarpGrid grids[block_size / 32];
  __shared__ SeenSamples seen_samples[finds_spots ? block_size / 32 : 1];
  const uint32_t lane = threadIdx.x % 32, warp = threadIdx.x / 32;
  WarpGrid &g = grids[warp];
  WarpLight *light = has_light ? &lights[warp] : nullptr;
  SeenSamples *seen = finds_spots ? &seen_samples[warp] : nullptr;
  const uint32_t num_leaves = b.numbers->num_leaves;
  GridCounts counts;
  for (uint32_t leaf; (leaf = next_item(&b.numbers->tickets[0], num_leaves)) != num_leaves;) {
    const uint32_t slot = b.leaves[leaf].slot, root = b.roots[slot];
    if (finds_spots && !is_visible(b, root)) continue;
    copy_words(g.piece, b.leaves[leaf].piece, lane);
    copy_words(g.patch, b.patches[slot], lane);
    __syncwarp();
    const bool is_in_front = dice(g, b.projection, lane, finds_spots ? &seen->places : nullptr);
    __syncwarp();
    ++counts.grids;
    counts.micropolygons += 1u << (g.piece.grid_u + g.piece.grid_v);
    if constexpr (has_light) counts.shaded += shade_grid(b, g, root, *light, lane);
    sample_quads<look, Walk>(b, g, is_in_front, leaf, root, light, seen, lane, counts.fragments);
  }
  if (!finds_spots) counts.add_to(*b.numbers);
}

// All grids are for the general kernel.
__global__ void __launch_bounds__(block_size)
    leave_all(const __grid_constant__ ReyesBatch b, bool finds_spots)
{
  const uint32_t num_leaves = b.numbers->num_leaves;
  uint32_t num_grids = 0, num_micropolygons = 0;
  for (uint64_t leaf = thread_item(); leaf < num_leaves; leaf += uint64_t(gridDim.x) * block_size) {
    const QueuedPiece &q = b.leaves[leaf];
    if (finds_spots && !is_visible(b, b.roots[q.slot])) continue;
    b.rest[atomicAdd(&b.numbers->num_rest, 1u)] = uint32_t(leaf) * 8;
    ++num_grids;
    num_micropolygons += 1u << (q.piece.grid_u + q.piece.grid_v);
  }
  if (finds_spots) return;
  __syncwarp();
  add_of_lanes(&b.numbers->num_grids, num_grids);
  add_of_lanes(&b.numbers->num_micropolygons, num_micropolygons);
}

}  // namespace

void launch_sample_grids(const ReyesBatch &batch, bool finds_spots, cudaStream_t stream)
{
  const uint64_t n = uint64_t(batch.leaf_capacity) * 32;
  if (batch.scene.scene.has_alpha_masks != 0) {
    launch_persistent("REYES' grids of masked surfaces", leave_all, batch.leaf_capacity, stream, batch,
                      finds_spots);
    return;
  }
  const auto launch_look = [&](const char *name, auto cells, auto masks) {
    if (batch.samples.masks != nullptr) launch_persistent(name, masks, n, stream, batch);
    else launch_persistent(name, cells, n, stream, batch);
  };
  if (batch.has_own_light) {
    launch_look("REYES stages 'dice', 'shade' and 'sample'", sample_grids<Look::OwnLight, TinyWalk>,
                sample_grids<Look::OwnLight, MaskWalk>);
  } else if (finds_spots) {
    launch_look("REYES stages 'dice' and 'sample', places", sample_grids<Look::Spots, TinyWalk>,
                sample_grids<Look::Spots, MaskWalk>);
  } else {
    launch_look("REYES stages 'dice' and 'sample'", sample_grids<Look::Nearest, TinyWalk>,
                sample_grids<Look::Nearest, MaskWalk>);
  }
}

}  // namespace gpurt::cuda
