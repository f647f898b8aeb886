// Closest and any hits by an uber-kernel: every lane has a ray with a short list of leaves, and a warp turns by vote between
// selecting leaves and testing their triangles, so that neither work waits for the slowest ray of the other.
//
// Source: the talk's uber-kernel, "leaf list empty: select K leaves, else intersect". Differs: a warp decides, by the
// majority of its lanes that could go on either way, and lanes whose list is not full yet keep it.
#include "cuda/accel/schedule/ray_work.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

namespace {

template <class Query, bool IsPersistent>
__global__ void __launch_bounds__(block_size)
    uber_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ RayBatch batch,
                Alignment aligned, RayPool pool, DeviceCounters *counters)
{
  // Lists lie lane by lane, so that a warp reads them without bank conflicts.
  __shared__ uint32_t list_first[leaf_list_size][block_size], list_count[leaf_list_size][block_size];
  __shared__ float list_begin[leaf_list_size][block_size];
  const KdGroupView &world = s.kd_trees.groups[0];
  const unsigned me = threadIdx.x;
  RayWork<Query> work;
  KdCursor at;
  uint64_t index = 0;
  uint32_t head = 0, num_leaves = 0;  // of the list, a ring
  bool has_ray = false, has_nodes = false, pool_is_empty = false;
  bool is_testing = false;  // the mode, the same for the whole warp
  uint32_t num_refills = 0, num_switches = 0, num_overflows = 0;
  for (;;) {
    const unsigned idle = __ballot_sync(all_lanes, !has_ray);
    if (!pool_is_empty && (idle == all_lanes || (IsPersistent && __popc(idle) >= 8))) {
      const unsigned count = __popc(idle);
      const uint64_t first = IsPersistent ? draw(pool, count) : thread_item() - lane_index();
      if (first < batch.num_rays) ++num_refills;
      pool_is_empty = !IsPersistent || first + count >= batch.num_rays;
      if (!has_ray) {
        index = first + __popc(idle & lanes_below());
        if (index < batch.num_rays) {
          has_ray = has_nodes = work.begin(s, batch.rays, index, aligned.rays);
          head = num_leaves = 0;
          if (has_ray) kd_begin(work.kd, at);
          else work.finish(s, batch, index, aligned.hits);
        }
      }
    } else if (idle == all_lanes) {
      break;
    }
    // Who could go on with what.
    const bool can_select = has_ray && has_nodes && num_leaves < leaf_list_size;
    const bool can_test = has_ray && num_leaves != 0;
    const int num_selecting = __popc(__ballot_sync(all_lanes, can_select));
    const int num_testing = __popc(__ballot_sync(all_lanes, can_test));
    // A warp stays with its work until fewer lanes can go on than with the other, which costs the fewest switches.
    const bool wants_test = is_testing ? num_testing != 0 && 2 * num_testing >= num_selecting
                                       : num_selecting == 0 || num_testing > 2 * num_selecting;
    if (wants_test != is_testing) ++num_switches;
    is_testing = wants_test;
    if (is_testing) {
      if (can_test) {
        const uint32_t k = head;
        head = (head + 1) % leaf_list_size;
        --num_leaves;
        if (work.is_within_limit(list_begin[k][me]) &&
            work.test_leaf(world.triangles, list_first[k][me], list_count[k][me])) {
          has_nodes = false;  // decided
          num_leaves = 0;
        }
      }
    } else if (can_select) {
      const KdNode leaf = kd_descend(world.tree, work.kd, at);
      if (payload(leaf) != 0) {
        const uint32_t k = (head + num_leaves) % leaf_list_size;
        list_first[k][me] = leaf.word;
        list_count[k][me] = payload(leaf);
        list_begin[k][me] = at.a;
        ++num_leaves;
      }
      has_nodes = kd_resume(work.kd, work.visitor.limit, at);
      if (has_nodes && num_leaves == leaf_list_size) ++num_overflows;
    }
    if (has_ray && !has_nodes && num_leaves == 0) {
      work.finish(s, batch, index, aligned.hits);
      has_ray = false;
    }
  }
  if (lane_index() == 0) {
    add_count(&counters->mode_switches, num_switches);
    if (IsPersistent) add_count(&counters->ray_refills, num_refills);
  }
  const uint32_t warp_overflows = warp_sum(num_overflows);
  if (lane_index() == 0) add_count(&counters->list_overflows, warp_overflows);
}

}  // namespace

void launch_uber(const TraceScene &scene, const RayBatch &batch, RayPool pool, DeviceCounters *counters,
                 cudaStream_t stream)
{
  dispatch_query(scene, batch, [&]<class Query>(Query) {
    if (pool.num_drawn != nullptr)
      launch_persistent("uber-kernel of a query, persistent threads", uber_kernel<Query, true>,
                        batch.num_rays, stream, scene, batch, alignment_of(batch), pool, counters);
    else
      launch("uber-kernel of a query", uber_kernel<Query, false>, batch.num_rays, stream, scene, batch,
             alignment_of(batch), pool, counters);
  });
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
