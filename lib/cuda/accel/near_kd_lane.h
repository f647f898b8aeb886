// What a thread of the kd-tree's fast kernels does. What a ray may hit is kept and measured as near_lane.h says.
#pragma once

#include "core/accel/near_kd.h"
#include "cuda/accel/near_lane.h"

namespace gpurt::cuda {

#if defined(__CUDACC__)

constexpr unsigned kd_warp_size = 32;

// The rays' axes of a warp: in shared memory, since registers cannot be indexed.
struct alignas(256) WarpAxes {
  float2 axis[3][kd_warp_size];
};

struct LaneAxes {
  const float2 *axes;  // of this lane
  __device__ __forceinline__ NearKdAxis operator()(uint32_t tag) const
  {
    const float2 x = axes[(tag & 3u) * kd_warp_size];
    return {x.x, x.y};
  }
};

__device__ __forceinline__ void set_axes(WarpAxes &axes, unsigned lane, const NearKdRay &q)
{
  for (int k = 0; k < 3; ++k) axes.axis[k][lane] = make_float2(q.axis[k].inverse, q.axis[k].shift);
}

// Where a ray goes no further; as a tag it is a leaf's.
constexpr uint32_t kd_end = 0xffffffffu;
constexpr uint32_t kd_empty_leaf = 3;

// What a ray leaves for later, and the end below it: a node, and the interval there. The array stands apart, so that `top`
// can live in a register.
constexpr unsigned kd_stack_size = kd_max_depth + 1;
struct NearKdStack {
  uint4 *entries;
  unsigned top;

  __device__ __forceinline__ void clear()
  {
    entries[0] = make_uint4(kd_end, __float_as_uint(-1.0f), __float_as_uint(-1.0f), 0);
    top = 1;
  }
  __device__ __forceinline__ void push(uint32_t index, float a, float b)
  {
    entries[top] = make_uint4(index, __float_as_uint(a), __float_as_uint(b), 0);
    ++top;
  }
};

__device__ __forceinline__ KdNode load_kd_node(const KdNode *nodes, uint32_t index)
{
  const uint2 n = __ldg(reinterpret_cast<const uint2 *>(nodes) + index);
  return {n.x, n.y};
}

// The nearest node that was left and begins before `end`, with its interval; its tag is kd_end where there is none.
__device__ __forceinline__ KdNode pop_kd_node(const KdNode *nodes, NearKdStack &stack, float end, float &a,
                                              float &b)
{
  uint4 e;
  do {
    e = stack.entries[--stack.top];
  } while (__uint_as_float(e.y) > end);
  a = __uint_as_float(e.y);
  b = at_most(__uint_as_float(e.z), end);
  return e.x == kd_end ? KdNode{0, kd_end} : load_kd_node(nodes, e.x);
}

// The root, or the end for a ray that misses the bounds.
__device__ __forceinline__ KdNode first_kd_node(const NearKdView &tree, float a, float b)
{
  return a <= b ? load_kd_node(tree.nodes, 0) : KdNode{0, kd_end};
}

// Calls test(triangle, its place) for the triangles of a leaf, until it returns true.
template <class Test>
__device__ __forceinline__ bool test_kd_leaf(const NearKdView &tree, KdNode leaf, Test &&test)
{
  const uint32_t past = leaf.word + payload(leaf);
  for (uint32_t k = leaf.word; k < past; ++k) {
    if (test(load_triangle(tree.triangles, k), k)) return true;
  }
  return false;
}

#endif

}  // namespace gpurt::cuda
