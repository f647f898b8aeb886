// Rays of the bvh's fast kernels by persistent warps, which give threads whose ray has ended a new one: for large batches
// of rays that lie apart, which would else leave most threads of a warp waiting for the longest ray.
//
// Source: Aila and Laine 2009, persistent threads and replacement of terminated rays.
#include "cuda/accel/near_lane.h"

namespace gpurt::cuda {
namespace {

constexpr unsigned warp_size = 32;
constexpr int blocks_per_sm = 8;
// A warp refills from so many idle lanes on, and steps over nodes while so many have one. Of 6 to 24 and 8 to 20 these
// measured best, by little.
constexpr int refill_at = 8, stepping_until = 12;

// Rays that are ready for a warp's lanes: made so by all lanes at once, drawn by few at a time.
struct WarpRays {
  float inverse[3][warp_size], shift[3][warp_size], origin[3][warp_size];
  float sx[warp_size], sy[warp_size], sz[warp_size], end_offset[warp_size], tmin[warp_size], tmax[warp_size];
  uint32_t main_axis[warp_size];  // 3: no ray
  uint32_t left_out[warp_size], ended_at[warp_size];
};
constexpr uint32_t no_axis = 3;

template <TraceQuery Query>
__device__ __forceinline__ void make_ready(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                           unsigned lane, WarpRays &warp)
{
  warp.main_axis[lane] = no_axis;
  if (i >= batch.num_rays) return;
  const Ray ray = load_ray(batch.rays, i, batch.aligned_rays);
  NearRay r;
  if (!make_near_ray(ray, s.world.tree, r)) {
    if (Query == TraceQuery::Closest) batch.candidates[i] = listed_candidate;
    list_ray(batch, i);
    return;
  }
  for (int k = 0; k < 3; ++k) {
    warp.inverse[k][lane] = at(r.inverse, k);
    warp.shift[k][lane] = at(r.shift, k);
    warp.origin[k][lane] = at(r.origin, k);
  }
  warp.sx[lane] = r.sx;
  warp.sy[lane] = r.sy;
  warp.sz[lane] = r.sz;
  warp.end_offset[lane] = r.end_offset;
  warp.tmin[lane] = ray.tmin;
  warp.tmax[lane] = ray.tmax;
  warp.main_axis[lane] = uint32_t(r.main_axis);
  warp.left_out[lane] = known_triangle(batch.left_out, i);
  warp.ended_at[lane] = known_triangle(batch.ended_at, i);
}

__device__ __forceinline__ NearRay ready_ray(const WarpRays &warp, unsigned slot)
{
  NearRay r;
  r.inverse = {warp.inverse[0][slot], warp.inverse[1][slot], warp.inverse[2][slot]};
  r.size = {fabsf(r.inverse.x), fabsf(r.inverse.y), fabsf(r.inverse.z)};
  r.shift = {warp.shift[0][slot], warp.shift[1][slot], warp.shift[2][slot]};
  r.origin = {warp.origin[0][slot], warp.origin[1][slot], warp.origin[2][slot]};
  r.sx = warp.sx[slot];
  r.sy = warp.sy[slot];
  r.sz = warp.sz[slot];
  r.end_offset = warp.end_offset[slot];
  r.main_axis = int(warp.main_axis[slot]);
  return r;
}

template <TraceQuery Query>
__global__ void __launch_bounds__(block_size, blocks_per_sm)
    refill_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ NearBatch batch)
{
  if (!is_for(batch, Coherence::Incoherent)) return;
  constexpr bool is_any = Query == TraceQuery::Any;
  __shared__ WarpRays warps[block_size / warp_size];
  const unsigned lane = threadIdx.x % warp_size;
  WarpRays &warp = warps[threadIdx.x / warp_size];
  uint32_t first = 0;           // of the rays that are ready
  uint32_t taken = invalid_id;  // first of the last rays that the warp took
  unsigned num_taken = warp_size;
  bool is_pool_empty = false;
  uint32_t i = invalid_id;
  NearRay r = {};
  Pending pending;
  bool found = false;
  float end = 0, tmin = 0, tmax = 0;
  uint32_t left_out = invalid_id, ended_at = invalid_id;
  uint32_t stack[bvh_max_depth + 1];
  stack[0] = bvh_empty;
  uint32_t *top = stack;
  uint32_t current = bvh_empty;
  for (;;) {
    const unsigned idle = __ballot_sync(~0u, current == bvh_empty);
    if (idle == ~0u || (!is_pool_empty && __popc(idle) >= refill_at)) {
      if (current == bvh_empty && i != invalid_id) {
        if constexpr (is_any) finish_any(batch, i, found, pending);
        else hand_over(batch, i, pending);
        i = invalid_id;
      }
      if (is_pool_empty) break;  // then all are idle
      if (num_taken == warp_size && !is_pool_empty) {
        if (lane == 0) first = atomicAdd(batch.next_ray, uint32_t(warp_size));
        first = __shfl_sync(~0u, first, 0);
        num_taken = 0;
        is_pool_empty = first >= batch.num_rays;
        if (!is_any && !is_pool_empty) {
          if (lane == 0) batch.taken_before[first / warp_size] = taken;
          taken = first;
        }
        make_ready<Query>(s, batch, first + lane, lane, warp);
        __syncwarp();
      }
      const unsigned slot = num_taken + __popc(idle & ((1u << lane) - 1u));
      num_taken = min(num_taken + __popc(idle), warp_size);
      if (current == bvh_empty && slot < warp_size && warp.main_axis[slot] != no_axis) {
        r = ready_ray(warp, slot);
        i = first + slot;
        found = false;
        pending.count = 0;
        pending.triangle = invalid_id;
        tmin = warp.tmin[slot];
        tmax = warp.tmax[slot];
        left_out = warp.left_out[slot];
        ended_at = warp.ended_at[slot];
        pending.lower = tmax;
        end = tmax + r.end_offset;
        top = stack + 1;
        current = s.world.tree.root;
      }
      __syncwarp();
    }
    do {
#pragma unroll
      for (int k = 0; k < 3; ++k) {
        if (!is_bvh_leaf(current)) step<!is_any>(s.world.tree.nodes, r, end, current, top);
      }
    } while (__popc(__ballot_sync(~0u, !is_bvh_leaf(current))) >= stepping_until);
    if (is_bvh_leaf(current) && current != bvh_empty) {
      if constexpr (is_any) {
        found = any_in_leaf(s.world.triangles, r, tmin, tmax, current, left_out, ended_at, pending);
        current = found ? bvh_empty : pop(top);
      } else {
        closest_in_leaf(s.world.triangles, r, tmin, current, left_out, end, pending);
        current = pop(top);
      }
    }
  }
  if constexpr (!is_any) measure_taken(s, batch, taken);
}

}  // namespace

void launch_near_refill(const TraceScene &scene, TraceQuery query, const NearBatch &batch,
                        cudaStream_t stream)
{
  const uint64_t num_threads = uint64_t(scene.num_sms) * blocks_per_sm * block_size;
  if (query == TraceQuery::Any)
    launch("any-hit kernel", refill_kernel<TraceQuery::Any>, num_threads, stream, scene, batch);
  else launch("closest-hit kernel", refill_kernel<TraceQuery::Closest>, num_threads, stream, scene, batch);
}

}  // namespace gpurt::cuda
