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

#include <type_traits>

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

// The same in scenes with placements: the candidates' placements lie pending_capacity behind their references.
struct PlacedPending : Pending {
  uint32_t placement;  // of the triangles that are tested; invalid_id: in world space
  float upper;         // the least of what lowered `end`: other trees count t from elsewhere
};
template <class Kind>
using PendingOf = std::conditional_t<Kind::placements, PlacedPending, Pending>;
template <class Kind>
constexpr uint32_t pending_words = Kind::placements ? 2 * pending_capacity : pending_capacity;

struct Candidate {
  uint32_t reference, placement;
};
template <class Kind>
__device__ __forceinline__ Candidate candidate_of(const uint32_t *references, uint32_t k)
{
  return {references[k], Kind::placements ? references[pending_capacity + k] : invalid_id};
}

__device__ __forceinline__ void clear(Pending &pending, float tmax)
{
  pending.count = 0;
  pending.triangle = invalid_id;
  pending.lower = tmax;
}
__device__ __forceinline__ void clear(PlacedPending &pending, float tmax)
{
  clear(static_cast<Pending &>(pending), tmax);
  pending.placement = invalid_id;
  pending.upper = tmax;
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

__device__ __forceinline__ void keep(PlacedPending &pending, uint32_t reference)
{
  pending.references[pending_capacity + min(pending.count, max_candidates)] = pending.placement;
  keep(static_cast<Pending &>(pending), reference);
}
__device__ __forceinline__ void lower_upper(Pending &, float) {}
__device__ __forceinline__ void lower_upper(PlacedPending &pending, float upper)
{
  pending.upper = at_most(pending.upper, upper);
}

__device__ __forceinline__ uint32_t known_triangle(const uint32_t *known, uint32_t i)
{
  return known != nullptr ? __ldg(known + i) : invalid_id;
}

// Takes a triangle that is hit with t in the interval for the closest hit, and lowers `end` where it is nearer.
template <class P>
__device__ __forceinline__ void take_hit(uint32_t triangle, uint32_t reference, HitInterval t,
                                         const NearRay &ray, float tmin, float &end, P &pending)
{
  if (t.lower + ray.end_offset > end || t.upper < tmin) return;
  const bool is_beyond_tmin = t.lower >= tmin;
  if (is_beyond_tmin) {
    if (t.upper < pending.lower && pending.count <= max_candidates) pending.count = 0;
    pending.lower = at_most(pending.lower, t.lower);
    end = at_most(end, t.upper + ray.end_offset);
    lower_upper(pending, t.upper);
  } else {
    pending.lower = -infinity;
  }
  keep(pending, reference);
  pending.triangle = triangle;
}

// Keeps a triangle that may be hit, at any t.
template <class P>
__device__ __forceinline__ void keep_unclear(uint32_t triangle, uint32_t reference, P &pending)
{
  keep(pending, reference);
  pending.lower = -infinity;  // may be no hit, or any: what is kept stays
  pending.triangle = triangle;
}

// Tests a triangle for the closest hit. `triangle` is its id: met again, it is known.
template <class P>
__device__ __forceinline__ void closest_in_triangle(const LeafTriangle &x, uint32_t triangle,
                                                    uint32_t reference, const NearRay &ray, float tmin,
                                                    uint32_t left_out, float &end, P &pending)
{
  HitInterval t;
  const EdgeVerdict verdict = test_near(ray, x.a, x.b, x.c, t);
  if (verdict == EdgeVerdict::Outside || triangle == pending.triangle || x.triangle == left_out) return;
  if (verdict == EdgeVerdict::Unclear) {
    keep_unclear(triangle, reference | unclear_bit, pending);
    return;
  }
  take_hit(triangle, reference, t, ray, tmin, end, pending);
}

// True where the triangle is hit for certain; keeps one that may be.
template <class P>
__device__ __forceinline__ bool any_in_triangle(const LeafTriangle &x, uint32_t reference, const NearRay &ray,
                                                float tmin, float tmax, uint32_t left_out, uint32_t ended_at,
                                                P &pending)
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

// Measures a triangle that the edge functions have told to be hit. False where t is out of the ray's interval; where the plane
// does not tell the hit, as on a border that rounding moves or edge-on, `is_clear` becomes false, and intersect() has to.
__device__ __forceinline__ bool measure(const LeafTriangle &x, const Ray &ray, TriangleHit &hit,
                                        bool &is_clear)
{
  return measure_hit(
      ray.origin, ray.direction, main_axis_of(ray.direction), x.a, x.b, x.c,
      [&](MeetingPoint &) { is_clear = false; }, ray.tmin, ray.tmax, hit);
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

// The triangles that a placement holds, and the ray in their space; in world space, all stays as it is.
template <class Kind>
__device__ __forceinline__ const LeafTriangle *enter_space(const TraceScene &s, uint32_t placement, Ray &ray)
{
  if (!Kind::placements || placement == invalid_id) return s.near_triangles;
  const Placement &p = s.scene.placements[placement];
  ray.origin = transform_point(p.world_to_object, ray.origin);
  ray.direction = transform_vector(p.world_to_object, ray.direction);
  return s.bvhs.groups[p.group].triangles;
}

__device__ __forceinline__ TriangleRay<TriangleTest::Watertight> triangle_ray_of(const Ray &ray)
{
  TraceRay r;
  prepare_ray(ray.origin, ray.direction, ray.tmin, ray.tmax, r);
  TriangleRay<TriangleTest::Watertight> triangle_ray;
  make_triangle_ray(r, triangle_ray);
  return triangle_ray;
}

// The nearest of a ray's candidates, candidate(0) to candidate(count - 1).
template <class Kind, class CandidateAt>
__device__ __forceinline__ void measure_candidates(const TraceScene &s, const Ray &ray, uint32_t count,
                                                   CandidateAt &&candidate_at, Finished &finished)
{
  const TriangleRay<TriangleTest::Watertight> world_ray = triangle_ray_of(ray);
  Hit &best = finished.hit;
  best = {ray.tmax, 0.0f, 0.0f, invalid_id, invalid_id};
  finished.primitive = invalid_id;
  for (uint32_t k = 0; k < count; ++k) {
    const Candidate candidate = candidate_at(k);
    Ray own = ray;
    const LeafTriangle *triangles = enter_space<Kind>(s, candidate.placement, own);
    const LeafTriangle x = load_triangle(triangles, candidate.reference & ~unclear_bit);
    TriangleHit hit;
    const auto &own_ray = Kind::placements ? triangle_ray_of(own) : world_ray;
    if (!intersect<EdgeRule::Inclusive>(own_ray, x.a, x.b, x.c, ray.tmin, ray.tmax, hit)) continue;
    const Hit found = {hit.t, hit.u, hit.v, x.triangle, candidate.placement};
    if (best.triangle != invalid_id && hit.t >= best.t) {
      if (hit.t > best.t) continue;
      if (Kind::placements ? !ids_precede(s.scene, found, best) : x.triangle > best.triangle) continue;
    }
    best = found;
    finished.primitive = x.primitive;
  }
}

// Finishes a ray by its candidates or, where there are too many, the general way.
template <TraceQuery Query, class Kind, class CandidateAt>
__device__ __forceinline__ void finish_left_over(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                                 uint32_t count, CandidateAt &&candidate_at)
{
  constexpr bool is_any = Query == TraceQuery::Any;
  const Ray ray = load_ray(batch.rays, i, true);
  Finished finished;
  if (count <= max_candidates) {
    measure_candidates<Kind>(s, ray, count, candidate_at, finished);
  } else {
    const auto &accel = [&]() -> const auto & {
      if constexpr (Kind::bvh) return s.bvhs;
      else return s.kd_trees;
    }();
    if constexpr (is_any) {
      finished.hit.triangle =
          trace_any<TriangleTest::Watertight, Kind::masks, Kind::placements>(accel, s.scene, ray)
              ? 0
              : invalid_id;
    } else {
      finished.hit =
          trace_closest<TriangleTest::Watertight, Kind::masks, Kind::placements>(accel, s.scene, ray);
      const uint32_t triangle = finished.hit.triangle;
      finished.primitive = triangle == invalid_id ? invalid_id : primitive_of(s.scene, triangle);
    }
  }
  if constexpr (is_any)
    static_cast<uint8_t *>(batch.results)[i] = finished.hit.triangle != invalid_id ? 1 : 0;
  else store_closest(s, batch, i, finished.hit, finished.primitive);
}

// In place, where few rays come, so that what the caller holds in registers matters more.
template <class Kind>
__device__ __noinline__ void finish_in_place(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                             uint32_t count, const uint32_t *references)
{
  finish_left_over<TraceQuery::Closest, Kind>(s, batch, i, count,
                                              [&](uint32_t k) { return candidate_of<Kind>(references, k); });
}

template <class Kind>
__device__ __forceinline__ auto *leftovers_of(const NearBatch &batch)
{
  if constexpr (Kind::placements) return static_cast<PlacedLeftover *>(static_cast<void *>(batch.leftovers));
  else return batch.leftovers;
}

// Lists a ray for the kernel that finishes. False: there is no room.
template <class Kind>
__device__ __forceinline__ bool leave_over(const NearBatch &batch, uint32_t i, uint32_t count,
                                           const uint32_t *references)
{
  const uint32_t k = atomicAdd(batch.num_leftovers, 1u);
  if (k >= batch.leftover_capacity) return false;
  auto &leftover = leftovers_of<Kind>(batch)[k];
  leftover.ray = i;
  for (uint32_t c = 0; c < max_candidates; ++c) {
    const bool is_kept = c < count && count <= max_candidates;
    leftover.references[c] = is_kept ? references[c] : no_candidate;
    if constexpr (Kind::placements)
      leftover.placements[c] = is_kept ? references[pending_capacity + c] : invalid_id;
  }
  return true;
}

// Measures the one candidate of a ray, or none. False: the ray is left over.
template <class Kind>
__device__ __forceinline__ bool measure_one(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                            Candidate candidate)
{
  const Ray ray = load_ray(batch.rays, i, true);  // again, rather than kept in registers
  Hit best = {ray.tmax, 0.0f, 0.0f, invalid_id, invalid_id};
  uint32_t primitive = invalid_id;
  bool is_clear = true;
  if (candidate.reference != no_candidate) {
    Ray own = ray;
    const LeafTriangle *triangles = enter_space<Kind>(s, candidate.placement, own);
    const LeafTriangle x = load_triangle(triangles, candidate.reference);
    TriangleHit hit;
    if (measure(x, own, hit, is_clear)) {
      best = {hit.t, hit.u, hit.v, x.triangle, candidate.placement};
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
template <class Kind>
__device__ __forceinline__ void finish_closest(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                               const Pending &pending)
{
  const uint32_t candidate = only_candidate(pending);
  uint32_t count = pending.count;
  if (candidate != left_over) {
    const uint32_t placement = candidate_of<Kind>(pending.references, 0).placement;
    if (measure_one<Kind>(s, batch, i, {candidate, placement})) return;
    pending.references[0] |= unclear_bit;
  }
  finish_in_place<Kind>(s, batch, i, count, pending.references);
}

// The end of a ray of any hits.
template <class Kind>
__device__ __forceinline__ void finish_any(const NearBatch &batch, uint32_t i, bool found,
                                           const Pending &pending)
{
  // Of a ray that is left over 0 until the kernel that finishes comes to it, which reads all results where its list is full.
  uint8_t result = found ? 1 : 0;
  if (!found && pending.count != 0 && !leave_over<Kind>(batch, i, pending.count, pending.references))
    result = unlisted_result;
  static_cast<uint8_t *>(batch.results)[i] = result;
}

// Where the placement of a candidate waits till it is measured: where the hit goes.
__device__ __forceinline__ uint32_t &waiting_placement(const NearBatch &batch, uint32_t i)
{
  const uint64_t hit_size = batch.layout == HitLayout::Compact    ? sizeof(CompactHit)
                            : batch.layout == HitLayout::Internal ? sizeof(Hit)
                                                                  : sizeof(FullHit);
  return static_cast<uint32_t *>(batch.results)[i * (hit_size / sizeof(uint32_t))];
}

// The end of a ray of closest hits in a warp that refills: what it found waits for the kernel that measures.
template <class Kind>
__device__ __forceinline__ void hand_over(const NearBatch &batch, uint32_t i, const Pending &pending)
{
  uint32_t candidate = only_candidate(pending);
  if (candidate == left_over && !leave_over<Kind>(batch, i, pending.count, pending.references))
    candidate = unlisted_left_over;
  batch.candidates[i] = candidate;
  if constexpr (Kind::placements)
    waiting_placement(batch, i) = candidate_of<Kind>(pending.references, 0).placement;
}

#endif

GPURT_KERNELS_END
}  // namespace gpurt::cuda
