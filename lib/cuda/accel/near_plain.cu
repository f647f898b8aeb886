// Rays of the bvh's fast kernels, a thread a ray: for rays that lie close together, and for small batches.
//
// Source: Aila and Laine 2009, while-while.
#include "cuda/accel/near_lane.h"

namespace gpurt::cuda {
namespace {

__global__ void __launch_bounds__(block_size, 9)
    near_closest_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ NearBatch batch,
                        const __grid_constant__ TiledRows rows)
{
  if (!is_for(batch, Coherence::Coherent)) return;
  const uint32_t i = rows.ray_of(uint32_t(thread_item()));
  if (i >= batch.num_rays) return;
  Pending pending;
  pending.count = max_candidates + 1;
  {
    const Ray ray = load_ray(batch.rays, i, batch.aligned_rays);
    NearRay r;
    if (make_near_ray(ray, s.world.tree, r)) {
      pending.count = 0;
      pending.triangle = invalid_id;
      pending.lower = ray.tmax;
      const uint32_t left_out = known_triangle(batch.left_out, i);
      float end = ray.tmax + r.end_offset;
      uint32_t stack[bvh_max_depth + 1];
      stack[0] = bvh_empty;
      uint32_t *top = stack + 1;
      uint32_t current = s.world.tree.root;
      for (;;) {
        while (!is_bvh_leaf(current)) step<true>(s.world.tree.nodes, r, end, current, top);
        if (current == bvh_empty) break;
        closest_in_leaf(s.world.triangles, r, ray.tmin, current, left_out, end, pending);
        current = pop(top);
      }
    }
  }
  finish_closest(s, batch, i, pending);
}

__global__ void __launch_bounds__(block_size, 8)
    near_any_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ NearBatch batch,
                    const __grid_constant__ TiledRows rows)
{
  if (!is_for(batch, Coherence::Coherent)) return;
  const uint32_t i = rows.ray_of(uint32_t(thread_item()));
  if (i >= batch.num_rays) return;
  const Ray ray = load_ray(batch.rays, i, batch.aligned_rays);
  bool found = false;
  Pending pending;
  pending.count = max_candidates + 1;
  NearRay r;
  if (make_near_ray(ray, s.world.tree, r)) {
    pending.count = 0;
    const uint32_t left_out = known_triangle(batch.left_out, i), ended_at = known_triangle(batch.ended_at, i);
    const float end = ray.tmax + r.end_offset;
    uint32_t stack[bvh_max_depth + 1];
    stack[0] = bvh_empty;
    uint32_t *top = stack + 1;
    uint32_t current = s.world.tree.root;
    for (;;) {
      while (!is_bvh_leaf(current)) step<false>(s.world.tree.nodes, r, end, current, top);
      if (current == bvh_empty) break;
      found = any_in_leaf(s.world.triangles, r, ray.tmin, ray.tmax, current, left_out, ended_at, pending);
      if (found) break;
      current = pop(top);
    }
  }
  finish_any(batch, i, found, pending);
}

}  // namespace

void launch_near_plain(const TraceScene &scene, TraceQuery query, const NearBatch &batch, uint32_t width,
                       cudaStream_t stream)
{
  const TiledRows rows(width, batch.num_rays);
  if (query == TraceQuery::Any)
    launch("any-hit kernel", near_any_kernel, rows.num_items(), stream, scene, batch, rows);
  else launch("closest-hit kernel", near_closest_kernel, rows.num_items(), stream, scene, batch, rows);
}

}  // namespace gpurt::cuda
