// Closest and any hits of packets: the 32 rays of a warp traverse together, and a leaf's triangles are loaded into shared
// memory once for all of them.
//
// Each ray keeps its own interval of every node on the common stack, and takes part in a node only where that interval is
// not empty. The packet visits the child first that more of its rays want first: a ray for which that is the wrong order
// finds its hits in another order, which costs it tests but changes no hit.
// Source: the talk's packet tracing; Wald, Slusallek, Benthin and Wagner 2001.
#include "cuda/accel/schedule/ray_work.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

namespace {

constexpr unsigned warps_per_block = block_size / warp_size;
// A triangle as three vectors, read by all lanes at once: a broadcast.
struct SharedTriangles {
  float4 part[3][warp_size];
};

struct LaneInterval {
  float a, b;
};

// A postponed node, which is the same for all lanes, with each lane's interval of it.
struct PacketEntry {
  uint32_t index;
  LaneInterval interval;
};

template <class Query>
__device__ __forceinline__ bool test_shared(RayWork<Query> &work, const SharedTriangles &shared,
                                            uint32_t count)
{
  for (uint32_t k = 0; k < count; ++k) {
    count_step();
    const float4 a = shared.part[0][k], b = shared.part[1][k], c = shared.part[2][k];
    const uint32_t triangle = __float_as_uint(a.w);
    if (triangle == work.known) continue;
    TriangleHit hit;
    if (intersect<EdgeRule::Inclusive>(work.triangle_ray, Vec3f{a.x, a.y, a.z}, Vec3f{b.x, b.y, b.z},
                                       Vec3f{c.x, c.y, c.z}, work.ray.tmin, work.visitor.limit, hit) &&
        work.visit(triangle, hit))
      return true;
  }
  return false;
}

// Traverses the world's tree with the rays of a warp, all of whose lanes call it. Returns the triangles that were shared.
template <class Query>
__device__ uint32_t trace_packet(const KdGroupView &world, RayWork<Query> &work, bool takes_part,
                                 SharedTriangles &shared)
{
  PacketEntry todo[kd_max_depth];
  int num_todo = 0;
  uint32_t num_shared = 0;
  uint32_t index = 0;
  constexpr LaneInterval empty = {1.0f, 0.0f};
  bool is_done = !takes_part;
  LaneInterval at = takes_part ? LaneInterval{work.kd.a, work.kd.b} : empty;
  if (!__any_sync(all_lanes, takes_part)) return 0;
  for (;;) {
    KdNode node = world.tree.nodes[index];
    while (!is_leaf(node)) {
      const bool is_active = at.a <= at.b;
      count_step(is_active);
      const KdAxis x = axis_of(work.kd, axis(node));
      const float s = (plane(node) - x.origin) * x.inverse;
      const float begin = s - x.widening, end = s + x.widening;
      // As kd_descend decides, NaNs and all.
      const bool near_alone = begin > at.b, far_alone = !near_alone && end < at.a;
      LaneInterval near = at, far = at;
      if (near_alone) far = empty;
      else if (far_alone) near = empty;
      else {
        near.b = min(at.b, end);
        far.a = max(at.a, begin);
      }
      const unsigned near_is_above = x.far_first;
      const unsigned wants_near = __ballot_sync(all_lanes, is_active && !far_alone);
      const unsigned wants_far = __ballot_sync(all_lanes, is_active && !near_alone);
      const unsigned above_near = __ballot_sync(all_lanes, is_active && near_is_above != 0);
      const unsigned active = wants_near | wants_far;
      // Lanes that want the child above and the one below the plane.
      const unsigned wants_above = (wants_near & above_near) | (wants_far & ~above_near);
      const unsigned wants_below = (wants_near & ~above_near) | (wants_far & above_near);
      const LaneInterval above = !is_active ? empty : (near_is_above != 0 ? near : far);
      const LaneInterval below = !is_active ? empty : (near_is_above != 0 ? far : near);
      bool go_above;
      if (wants_above == 0 || wants_below == 0) {
        go_above = wants_below == 0;
      } else {
        go_above = 2 * __popc(active & above_near) > __popc(active);
        todo[num_todo++] = {payload(node) + (go_above ? 0u : 1u), go_above ? below : above};
      }
      index = payload(node) + (go_above ? 1u : 0u);
      at = go_above ? above : below;
      node = world.tree.nodes[index];
    }
    const uint32_t count = payload(node);
    for (uint32_t first = 0; first < count; first += warp_size) {
      const uint32_t batch = min(count - first, warp_size);
      __syncwarp();
      if (lane_index() < batch) {
        const float4 *from =
            reinterpret_cast<const float4 *>(world.triangles + node.word + first + lane_index());
        for (int k = 0; k < 3; ++k) shared.part[k][lane_index()] = __ldg(from + k);
      }
      __syncwarp();
      num_shared += batch;
      if (!is_done && at.a <= at.b) is_done = test_shared(work, shared, batch);
    }
    // Resume where a ray that is not done has something left.
    for (;;) {
      if (num_todo == 0 || __all_sync(all_lanes, is_done)) return num_shared;
      --num_todo;
      index = todo[num_todo].index;
      at = todo[num_todo].interval;
      if (is_done) at = empty;
      else if (at.a <= at.b) {
        const float end = work.visitor.limit + work.kd.t_widening;
        if (at.a > end) at = empty;
        else at.b = min(at.b, end);
      }
      if (__any_sync(all_lanes, at.a <= at.b)) break;
    }
  }
}

template <class Query, bool IsPersistent>
__global__ void __launch_bounds__(block_size)
    packet_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ RayBatch batch,
                  Alignment aligned, RayPool pool, DeviceCounters *counters)
{
  __shared__ SharedTriangles shared[warps_per_block];
  const unsigned warp = threadIdx.x / warp_size;
  uint32_t num_packets = 0, num_refills = 0;
  unsigned long long num_shared = 0;
  uint64_t first = IsPersistent ? 0 : thread_item() - lane_index();
  for (;;) {
    if (IsPersistent) first = draw(pool, warp_size);
    if (first >= batch.num_rays) break;
    ++num_refills;
    const uint64_t i = first + lane_index();
    RayWork<Query> work;
    work.kd = {};  // lanes without a ray take part in votes alone
    const bool takes_part = i < batch.num_rays && work.begin(s, batch.rays, i, aligned.rays);
    if (s.kd_trees.groups[0].tree.num_nodes != 0) {
      num_shared += trace_packet(s.kd_trees.groups[0], work, takes_part, shared[warp]);
      ++num_packets;
    }
    if (i < batch.num_rays) work.finish(s, batch, i, aligned.hits);
    __syncwarp();
    if (!IsPersistent) break;
  }
  if (lane_index() == 0) {
    add_count(&counters->packets, num_packets);
    if (num_shared != 0) atomicAdd(&counters->shared_triangles, num_shared);
    if (IsPersistent) add_count(&counters->ray_refills, num_refills);
  }
}

}  // namespace

void launch_packets(const TraceScene &scene, const RayBatch &batch, RayPool pool, DeviceCounters *counters,
                    cudaStream_t stream)
{
  dispatch_query(scene, batch, [&]<class Query>(Query) {
    if (pool.num_drawn != nullptr)
      launch_persistent("kernel of packets, persistent threads", packet_kernel<Query, true>, batch.num_rays,
                        stream, scene, batch, alignment_of(batch), pool, counters);
    else
      launch("kernel of packets", packet_kernel<Query, false>, batch.num_rays, stream, scene, batch,
             alignment_of(batch), pool, counters);
  });
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
