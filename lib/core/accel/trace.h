// Ray queries over a scene: group 0 in world space, then the placements of shared geometries through a tree over their
// bounds. Closest hit, any hit and all hits differ in their visitor alone.
//
// `Accel` is KdAccelView, BvhAccelView, or another type for which group_tree() and test_leaf() exist and that has a tree
// `placements`: backends lay out leaves as suits them. Kernels are compiled with and without alpha masks (`Masks`) and
// shared geometries (`Placements`): those without what a scene lacks are smaller and faster.
#pragma once

#include "core/accel/bvh_accel.h"
#include "core/accel/bvh_traverse.h"
#include "core/accel/hit_ids.h"
#include "core/accel/kd_accel.h"
#include "core/accel/kd_traverse.h"
#include "core/scene/surface.h"

namespace gpurt {

// A placement lies in many leaves of the placements' tree: the last few visited are not visited again.
struct PlacementMailbox {
  uint32_t recent[4];
  uint32_t next;
};

GPURT_FUNCTIONS_BEGIN

// Either tree. `Ordered`: leaves that are met early lower the limit for later ones.
template <bool Ordered, class LeafAction>
GPURT_INLINE void traverse(const KdTreeView &tree, const TraceRay &ray, float &t_limit, LeafAction &&leaf)
{
  traverse_kd(tree, ray, t_limit, leaf);
}
template <bool Ordered, class LeafAction>
GPURT_INLINE void traverse(const BvhView &tree, const TraceRay &ray, float &t_limit, LeafAction &&leaf)
{
  traverse_bvh<Ordered>(tree, ray, t_limit, leaf);
}

GPURT_INLINE bool enter_placement(PlacementMailbox &mailbox, uint32_t placement)
{
  for (int i = 0; i < 4; ++i) {
    if (mailbox.recent[i] == placement) return false;
  }
#if defined(__CUDA_ARCH__)
  // A shift register, so that it can live in registers.
  mailbox.recent[3] = mailbox.recent[2];
  mailbox.recent[2] = mailbox.recent[1];
  mailbox.recent[1] = mailbox.recent[0];
  mailbox.recent[0] = placement;
#else
  mailbox.recent[mailbox.next++ & 3u] = placement;
#endif
  return true;
}

// ray_key where a visitor wants it.
template <bool Masks>
GPURT_INLINE uint64_t pass_key(const TraceRay &ray)
{
  return Masks ? ray_key(ray) : 0;
}

// Keeps the nearest hit; of several at the same t that with the smaller (instance, primitive).
template <bool Masks>
struct ClosestVisitor {
  static constexpr bool is_ordered = true;
  const SceneView *scene;
  float limit;  // largest t of interest
  Hit best;
  uint64_t key;  // of the ray, see pass_key

  GPURT_HD bool operator()(uint32_t triangle, uint32_t placement, const TriangleHit &h)
  {
    const Hit hit = {h.t, h.u, h.v, triangle, placement};
    if (best.triangle != invalid_id && h.t == best.t && !ids_precede(*scene, hit, best)) return false;
    if (Masks && lets_pass(*scene, key, triangle, placement, h.u, h.v)) return false;
    best = hit;
    limit = h.t;
    return false;
  }
};

template <bool Masks>
struct AnyVisitor {
  static constexpr bool is_ordered = false;
  const SceneView *scene;
  float limit;
  bool found;
  uint64_t key;

  GPURT_HD bool operator()(uint32_t triangle, uint32_t placement, const TriangleHit &h)
  {
    if (Masks && lets_pass(*scene, key, triangle, placement, h.u, h.v)) return false;
    return found = true;
  }
};

// Hands every hit to `sink`, in no order; a triangle that lies in several leaves comes several times, with equal bits.
template <bool Masks, class Sink>
struct AllVisitor {
  static constexpr bool is_ordered = false;
  const SceneView *scene;
  float limit;
  Sink &sink;
  uint64_t key;

