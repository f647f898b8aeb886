// Closest and any hits by two kernels in turn: one goes down the tree and selects the next leaves of each ray, the other
// tests their triangles. Where a list is full, the stack waits in memory for the next round.
//
// Source: the talk's tree traversal and primitive intersection kernels; Horn, Sugerman, Houston and Hanrahan 2007 for
// traversal that resumes. Differs: what is left of a ray is its stack, so that nothing is walked twice.
#include "cuda/accel/schedule/ray_work.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

namespace {

// A ray's stack as a column of an array in memory, so that a warp's entries of the same depth lie side by side.
struct ColumnStack {
  KdEntry *first;
  uint32_t stride;
  GPURT_INLINE KdEntry &operator[](int i) const { return first[uint64_t(i) * stride]; }
};

struct ColumnCursor {
  uint32_t index;
  int num_todo;
  float a, b;
  ColumnStack todo;
};

// Calls work(i) for every item below n: this thread's, or those that its warp draws from the pool.
template <bool IsPersistent, class Work>
__device__ __forceinline__ void for_each_item(uint32_t n, RayPool pool, DeviceCounters *counters, Work &&work)
{
  if constexpr (IsPersistent) {
    uint32_t num_refills = 0;
    for (uint64_t first; (first = draw(pool, warp_size)) < n; ++num_refills) {
      work(first + lane_index(), first + lane_index() < n);
      __syncwarp();
    }
    if (lane_index() == 0) add_count(&counters->ray_refills, num_refills);
  } else {
    work(thread_item(), thread_item() < n);
  }
}

template <bool IsPersistent>
__global__ void __launch_bounds__(block_size)
    select_leaves_kernel(const __grid_constant__ TraceScene s, const Ray *rays, bool aligned,
                         const __grid_constant__ LeafListState state, uint32_t num_active, bool is_first,
                         RayPool pool, DeviceCounters *counters)
{
  const KdTreeView &tree = s.kd_trees.groups[0].tree;
  uint32_t num_overflows = 0;
  for_each_item<IsPersistent>(num_active, pool, counters, [&](uint64_t item, bool is_there) {
    if (!is_there) return;
    const uint32_t id = is_first ? uint32_t(item) : state.active[0][item];
    const Ray given = load_ray(rays, id, aligned);
    TraceRay ray;
    const bool is_valid = prepare_ray(given.origin, given.direction, given.tmin, given.tmax, ray);
    if (is_first) state.hits[id] = {is_valid ? ray.tmax : given.tmax, 0.0f, 0.0f, invalid_id, invalid_id};
    uint32_t num_leaves = 0;
    ColumnCursor at{0, 0, 0, 0, {state.stacks + id, state.capacity}};
    if (is_valid && tree.num_nodes != 0) {
      const float limit = state.hits[id].t;
      const KdRay r = make_kd_ray(ray, tree.bounds, limit);
      bool goes_on;
      if (is_first) {
        goes_on = r.a <= r.b;
        kd_begin(r, at);
      } else {
        at.num_todo = int(state.num_todo[id]);
        goes_on = kd_resume(r, limit, at);
      }
      while (goes_on) {
        const KdNode leaf = kd_descend(tree, r, at);
        if (payload(leaf) != 0) {
          state.leaves[uint64_t(num_leaves) * state.capacity + id] = {leaf.word, payload(leaf), at.a};
          if (++num_leaves == leaf_list_size) break;
        }
        goes_on = kd_resume(r, limit, at);
      }
      if (num_leaves == leaf_list_size && at.num_todo != 0) ++num_overflows;
    }
    state.num_todo[id] = uint32_t(at.num_todo);
    state.num_leaves[id] = num_leaves;
  });
  __syncwarp();
  num_overflows = warp_sum(num_overflows);
  if (lane_index() == 0) add_count(&counters->list_overflows, num_overflows);
}

template <class Query, bool IsPersistent>
__global__ void __launch_bounds__(block_size)
    intersect_leaves_kernel(const __grid_constant__ TraceScene s, const Ray *rays, bool aligned,
                            const __grid_constant__ LeafListState state, uint32_t num_active, bool is_first,
                            RayPool pool, DeviceCounters *counters)
{
  const KdGroupView &world = s.kd_trees.groups[0];
  for_each_item<IsPersistent>(num_active, pool, counters, [&](uint64_t item, bool is_there) {
    bool goes_on = false;
    uint32_t id = 0;
    if (is_there) {
      id = is_first ? uint32_t(item) : state.active[0][item];
      const uint32_t num_leaves = state.num_leaves[id];
      goes_on = state.num_todo[id] != 0;
      if (num_leaves != 0) {
        RayWork<Query> work;
        work.begin(s, rays, id, aligned);
        Query::restore(state.hits[id], work.visitor);
        bool is_decided = false;
        for (uint32_t k = 0; k < num_leaves && !is_decided; ++k) {
          const ListedLeaf leaf = state.leaves[uint64_t(k) * state.capacity + id];
          // Leaves that were selected before a hit in an earlier one was known. Later ones may begin nearer, where
          // planes are almost parallel to the ray.
          if (!work.is_within_limit(leaf.begin)) continue;
          is_decided = work.test_leaf(world.triangles, leaf.first, leaf.count);
        }
        Query::save(work.visitor, state.hits[id]);
        goes_on = goes_on && !is_decided;
      }
    }
    // A place in the next round for every ray that goes on: one atomic operation a warp.
    const unsigned votes = __ballot_sync(all_lanes, goes_on);
    unsigned long long first = 0;
    if (lane_index() == 0 && votes != 0)
      first = atomicAdd(state.num_active, static_cast<unsigned long long>(__popc(votes)));
    first = __shfl_sync(all_lanes, first, 0);
    if (goes_on) state.active[1][first + __popc(votes & lanes_below())] = id;
  });
}

template <class Query>
__global__ void __launch_bounds__(block_size)
    finish_lists_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ RayBatch batch,
                        Alignment aligned, const __grid_constant__ LeafListState state)
{
  const uint64_t i = thread_item();
  if (i >= batch.num_rays) return;
  RayWork<Query> work;
  work.begin(s, batch.rays, i, aligned.rays);
  Query::restore(state.hits[i], work.visitor);
  work.finish(s, batch, i, aligned.hits);
}

}  // namespace

