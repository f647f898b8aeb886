// What a thread of the fast kernels does with triangles, and at the end of a ray.
//
// Measuring a hit in double takes more registers and instructions than all the rest of a step, so it is done after traversal.
// Till then a ray keeps the triangles that it may hit, nearly always one, with an interval for the nearest t.
//
// Few rays are left over: those with several candidates or with some that single precision is not clear about, and, fewer
// still, those that have to go the general way, which takes 40 to 110 us a ray. Closest hits of a thread a ray finish them in
// place, behind other warps. Warps that refill cannot: within the loop a call would take its values out of registers, and
// halve the speed; after it, no other warps are left to hide behind. They and any hits list them for a kernel of their own.
#pragma once

#include "core/accel/near_ray.h"
#include "core/accel/trace.h"
#include "cuda/accel/near.h"
#include "cuda/accel/ray_io.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

#if defined(__CUDACC__)

constexpr unsigned warp_size = 32;

// Whether a kernel is the one for rays of this order.
__device__ __forceinline__ bool is_for(const NearBatch &batch, Coherence order)
{
  return batch.probed == nullptr || *batch.probed == uint32_t(order);
}

// Triangles of which one, or none, is the hit.
struct Pending {
  uint32_t
      *references;    // the first max_candidates of them, and room for one; in local memory, as the stack is
  uint32_t count;     // over max_candidates: the ray has to go the general way
  uint32_t triangle;  // that came last: met again in another leaf, it is known
  float lower;        // of all their t
};
constexpr uint32_t pending_capacity = max_candidates + 1;

__device__ __forceinline__ void clear(Pending &pending, float tmax)
{
  pending.count = 0;
  pending.triangle = invalid_id;
  pending.lower = tmax;
}

__device__ __forceinline__ LeafTriangle load_triangle(const LeafTriangle *triangles, uint32_t reference)
{
  const float4 *p = reinterpret_cast<const float4 *>(triangles + reference);
  const float4 a = __ldg(p), b = __ldg(p + 1), c = __ldg(p + 2);
  return {{a.x, a.y, a.z},      __float_as_uint(a.w), {b.x, b.y, b.z},
          __float_as_uint(b.w), {c.x, c.y, c.z},      __float_as_uint(c.w)};
}

__device__ __forceinline__ void keep(Pending &pending, uint32_t reference)
{
  pending.references[min(pending.count, max_candidates)] = reference;
  ++pending.count;
}

__device__ __forceinline__ uint32_t known_triangle(const uint32_t *known, uint32_t i)
{
  return known != nullptr ? __ldg(known + i) : invalid_id;
}

// Tests a triangle for the closest hit, and lowers `end` where it is nearer. `triangle` is its id: met again, it is known.
__device__ __forceinline__ void closest_in_triangle(const LeafTriangle &x, uint32_t triangle,
                                                    uint32_t reference, const NearRay &ray, float tmin,
                                                    uint32_t left_out, float &end, Pending &pending)
{
  HitInterval t;
  const EdgeVerdict verdict = test_near(ray, x.a, x.b, x.c, t);
  if (verdict == EdgeVerdict::Outside || triangle == pending.triangle || x.triangle == left_out) return;
  if (verdict == EdgeVerdict::Unclear) {
    keep(pending, reference | unclear_bit);
    pending.lower = -infinity;  // may be no hit, or any: what is kept stays
    pending.triangle = triangle;
    return;
  }
  if (t.lower + ray.end_offset > end || t.upper < tmin) return;
  const bool is_beyond_tmin = t.lower >= tmin;
  if (is_beyond_tmin) {
    if (t.upper < pending.lower && pending.count <= max_candidates) pending.count = 0;
    pending.lower = at_most(pending.lower, t.lower);
    end = at_most(end, t.upper + ray.end_offset);
  } else {
    pending.lower = -infinity;
  }
  keep(pending, reference);
  pending.triangle = triangle;
}

// True where the triangle is hit for certain; keeps one that may be.
__device__ __forceinline__ bool any_in_triangle(const LeafTriangle &x, uint32_t reference, const NearRay &ray,
                                                float tmin, float tmax, uint32_t left_out, uint32_t ended_at,
                                                Pending &pending)
{
  HitInterval t;
  const EdgeVerdict verdict = test_near(ray, x.a, x.b, x.c, t);
  if (verdict == EdgeVerdict::Outside || x.triangle == left_out || x.triangle == ended_at) return false;
  if (verdict == EdgeVerdict::Inside) {
    if (t.lower > tmax || t.upper < tmin) return false;
    if (t.lower >= tmin && t.upper <= tmax) return true;
  } else {
    reference |= unclear_bit;
  }
  keep(pending, reference);
  return false;
}

