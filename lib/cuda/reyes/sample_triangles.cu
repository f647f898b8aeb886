// Stage 'sample' of meshes' triangles, which are flat and need no dicing: small ones a lane each, and large ones from any
// stage a warp for each part of the image.
#include "cuda/reyes/sample_triangles.h"

namespace gpurt::cuda {
namespace {

constexpr unsigned scan_threads = 1024;

template <Look look, bool has_masks>
__global__ void __launch_bounds__(block_size) sample_triangles(const __grid_constant__ ReyesBatch b)
{
  sample_triangles_of<look, has_masks>(b);
}

template <Look look, bool has_masks>
__global__ void __launch_bounds__(block_size) sample_large(const __grid_constant__ ReyesBatch b)
{
  sample_large_of<look, has_masks>(b);
}

// large_tiles[i] = the tiles of triangle i.
__global__ void __launch_bounds__(block_size) count_large_tiles(const __grid_constant__ ReyesBatch b)
{
  const uint32_t n = min(b.numbers->num_large, b.large_capacity), tile = uint32_t(cells_a_tile(b.samples));
  for (uint64_t i = thread_item(); i < n; i += uint64_t(gridDim.x) * block_size) {
    LargeCover large;
    const CellRange &c = large.cells;
    b.large_tiles[i] = make_large_cover(b, b.large[i], large)
                           ? (uint32_t(c.x1) / tile - uint32_t(c.x0) / tile + 1) *
                                 (uint32_t(c.y1) / tile - uint32_t(c.y0) / tile + 1)
                           : 0;
  }
}

// large_tiles[i] = the tiles of triangles 0 .. i. One block.
__global__ void __launch_bounds__(scan_threads) sum_large_tiles(const __grid_constant__ ReyesBatch b)
{
  __shared__ uint32_t warp_sums[scan_threads / 32];
  const uint32_t n = min(b.numbers->num_large, b.large_capacity);
  const uint32_t lane = threadIdx.x % 32, warp = threadIdx.x / 32;
  uint32_t before = 0;
  for (uint32_t first = 0; first < n; first += scan_threads) {
    const uint32_t i = first + threadIdx.x;
    uint32_t sum = i < n ? b.large_tiles[i] : 0;
    for (int offset = 1; offset < 32; offset *= 2) {
      const uint32_t other = __shfl_up_sync(all_lanes, sum, offset);
      if (lane >= uint32_t(offset)) sum += other;
    }
    if (lane == 31) warp_sums[warp] = sum;
    __syncthreads();
    uint32_t base = before;
    for (uint32_t w = 0; w < scan_threads / 32; ++w) {
      if (w < warp) base += warp_sums[w];
      before += warp_sums[w];
    }
    if (i < n) b.large_tiles[i] = base + sum;
    __syncthreads();
  }
}

}  // namespace

void launch_sample_triangles(const ReyesBatch &batch, Look look, cudaStream_t stream)
{
  choose_kernel(look, batch.has_cutouts != 0, [&](auto kind, auto masks) {
    launch_persistent("REYES stage 'sample', triangles", sample_triangles<kind.value, masks.value>,
                      uint64_t(1) << 30, stream, batch);
  });
}

void launch_count_large_tiles(const ReyesBatch &batch, cudaStream_t stream)
{
  launch_persistent("REYES stage 'sample', tiles of large triangles", count_large_tiles, batch.large_capacity,
                    stream, batch);
  launch_blocks("REYES stage 'sample', sums of tiles", sum_large_tiles, 1, scan_threads, stream, batch);
}

void launch_sample_large(const ReyesBatch &batch, Look look, cudaStream_t stream)
{
  launch_count_large_tiles(batch, stream);
  choose_kernel(look, batch.has_cutouts != 0, [&](auto kind, auto masks) {
    launch_persistent("REYES stage 'sample', large triangles", sample_large<kind.value, masks.value>,
                      uint64_t(1) << 30, stream, batch);
  });
}

}  // namespace gpurt::cuda