void launch_select_leaves(const TraceScene &scene, const RayBatch &batch, const LeafListState &state,
                          uint32_t num_active, bool is_first, RayPool pool, DeviceCounters *counters,
                          cudaStream_t stream)
{
  const bool aligned = is_aligned_16(batch.rays);
  if (pool.num_drawn != nullptr)
    launch_persistent("kernel that selects leaves, persistent threads", select_leaves_kernel<true>,
                      num_active, stream, scene, batch.rays, aligned, state, num_active, is_first, pool,
                      counters);
  else
    launch("kernel that selects leaves", select_leaves_kernel<false>, num_active, stream, scene, batch.rays,
           aligned, state, num_active, is_first, pool, counters);
}

void launch_intersect_leaves(const TraceScene &scene, const RayBatch &batch, const LeafListState &state,
                             uint32_t num_active, bool is_first, RayPool pool, DeviceCounters *counters,
                             cudaStream_t stream)
{
  const bool aligned = is_aligned_16(batch.rays);
  dispatch_query(scene, batch, [&]<class Query>(Query) {
    if (pool.num_drawn != nullptr)
      launch_persistent("kernel that tests listed leaves, persistent threads",
                        intersect_leaves_kernel<Query, true>, num_active, stream, scene, batch.rays, aligned,
                        state, num_active, is_first, pool, counters);
    else
      launch("kernel that tests listed leaves", intersect_leaves_kernel<Query, false>, num_active, stream,
             scene, batch.rays, aligned, state, num_active, is_first, pool, counters);
  });
}

void launch_finish_lists(const TraceScene &scene, const RayBatch &batch, const LeafListState &state,
                         cudaStream_t stream)
{
  dispatch_query(scene, batch, [&]<class Query>(Query) {
    launch("kernel that finishes listed rays", finish_lists_kernel<Query>, batch.num_rays, stream, scene,
           batch, alignment_of(batch), state);
  });
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
