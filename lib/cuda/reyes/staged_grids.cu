// Stages 'dice', 'shade' and 'sample' as separate kernels with memory between them, as many grids at a time as it has room
// for: the talk's regular kernels, which the host schedules.
#include "cuda/reyes/sample_quads.h"

namespace gpurt::cuda {

// What stages hand on of a grid.
struct DicedGrid {
  int32_t x[max_grid_vertices], y[max_grid_vertices];
  float z[max_grid_vertices];
  uint32_t is_in_front;
  uint32_t packed[max_segments * max_segments];
};

namespace {

struct StagedGrids {
  DicedGrid *grids;
  uint32_t first_leaf, num_leaves;
};

// Calls work(grid, leaf) by this warp for its leaves of the range.
template <class Work>
__device__ __forceinline__ void for_each_leaf(const StagedGrids &s, const Work &work)
{
  const uint32_t num_warps = gridDim.x * (block_size / 32);
  for (uint32_t i = uint32_t(thread_item() / 32); i < s.num_leaves; i += num_warps)
    work(s.grids[i], s.first_leaf + i);
}

__global__ void __launch_bounds__(block_size)
    dice_grids(const __grid_constant__ ReyesBatch b, const __grid_constant__ StagedGrids s)
{
  __shared__ WarpGrid grids[block_size / 32];
  WarpGrid &g = grids[threadIdx.x / 32];
  const uint32_t lane = threadIdx.x % 32;
  GridCounts counts;
  for_each_leaf(s, [&](DicedGrid &to, uint32_t leaf) {
    copy_words(g.piece, b.leaves[leaf].piece, lane);
    copy_words(g.patch, b.patches[b.leaves[leaf].slot], lane);
    __syncwarp();
    const bool is_in_front = dice(g, b.projection, lane);
    __syncwarp();
    const uint32_t num_vertices = ((1u << g.piece.grid_u) + 1) * ((1u << g.piece.grid_v) + 1);
    for (uint32_t k = lane; k < num_vertices; k += 32) {
      to.x[k] = g.x[k];
      to.y[k] = g.y[k];
      to.z[k] = g.z[k];
    }
    if (lane == 0) to.is_in_front = is_in_front ? 1 : 0;
    ++counts.grids;
    counts.micropolygons += 1u << (g.piece.grid_u + g.piece.grid_v);
    __syncwarp();
  });
  counts.add_to(*b.numbers);
}

__global__ void __launch_bounds__(block_size)
    shade_grids(const __grid_constant__ ReyesBatch b, const __grid_constant__ StagedGrids s)
{
  __shared__ WarpGrid grids[block_size / 32];
  __shared__ WarpLight lights[block_size / 32];
  WarpGrid &g = grids[threadIdx.x / 32];
  WarpLight &light = lights[threadIdx.x / 32];
  const uint32_t lane = threadIdx.x % 32;
  GridCounts counts;
  for_each_leaf(s, [&](DicedGrid &to, uint32_t leaf) {
    const uint32_t slot = b.leaves[leaf].slot;
    copy_words(g.piece, b.leaves[leaf].piece, lane);
    copy_words(g.patch, b.patches[slot], lane);
    __syncwarp();
    const uint32_t n = shade_grid(b, g, b.roots[slot], light, lane);
    counts.shaded += n;
    for (uint32_t k = lane; k < n; k += 32) to.packed[k] = light.packed[k];
    __syncwarp();
  });
  counts.add_to(*b.numbers);
}

template <class Walk>
__global__ void __launch_bounds__(block_size, 6)
    sample_diced_grids(const __grid_constant__ ReyesBatch b, const __grid_constant__ StagedGrids s)
{
  __shared__ WarpGrid grids[block_size / 32];
  __shared__ WarpLight lights[block_size / 32];
  WarpGrid &g = grids[threadIdx.x / 32];
  WarpLight &light = lights[threadIdx.x / 32];
  const uint32_t lane = threadIdx.x % 32;
  GridCounts counts;
  for_each_leaf(s, [&](const DicedGrid &from, uint32_t leaf) {
    copy_words(g.piece, b.leaves[leaf].piece, lane);
    __syncwarp();
    const uint32_t num_vertices = ((1u << g.piece.grid_u) + 1) * ((1u << g.piece.grid_v) + 1);
    for (uint32_t k = lane; k < num_vertices; k += 32) {
      g.x[k] = from.x[k];
      g.y[k] = from.y[k];
      g.z[k] = from.z[k];
    }
    const uint32_t num_points =
        1u << (shaded_bits(g.piece.grid_u, b.own.block_bits) + shaded_bits(g.piece.grid_v, b.own.block_bits));
    for (uint32_t k = lane; k < num_points; k += 32) light.packed[k] = from.packed[k];
    __syncwarp();
    sample_quads<Look::OwnLight, Walk>(b, g, from.is_in_front != 0, leaf, b.roots[b.leaves[leaf].slot],
                                       &light, nullptr, lane, counts.fragments);
  });
  counts.add_to(*b.numbers);
}

}  // namespace

uint64_t diced_grid_bytes() { return sizeof(DicedGrid); }

uint64_t launch_staged_grids(const ReyesBatch &batch, uint32_t num_leaves, DicedGrid *grids,
                             uint32_t capacity, cudaStream_t stream)
{
  uint64_t num_rounds = 0;
  for (uint32_t first = 0; first < num_leaves; first += capacity, ++num_rounds) {
    const StagedGrids s{grids, first, min(capacity, num_leaves - first)};
    const uint64_t n = uint64_t(s.num_leaves) * 32;
    launch("REYES stage 'dice'", dice_grids, n, stream, batch, s);
    launch("REYES stage 'shade'", shade_grids, n, stream, batch, s);
    if (batch.samples.masks != nullptr) {
      launch("REYES stage 'sample'", sample_diced_grids<MaskWalk>, n, stream, batch, s);
    } else {
      launch("REYES stage 'sample'", sample_diced_grids<TinyWalk>, n, stream, batch, s);
    }
  }
  return num_rounds;
}

}  // namespace gpurt::cuda
