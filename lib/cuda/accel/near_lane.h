// What a thread of the bvh's fast kernels does: a step over a node, a leaf's triangles, the end of a ray.
//
// Measuring a hit in double takes more registers and instructions than all the rest of a step, so another kernel does it
// after traversal. Till then a ray keeps the triangles that it may hit, nearly always one, with an interval for the nearest
// t. Rays that are not near the tree, or may hit too many triangles, are listed, and a third kernel traces them the
// general way.
#pragma once

#include "core/accel/near_ray.h"
#include "core/accel/trace.h"
#include "cuda/accel/near.h"
#include "cuda/accel/ray_io.h"

namespace gpurt::cuda {

#if defined(__CUDACC__)

// Whether a kernel is the one for rays of this order.
__device__ __forceinline__ bool is_for(const NearBatch &batch, Coherence order)
{
  return batch.probed == nullptr || *batch.probed == uint32_t(order);
}

// Triangles of which one, or none, is the hit.
struct Pending {
  uint32_t reference;              // the first of them
  uint32_t second, third, fourth;  // no array: indexed, it would take all of this out of registers
  uint32_t count;                  // over max_candidates: the ray has to be listed
  uint32_t triangle;               // that came last: met again in another leaf, it is known
  float lower;                     // of all their t
};

// `top` points behind the last entry of a stack: indices would take two instructions more an access.
__device__ __forceinline__ uint32_t pop(uint32_t *&top) { return *--top; }

// A node: goes to the child that the ray meets first, or the larger one, and leaves the other for later.
template <bool Ordered>
__device__ __forceinline__ void step(const BvhNode *nodes, const NearRay &ray, float end, uint32_t &current,
                                     uint32_t *&top)
{
  const BvhNode node = load_node(nodes, current);
  float enter0, leave0, enter1, leave1;
  clip_near(ray, node.center0, half0(node.half[0]), half0(node.half[1]), half0(node.half[2]), end, enter0,
            leave0);
  clip_near(ray, node.center1, half1(node.half[0]), half1(node.half[1]), half1(node.half[2]), end, enter1,
            leave1);
  // Not a number, from a half extent that overflowed: visited.
  const bool meets0 = !(enter0 > leave0), meets1 = !(enter1 > leave1);
  const bool second_first = !meets0 || (Ordered && meets1 && enter1 < enter0);
  current = second_first ? node.child1 : node.child0;
  if (meets0 && meets1) *top++ = second_first ? node.child0 : node.child1;
  if (!meets0 && !meets1) current = pop(top);
}

__device__ __forceinline__ LeafTriangle load_triangle(const LeafTriangle *triangles, uint32_t reference)
{
  const float4 *p = reinterpret_cast<const float4 *>(triangles + reference);
  const float4 a = __ldg(p), b = __ldg(p + 1), c = __ldg(p + 2);
  return {{a.x, a.y, a.z},      __float_as_uint(a.w), {b.x, b.y, b.z},
          __float_as_uint(b.w), {c.x, c.y, c.z},      __float_as_uint(c.w)};
}

// Leaves a ray to the general kernel.
__device__ __forceinline__ void list_ray(const NearBatch &batch, uint32_t i)
{
  const uint32_t k = atomicAdd(batch.num_listed, 1u);
  if (k < batch.list_capacity) batch.listed[k] = i;
}

__device__ __forceinline__ void keep(Pending &pending, uint32_t reference)
{
  if (pending.count == 0) pending.reference = reference;
  else if (pending.count == 1) pending.second = reference;
  else if (pending.count == 2) pending.third = reference;
  else if (pending.count == 3) pending.fourth = reference;
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
    pending.count = max_candidates + 1;
    return;
  }
  if (t.lower + ray.end_offset > end || t.upper < tmin) return;
  const bool is_beyond_tmin = t.lower >= tmin;
  if (is_beyond_tmin) {
    if (t.upper < pending.lower && pending.count <= max_candidates) pending.count = 0;
    pending.lower = at_most(pending.lower, t.lower);
    end = at_most(end, t.upper + ray.end_offset);
  } else {
    pending.lower = -infinity;  // may be no hit: what is kept stays
  }
  keep(pending, reference);
  pending.triangle = triangle;
}

__device__ __forceinline__ void closest_in_leaf(const LeafTriangle *triangles, const NearRay &ray, float tmin,
                                                uint32_t leaf, uint32_t left_out, float &end,
                                                Pending &pending)
{
  const uint32_t first = leaf_first(leaf), past = first + leaf_size(leaf);
  for (uint32_t k = first; k < past; ++k) {
    const LeafTriangle x = load_triangle(triangles, k);
    closest_in_triangle(x, x.triangle, k, ray, tmin, left_out, end, pending);
  }
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
    keep(pending, reference);
  } else {
    pending.count = max_candidates + 1;
  }
  return false;
}

