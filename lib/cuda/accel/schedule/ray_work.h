// What scheduled kernels do to a ray, step by step: begin, test a leaf of the world's tree, finish. Only .cu files include
// this.
//
// The world's tree is traversed by schedule; shared geometries, whose trees lie behind transforms, by the fused loop once
// the world is done.
#pragma once

#include "core/accel/trace.h"
#include "cuda/accel/ray_io.h"
#include "cuda/accel/schedule/kernels.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

/// Writes a closest hit as the batch has it.
__device__ __forceinline__ void store_closest(const SceneView &scene, const RayBatch &batch, uint64_t i,
                                              bool aligned, const Hit &hit)
{
  if (batch.layout == HitLayout::Internal) static_cast<Hit *>(batch.hits)[i] = hit;
  else if (batch.layout == HitLayout::Compact)
    store_hit(static_cast<CompactHit *>(batch.hits), i, compact_hit(scene, hit), aligned);
  else store_hit(static_cast<FullHit *>(batch.hits), i, full_hit(scene, hit), aligned);
}

/// What a kernel is compiled for. `Everything`: alpha masks and shared geometries; else neither.
template <bool EverythingValue>
struct ClosestQuery {
  static constexpr bool everything = EverythingValue;
  using Visitor = ClosestVisitor<EverythingValue>;

  static GPURT_INLINE Visitor make_visitor(const SceneView &scene, const TraceRay &ray)
  {
    return {&scene, ray.tmax, {ray.tmax, 0.0f, 0.0f, invalid_id, invalid_id}, pass_key<EverythingValue>(ray)};
  }
  static __device__ __forceinline__ void store(const SceneView &scene, const RayBatch &batch, uint64_t i,
                                               bool aligned, const TraceRay &ray, float miss_t,
                                               const Visitor &visitor)
  {
    Hit hit = visitor.best;
    hit.t = hit.triangle != invalid_id ? caller_t(ray, hit.t) : miss_t;
    store_closest(scene, batch, i, aligned, hit);
  }
  static GPURT_INLINE bool is_decided(const Visitor &) { return false; }
  // What is kept of a query between kernels.
  static GPURT_INLINE void save(const Visitor &visitor, Hit &hit) { hit = visitor.best; }
  static GPURT_INLINE void restore(const Hit &hit, Visitor &visitor)
  {
    visitor.best = hit;
    visitor.limit = hit.t;
  }
};

template <bool EverythingValue>
struct AnyQuery {
  static constexpr bool everything = EverythingValue;
  using Visitor = AnyVisitor<EverythingValue>;

  static GPURT_INLINE Visitor make_visitor(const SceneView &scene, const TraceRay &ray)
  {
    return {&scene, ray.tmax, false, pass_key<EverythingValue>(ray)};
  }
  static __device__ __forceinline__ void store(const SceneView &, const RayBatch &batch, uint64_t i, bool,
                                               const TraceRay &, float, const Visitor &visitor)
  {
    batch.occluded[i] = visitor.found ? 1 : 0;
  }
  static GPURT_INLINE bool is_decided(const Visitor &visitor) { return visitor.found; }
  static GPURT_INLINE void save(const Visitor &visitor, Hit &hit)
  {
    if (visitor.found) hit.triangle = 0;
  }
  static GPURT_INLINE void restore(const Hit &hit, Visitor &visitor)
  {
    visitor.found = hit.triangle != invalid_id;
  }
};

/// Calls fn(Query{}) with what fits the scene and the batch.
template <class Fn>
void dispatch_query(const TraceScene &scene, const RayBatch &batch, Fn &&fn)
{
  const bool everything = scene.scene.has_alpha_masks || scene.scene.num_placements != 0;
  if constexpr (!counts_lanes) {
    if (batch.occluded != nullptr) {
      if (everything) fn(AnyQuery<true>{});
      else fn(AnyQuery<false>{});
      return;
    }
  }
  if (everything) fn(ClosestQuery<true>{});
  else fn(ClosestQuery<false>{});
}