// Measures a triangle that the edge functions have told to be hit. False where t is out of the ray's interval; where the
// triangle is seen edge-on, which single precision may miss, `is_clear` becomes false.
//
// So it does in a kd-tree where the plane is met on the triangle's border or beyond: t may then be outside of the cell that
// the triangle was found in, and whether it is found there depends on how much is left to rounding, which in these kernels
// is more than on the CPU. The boxes of bvhs hold their triangles as far as t may be.
__device__ __forceinline__ bool measure(const TraceScene &s, const LeafTriangle &x, const Ray &ray,
                                        TriangleHit &hit, bool &is_clear)
{
  const bool is_hit = measure_hit(
      ray.origin, ray.direction, main_axis_of(ray.direction), x.a, x.b, x.c,
      [&] {
        is_clear = false;
        return EdgeWeights{1.0, 1.0, 1.0};
      },
      ray.tmin, ray.tmax, hit);
  if (is_hit && !s.has_bvhs && (hit.u == 0.0f || hit.v == 0.0f || hit.v == 1.0f - hit.u)) is_clear = false;
  return is_hit;
}

__device__ __forceinline__ void store_closest(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                              const Hit &hit, uint32_t primitive)
{
  if (batch.layout == HitLayout::Compact) {
    store_hit(static_cast<CompactHit *>(batch.results), i, CompactHit{hit.t, hit.u, hit.v, primitive}, true);
  } else if (batch.layout == HitLayout::Internal) {
    static_cast<Hit *>(batch.results)[i] = hit;
  } else {
    store_hit(static_cast<FullHit *>(batch.results), i, full_hit(s.scene, hit), true);
  }
}

// What becomes known of a ray that is left over.
struct Finished {
  Hit hit;
  uint32_t primitive;
};

// The nearest of a ray's candidates, reference(0) to reference(count - 1). False: the ray has to go the general way.
template <bool Bvh, class Reference>
__device__ __forceinline__ bool measure_candidates(const TraceScene &s, const Ray &ray, uint32_t count,
                                                   Reference &&reference, Finished &finished)
{
  TraceRay r;
  prepare_ray(ray.origin, ray.direction, ray.tmin, ray.tmax, r);
  TriangleRay<TriangleTest::Watertight> triangle_ray;
  make_triangle_ray(r, triangle_ray);
  Hit &best = finished.hit;
  best = {ray.tmax, 0.0f, 0.0f, invalid_id, invalid_id};
  finished.primitive = invalid_id;
  bool is_clear = true;
  for (uint32_t k = 0; k < count; ++k) {
    const uint32_t candidate = reference(k);
    const LeafTriangle x = load_triangle(s.near_triangles, candidate & ~unclear_bit);
    TriangleHit hit;
    if constexpr (Bvh) {
      if (!intersect<EdgeRule::Inclusive>(triangle_ray, x.a, x.b, x.c, ray.tmin, ray.tmax, hit)) continue;
    } else {
      if ((candidate & unclear_bit) != 0) is_clear = false;
      if (!measure(s, x, ray, hit, is_clear)) continue;
    }
    if (best.triangle != invalid_id && (hit.t > best.t || (hit.t == best.t && x.triangle > best.triangle)))
      continue;
    best = {hit.t, hit.u, hit.v, x.triangle, invalid_id};
    finished.primitive = x.primitive;
  }
  return is_clear;
}

// Finishes a ray by its candidates or, where they do not tell or there are too many, the general way.
template <TraceQuery Query, bool Bvh, class Reference>
__device__ __forceinline__ void finish_left_over(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                                 uint32_t count, Reference &&reference)
{
  constexpr bool is_any = Query == TraceQuery::Any;
  const Ray ray = load_ray(batch.rays, i, true);
  Finished finished;
  if (count > max_candidates || !measure_candidates<Bvh>(s, ray, count, reference, finished)) {
    const auto &accel = [&]() -> const auto & {
      if constexpr (Bvh) return s.bvhs;
      else return s.kd_trees;
    }();
    if constexpr (is_any) {
      finished.hit.triangle =
          trace_any<TriangleTest::Watertight, false, false>(accel, s.scene, ray) ? 0 : invalid_id;
    } else {
      finished.hit = trace_closest<TriangleTest::Watertight, false, false>(accel, s.scene, ray);
      const uint32_t triangle = finished.hit.triangle;
      finished.primitive = triangle == invalid_id ? invalid_id : primitive_of(s.scene, triangle);
    }
  }
  if constexpr (is_any)
    static_cast<uint8_t *>(batch.results)[i] = finished.hit.triangle != invalid_id ? 1 : 0;
  else store_closest(s, batch, i, finished.hit, finished.primitive);
}

