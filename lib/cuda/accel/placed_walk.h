// A ray's way through the bvhs of a scene with placements, as the fast kernels go it: through that of world space, then through
// the one over placements, and from its leaves into those of the placements' groups.
//
// One stack serves all of it: a word of its own marks where a group's tree ends and the ray goes on among the placements. The ray
// is in the space of the tree that it is in, and made anew whenever that changes: both is rare beside steps. Boxes are widened
// on the way (make_far_ray), since a group is often small beside how far away its rays begin.
#pragma once

#include "cuda/accel/bvh_walk.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

#if defined(__CUDACC__)

// Marks the end of a group's tree on the stack. No leaf has this word: it would begin beyond the last reference.
constexpr uint32_t bvh_group_end = bvh_empty - 1;
static_assert(bvh_max_references <= (bvh_group_end & 0x0fffffffu));

template <bool Masks>
struct PlacedBvhWalk {
  using Kind = NearKind<true, Masks, true>;
  static constexpr int plain_blocks = 8, refill_blocks = 7;
  static constexpr int steps = BvhWalk::steps, stepping_until = BvhWalk::stepping_until;

  using Entry = uint32_t;
  // Of both trees; and the end, what is left of a leaf of placements, the end of a group, and the placements' root.
  static constexpr unsigned stack_size = 2 * bvh_max_depth + 4;
  struct Shared {};

  NearRay ray;
  float widening;
  Entry *top;
  uint32_t current;
  const BvhNode *nodes;
  const LeafTriangle *triangles;  // null: among the placements

  __device__ __forceinline__ PlacedBvhWalk(Entry *stack, Shared *, unsigned)
      : ray{}, widening(0), top(stack), current(bvh_empty), nodes(nullptr), triangles(nullptr)
  {
    stack[0] = bvh_empty;
  }

  __device__ __forceinline__ bool has_ended() const { return current == bvh_empty; }
  __device__ __forceinline__ bool is_at_leaf() const { return is_bvh_leaf(current); }
  __device__ __forceinline__ void stop() { current = bvh_empty; }
  __device__ __forceinline__ void pop(float) { current = *--top; }
  // At what is_at_leaf() tells to be a leaf: whether it holds no triangles.
  __device__ __forceinline__ bool is_between_trees() const
  {
    return triangles == nullptr || current == bvh_group_end;
  }

  __device__ __forceinline__ static const BvhView &first_tree(const TraceScene &s)
  {
    return s.world.tree.root != bvh_empty ? s.world.tree : s.bvhs.placements;
  }
  // Starts at the root. False: the ray has to go the general way.
  __device__ __forceinline__ bool begin(const TraceScene &s, const Ray &r, Entry *stack)
  {
    if (!make_far_ray(r, first_tree(s), ray, widening)) return false;
    restart(s, stack);
    return true;
  }
  __device__ __forceinline__ void restart(const TraceScene &s, Entry *stack)
  {
    const BvhView &tree = first_tree(s);
    const bool has_world = s.world.tree.root != bvh_empty;
    top = stack + 1;
    if (has_world) {
      *top++ = s.bvhs.placements.root;
      *top++ = bvh_group_end;
    }
    current = tree.root;
    nodes = tree.nodes;
    triangles = has_world ? s.world.triangles : nullptr;
  }

  // As in BvhWalk.
  template <bool Ordered>
  __device__ __forceinline__ void step(const TraceScene &, float end)
  {
    count_step();
    const BvhNode node = load_node(nodes, current);
    float enter0, leave0, enter1, leave1;
    clip_near(ray, node.center0, half0(node.half[0]) + widening, half0(node.half[1]) + widening,
              half0(node.half[2]) + widening, end, enter0, leave0);
    clip_near(ray, node.center1, half1(node.half[0]) + widening, half1(node.half[1]) + widening,
              half1(node.half[2]) + widening, end, enter1, leave1);
    const bool meets0 = !(enter0 > leave0), meets1 = !(enter1 > leave1);
    const bool second_first = !meets0 || (Ordered && meets1 && enter1 < enter0);
    current = second_first ? node.child1 : node.child0;
    if (meets0 && meets1) *top++ = second_first ? node.child0 : node.child1;
    if (!meets0 && !meets1) current = *--top;
  }

  template <class Test>
  __device__ __forceinline__ bool test_leaf(const TraceScene &, Test &&test)
  {
    const uint32_t first = leaf_first(current), past = first + leaf_size(current);
    for (uint32_t k = first; k < past; ++k) {
      count_step();
      const LeafTriangle x = load_triangle(triangles, k);
      if (test(x, x.triangle, k)) return true;
    }
    return false;
  }

  // From a group's tree back among the placements, or into that of the next placement of a leaf. `world` is the ray, `limit` the
  // largest t of interest. A ray that a tree cannot take ends here, and `pending` tells that it has to go the general way.
  template <class P>
  __device__ __forceinline__ void change_tree(const TraceScene &s, Ray world, float limit, float &end,
                                              P &pending)
  {
    const BvhView *tree = &s.bvhs.placements;
    pending.placement = pending.triangle = invalid_id;
    if (current == bvh_group_end) {
      triangles = nullptr;
      current = *--top;
      if (has_ended()) return;
    }
    if (is_at_leaf()) {
      // What lies in world space stays known: the ray is not needed there.
      const uint32_t first = leaf_first(current), count = leaf_size(current);
      if (count > 1) *top++ = bvh_leaf(first + 1, count - 1);
      pending.placement = s.bvhs.placements.references[first];
      const Placement &p = s.scene.placements[pending.placement];
      const BvhGroupView &group = s.bvhs.groups[p.group];
      tree = &group.tree;
      triangles = group.triangles;
      if (tree->root == bvh_empty) {
        current = bvh_group_end;
        return;
      }
      *top++ = bvh_group_end;
      current = tree->root;
      world.origin = transform_point(p.world_to_object, world.origin);
      world.direction = transform_vector(p.world_to_object, world.direction);
    }
    nodes = tree->nodes;
    if (make_far_ray(world, *tree, ray, widening)) {
      end = limit + ray.end_offset;
    } else {
      pending.count = max_candidates + 1;
      stop();
    }
  }

  // As in BvhWalk.
  struct Waiting {};
  __device__ __forceinline__ static bool start(const TraceScene &s, const Ray &from, NearRay &r, NearBegin &n)
  {
    return start_far_ray(from, first_tree(s), r, n);
  }
  __device__ __forceinline__ static void keep(const TraceScene &, const Ray &, NearRay &, NearBegin &,
                                              Waiting &, unsigned)
  {}
  __device__ __forceinline__ static Vec3f center(const TraceScene &s) { return first_tree(s).frame.center; }
  __device__ __forceinline__ void take(const TraceScene &s, float tmin, NearBegin &n, const Waiting &,
                                       unsigned, Entry *stack)
  {
    clip_from(tmin, ray, n);
    widening = far_widening(first_tree(s), n.farthest);
    restart(s, stack);
  }
};

#endif

GPURT_KERNELS_END
}  // namespace gpurt::cuda
