// Rays of the fast kernels by persistent warps, which give threads whose ray has ended a new one: for large batches of rays
// that lie apart, which would else leave most threads of a warp waiting for the longest ray.
//
// Source: Aila and Laine 2009, persistent threads and replacement of terminated rays.
#pragma once

#include <algorithm>

#include "cuda/accel/near_exact.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

#if defined(__CUDACC__)

// A warp refills from so many idle lanes on. Of 6 to 24 this measured best, by little.
constexpr int refill_at = 8;

// Rays that wait for a warp's lanes: made so by all lanes at once, taken by few at a time. In as little shared memory as lets
// nine blocks of a bvh's have 64 KB of an H100's 256: the rest is L1, for which the warps wait.
template <class Walk>
struct WaitingRays {
  float origin[3][warp_size], inverse[3][warp_size];
  float sx[warp_size], sy[warp_size], sz[warp_size];
  float farthest[warp_size];  // with_axis(); no_ray
  float tmin[warp_size], tmax[warp_size];
  [[no_unique_address]] typename Walk::Waiting walk;
  uint32_t num_refills;
};
constexpr float no_ray = -1.0f;

template <class Walk, TraceQuery Query>
__device__ __forceinline__ void make_ready(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                           unsigned lane, WaitingRays<Walk> &rays)
{
  rays.farthest[lane] = no_ray;
  if (i >= batch.num_rays) return;
  const Ray ray = load_ray(batch.rays, i, true);
  NearRay r;
  NearBegin n;
  if (!Walk::start(s, ray, r, n)) {
    Pending general;
    general.count = max_candidates + 1;
    general.references = nullptr;
    if constexpr (Query == TraceQuery::Any) finish_any<typename Walk::Kind>(batch, i, false, general);
    else
      batch.candidates[i] =
          leave_over<typename Walk::Kind>(batch, i, general.count, nullptr) ? left_over : unlisted_left_over;
    return;
  }
  n.farthest = with_axis(n.farthest, r.main_axis);
  Walk::keep(s, ray, r, n, rays.walk, lane);
  for (int k = 0; k < 3; ++k) {
    rays.origin[k][lane] = at(r.origin, k);
    rays.inverse[k][lane] = at(r.inverse, k);
  }
  rays.sx[lane] = r.sx;
  rays.sy[lane] = r.sy;
  rays.sz[lane] = r.sz;
  rays.farthest[lane] = n.farthest;
  rays.tmin[lane] = ray.tmin;
  rays.tmax[lane] = ray.tmax;
}

