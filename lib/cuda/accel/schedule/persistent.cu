// Closest and any hits by persistent threads: as many as the device holds, which draw rays from a pool. A warp draws new
// rays for its idle lanes once there are enough of them, so that a long ray keeps few lanes waiting.
//
// Source: Aila and Laine 2009, persistent threads; the talk's pool of rays.
// Differs: lanes are refilled between leaves, not only when the whole warp has run dry.
#include "cuda/accel/schedule/ray_work.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

namespace {

// Idle lanes for which a warp draws rays: fewer cost more draws than the lanes' waiting does.
constexpr unsigned refill_lanes = 8;

template <class Query>
__global__ void __launch_bounds__(block_size)
    persistent_stack_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ RayBatch batch,
                            Alignment aligned, RayPool pool, DeviceCounters *counters)
{
  const KdGroupView &world = s.kd_trees.groups[0];
  RayWork<Query> work;
  KdCursor at;
  uint64_t index = 0;
  bool has_ray = false, pool_is_empty = false;
  uint32_t num_refills = 0;
  for (;;) {
    const unsigned idle = __ballot_sync(all_lanes, !has_ray);
    if (!pool_is_empty && __popc(idle) >= int(refill_lanes)) {
      const uint64_t first = draw(pool, __popc(idle));
      if (first < batch.num_rays) ++num_refills;
      pool_is_empty = first + __popc(idle) >= batch.num_rays;
      if (!has_ray) {
        index = first + __popc(idle & lanes_below());
        if (index < batch.num_rays) {
          has_ray = work.begin(s, batch.rays, index, aligned.rays);
          if (has_ray) kd_begin(work.kd, at);
          else work.finish(s, batch, index, aligned.hits);
        }
      }
    } else if (idle == all_lanes) {
      break;
    }
    if (has_ray) {
      const KdNode leaf = kd_descend(world.tree, work.kd, at);
      const bool is_decided = payload(leaf) != 0 && work.test_leaf(world.triangles, leaf.word, payload(leaf));
      if (is_decided || !kd_resume(work.kd, work.visitor.limit, at)) {
        work.finish(s, batch, index, aligned.hits);
        has_ray = false;
      }
    }
  }
  if (lane_index() == 0) add_count(&counters->ray_refills, num_refills);
}

}  // namespace

void launch_persistent_stack(const TraceScene &scene, const RayBatch &batch, RayPool pool,
                             DeviceCounters *counters, cudaStream_t stream)
{
  dispatch_query(scene, batch, [&]<class Query>(Query) {
    launch_persistent(persistent_kernel_name, persistent_stack_kernel<Query>, batch.num_rays, stream, scene,
                      batch, alignment_of(batch), pool, counters);
  });
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