/// Whether pointers of the batch allow 16-byte loads and stores.
struct Alignment {
  bool rays, hits;
};
inline Alignment alignment_of(const RayBatch &batch)
{
  return {is_aligned_16(batch.rays), is_aligned_16(batch.hits)};
}

/// One ray on its way.
template <class Query>
struct RayWork {
  TraceRay ray;
  KdRay kd;
  TriangleRay<TriangleTest::Watertight> triangle_ray;
  typename Query::Visitor visitor;
  uint32_t known;  // the triangle that the visitor saw last
  float miss_t;
  bool is_valid;

  /// Reads ray i. True if it meets the world's tree.
  __device__ __forceinline__ bool begin(const TraceScene &s, const Ray *rays, uint64_t i, bool aligned)
  {
    const Ray r = load_ray(rays, i, aligned);
    miss_t = r.tmax;
    known = invalid_id;
    ray.tmax = r.tmax;
    is_valid = prepare_ray(r.origin, r.direction, r.tmin, r.tmax, ray);
    visitor = Query::make_visitor(s.scene, ray);
    if (!is_valid) return false;
    make_triangle_ray(ray, triangle_ray);
    const KdTreeView &tree = s.kd_trees.groups[0].tree;
    if (tree.num_nodes == 0) return false;
    kd = make_kd_ray(ray, tree.bounds, visitor.limit);
    return kd.a <= kd.b;
  }

  /// Shows the visitor a hit. True if the query is decided.
  __device__ __forceinline__ bool visit(uint32_t triangle, const TriangleHit &hit)
  {
    known = triangle;
    return visitor(triangle, invalid_id, hit);
  }

  __device__ __forceinline__ bool test_leaf(const LeafTriangle *triangles, uint32_t first, uint32_t count)
  {
    return test_triangles<EdgeRule::Inclusive>(
        triangles + first, count, triangle_ray, ray.tmin, visitor.limit, known,
        [&](uint32_t triangle, const TriangleHit &hit) { return visit(triangle, hit); });
  }

  /// Whether what begins at `begin` along the ray may still matter.
  __device__ __forceinline__ bool is_within_limit(float begin) const
  {
    return !(begin > visitor.limit + kd.t_widening);
  }

  /// Traces shared geometries and writes the result.
  __device__ __forceinline__ void finish(const TraceScene &s, const RayBatch &batch, uint64_t i, bool aligned)
  {
    if constexpr (Query::everything) {
      if (is_valid && s.scene.num_placements != 0 && !Query::is_decided(visitor))
        trace_placements<TriangleTest::Watertight, EdgeRule::Inclusive>(s.kd_trees, s.scene, ray, visitor);
    }
    Query::store(s.scene, batch, i, aligned, ray, miss_t, visitor);
  }
};

constexpr unsigned warp_size = 32;
constexpr unsigned all_lanes = ~0u;

__device__ __forceinline__ unsigned lane_index() { return threadIdx.x % warp_size; }
__device__ __forceinline__ unsigned lanes_below() { return (1u << lane_index()) - 1u; }

__device__ __forceinline__ void add_count(unsigned long long *counter, uint32_t count)
{
  if (count != 0) atomicAdd(counter, static_cast<unsigned long long>(count));
}

__device__ __forceinline__ uint32_t warp_sum(uint32_t value)
{
  for (unsigned step = warp_size / 2; step != 0; step /= 2) value += __shfl_xor_sync(all_lanes, value, step);
  return value;
}

/// Draws `count` pieces of work for a warp, all of whose lanes call it; returns the first one.
__device__ __forceinline__ uint64_t draw(RayPool pool, unsigned count)
{
  unsigned long long first = 0;
  if (lane_index() == 0) first = atomicAdd(pool.num_drawn, static_cast<unsigned long long>(count));
  return __shfl_sync(all_lanes, first, 0);
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
