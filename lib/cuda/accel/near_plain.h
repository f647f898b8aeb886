// Rays of the fast kernels, a thread a ray: for rays that lie close together, and for small batches.
//
// Source: Aila and Laine 2009, while-while.
#pragma once

#include "cuda/accel/near_exact.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

#if defined(__CUDACC__)

template <class Walk, TraceQuery Query>
__global__ void __launch_bounds__(block_size, Walk::plain_blocks)
    near_plain_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ NearBatch batch,
                      const __grid_constant__ TiledRows rows)
{
  constexpr bool is_any = Query == TraceQuery::Any;
  using Kind = typename Walk::Kind;
  if (!is_for(batch, Coherence::Coherent)) return;
  __shared__ typename Walk::Shared shared[block_size / warp_size];
  const uint32_t i = rows.ray_of(uint32_t(thread_item()));
  if (i >= batch.num_rays) return;
  bool found = false;
  uint32_t references[pending_words<Kind>];
  PendingOf<Kind> pending;
  pending.references = references;
  pending.count = max_candidates + 1;
  {
    const Ray ray = load_ray(batch.rays, i, true);
    typename Walk::Entry stack[Walk::stack_size];
    Walk walk(stack, &shared[threadIdx.x / warp_size], threadIdx.x % warp_size);
    if (walk.begin(s, ray, stack)) {
      clear(pending, ray.tmax);
      const uint32_t left_out = known_triangle(batch.left_out, i),
                     ended_at = is_any ? known_triangle(batch.ended_at, i) : invalid_id;
      float end = ray.tmax + walk.ray.end_offset;
      for (;;) {
        while (!walk.is_at_leaf()) walk.template step<!is_any>(s, end);
        if (walk.has_ended()) break;
        if constexpr (Kind::placements) {
          if (walk.is_between_trees()) {
            walk.change_tree(s, load_ray(batch.rays, i, true), is_any ? ray.tmax : pending.upper, end,
                             pending);
            continue;
          }
        }
        found = walk.test_leaf(s, [&](const LeafTriangle &x, uint32_t triangle, uint32_t reference) {
          if constexpr (is_any) {
            return any_in<Kind>(s, batch, i, x, reference, walk.ray, ray.tmin, ray.tmax, left_out, ended_at,
                                pending);
          } else {
            closest_in<Kind>(s, batch, i, x, triangle, reference, walk.ray, ray.tmin, left_out, end, pending);
            return false;
          }
        });
        if (is_any && found) break;
        walk.pop(end);
      }
    }
  }
  if constexpr (is_any) finish_any<Kind>(batch, i, found, pending);
  else finish_closest<Kind>(s, batch, i, pending);
}

template <class Walk>
void launch_plain(const TraceScene &scene, TraceQuery query, const NearBatch &batch, uint32_t width,
                  cudaStream_t stream)
{
  const TiledRows rows(width, batch.num_rays);
  constexpr size_t shared_bytes = block_size / warp_size * sizeof(typename Walk::Shared);
  if constexpr (!counts_lanes) {
    if (query == TraceQuery::Any) {
      launch_for_l1("any-hit kernel", near_plain_kernel<Walk, TraceQuery::Any>, rows.num_items(),
                    Walk::plain_blocks, shared_bytes, stream, scene, batch, rows);
      return;
    }
  }
  launch_for_l1("closest-hit kernel", near_plain_kernel<Walk, TraceQuery::Closest>, rows.num_items(),
                Walk::plain_blocks, shared_bytes, stream, scene, batch, rows);
}

#endif

GPURT_KERNELS_END
}  // namespace gpurt::cuda
