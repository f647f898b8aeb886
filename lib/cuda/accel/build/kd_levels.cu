// The kernels that split the cells of a kd-tree's level: a warp or a block a cell.
#include <cub/device/device_scan.cuh>

#include "cuda/accel/build/kd_kernels.h"
#include "cuda/launch.h"

namespace gpurt::cuda {
namespace {

constexpr unsigned large_threads = 256;
constexpr unsigned small_warps = block_size / warp_size;

__device__ uint64_t warp_item() { return uint64_t(blockIdx.x) * small_warps + threadIdx.x / warp_size; }

__global__ void __launch_bounds__(block_size) choose_small_kernel(KdLevel level)
{
  __shared__ KdSmallShared shared[small_warps];
  const uint64_t i = warp_item();
  if (i >= level.num_cells) return;
  const KdBuildCell cell = level.cells[i];
  if (cell.count > kd_small_cell) return;
  choose_small(WarpGroup(), level.from + cell.first, cell, level.depth, level.costs,
               shared[threadIdx.x / warp_size], level.choices[i]);
}

__global__ void __launch_bounds__(large_threads) choose_large_kernel(KdLevel level)
{
  __shared__ uint32_t sums[large_threads / warp_size];
  __shared__ KdLargeShared shared;
  const uint32_t i = level.large[blockIdx.x];
  const KdBuildCell cell = level.cells[i];
  choose_large(BlockGroup(sums), level.from + cell.first, cell, level.depth, level.costs, shared,
               level.choices[i]);
}

__global__ void __launch_bounds__(block_size) needs_kernel(KdLevel level)
{
  const uint64_t i = thread_item();
  if (i > level.num_cells) return;
  KdLevelSums needs = {0, 0, 0};
  if (i < level.num_cells) {
    const KdChoice choice = level.choices[i];
    if (choice.is_split) needs = {1, choice.num[0] + choice.num[1], 0};
    else needs = {0, 0, level.cells[i].count};
  }
  level.sums[i] = needs;
}

struct AddSums {
  __device__ KdLevelSums operator()(const KdLevelSums &x, const KdLevelSums &y) const
  {
    return {x.splits + y.splits, x.references + y.references, x.leaf_references + y.leaf_references};
  }
};

template <class Group>
__device__ void partition(const Group &group, const KdLevel &level, uint64_t i)
{
  const KdBuildCell cell = level.cells[i];
  const KdChoice choice = level.choices[i];
  const KdLevelSums sums = level.sums[i];
  KdNode &node = level.nodes[level.first_node + i];
  if (!choice.is_split) {
    const uint32_t first = cell.count == 0 ? 0 : level.first_reference + sums.leaf_references;
    if (group.thread() == 0) node = {first, cell.count << 2 | 3u};
    for (uint32_t k = group.thread(); k < cell.count; k += group.size())
      level.references[first + k] = level.from[cell.first + k].triangle;
    return;
  }
  const uint32_t first_below = sums.references, first_above = first_below + choice.num[0];
  uint32_t num[2];
  partition_cell(group, level.scene, level.from + cell.first, cell, choice, level.to + first_below,
                 level.to + first_above, num);
  if (group.thread() != 0) return;
  const uint32_t child = 2 * sums.splits;
  node = {float_bits(choice.position), (level.first_node + level.num_cells + child) << 2 | choice.axis};
  KdBuildCell children[2];
  make_child_cells(cell, choice, num, first_below, first_above, children);
  for (uint32_t c = 0; c < 2; ++c) {
    level.next_cells[child + c] = children[c];
    if (children[c].count > kd_small_cell) level.next_large[add_to(level.num_next_large, 1)] = child + c;
  }
}

__global__ void __launch_bounds__(block_size) partition_small_kernel(KdLevel level)
{
  const uint64_t i = warp_item();
  if (i >= level.num_cells || level.cells[i].count > kd_small_cell) return;
  partition(WarpGroup(), level, i);
}

__global__ void __launch_bounds__(large_threads) partition_large_kernel(KdLevel level)
{
  __shared__ uint32_t sums[large_threads / warp_size];
  partition(BlockGroup(sums), level, level.large[blockIdx.x]);
}

__global__ void __launch_bounds__(kd_cost_block)
    cost_kernel(KdLevel level, double root_area, double *block_sums)
{
  __shared__ double sums[kd_cost_block];
  const uint64_t i = uint64_t(blockIdx.x) * kd_cost_block + threadIdx.x;
  double cost = 0;
  if (i < level.num_cells) {
    const KdBuildCell cell = level.cells[i];
    const double x = double(cell.box.hi.x) - cell.box.lo.x, y = double(cell.box.hi.y) - cell.box.lo.y,
                 z = double(cell.box.hi.z) - cell.box.lo.z;
    const double share = root_area > 0 ? (x * y + y * z + z * x) / root_area : 1.0;
    cost = share * (level.choices[i].is_split ? double(level.costs.traversal_cost) : double(cell.count));
  }
  sums[threadIdx.x] = cost;
  __syncthreads();
  // In an order of its own: the sum has the same bits in every run.
  for (unsigned step = kd_cost_block / 2; step != 0; step /= 2) {
    if (threadIdx.x < step) sums[threadIdx.x] += sums[threadIdx.x + step];
    __syncthreads();
  }
  if (threadIdx.x == 0) block_sums[blockIdx.x] = sums[0];
}

unsigned small_blocks(uint32_t num_cells) { return (num_cells + small_warps - 1) / small_warps; }

}  // namespace

void launch_kd_choose(const KdLevel &level, cudaStream_t stream)
{
  launch_blocks("kernel that chooses splits of small cells", choose_small_kernel,
                small_blocks(level.num_cells), block_size, stream, level);
  if (level.num_large != 0)
    launch_blocks("kernel that chooses splits of large cells", choose_large_kernel, level.num_large,
                  large_threads, stream, level);
}

uint64_t kd_sum_bytes(uint32_t num_cells)
{
  size_t bytes = 0;
  check(cub::DeviceScan::ExclusiveScan(nullptr, bytes, static_cast<const KdLevelSums *>(nullptr),
                                       static_cast<KdLevelSums *>(nullptr), AddSums(), KdLevelSums{0, 0, 0},
                                       int(num_cells) + 1),
        "cub::DeviceScan::ExclusiveScan");
  return bytes;
}

void launch_kd_sum(const KdLevel &level, void *scratch, uint64_t scratch_bytes, cudaStream_t stream)
{
  launch("kernel that says what cells need", needs_kernel, uint64_t(level.num_cells) + 1, stream, level);
  size_t bytes = scratch_bytes;
  check(cub::DeviceScan::ExclusiveScan(scratch, bytes, level.sums, level.sums, AddSums(),
                                       KdLevelSums{0, 0, 0}, int(level.num_cells) + 1, stream),
        "cub::DeviceScan::ExclusiveScan");
}

void launch_kd_partition(const KdLevel &level, cudaStream_t stream)
{
  launch_blocks("kernel that splits small cells", partition_small_kernel, small_blocks(level.num_cells),
                block_size, stream, level);
  if (level.num_large != 0)
    launch_blocks("kernel that splits large cells", partition_large_kernel, level.num_large, large_threads,
                  stream, level);
}

void launch_kd_cost(const KdLevel &level, double root_area, double *sums, cudaStream_t stream)
{
  launch_blocks("kernel that sums a kd-tree's cost", cost_kernel,
                (level.num_cells + kd_cost_block - 1) / kd_cost_block, kd_cost_block, stream, level,
                root_area, sums);
}

}  // namespace gpurt::cuda
