// Splits of nodes so large that many blocks share the work: each takes chunks of references, and what the chunks count is
// added up before a split is chosen and before references move.
#include "cuda/accel/build/large_nodes.h"
#include "cuda/launch.h"

namespace gpurt::cuda {
namespace {

constexpr unsigned threads = 256;
constexpr unsigned num_warps = threads / warp_size;

// Lists the level's large nodes and their chunks: a block a node.
__global__ void __launch_bounds__(threads) list_kernel(BuildState state)
{
  const uint32_t index = state.level.list[LargeNode][blockIdx.x];
  const uint32_t count = state.level.nodes[index].count;
  __shared__ uint32_t large, first_chunk;
  const uint32_t num_chunks = (count + chunk_size - 1) / chunk_size;
  if (threadIdx.x == 0) {
    large = add_to(&state.level.counters->num_large, 1);
    first_chunk = add_to(&state.level.counters->num_chunks, num_chunks);
    LargeSplit &l = state.large[large];
    l.node = index;
    l.first_chunk = first_chunk;
    l.num_chunks = num_chunks;
    begin_split(l.state, count);
  }
  __syncthreads();
  clear_bins(BlockGroup(nullptr), state.large[large].bins);
  for (uint32_t i = threadIdx.x; i < num_chunks; i += threads) {
    SplitChunk &c = state.chunks[first_chunk + i];
    c.large = large;
    c.first = i * chunk_size;
    c.count = min(chunk_size, count - i * chunk_size);
  }
}

// Adds a chunk's bins to its node's.
__device__ void add_bins(const BuildBins &from, BuildBins &to)
{
  if (threadIdx.x == 0) raise_to(&to.widest, from.widest);
  for (uint32_t i = threadIdx.x; i < 3 * num_bins; i += threads) {
    const uint32_t k = i / num_bins, b = i % num_bins;
    if (from.lo[k][b][0] > from.hi[k][b][0]) continue;  // nothing there
    for (int c = 0; c < 3; ++c) {
      lower_to(&to.lo[k][b][c], from.lo[k][b][c]);
      raise_to(&to.hi[k][b][c], from.hi[k][b][c]);
    }
    if (from.first[k][b] != 0) add_to(&to.first[k][b], from.first[k][b]);
    if (from.last[k][b] != 0) add_to(&to.last[k][b], from.last[k][b]);
  }
}

__global__ void __launch_bounds__(threads) bin_objects_kernel(BuildState state)
{
  if (blockIdx.x >= state.level.counters->num_chunks) return;
  __shared__ uint32_t sums[num_warps];
  __shared__ BuildBins bins;
  const BlockGroup group(sums);
  SplitChunk &chunk = state.chunks[blockIdx.x];
  LargeSplit &large = state.large[chunk.large];
  const BuildNode &node = state.level.nodes[large.node];
  if (must_halve(node.count, node.depth)) return;
  clear_bins(group, bins);
  __syncthreads();
  bin_objects(group, state.level.from + node.first + chunk.first, chunk.count, node.bounds, node.centers,
              bins);
  __syncthreads();
  add_bins(bins, large.bins);
  for (uint32_t i = threadIdx.x; i < 3 * num_bins; i += threads)
    chunk.object_first[i / num_bins][i % num_bins] = bins.first[i / num_bins][i % num_bins];
}

__global__ void __launch_bounds__(64) choose_kernel(BuildState state)
{
  if (blockIdx.x >= state.level.counters->num_large) return;
  __shared__ uint32_t sums[2];
  __shared__ BuildBins bins;
  __shared__ SplitState split;
  const BlockGroup group(sums);
  LargeSplit &large = state.large[blockIdx.x];
  const BuildNode &node = state.level.nodes[large.node];
  if (must_halve(node.count, node.depth)) return;
  const uint32_t *from = reinterpret_cast<const uint32_t *>(&large.bins);
  uint32_t *to = reinterpret_cast<uint32_t *>(&bins);
  for (uint32_t i = threadIdx.x; i < sizeof(BuildBins) / 4; i += blockDim.x) to[i] = from[i];
  if (threadIdx.x == 0) split = large.state;
  __syncthreads();
  compare_planes(group, bins, node.count, false, 0, state.level.scale, &split.best_object);
  __syncthreads();
  if (threadIdx.x == 0) {
    take_object_split(split, bins, node.centers, node.count, node.spare, state.level.scale,
                      state.level.root_area);
    large.state = split;
  }
  clear_bins(group, large.bins);
}

__global__ void __launch_bounds__(threads) bin_space_kernel(BuildState state)
{
  if (blockIdx.x >= state.level.counters->num_chunks) return;
  SplitChunk &chunk = state.chunks[blockIdx.x];
  LargeSplit &large = state.large[chunk.large];
  if (!large.state.tries_space) return;
  __shared__ uint32_t sums[num_warps];
  __shared__ BuildBins bins;
  const BlockGroup group(sums);
  const BuildNode &node = state.level.nodes[large.node];
  clear_bins(group, bins);
  __syncthreads();
  bin_space(group, state.level.scene, state.level.from + node.first + chunk.first, chunk.count, node.bounds,
            bins);
  __syncthreads();
  add_bins(bins, large.bins);
  for (uint32_t i = threadIdx.x; i < 3 * num_bins; i += threads) {
    chunk.first_bin[i / num_bins][i % num_bins] = bins.first[i / num_bins][i % num_bins];
    chunk.last_bin[i / num_bins][i % num_bins] = bins.last[i / num_bins][i % num_bins];
  }
}

// How many of a chunk's references each child gets: the first below, the second above.
__device__ uint64_t count_sides(const SplitChunk &chunk, const BuildSplit &split)
{
  uint32_t num[2] = {0, 0};
  if (split.kind == SplitKind::Halves) {
    num[0] = chunk.first >= split.num[0] ? 0 : min(chunk.count, split.num[0] - chunk.first);
    num[1] = chunk.count - num[0];
  } else if (split.kind == SplitKind::Object) {
    for (uint32_t b = 0; b <= split.bin; ++b) num[0] += chunk.object_first[split.axis][b];
    num[1] = chunk.count - num[0];
  } else {
    for (uint32_t b = 0; b < num_bins; ++b) {
      if (b <= split.bin) num[0] += chunk.first_bin[split.axis][b];
      else num[1] += chunk.last_bin[split.axis][b];
    }
  }
  return uint64_t(num[1]) << 32 | num[0];
}

// Decides between object and space, makes the children, and finds where each chunk's references go.
__global__ void __launch_bounds__(threads) finish_kernel(BuildState state)
{
  if (blockIdx.x >= state.level.counters->num_large) return;
  __shared__ uint32_t sums[num_warps];
  __shared__ SplitState split;
  const BlockGroup group(sums);
  LargeSplit &large = state.large[blockIdx.x];
  const BuildNode &node = state.level.nodes[large.node];
  if (threadIdx.x == 0) split = large.state;
  __syncthreads();
  if (split.tries_space) {
    compare_planes(group, large.bins, node.count, true, node.spare, state.level.scale, &split.best_spatial);
    __syncthreads();
    if (threadIdx.x == 0) take_spatial_split(split, large.bins, node.bounds);
  }
  if (threadIdx.x == 0) {
    make_children(state.level, large.node, split.split);
    large.state = split;
  }
  __syncthreads();
  uint32_t base[2] = {0, 0};
  for (uint32_t first = 0; first < large.num_chunks; first += threads) {
    const uint32_t i = first + threadIdx.x;
    SplitChunk *chunk = i < large.num_chunks ? &state.chunks[large.first_chunk + i] : nullptr;
    const uint64_t num = chunk != nullptr ? count_sides(*chunk, split.split) : 0;
    uint32_t total[2];
    const uint32_t before0 = group.scan(uint32_t(num), total[0]),
                   before1 = group.scan(uint32_t(num >> 32), total[1]);
    if (chunk != nullptr) {
      chunk->offset[0] = base[0] + before0;
      chunk->offset[1] = base[1] + before1;
    }
    base[0] += total[0];
    base[1] += total[1];
  }
}

// Splits by object and in space have kernels of their own, since cutting triangles takes many registers.
template <bool Cuts>
__global__ void __launch_bounds__(threads) move_kernel(BuildState state)
{
  if (blockIdx.x >= state.level.counters->num_chunks) return;
  __shared__ uint32_t sums[num_warps];
  __shared__ OrderedBox boxes[4];
  const BlockGroup group(sums);
  const SplitChunk &chunk = state.chunks[blockIdx.x];
  const LargeSplit &large = state.large[chunk.large];
  if ((large.state.split.kind == SplitKind::Spatial) != Cuts) return;
  const BuildNode &node = state.level.nodes[large.node];
  if (threadIdx.x < 4) boxes[threadIdx.x] = empty_ordered_box();
  __syncthreads();
  BuildNode *children = state.level.nodes + node.child;
  const SplitTarget target = {
      {references_of(children[0], state.level.to, state.level.small_nodes) + chunk.offset[0],
       references_of(children[1], state.level.to, state.level.small_nodes) + chunk.offset[1]},
      {&boxes[0], &boxes[1]},
      {&boxes[2], &boxes[3]}};
  move_references<Cuts>(group, state.level.scene, state.level.from + node.first + chunk.first, chunk.count,
                        chunk.first, large.state.split, target);
  __syncthreads();
  if (threadIdx.x < 12) {
    const int box = int(threadIdx.x) / 3, k = int(threadIdx.x) % 3;
    OrderedBox &to = box < 2 ? children[box].bounds : children[box - 2].centers;
    lower_to(&to.lo[k], boxes[box].lo[k]);
    raise_to(&to.hi[k], boxes[box].hi[k]);
  }
}

}  // namespace

void launch_split_large(const BuildState &state, uint32_t num_large, uint32_t num_references,
                        cudaStream_t stream)
{
  const uint32_t max_chunks = num_references / chunk_size + num_large;
  list_kernel<<<num_large, threads, 0, stream>>>(state);
  check(cudaGetLastError(), "kernel that lists large nodes");
  bin_objects_kernel<<<max_chunks, threads, 0, stream>>>(state);
  check(cudaGetLastError(), "kernel that bins references");
  choose_kernel<<<num_large, 64, 0, stream>>>(state);
  check(cudaGetLastError(), "kernel that chooses splits");
  bin_space_kernel<<<max_chunks, threads, 0, stream>>>(state);
  check(cudaGetLastError(), "kernel that bins parts of triangles");
  finish_kernel<<<num_large, threads, 0, stream>>>(state);
  check(cudaGetLastError(), "kernel that makes children");
  move_kernel<false><<<max_chunks, threads, 0, stream>>>(state);
  check(cudaGetLastError(), "kernel that moves references");
  move_kernel<true><<<max_chunks, threads, 0, stream>>>(state);
  check(cudaGetLastError(), "kernel that cuts references");
}

}  // namespace gpurt::cuda