template <class Walk, TraceQuery Query>
__global__ void __launch_bounds__(block_size, Walk::refill_blocks)
    near_refill_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ NearBatch batch)
{
  if (!is_for(batch, Coherence::Incoherent)) return;
  constexpr bool is_any = Query == TraceQuery::Any;
  using Kind = typename Walk::Kind;
  __shared__ typename Walk::Shared shared[block_size / warp_size];
  __shared__ WaitingRays<Walk> warps[block_size / warp_size];
  const unsigned lane = threadIdx.x % warp_size;
  WaitingRays<Walk> &warp = warps[threadIdx.x / warp_size];
  uint32_t first = 0;  // of the rays that are ready
  unsigned num_taken = warp_size;
  bool is_pool_empty = false;
  uint32_t i = invalid_id;
  uint32_t references[pending_words<Kind>];
  PendingOf<Kind> pending;
  pending.references = references;
  bool found = false;
  float end = 0, tmin = 0, tmax = 0;
  uint32_t left_out = invalid_id, ended_at = invalid_id;
  typename Walk::Entry stack[Walk::stack_size];
  Walk walk(stack, &shared[threadIdx.x / warp_size], lane);
  if (lane == 0) warp.num_refills = 0;
  for (;;) {
    const unsigned idle = __ballot_sync(~0u, walk.has_ended());
    if (idle == ~0u || (!is_pool_empty && __popc(idle) >= refill_at)) {
      if (walk.has_ended() && i != invalid_id) {
        if constexpr (is_any) finish_any<Kind>(batch, i, found, pending);
        else hand_over<Kind>(batch, i, pending);
        i = invalid_id;
      }
      if (is_pool_empty) break;  // then all are idle
      if (num_taken == warp_size) {
        if (lane == 0) first = atomicAdd(batch.next_ray, uint32_t(warp_size));
        first = __shfl_sync(~0u, first, 0);
        num_taken = 0;
        is_pool_empty = first >= batch.num_rays;
        make_ready<Walk, Query>(s, batch, first + lane, lane, warp);
        __syncwarp();
      }
      if (lane == 0 && !is_pool_empty) ++warp.num_refills;
      const unsigned slot = num_taken + __popc(idle & ((1u << lane) - 1u));
      num_taken = min(num_taken + __popc(idle), warp_size);
      if (walk.has_ended() && slot < warp_size && warp.farthest[slot] >= 0.0f) {
        NearRay &r = walk.ray;
        NearBegin n;
        n.farthest = warp.farthest[slot];
        r.main_axis = axis_in(n.farthest);
        r.origin = {warp.origin[0][slot], warp.origin[1][slot], warp.origin[2][slot]};
        n.offset = r.origin - Walk::center(s);
        r.inverse = {warp.inverse[0][slot], warp.inverse[1][slot], warp.inverse[2][slot]};
        r.sx = warp.sx[slot];
        r.sy = warp.sy[slot];
        r.sz = warp.sz[slot];
        tmin = warp.tmin[slot];
        tmax = warp.tmax[slot];
        walk.take(s, tmin, n, warp.walk, slot, stack);
        i = first + slot;
        found = false;
        left_out = known_triangle(batch.left_out, i);
        if constexpr (is_any) ended_at = known_triangle(batch.ended_at, i);
        clear(pending, tmax);
        end = tmax + r.end_offset;
      }
      __syncwarp();
    }
    do {
#pragma unroll
      for (int k = 0; k < Walk::steps; ++k) {
        if (!walk.is_at_leaf()) walk.template step<!is_any>(s, end);
      }
    } while (__popc(__ballot_sync(~0u, !walk.is_at_leaf())) >= Walk::stepping_until);
    if constexpr (Kind::placements) {
      if (walk.is_at_leaf() && !walk.has_ended() && walk.is_between_trees())
        walk.change_tree(s, load_ray(batch.rays, i, true), is_any ? tmax : pending.upper, end, pending);
    }
    if (walk.is_at_leaf() && !walk.has_ended() && !walk.is_between_trees()) {
      found = walk.test_leaf(s, [&](const LeafTriangle &x, uint32_t triangle, uint32_t reference) {
        if constexpr (is_any) {
          return any_in<Kind>(s, batch, i, x, reference, walk.ray, tmin, tmax, left_out, ended_at, pending);
        } else {
          closest_in<Kind>(s, batch, i, x, triangle, reference, walk.ray, tmin, left_out, end, pending);
          return false;
        }
      });
      if (is_any && found) walk.stop();
      else walk.pop(end);
    }
  }
  if (batch.num_refills != nullptr && lane == 0)
    atomicAdd(batch.num_refills, static_cast<unsigned long long>(warp.num_refills));
}

template <class Walk>
void launch_refill(const TraceScene &scene, TraceQuery query, const NearBatch &batch, cudaStream_t stream)
{
  const uint64_t num_threads =
      std::min<uint64_t>(uint64_t(scene.num_sms) * Walk::refill_blocks * block_size, batch.num_rays);
  constexpr size_t shared_bytes =
      block_size / warp_size * (sizeof(WaitingRays<Walk>) + sizeof(typename Walk::Shared));
  const bool is_any = query == TraceQuery::Any, is_asked_for = batch.num_refills != nullptr;
  const char *name = is_asked_for ? persistent_kernel_name : is_any ? "any-hit kernel" : "closest-hit kernel";
  if constexpr (!counts_lanes) {
    if (is_any) {
      launch_for_l1(name, near_refill_kernel<Walk, TraceQuery::Any>, num_threads, Walk::refill_blocks,
                    shared_bytes, stream, scene, batch);
      return;
    }
  }
  launch_for_l1(name, near_refill_kernel<Walk, TraceQuery::Closest>, num_threads, Walk::refill_blocks,
                shared_bytes, stream, scene, batch);
}

#endif

GPURT_KERNELS_END
}  // namespace gpurt::cuda
