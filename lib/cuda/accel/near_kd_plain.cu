// Rays of the kd-tree's fast kernels, a thread a ray: for rays that lie close together, and for small batches.
//
// Source: Aila and Laine 2009, while-while.
#include "cuda/accel/near_kd_lane.h"

namespace gpurt::cuda {
namespace {

template <TraceQuery Query>
__global__ void __launch_bounds__(block_size, 8)
    near_kd_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ NearBatch batch,
                   const __grid_constant__ TiledRows rows)
{
  constexpr bool is_any = Query == TraceQuery::Any;
  if (!is_for(batch, Coherence::Coherent)) return;
  __shared__ WarpAxes axes[block_size / kd_warp_size];
  const uint32_t i = rows.ray_of(uint32_t(thread_item()));
  if (i >= batch.num_rays) return;
  bool found = false;
  Pending pending;
  pending.count = max_candidates + 1;
  {
    const Ray ray = load_ray(batch.rays, i, batch.aligned_rays);
    NearRay r;
    NearKdRay q;
    if (make_near_kd_ray(ray, s.near_kd, r, q)) {
      const unsigned lane = threadIdx.x % kd_warp_size;
      WarpAxes &own = axes[threadIdx.x / kd_warp_size];
      set_axes(own, lane, q);
      const LaneAxes lane_axes{&own.axis[0][lane]};
      pending.count = 0;
      pending.triangle = invalid_id;
      pending.lower = ray.tmax;
      const uint32_t left_out = known_triangle(batch.left_out, i),
                     ended_at = is_any ? known_triangle(batch.ended_at, i) : invalid_id;
      float end = ray.tmax + r.end_offset, a = q.a, b = q.b;
      uint4 entries[kd_stack_size];
      NearKdStack stack{entries, 0};
      stack.clear();
      KdNode node = first_kd_node(s.near_kd, a, b);
      for (;;) {
        while (!is_leaf(node))
          node = load_kd_node(s.near_kd.nodes, near_kd_step(node, lane_axes, q.width, a, b, stack));
        if (node.tag == kd_end) break;
        found = test_kd_leaf(s.near_kd, node, [&](const LeafTriangle &x, uint32_t place) {
          if constexpr (is_any)
            return any_in_triangle(x, place, r, ray.tmin, ray.tmax, left_out, ended_at, pending);
          else closest_in_triangle(x, x.triangle, place, r, ray.tmin, left_out, end, pending);
          return false;
        });
        if (is_any && found) break;
        node = pop_kd_node(s.near_kd.nodes, stack, end, a, b);
      }
    }
  }
  if constexpr (is_any) finish_any(batch, i, found, pending);
  else finish_closest(s, batch, i, pending);
}

}  // namespace

void launch_near_kd_plain(const TraceScene &scene, TraceQuery query, const NearBatch &batch, uint32_t width,
                          cudaStream_t stream)
{
  const TiledRows rows(width, batch.num_rays);
  if (query == TraceQuery::Any)
    launch("any-hit kernel", near_kd_kernel<TraceQuery::Any>, rows.num_items(), stream, scene, batch, rows);
  else
    launch("closest-hit kernel", near_kd_kernel<TraceQuery::Closest>, rows.num_items(), stream, scene, batch,
           rows);
}

}  // namespace gpurt::cuda
