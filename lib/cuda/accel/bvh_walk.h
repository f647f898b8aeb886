// A ray's way through a bvh, step by step, as the fast kernels go it.
#pragma once

#include "cuda/accel/near_lane.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

#if defined(__CUDACC__)

struct BvhWalk {
  using Kind = NearKind<true>;
  // Blocks of a multiprocessor that registers must leave room for.
  static constexpr int plain_blocks = 10, refill_blocks = 9;
  // Of warps that refill: steps between votes, and lanes that have a node while the warp goes on stepping. Of 8 to 20 lanes
  // these measured best, by little.
  static constexpr int steps = 3, stepping_until = 12;

  // What a ray leaves for later, above what is never taken off.
  using Entry = uint32_t;
  static constexpr unsigned stack_size = bvh_max_depth + 1;
  // What a warp's rays keep in shared memory: nothing.
  struct Shared {};

  NearRay ray;
  Entry *top;  // behind the last entry: an index would take two instructions more an access
  uint32_t current;

  __device__ __forceinline__ BvhWalk(Entry *stack, Shared *, unsigned) : ray{}, top(stack), current(bvh_empty)
  {
    stack[0] = bvh_empty;
  }

  __device__ __forceinline__ bool has_ended() const { return current == bvh_empty; }
  __device__ __forceinline__ bool is_at_leaf() const { return is_bvh_leaf(current); }
  __device__ __forceinline__ void stop() { current = bvh_empty; }
  __device__ __forceinline__ void pop(float) { current = *--top; }
  __device__ __forceinline__ bool is_between_trees() const { return false; }

  // Starts at the root. False: the ray has to go the general way.
  __device__ __forceinline__ bool begin(const TraceScene &s, const Ray &r, Entry *stack)
  {
    if (!make_near_ray(r, s.world.tree, ray)) return false;
    restart(s, stack);
    return true;
  }
  __device__ __forceinline__ void restart(const TraceScene &s, Entry *stack)
  {
    top = stack + 1;
    current = s.world.tree.root;
  }

  // A node: goes to the child that the ray meets first, or the larger one, and leaves the other for later.
  template <bool Ordered>
  __device__ __forceinline__ void step(const TraceScene &s, float end)
  {
    count_step();
    const BvhNode node = load_node(s.world.tree.nodes, current);
    float enter0, leave0, enter1, leave1;
    clip_near(ray, node.center0, half0(node.half[0]), half0(node.half[1]), half0(node.half[2]), end, enter0,
              leave0);
    clip_near(ray, node.center1, half1(node.half[0]), half1(node.half[1]), half1(node.half[2]), end, enter1,
              leave1);
    // Not a number, from a half extent that overflowed: visited.
    const bool meets0 = !(enter0 > leave0), meets1 = !(enter1 > leave1);
    const bool second_first = !meets0 || (Ordered && meets1 && enter1 < enter0);
    current = second_first ? node.child1 : node.child0;
    if (meets0 && meets1) *top++ = second_first ? node.child0 : node.child1;
    if (!meets0 && !meets1) current = *--top;
  }

  // Calls test(triangle, its id, its reference) for the triangles of a leaf, until it returns true.
  template <class Test>
  __device__ __forceinline__ bool test_leaf(const TraceScene &s, Test &&test)
  {
    const uint32_t first = leaf_first(current), past = first + leaf_size(current);
    for (uint32_t k = first; k < past; ++k) {
      count_step();
      const LeafTriangle x = load_triangle(s.world.triangles, k);
      if (test(x, x.triangle, k)) return true;
    }
    return false;
  }

  // Of a ray that waits till a lane takes it: whether it can, and what beside WaitingRays has to be kept of it, nothing.
  struct Waiting {};
  __device__ __forceinline__ static bool start(const TraceScene &s, const Ray &from, NearRay &r, NearBegin &n)
  {
    return start_near_ray(from, s.world.tree, r, n);
  }
  __device__ __forceinline__ static void keep(const TraceScene &, const Ray &, NearRay &, NearBegin &,
                                              Waiting &, unsigned)
  {}
  __device__ __forceinline__ static Vec3f center(const TraceScene &s) { return s.world.tree.frame.center; }
  __device__ __forceinline__ void take(const TraceScene &s, float tmin, NearBegin &n, const Waiting &,
                                       unsigned, Entry *stack)
  {
    clip_from(tmin, ray, n);
    restart(s, stack);
  }
};

#endif

GPURT_KERNELS_END
}  // namespace gpurt::cuda
