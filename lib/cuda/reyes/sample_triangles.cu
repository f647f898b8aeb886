// Stage 'sample' of meshes' triangles, which are flat and need no dicing: small ones a lane each, and large ones from any
// stage a warp for each part of them.
#include "cuda/reyes/sample_triangles.h"

namespace gpurt::cuda {
namespace {

constexpr unsigned scan_threads = 1024, scanned_together = 8;

template <Look look, bool has_masks>
__global__ void __launch_bounds__(block_size) sample_triangles(const __grid_constant__ ReyesBatch b)
{
  sample_triangles_of<look, has_masks>(b);
}

template <Look look, bool has_masks>
__global__ void __launch_bounds__(block_size)
    sample_large(const __grid_constant__ ReyesBatch b, LargeParts parts)
{
  sample_large_of<look, has_masks>(b, parts);
}

// large_parts[i] = the parts of triangle i.
__global__ void __launch_bounds__(block_size) count_large_parts(const __grid_constant__ ReyesBatch b)
{
  __shared__ PixelRows rows[block_size / 32];
  const uint32_t n = min(b.numbers->num_large, b.large_capacity), num_warps = gridDim.x * (block_size / 32);
  for (uint32_t i = uint32_t(thread_item() / 32); i < n; i += num_warps) {
    const uint32_t num_parts = count_parts(b, b.large[i], rows[threadIdx.x / 32]);
    if (threadIdx.x % 32 == 0) b.large_parts[i] = num_parts;
  }
}

// large_parts[i] = the parts of triangles 0 .. i. One block.
__global__ void __launch_bounds__(scan_threads) sum_large_parts(const __grid_constant__ ReyesBatch b)
{
  __shared__ uint32_t warp_sums[scan_threads / 32];
  const uint32_t n = min(b.numbers->num_large, b.large_capacity);
  const uint32_t lane = threadIdx.x % 32, warp = threadIdx.x / 32;
  uint32_t before = 0;
  for (uint32_t first = 0; first < n; first += scan_threads * scanned_together) {
    const uint32_t begin = first + threadIdx.x * scanned_together;
    uint32_t sums[scanned_together], sum = 0;
#pragma unroll
    for (uint32_t k = 0; k < scanned_together; ++k) {
      sum += begin + k < n ? b.large_parts[begin + k] : 0;
      sums[k] = sum;
    }
    uint32_t in_warp = sum;
    for (int offset = 1; offset < 32; offset *= 2) {
      const uint32_t other = __shfl_up_sync(all_lanes, in_warp, offset);
      if (lane >= uint32_t(offset)) in_warp += other;
    }
    if (lane == 31) warp_sums[warp] = in_warp;
    __syncthreads();
    uint32_t base = before;
    for (uint32_t w = 0; w < scan_threads / 32; ++w) {
      if (w < warp) base += warp_sums[w];
      before += warp_sums[w];
    }
#pragma unroll
    for (uint32_t k = 0; k < scanned_together; ++k) {
      if (begin + k < n) b.large_parts[begin + k] = base + in_warp - sum + sums[k];
    }
    __syncthreads();
  }
  if (threadIdx.x == 0) b.numbers->num_large_parts = before;
}

}  // namespace

void launch_sample_triangles(const ReyesBatch &batch, Look look, cudaStream_t stream)
{
  choose_kernel(look, batch.has_cutouts != 0, [&](auto kind, auto masks) {
    launch_persistent("REYES stage 'sample', triangles", sample_triangles<kind.value, masks.value>,
                      uint64_t(1) << 30, stream, batch);
  });
}

void launch_count_large_parts(const ReyesBatch &batch, cudaStream_t stream)
{
  launch_persistent("REYES stage 'sample', parts of large triangles", count_large_parts,
                    uint64_t(batch.large_capacity) * 32, stream, batch);
  launch_blocks("REYES stage 'sample', sums of parts", sum_large_parts, 1, scan_threads, stream, batch);
}

void launch_sample_large(const ReyesBatch &batch, Look look, LargeParts parts, cudaStream_t stream)
{
  choose_kernel(look, batch.has_cutouts != 0, [&](auto kind, auto masks) {
    launch_persistent("REYES stage 'sample', large triangles", sample_large<kind.value, masks.value>,
                      uint64_t(parts.num) * 32, stream, batch, parts);
  });
}

}  // namespace gpurt::cuda