  GPURT_HD bool operator()(uint32_t triangle, uint32_t placement, const TriangleHit &h)
  {
    if (Masks && lets_pass(*scene, key, triangle, placement, h.u, h.v)) return false;
    sink(Hit{h.t, h.u, h.v, triangle, placement});
    return false;
  }
};

// Traverses one group. `ray` is in the group's space; its t is the visitor's t times 2^exponent.
// Returns true if the visitor asked to stop.
template <TriangleTest Test, EdgeRule Rule, class Accel, class Visitor>
GPURT_HD inline bool trace_group(const Accel &accel, uint32_t group, const TraceRay &ray, int exponent,
                                 uint32_t placement, Visitor &visitor)
{
  TriangleRay<Test> triangle_ray;
  make_triangle_ray(ray, triangle_ray);
  float limit = exponent == 0 ? visitor.limit : scale_by_power(visitor.limit, exponent);
  bool is_done = false;
  // The triangle that the visitor saw last: met again in the next leaf, it would meet with the same answer.
  uint32_t known = invalid_id;
  const auto on_hit = [&](uint32_t triangle, TriangleHit hit) {
    if (exponent != 0) hit.t = scale_by_power(hit.t, -exponent);
    known = triangle;
    is_done = visitor(triangle, placement, hit);
    limit = exponent == 0 ? visitor.limit : scale_by_power(visitor.limit, exponent);
    return is_done;
  };
  traverse<Visitor::is_ordered>(group_tree(accel, group), ray, limit, [&](uint32_t first, uint32_t count) {
    return test_leaf<Rule>(accel, group, first, count, triangle_ray, ray.tmin, limit, known, on_hit);
  });
  return is_done;
}

// Traverses the groups of placements, nearest cells first.
template <TriangleTest Test, EdgeRule Rule, class Accel, class Visitor>
GPURT_HD inline void trace_placements(const Accel &accel, const SceneView &scene, const TraceRay &ray,
                                      Visitor &visitor)
{
  PlacementMailbox mailbox = {{invalid_id, invalid_id, invalid_id, invalid_id}, 0};
  traverse<Visitor::is_ordered>(accel.placements, ray, visitor.limit, [&](uint32_t first, uint32_t count) {
    for (uint32_t i = 0; i < count; ++i) {
      const uint32_t id = accel.placements.references[first + i];
      if (!enter_placement(mailbox, id)) continue;
      const Placement &p = scene.placements[id];
      // The direction is not normalised, so that t keeps its unit.
      TraceRay object_ray;
      if (!prepare_ray(transform_point(p.world_to_object, ray.origin),
                       transform_vector(p.world_to_object, ray.direction), ray.tmin, ray.tmax, object_ray)) {
        continue;
      }
      if (trace_group<Test, Rule>(accel, p.group, object_ray, object_ray.exponent, id, visitor)) return true;
    }
    return false;
  });
}

// Shows the visitor every hit that may interest it.
template <TriangleTest Test, EdgeRule Rule, bool Placements, class Accel, class Visitor>
GPURT_HD inline void trace_ray(const Accel &accel, const SceneView &scene, const TraceRay &ray,
                               Visitor &visitor)
{
  if (trace_group<Test, Rule>(accel, 0, ray, 0, invalid_id, visitor)) return;
  if constexpr (Placements) trace_placements<Test, Rule>(accel, scene, ray, visitor);
}

template <TriangleTest Test, bool Masks, bool Placements, class Accel>
GPURT_HD inline Hit trace_closest(const Accel &accel, const SceneView &scene, const Ray &ray)
{
  const Hit miss = {ray.tmax, 0.0f, 0.0f, invalid_id, invalid_id};
  TraceRay r;
  if (!prepare_ray(ray.origin, ray.direction, ray.tmin, ray.tmax, r)) return miss;
  ClosestVisitor<Masks> visitor{&scene, r.tmax, miss, pass_key<Masks>(r)};
  trace_ray<Test, EdgeRule::Inclusive, Placements>(accel, scene, r, visitor);
  if (visitor.best.triangle != invalid_id) visitor.best.t = caller_t(r, visitor.best.t);
  return visitor.best;
}

template <TriangleTest Test, bool Masks, bool Placements, class Accel>
GPURT_HD inline bool trace_any(const Accel &accel, const SceneView &scene, const Ray &ray)
{
  TraceRay r;
  if (!prepare_ray(ray.origin, ray.direction, ray.tmin, ray.tmax, r)) return false;
  AnyVisitor<Masks> visitor{&scene, r.tmax, false, pass_key<Masks>(r)};
  trace_ray<Test, EdgeRule::Inclusive, Placements>(accel, scene, r, visitor);
  return visitor.found;
}

// Calls sink(hit) for every crossing, unsorted and with repetitions.
template <TriangleTest Test, bool Masks, bool Placements, class Accel, class Sink>
GPURT_HD inline void trace_all(const Accel &accel, const SceneView &scene, const Ray &ray, Sink &&sink)
{
  TraceRay r;
  if (!prepare_ray(ray.origin, ray.direction, ray.tmin, ray.tmax, r)) return;
  const auto rescaled = [&](Hit hit) {
    hit.t = caller_t(r, hit.t);
    sink(hit);
  };
  AllVisitor<Masks, decltype(rescaled)> visitor{&scene, r.tmax, rescaled, pass_key<Masks>(r)};
  trace_ray<Test, EdgeRule::HalfOpen, Placements>(accel, scene, r, visitor);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
