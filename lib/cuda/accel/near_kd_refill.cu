// Rays of the kd-tree's fast kernels by persistent warps, which give threads whose ray has ended a new one: for large batches
// of rays that lie apart, which would else leave most threads of a warp waiting for the longest ray.
//
// Source: Aila and Laine 2009, persistent threads and replacement of terminated rays.
#include "cuda/accel/near_kd_lane.h"

namespace gpurt::cuda {
namespace {

constexpr int blocks_per_sm = 8;
// A warp refills from so many idle lanes on, and steps over nodes, so many between votes, while so many lanes have one.
constexpr int refill_at = 8, steps = 4, stepping_until = 12;

// Rays that are ready for a warp's lanes: made so by all lanes at once, drawn by few at a time.
struct WarpRays {
  float2 axis[3][kd_warp_size];
  float origin[3][kd_warp_size];
  float sx[kd_warp_size], sy[kd_warp_size], sz[kd_warp_size], end_offset[kd_warp_size], tmin[kd_warp_size],
      tmax[kd_warp_size];
  float a[kd_warp_size], b[kd_warp_size], width[kd_warp_size];
  uint32_t main_axis[kd_warp_size];  // 3: no ray
  uint32_t left_out[kd_warp_size], ended_at[kd_warp_size];
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
  NearKdRay q;
  if (!make_near_kd_ray(ray, s.near_kd, r, q)) {
    list_ray(batch, i);
    if constexpr (Query == TraceQuery::Closest) batch.candidates[i] = listed_candidate;
    return;
  }
  for (int k = 0; k < 3; ++k) {
    warp.axis[k][lane] = make_float2(q.axis[k].inverse, q.axis[k].shift);
    warp.origin[k][lane] = at(r.origin, k);
  }
  warp.sx[lane] = r.sx;
  warp.sy[lane] = r.sy;
  warp.sz[lane] = r.sz;
  warp.end_offset[lane] = r.end_offset;
  warp.tmin[lane] = ray.tmin;
  warp.tmax[lane] = ray.tmax;
  warp.a[lane] = q.a;
  warp.b[lane] = q.b;
  warp.width[lane] = q.width;
  warp.main_axis[lane] = uint32_t(r.main_axis);
  warp.left_out[lane] = known_triangle(batch.left_out, i);
  if constexpr (Query == TraceQuery::Any) warp.ended_at[lane] = known_triangle(batch.ended_at, i);
}

template <TraceQuery Query>
__global__ void __launch_bounds__(block_size, blocks_per_sm)
    near_kd_refill_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ NearBatch batch)
{
  if (!is_for(batch, Coherence::Incoherent)) return;
  constexpr bool is_any = Query == TraceQuery::Any;
  __shared__ WarpAxes axes[block_size / kd_warp_size];
  __shared__ WarpRays warps[block_size / kd_warp_size];
  const unsigned lane = threadIdx.x % kd_warp_size;
  WarpRays &warp = warps[threadIdx.x / kd_warp_size];
  WarpAxes &own = axes[threadIdx.x / kd_warp_size];
  const LaneAxes lane_axes{&own.axis[0][lane]};
  uint32_t first = 0;           // of the rays that are ready
  uint32_t taken = invalid_id;  // first of the last rays that the warp took
  unsigned num_taken = kd_warp_size;
  bool is_pool_empty = false;
  uint32_t i = invalid_id;
  NearRay r = {};
  Pending pending;
  bool found = false;
  uint32_t left_out = invalid_id, ended_at = invalid_id;
  float end = 0, tmin = 0, tmax = 0, width = 0, a = 0, b = 0;
  uint4 entries[kd_stack_size];
  NearKdStack stack{entries, 0};
  stack.clear();
  KdNode node = {0, kd_end};
  for (;;) {
    const unsigned idle = __ballot_sync(~0u, node.tag == kd_end);
    if (idle == ~0u || (!is_pool_empty && __popc(idle) >= refill_at)) {
      if (node.tag == kd_end && i != invalid_id) {
        if constexpr (is_any) finish_any(batch, i, found, pending);
        else hand_over(batch, i, pending);
        i = invalid_id;
      }
      if (is_pool_empty) break;  // then all are idle
      if (num_taken == kd_warp_size && !is_pool_empty) {
        if (lane == 0) first = atomicAdd(batch.next_ray, uint32_t(kd_warp_size));
        first = __shfl_sync(~0u, first, 0);
        num_taken = 0;
        is_pool_empty = first >= batch.num_rays;
        if (!is_any && !is_pool_empty) {
          if (lane == 0) batch.taken_before[first / kd_warp_size] = taken;
          taken = first;
        }
        make_ready<Query>(s, batch, first + lane, lane, warp);
        __syncwarp();
      }
      const unsigned slot = num_taken + __popc(idle & ((1u << lane) - 1u));
      num_taken = min(num_taken + __popc(idle), kd_warp_size);
      if (node.tag == kd_end && slot < kd_warp_size && warp.main_axis[slot] != no_axis) {
        for (int k = 0; k < 3; ++k) own.axis[k][lane] = warp.axis[k][slot];
        r.origin = {warp.origin[0][slot], warp.origin[1][slot], warp.origin[2][slot]};
        r.sx = warp.sx[slot];
        r.sy = warp.sy[slot];
        r.sz = warp.sz[slot];
        r.end_offset = warp.end_offset[slot];
        r.main_axis = int(warp.main_axis[slot]);
        i = first + slot;
        found = false;
        pending.count = 0;
        pending.triangle = invalid_id;
        left_out = warp.left_out[slot];
        if constexpr (is_any) ended_at = warp.ended_at[slot];
        tmin = warp.tmin[slot];
        tmax = warp.tmax[slot];
        width = warp.width[slot];
        a = warp.a[slot];
        b = warp.b[slot];
        pending.lower = tmax;
        end = tmax + r.end_offset;
        stack.clear();
        node = first_kd_node(s.near_kd, a, b);
      }
      __syncwarp();
    }
    do {
#pragma unroll
      for (int k = 0; k < steps; ++k) {
        // Leaves that are empty are not worth a vote.
        if (!is_leaf(node))
          node = load_kd_node(s.near_kd.nodes, near_kd_step(node, lane_axes, width, a, b, stack));
        else if (node.tag == kd_empty_leaf) node = pop_kd_node(s.near_kd.nodes, stack, end, a, b);
      }
    } while (__popc(__ballot_sync(~0u, !is_leaf(node))) >= stepping_until);
    if (is_leaf(node) && node.tag != kd_end) {
      found = test_kd_leaf(s.near_kd, node, [&](const LeafTriangle &x, uint32_t place) {
        if constexpr (is_any) return any_in_triangle(x, place, r, tmin, tmax, left_out, ended_at, pending);
        else closest_in_triangle(x, x.triangle, place, r, tmin, left_out, end, pending);
        return false;
      });
      node = is_any && found ? KdNode{0, kd_end} : pop_kd_node(s.near_kd.nodes, stack, end, a, b);
    }
  }
  if constexpr (!is_any) measure_taken(s, batch, taken);
}

}  // namespace

void launch_near_kd_refill(const TraceScene &scene, TraceQuery query, const NearBatch &batch,
                           cudaStream_t stream)
{
  const uint64_t num_threads = uint64_t(scene.num_sms) * blocks_per_sm * block_size;
  if (query == TraceQuery::Any)
    launch("any-hit kernel", near_kd_refill_kernel<TraceQuery::Any>, num_threads, stream, scene, batch);
  else
    launch("closest-hit kernel", near_kd_refill_kernel<TraceQuery::Closest>, num_threads, stream, scene,
           batch);
}

}  // namespace gpurt::cuda
