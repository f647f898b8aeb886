#include "cuda/accel/build/refit_kernels.h"

#include "core/accel/bvh_node.h"
#include "core/accel/degenerate.h"
#include "cuda/launch.h"

namespace gpurt::cuda {
namespace {

static_assert(refit_block_size == block_size);

__global__ void clear_kernel(RefitState s)
{
  *s.bounds = empty_ordered_box();
  *s.num_empty = 0;
}

__global__ void __launch_bounds__(block_size)
    triangles_kernel(RefitState s, const Vec3f *positions, const UInt3 *indices)
{
  __shared__ uint32_t sums[block_size / warp_size];
  const uint64_t i = thread_item();
  Box box = empty_box();
  if (i < s.num_triangles) {
    const LeafTriangle old = s.old_triangles[i];
    const uint32_t triangle = old.triangle;
    const UInt3 c = indices[triangle];
    const Vec3f p0 = positions[c.x], p1 = positions[c.y], p2 = positions[c.z];
    s.triangles[i] = {p0, triangle, p1, old.primitive, p2, old.segment};
    if (has_no_area(p0, p1, p2)) add_to(s.num_empty, 1);
    box = {min(p0, min(p1, p2)), max(p0, max(p1, p2))};
  }
  extend_by_all(BlockGroup(sums), *s.bounds, box);
}

__global__ void __launch_bounds__(block_size) parents_kernel(RefitState s)
{
  const uint64_t i = thread_item();
  if (i >= s.num_nodes) return;
  if (i == 0) s.parents[0] = invalid_id;
  const BvhNode &node = s.old_nodes[i];
  if (!is_bvh_leaf(node.child0)) s.parents[node.child0] = uint32_t(2 * i);
  if (!is_bvh_leaf(node.child1)) s.parents[node.child1] = uint32_t(2 * i + 1);
}

__device__ __forceinline__ uint32_t child_of(const BvhNode &node, uint32_t slot)
{
  return slot % 2 == 0 ? node.child0 : node.child1;
}

// A thread a slot: those of leaves start, and go up as long as they come second.
__global__ void __launch_bounds__(block_size) boxes_kernel(RefitState s)
{
  const uint64_t i = thread_item();
  if (i >= 2 * s.num_nodes) return;
  uint32_t slot = uint32_t(i);
  const uint32_t word = child_of(s.old_nodes[slot / 2], slot);
  if (!is_bvh_leaf(word)) return;
  Box box = empty_box();
  for (uint32_t t = leaf_first(word); t < leaf_first(word) + leaf_size(word); ++t) {
    const LeafTriangle triangle = s.triangles[t];
    box = extend(extend(extend(box, triangle.a), triangle.b), triangle.c);
  }
  for (;;) {
    s.boxes[slot] = box;
    const uint32_t node = slot / 2;
    // The other child's box is written before it arrives, and read after this one has.
    __threadfence();
    if (atomicAdd(&s.arrivals[node], 1) == 0) return;
    __threadfence();
    if (s.parents[node] == invalid_id) return;
    const volatile float *other = reinterpret_cast<const volatile float *>(&s.boxes[slot ^ 1u]);
    box = extend(box, Box{{other[0], other[1], other[2]}, {other[3], other[4], other[5]}});
    slot = s.parents[node];
  }
}

__global__ void __launch_bounds__(block_size)
    nodes_kernel(RefitState s, BvhFrame frame, float scale, BvhNode *nodes, double *costs)
{
  __shared__ double sums[block_size];
  const uint64_t i = thread_item();
  double cost = 0;
  if (i < s.num_nodes) {
    const BvhNode &old = s.old_nodes[i];
    const Box box0 = s.boxes[2 * i], box1 = s.boxes[2 * i + 1];
    nodes[i] = make_bvh_node(box0, old.child0, box1, old.child1, frame);
    cost = double(scaled_half_area(extend(box0, box1), scale)) * build_traversal_cost;
    if (is_bvh_leaf(old.child0)) cost += double(scaled_half_area(box0, scale)) * leaf_size(old.child0);
    if (is_bvh_leaf(old.child1)) cost += double(scaled_half_area(box1, scale)) * leaf_size(old.child1);
  }
  sums[threadIdx.x] = cost;
  __syncthreads();
  // In an order of its own: the sum has the same bits in every run.
  for (unsigned step = block_size / 2; step != 0; step /= 2) {
    if (threadIdx.x < step) sums[threadIdx.x] += sums[threadIdx.x + step];
    __syncthreads();
  }
  if (threadIdx.x == 0) costs[blockIdx.x] = sums[0];
}

}  // namespace

void launch_refit_triangles(const RefitState &state, const SceneView &scene, cudaStream_t stream)
{
  clear_kernel<<<1, 1, 0, stream>>>(state);
  check(cudaGetLastError(), "kernel that clears a refit's counters");
  launch("kernel that reads triangles anew", triangles_kernel, state.num_triangles, stream, state,
         scene.positions, scene.indices);
}

void launch_refit_boxes(const RefitState &state, cudaStream_t stream)
{
  launch("kernel that finds parents", parents_kernel, state.num_nodes, stream, state);
  launch("kernel that refits boxes", boxes_kernel, 2 * state.num_nodes, stream, state);
}

void launch_refit_nodes(const RefitState &state, const BvhFrame &frame, float scale, BvhNode *nodes,
                        double *costs, cudaStream_t stream)
{
  launch("kernel that refits nodes", nodes_kernel, state.num_nodes, stream, state, frame, scale, nodes,
         costs);
}

}  // namespace gpurt::cuda
