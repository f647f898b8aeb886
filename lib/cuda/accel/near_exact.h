// Triangles in the fast kernels of scenes with alpha masks or materials that blend: whether a ray passes one is decided where it
// is met.
//
// The closest hit must not end at a triangle that lets the ray pass, and whether it does depends on u and v to the bit, since
// the CPU decides by them. So such a triangle is measured in full, as the general way does, before it may lower the ray's end;
// then its t is known, and what is kept of it is a candidate like others, which nothing has to decide again. So are triangles
// that single precision is not clear about, since the way to do it is there.
#pragma once

#include "core/accel/trace.h"
#include "cuda/accel/near_lane.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

#if defined(__CUDACC__)

__device__ __forceinline__ bool may_let_pass(const SceneView &scene, const LeafTriangle &x)
{
  const Material &material = scene.materials[scene.segments[x.segment].material];
  return material.alpha_cutoff > 0.0f || material.blends != 0;
}

constexpr float no_t = __builtin_nanf("");

// The t at which a ray hits a triangle that does not let it pass; else no_t, which is not a number. With unclear_bit, it has to
// be found out whether it is hit. A call, which is what makes kernels for masks slower than those without: what the walk holds
// has to survive it, and of scenes without masks it took 35 to 45 % of the rate, seldom as it was called.
template <class Kind>
__device__ __noinline__ float exact_t(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                      uint32_t reference, uint32_t placement)
{
  const Ray ray = load_ray(batch.rays, i, true);
  Ray own = ray;
  const LeafTriangle x = load_triangle(enter_space<Kind>(s, placement, own), reference & ~unclear_bit);
  TriangleHit hit;
  bool is_clear = (reference & unclear_bit) == 0, is_hit = is_clear && measure(x, own, hit, is_clear);
  if (!is_clear)
    is_hit = intersect<EdgeRule::Inclusive>(triangle_ray_of(own), x.a, x.b, x.c, ray.tmin, ray.tmax, hit);
  if (!is_hit) return no_t;
  const float opacity = opacity_at(s.scene, x.triangle, hit.u, hit.v);
  if (!(opacity > 0.0f)) return no_t;
  if (opacity < 1.0f) {  // by the ray's hash, which others need not have
    TraceRay world;
    prepare_ray(ray.origin, ray.direction, ray.tmin, ray.tmax, world);
    if (lets_pass(s.scene, ray_key(world), x.triangle, placement, hit.u, hit.v)) return no_t;
  }
  return hit.t;
}

// Triangles of world space alone lie in one place: elsewhere, what a ray left may be met again.
__device__ __forceinline__ uint32_t placement_of(const Pending &) { return invalid_id; }
__device__ __forceinline__ uint32_t placement_of(const PlacedPending &pending) { return pending.placement; }
template <class P>
__device__ __forceinline__ uint32_t known_here(const P &pending, uint32_t known)
{
  return placement_of(pending) == invalid_id ? known : invalid_id;
}

// closest_in_triangle() for any kind of scene.
template <class Kind, class P>
__device__ __forceinline__ void closest_in(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                           const LeafTriangle &x, uint32_t triangle, uint32_t reference,
                                           const NearRay &ray, float tmin, uint32_t left_out, float &end,
                                           P &pending)
{
  left_out = known_here(pending, left_out);
  if constexpr (!Kind::masks) {
    closest_in_triangle(x, triangle, reference, ray, tmin, left_out, end, pending);
  } else {
    HitInterval t;
    const EdgeVerdict verdict = test_near(ray, x.a, x.b, x.c, t);
    if (verdict == EdgeVerdict::Outside || triangle == pending.triangle || x.triangle == left_out) return;
    const bool is_inside = verdict == EdgeVerdict::Inside;
    if (is_inside && (t.lower + ray.end_offset > end || t.upper < tmin)) return;
    if (!is_inside) reference |= unclear_bit;
    if (!is_inside || t.lower < tmin || may_let_pass(s.scene, x)) {
      pending.triangle = triangle;
      t.lower = t.upper = exact_t<Kind>(s, batch, i, reference, placement_of(pending));
      if (t.lower != t.lower) return;
    }
    take_hit(triangle, reference, t, ray, tmin, end, pending);
  }
}

// any_in_triangle() for any kind of scene.
template <class Kind, class P>
__device__ __forceinline__ bool any_in(const TraceScene &s, const NearBatch &batch, uint32_t i,
                                       const LeafTriangle &x, uint32_t reference, const NearRay &ray,
                                       float tmin, float tmax, uint32_t left_out, uint32_t ended_at,
                                       P &pending)
{
  left_out = known_here(pending, left_out);
  ended_at = known_here(pending, ended_at);
  if constexpr (!Kind::masks) {
    return any_in_triangle(x, reference, ray, tmin, tmax, left_out, ended_at, pending);
  } else {
    HitInterval t;
    const EdgeVerdict verdict = test_near(ray, x.a, x.b, x.c, t);
    if (verdict == EdgeVerdict::Outside || x.triangle == pending.triangle || x.triangle == left_out ||
        x.triangle == ended_at)
      return false;
    const bool is_inside = verdict == EdgeVerdict::Inside;
    if (is_inside && (t.lower > tmax || t.upper < tmin)) return false;
    if (is_inside && t.lower >= tmin && t.upper <= tmax && !may_let_pass(s.scene, x)) return true;
    pending.triangle = x.triangle;  // met again, it would be no hit again
    const float exact =
        exact_t<Kind>(s, batch, i, is_inside ? reference : reference | unclear_bit, placement_of(pending));
    return exact == exact;
  }
}

#endif

GPURT_KERNELS_END
}  // namespace gpurt::cuda
