// Closest and any hits in scenes with alpha masks or materials that blend, all of them in world space: a thread a ray, in rounds.
//
// Whether a triangle lets a ray pass depends on u and v to the bit, which are measured in double. Amid traversal that takes
// what the walk holds out of its registers, and a third of the rate. So a round finds the nearest triangle, whatever its
// material, and measures it when the walk is over; where it lets the ray pass, the next round begins at its t and leaves it out.
// Of triangles that were passed none lies at a larger t, so that none comes again.
#pragma once

#include "core/accel/trace.h"
#include "cuda/accel/near_lane.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

#if defined(__CUDACC__)

// A ray through more layers than these goes the general way, which does not begin anew behind each.
constexpr uint32_t max_mask_rounds = 24;

// The nearest of a round's candidates: where there are several, or single precision is not clear about one.
template <class Kind>
__device__ __noinline__ void measure_several(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                             float from, uint32_t count, const uint32_t *references,
                                             Finished &finished)
{
  Ray ray = load_ray(batch.rays, i, true);
  ray.tmin = from;
  measure_candidates<Kind>(
      s, ray, count, [&](uint32_t k) { return candidate_of<Kind>(references, k); }, finished);
}

// The same of one, or none. False: it is not clear.
__device__ __forceinline__ bool measure_single(const TraceScene &s, const Ray &ray, uint32_t reference,
                                               Finished &finished)
{
  finished = {{ray.tmax, 0.0f, 0.0f, invalid_id, invalid_id}, invalid_id};
  bool is_clear = true;
  if (reference == no_candidate) return true;
  const LeafTriangle x = load_triangle(s.near_triangles, reference);
  TriangleHit hit;
  if (measure(x, ray, hit, is_clear)) finished = {{hit.t, hit.u, hit.v, x.triangle, invalid_id}, x.primitive};
  return is_clear;
}

enum class RoundEnd { Finished, GoesOn, General };

// The end of a round: what was found, or, in `from` and `passed`, where the next one begins.
template <TraceQuery Query, class Kind>
__device__ __forceinline__ RoundEnd end_round(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                              const Pending &pending, float &from, uint32_t &passed)
{
  if (pending.count > max_candidates) return RoundEnd::General;
  Ray ray = load_ray(batch.rays, i, true);
  const float tmin = ray.tmin;
  ray.tmin = from;
  Finished finished;
  const uint32_t candidate = only_candidate(pending);
  if (candidate == left_over || !measure_single(s, ray, candidate, finished))
    measure_several<Kind>(s, batch, i, from, pending.count, pending.references, finished);
  const Hit &hit = finished.hit;
  if (hit.triangle != invalid_id) {
    const float opacity = opacity_at(s.scene, hit.triangle, hit.u, hit.v);
    bool passes = opacity <= 0.0f;
    if (opacity > 0.0f && opacity < 1.0f) {
      TraceRay world;
      prepare_ray(ray.origin, ray.direction, tmin, ray.tmax, world);
      passes = lets_pass(s.scene, ray_key(world), hit.triangle, invalid_id, hit.u, hit.v);
    }
    if (passes) {
      // Several at the same t: one alone can be left out.
      if (passed != invalid_id && hit.t == from) return RoundEnd::General;
      from = hit.t;
      passed = hit.triangle;
      return RoundEnd::GoesOn;
    }
  }
  if constexpr (Query == TraceQuery::Any)
    static_cast<uint8_t *>(batch.results)[i] = hit.triangle != invalid_id ? 1 : 0;
  else store_closest(s, batch, i, hit, finished.primitive);
  return RoundEnd::Finished;
}

template <TraceQuery Query, class Kind>
__device__ __noinline__ void finish_general(const TraceScene &s, const NearBatch &batch, uint32_t i)
{
  finish_left_over<Query, Kind>(s, batch, i, max_candidates + 1,
                                [](uint32_t) { return Candidate{0, invalid_id}; });
}

template <class Walk, TraceQuery Query>
__global__ void __launch_bounds__(block_size, Walk::plain_blocks)
    near_masked_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ NearBatch batch,
                       const __grid_constant__ TiledRows rows)
{
  using Kind = NearKind<true, true>;
  __shared__ typename Walk::Shared shared[block_size / warp_size];
  const uint32_t i = rows.ray_of(uint32_t(thread_item()));
  if (i >= batch.num_rays) return;
  uint32_t references[pending_words<Kind>];
  Pending pending;
  pending.references = references;
  typename Walk::Entry stack[Walk::stack_size];
  float from = load_ray(batch.rays, i, true).tmin;
  uint32_t passed = invalid_id;
  RoundEnd end_of_round = RoundEnd::GoesOn;
  for (uint32_t round = 0; end_of_round == RoundEnd::GoesOn; ++round) {
    pending.count = max_candidates + 1;
    Ray ray = load_ray(batch.rays, i, true);
    ray.tmin = from;
    Walk walk(stack, &shared[threadIdx.x / warp_size], threadIdx.x % warp_size);
    if (round < max_mask_rounds && walk.begin(s, ray, stack)) {
      clear(pending, ray.tmax);
      float end = ray.tmax + walk.ray.end_offset;
      for (;;) {
        while (!walk.is_at_leaf()) walk.template step<true>(s, end);
        if (walk.has_ended()) break;
        walk.test_leaf(s, [&](const LeafTriangle &x, uint32_t triangle, uint32_t reference) {
          closest_in_triangle(x, triangle, reference, walk.ray, from, passed, end, pending);
          return false;
        });
        walk.pop(end);
      }
    }
    end_of_round = end_round<Query, Kind>(s, batch, i, pending, from, passed);
  }
  if (end_of_round == RoundEnd::General) finish_general<Query, Kind>(s, batch, i);
}

#endif

GPURT_KERNELS_END
}  // namespace gpurt::cuda
