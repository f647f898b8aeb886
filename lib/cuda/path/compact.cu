#include "cuda/path/compact.h"

#include <type_traits>

#include "cuda/launch.h"
#include "cuda/path/place.h"
#include "cuda/path/queue_items.h"

namespace gpurt::cuda {
namespace {

constexpr unsigned warp_size = 32;
constexpr unsigned num_warps = block_size / warp_size;
constexpr unsigned rounds = warp_size / num_warps;  // a block's counts of (round, warp) fill one warp
constexpr unsigned rays_per_block = block_size * rounds;
constexpr unsigned scan_threads = warp_size * warp_size;

// The order of a block's rays: round by round, in each by thread.
__device__ __forceinline__ uint32_t ray_of(unsigned round)
{
  return blockIdx.x * rays_per_block + round * block_size + threadIdx.x;
}

// What says of a queue's items which are there.
const uint32_t *tokens(const FlagQueue &queue) { return queue.flags; }
template <class Queue>
const Ray *tokens(const Queue &queue)
{
  return queue.rays;
}

template <class Token>
__global__ void __launch_bounds__(block_size)
    count_kernel(const Token *items, uint32_t n, uint32_t *block_counts)
{
  uint32_t count = 0;
  for (unsigned round = 0; round < rounds; ++round)
    count += __syncthreads_count(is_there(items, ray_of(round), n));
  if (threadIdx.x == 0) block_counts[blockIdx.x] = count;
}

// The sum of `value` over the lanes up to this one.
__device__ __forceinline__ uint32_t warp_prefix_sum(uint32_t value, unsigned lane)
{
  for (unsigned step = 1; step < warp_size; step *= 2) {
    const uint32_t other = __shfl_up_sync(~0u, value, step);
    if (lane >= step) value += other;
  }
  return value;
}

// One block, since a few thousand counts take it less time than another launch would.
__global__ void __launch_bounds__(scan_threads)
    scan_kernel(uint32_t *block_counts, uint32_t num_blocks, uint32_t *total)
{
  __shared__ uint32_t warp_sums[warp_size];
  const unsigned lane = threadIdx.x % warp_size, warp = threadIdx.x / warp_size;
  uint32_t base = 0;
  for (uint32_t first = 0; first < num_blocks; first += scan_threads) {
    const uint32_t i = first + threadIdx.x;
    const uint32_t count = i < num_blocks ? block_counts[i] : 0;
    const uint32_t in_warp = warp_prefix_sum(count, lane);
    if (lane == warp_size - 1) warp_sums[warp] = in_warp;
    __syncthreads();
    if (warp == 0) warp_sums[lane] = warp_prefix_sum(warp_sums[lane], lane);
    __syncthreads();
    const uint32_t before = warp != 0 ? warp_sums[warp - 1] : 0;
    if (i < num_blocks) block_counts[i] = base + before + in_warp - count;
    base += warp_sums[warp_size - 1];
    __syncthreads();
  }
  if (threadIdx.x == 0) *total = base;
}

template <class Queue, class Token>
__global__ void __launch_bounds__(block_size)
    scatter_kernel(Queue from, const Token *items, uint32_t n, Queue to, const uint32_t *block_offsets)
{
  __shared__ uint32_t first[rounds * num_warps];
  const unsigned lane = threadIdx.x % warp_size, warp = threadIdx.x / warp_size;
  uint32_t votes[rounds];
#pragma unroll
  for (unsigned round = 0; round < rounds; ++round) {
    votes[round] = __ballot_sync(~0u, is_there(items, ray_of(round), n));
    if (lane == 0) first[round * num_warps + warp] = __popc(votes[round]);
  }
  __syncthreads();
  if (warp == 0) {
    const uint32_t count = first[lane];
    first[lane] = block_offsets[blockIdx.x] + warp_prefix_sum(count, lane) - count;
  }
  __syncthreads();
#pragma unroll
  for (unsigned round = 0; round < rounds; ++round) {
    if (!(votes[round] >> lane & 1u)) continue;
    const uint32_t k = first[round * num_warps + warp] + __popc(votes[round] & ((1u << lane) - 1u));
    move_item(from, ray_of(round), to, k);
  }
}

template <class Queue>
void compact(const Queue &from, uint32_t n, const Queue &to, const CompactScratch &scratch,
             cudaStream_t stream)
{
  const uint32_t num_blocks = compact_num_blocks(n);
  const auto *const items = tokens(from);
  using Token = std::remove_cvref_t<decltype(*items)>;
  launch_blocks("kernel that counts rays", count_kernel<Token>, num_blocks, block_size, stream, items, n,
                scratch.block_counts);
  launch_blocks("kernel that sums counts of rays", scan_kernel, 1, scan_threads, stream, scratch.block_counts,
                num_blocks, scratch.total);
  launch_blocks("kernel that moves rays", scatter_kernel<Queue, Token>, num_blocks, block_size, stream, from,
                items, n, to, scratch.block_counts);
}

}  // namespace

uint64_t block_scan_bytes(uint32_t n) { return uint64_t(compact_num_blocks(n)) * sizeof(uint32_t); }

void launch_place_by_block_scan(const uint32_t *flags, uint32_t n, void *memory, uint32_t *places,
                                uint32_t *total, cudaStream_t stream)
{
  const FlagQueue queue{flags, places};
  compact(queue, n, queue, {static_cast<uint32_t *>(memory), total}, stream);
}

uint32_t compact_num_blocks(uint32_t n) { return (n + rays_per_block - 1) / rays_per_block; }

void launch_compact_rays(const RayQueue &from, uint32_t n, const RayQueue &to, const CompactScratch &scratch,
                         cudaStream_t stream)
{
  compact(from, n, to, scratch, stream);
}

void launch_compact_shadows(const ShadowQueue &from, uint32_t n, const ShadowQueue &to,
                            const CompactScratch &scratch, cudaStream_t stream)
{
  compact(from, n, to, scratch, stream);
}

}  // namespace gpurt::cuda