// In place, where few rays come, so that what the caller holds in registers matters more.
template <bool Bvh>
__device__ __noinline__ void finish_in_place(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                             uint32_t count, const uint32_t *references)
{
  finish_left_over<TraceQuery::Closest, Bvh>(s, batch, i, count, [&](uint32_t k) { return references[k]; });
}

// Lists a ray for the kernel that finishes. False: there is no room.
__device__ __forceinline__ bool leave_over(const NearBatch &batch, uint32_t i, uint32_t count,
                                           const uint32_t *references)
{
  const uint32_t k = atomicAdd(batch.num_leftovers, 1u);
  if (k >= batch.leftover_capacity) return false;
  Leftover &leftover = batch.leftovers[k];
  leftover.ray = i;
  for (uint32_t c = 0; c < max_candidates; ++c)
    leftover.references[c] = c < count && count <= max_candidates ? references[c] : no_candidate;
  return true;
}

// Measures the one candidate of a ray, or none. False: the ray is left over.
__device__ __forceinline__ bool measure_one(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                            uint32_t reference)
{
  const Ray ray = load_ray(batch.rays, i, true);  // again, rather than kept in registers
  Hit best = {ray.tmax, 0.0f, 0.0f, invalid_id, invalid_id};
  uint32_t primitive = invalid_id;
  bool is_clear = true;
  if (reference != no_candidate) {
    const LeafTriangle x = load_triangle(s.near_triangles, reference);
    TriangleHit hit;
    if (measure(s, x, ray, hit, is_clear)) {
      best = {hit.t, hit.u, hit.v, x.triangle, invalid_id};
      primitive = x.primitive;
    }
  }
  if (is_clear) store_closest(s, batch, i, best, primitive);
  return is_clear;
}

// The candidate of a ray that has one or none, and is clear about it; else left_over.
__device__ __forceinline__ uint32_t only_candidate(const Pending &pending)
{
  if (pending.count == 0) return no_candidate;
  const uint32_t reference = pending.references[0];
  return pending.count == 1 && (reference & unclear_bit) == 0 ? reference : left_over;
}

// The end of a ray of closest hits, a thread a ray.
template <bool Bvh>
__device__ __forceinline__ void finish_closest(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                               const Pending &pending)
{
  const uint32_t candidate = only_candidate(pending);
  uint32_t count = pending.count;
  if (candidate != left_over) {
    if (measure_one(s, batch, i, candidate)) return;
    pending.references[0] |= unclear_bit;
  }
  finish_in_place<Bvh>(s, batch, i, count, pending.references);
}

// The end of a ray of any hits.
__device__ __forceinline__ void finish_any(const NearBatch &batch, uint32_t i, bool found,
                                           const Pending &pending)
{
  uint8_t result = found ? 1 : 0;
  if (!found && pending.count != 0) {
    if (leave_over(batch, i, pending.count, pending.references)) return;
    result = unlisted_result;
  }
  static_cast<uint8_t *>(batch.results)[i] = result;
}

// The end of a ray of closest hits in a warp that refills: kept for measure_taken().
__device__ __forceinline__ void hand_over(const NearBatch &batch, uint32_t i, const Pending &pending)
{
  uint32_t candidate = only_candidate(pending);
  if (candidate == left_over && !leave_over(batch, i, pending.count, pending.references))
    candidate = unlisted_left_over;
  batch.candidates[i] = candidate;
}

// Measures what the rays of a warp found, all lanes at once, once all of them have ended: amid traversal few end at a time,
// and its registers would be in the way. `taken` are the last 32 that the warp took, invalid_id if it took none.
__device__ __forceinline__ void measure_taken(const TraceScene &s, const NearBatch &batch, uint32_t taken)
{
  __syncwarp();
  for (; taken != invalid_id; taken = batch.taken_before[taken / warp_size]) {
    const uint32_t i = taken + threadIdx.x % warp_size;
    if (i >= batch.num_rays) continue;
    uint32_t candidate = batch.candidates[i];
    if (candidate == left_over || candidate == unlisted_left_over) continue;
    if (measure_one(s, batch, i, candidate)) continue;
    candidate |= unclear_bit;
    if (!leave_over(batch, i, 1, &candidate)) batch.candidates[i] = unlisted_left_over;
  }
}

#endif

GPURT_KERNELS_END
}  // namespace gpurt::cuda