__device__ __forceinline__ bool any_in_leaf(const LeafTriangle *triangles, const NearRay &ray, float tmin,
                                            float tmax, uint32_t leaf, uint32_t left_out, uint32_t ended_at,
                                            Pending &pending)
{
  const uint32_t first = leaf_first(leaf), past = first + leaf_size(leaf);
  for (uint32_t k = first; k < past; ++k) {
    if (any_in_triangle(load_triangle(triangles, k), k, ray, tmin, tmax, left_out, ended_at, pending))
      return true;
  }
  return false;
}

// Rays of which more than one triangle has to be measured, or that have to be listed.
__device__ __forceinline__ void hand_over_group(const NearBatch &batch, uint32_t i, const Pending &pending)
{
  const uint32_t k = pending.count <= max_candidates ? atomicAdd(batch.num_groups, 1u) : batch.group_capacity;
  if (k >= batch.group_capacity) {
    list_ray(batch, i);
    return;
  }
  CandidateGroup &group = batch.groups[k];
  group.ray = i;
  group.references[0] = pending.reference;
  static_assert(max_candidates == 4);
  group.references[1] = pending.count > 1 ? pending.second : no_candidate;
  group.references[2] = pending.count > 2 ? pending.third : no_candidate;
  group.references[3] = pending.count > 3 ? pending.fourth : no_candidate;
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
    store_hit(static_cast<CompactHit *>(batch.results), i, CompactHit{hit.t, hit.u, hit.v, primitive},
              batch.aligned_results);
  } else if (batch.layout == HitLayout::Internal) {
    static_cast<Hit *>(batch.results)[i] = hit;
  } else {
    store_hit(static_cast<FullHit *>(batch.results), i, full_hit(s.scene, hit), batch.aligned_results);
  }
}

// Measures and writes the hit of a ray with one candidate or none; others are handed over.
__device__ __forceinline__ void finish_closest(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                               const Pending &pending)
{
  if (pending.count > 1) {
    hand_over_group(batch, i, pending);
    return;
  }
  const Ray ray = load_ray(batch.rays, i, batch.aligned_rays);  // again, rather than kept in registers
  Hit best = {ray.tmax, 0.0f, 0.0f, invalid_id, invalid_id};
  uint32_t primitive = invalid_id;
  if (pending.count != 0) {
    const LeafTriangle x = load_triangle(s.near_triangles, pending.reference);
    TriangleHit hit;
    bool is_clear = true;
    if (measure(s, x, ray, hit, is_clear)) {
      best = {hit.t, hit.u, hit.v, x.triangle, invalid_id};
      primitive = x.primitive;
    }
    if (!is_clear) {
      list_ray(batch, i);
      return;
    }
  }
  store_closest(s, batch, i, best, primitive);
}

// Keeps what a ray has found for measure_taken().
__device__ __forceinline__ void hand_over(const NearBatch &batch, uint32_t i, const Pending &pending)
{
  batch.candidates[i] = pending.count == 1   ? pending.reference
                        : pending.count == 0 ? no_candidate
                                             : listed_candidate;
  if (pending.count > 1) hand_over_group(batch, i, pending);
}

// Measures what the rays of a warp found, all lanes at once, once all of them have ended: amid traversal few end at a time,
// and its registers would be in the way. `taken` are the last 32 that the warp took, invalid_id if it took none.
__device__ __forceinline__ void measure_taken(const TraceScene &s, const NearBatch &batch, uint32_t taken)
{
  __syncwarp();
  for (; taken != invalid_id; taken = batch.taken_before[taken / 32]) {
    const uint32_t i = taken + threadIdx.x % 32;
    if (i >= batch.num_rays) continue;
    Pending pending;
    pending.reference = batch.candidates[i];
    if (pending.reference == listed_candidate) continue;
    pending.count = pending.reference == no_candidate ? 0 : 1;
    finish_closest(s, batch, i, pending);
  }
}

__device__ __forceinline__ void finish_any(const NearBatch &batch, uint32_t i, bool found,
                                           const Pending &pending)
{
  if (found || pending.count == 0) static_cast<uint8_t *>(batch.results)[i] = found ? 1 : 0;
  else hand_over_group(batch, i, pending);
}

#endif

}  // namespace gpurt::cuda
