// The kernels that split a level's nodes, and those that place what came of them.
#include "cuda/accel/build/large_nodes.h"
#include "cuda/accel/build/small_tree.h"
#include "cuda/launch.h"

namespace gpurt::cuda {
namespace {

// Blocks that split one node each: of more threads for more references.
constexpr unsigned medium_threads = 64, large_threads = 256, spatial_threads = 128;
// Blocks that take nodes one after another.
constexpr unsigned num_spatial_blocks = 2048;
constexpr unsigned small_warps = block_size / warp_size;

// A warp a small node: builds its subtree.
__global__ void __launch_bounds__(block_size) small_kernel(BuildLevel level, uint32_t num_nodes)
{
  __shared__ SmallTree shared[small_warps];
  const unsigned warp = threadIdx.x / warp_size;
  const uint64_t index = uint64_t(blockIdx.x) * small_warps + warp;
  if (index >= num_nodes) return;
  BuildNode &node = level.nodes[index];
  if (!is_small(node)) return;
  build_small(WarpGroup(), references_of(node, nullptr, level.small_nodes), node, level.scale, level.frame,
              shared[warp], level.small_nodes + node.subtree, level.small_references + node.subtree);
}

// A block a node of one class.
template <unsigned Threads>
__global__ void __launch_bounds__(Threads) split_kernel(BuildLevel level, uint32_t node_class)
{
  __shared__ uint32_t sums[Threads / warp_size];
  __shared__ SplitShared shared;
  split_node<false>(BlockGroup(sums), level, level.list[node_class][blockIdx.x], shared);
}

// Those that the blocks before have left over.
__global__ void __launch_bounds__(spatial_threads) spatial_kernel(BuildLevel level)
{
  __shared__ uint32_t sums[spatial_threads / warp_size];
  __shared__ SplitShared shared;
  const uint32_t num_nodes = level.counters->num_spatial;
  for (uint32_t i = blockIdx.x; i < num_nodes; i += gridDim.x)
    split_node<true>(BlockGroup(sums), level, level.spatial_list[i], shared);
}

__global__ void __launch_bounds__(block_size) sum_up_kernel(BuildState state, uint32_t begin, uint32_t end)
{
  const uint64_t index = begin + thread_item();
  if (index < end) sum_up(state.level.nodes, uint32_t(index), state.level.scale);
}

__global__ void __launch_bounds__(block_size)
    place_kernel(BuildState state, uint32_t begin, uint32_t end, BuildTarget target)
{
  const uint64_t index = begin + thread_item();
  if (index < end)
    place_children(state.level.nodes, uint32_t(index), state.level.scale, state.level.frame, target);
}

__global__ void __launch_bounds__(block_size)
    place_small_kernel(BuildState state, uint32_t num_nodes, BuildTarget target)
{
  const uint64_t index = uint64_t(blockIdx.x) * small_warps + threadIdx.x / warp_size;
  if (index >= num_nodes || !is_small(state.level.nodes[index])) return;
  place_small(WarpGroup(), state.level.nodes[index], state.level.small_nodes, state.level.small_references,
              target);
}

}  // namespace

void launch_split_level(const BuildState &state, const uint32_t (&num_of_class)[4], uint32_t num_references,
                        cudaStream_t stream)
{
  if (num_of_class[LargeNode] != 0)
    launch_split_large(state, num_of_class[LargeNode], num_references, stream);
  if (num_of_class[BlockNode] != 0) {
    split_kernel<large_threads>
        <<<num_of_class[BlockNode], large_threads, 0, stream>>>(state.level, BlockNode);
    check(cudaGetLastError(), "kernel that splits nodes");
  }
  if (num_of_class[MediumNode] != 0) {
    split_kernel<medium_threads>
        <<<num_of_class[MediumNode], medium_threads, 0, stream>>>(state.level, MediumNode);
    check(cudaGetLastError(), "kernel that splits nodes");
  }
  if (const uint32_t num = num_of_class[BlockNode] + num_of_class[MediumNode]; num != 0) {
    spatial_kernel<<<min(num, num_spatial_blocks), spatial_threads, 0, stream>>>(state.level);
    check(cudaGetLastError(), "kernel that splits nodes in space");
  }
}

void launch_build_small(const BuildState &state, uint32_t num_nodes, cudaStream_t stream)
{
  small_kernel<<<(num_nodes + small_warps - 1) / small_warps, block_size, 0, stream>>>(state.level,
                                                                                       num_nodes);
  check(cudaGetLastError(), "kernel that builds small subtrees");
}

void launch_sum_up(const BuildState &state, uint32_t begin, uint32_t end, cudaStream_t stream)
{
  launch("kernel that sums over subtrees", sum_up_kernel, end - begin, stream, state, begin, end);
}

void launch_place(const BuildState &state, uint32_t begin, uint32_t end, const BuildTarget &target,
                  cudaStream_t stream)
{
  launch("kernel that places nodes", place_kernel, end - begin, stream, state, begin, end, target);
}

void launch_place_small(const BuildState &state, uint32_t num_nodes, const BuildTarget &target,
                        cudaStream_t stream)
{
  place_small_kernel<<<(num_nodes + small_warps - 1) / small_warps, block_size, 0, stream>>>(state, num_nodes,
                                                                                             target);
  check(cudaGetLastError(), "kernel that places small subtrees");
}

}  // namespace gpurt::cuda
