// The fast kernels of bvhs and kd-trees as host code calls them: closest and any hits by the watertight test, of rays and hits
// that lie at multiples of 16 bytes; kd-trees' of scenes without placements and alpha masks.
#pragma once

#include "cuda/accel/kernels.h"
#include "cuda/accel/tiled_rows.h"

namespace gpurt::cuda {

// A triangle that a ray may hit, till it is measured: a reference of the tree, with a bit where single precision cannot tell
// whether the triangle is hit.
constexpr uint32_t unclear_bit = 0x80000000u;
constexpr uint64_t max_near_references = uint64_t(1) << 31;
// Or one of these. What is left over is finished by a kernel of its own.
constexpr uint32_t no_candidate = invalid_id;
constexpr uint32_t left_over = invalid_id - 1;
constexpr uint32_t unlisted_left_over = invalid_id - 2;  // where Leftovers had no room
constexpr uint8_t unlisted_result = 2;                   // the same, of any hits

// A ray that is left over, with the triangles that it may hit; the first one is no_candidate where it has to go the general
// way.
constexpr uint32_t max_candidates = 4;
struct Leftover {
  uint32_t ray;
  uint32_t references[max_candidates];
};
// The same in scenes with placements.
struct PlacedLeftover : Leftover {
  uint32_t placements[max_candidates];  // invalid_id: in world space
};

/// Rays of a launch, where their results go, and what the kernels hand to one another.
struct NearBatch {
  const Ray *rays;
  uint32_t num_rays;
  HitLayout layout;                     // of closest hits
  void *results;                        // hits, or a byte a ray
  const uint32_t *left_out, *ended_at;  // as in RayOrder
  const uint32_t *probed;  // what the rays' order was found to be, a Coherence; null: known before the launch
  uint32_t *num_leftovers;  // may be more than there is room for
  Leftover *leftovers;      // or PlacedLeftovers
  uint32_t leftover_capacity;
  // Of warps that refill:
  uint32_t *next_ray;               // the pool's counter
  unsigned long long *num_refills;  // times that a warp refilled are added; null: not wanted
  uint32_t *candidates;             // [num_rays], of closest hits
};

/// What kernels are compiled for: a tree, and what the scene has. Each has what it needs alone, and is faster for it.
template <bool BvhValue, bool MasksValue = false, bool PlacementsValue = false>
struct NearKind {
  static constexpr bool bvh = BvhValue, masks = MasksValue, placements = PlacementsValue;
};

/// Calls fn(NearKind<...>{}) with what fits a scene that has_near_kernels(). Kernels that count lanes have both of masks and
/// placements or neither.
template <class Fn>
void dispatch_near(const TraceScene &scene, Fn &&fn)
{
  if (!scene.has_bvhs) return fn(NearKind<false>{});
  if (scene.scene.num_placements == 0) return fn(NearKind<true>{});
  if constexpr (!counts_lanes) {
    if (!scene.scene.has_alpha_masks) return fn(NearKind<true, false, true>{});
  }
  fn(NearKind<true, true, true>{});
}

/// Whether kd-trees' fast kernels may serve the scene, as far as it tells.
inline bool may_have_quads(const TraceScene &scene)
{
  return scene.triangle_test == TriangleTest::Watertight && scene.scene.num_placements == 0 &&
         !scene.scene.has_alpha_masks;
}

/// Whether the fast kernels can trace the scene.
inline bool has_near_kernels(const TraceScene &scene)
{
  const bool has_placements = scene.scene.num_placements != 0;
  if (scene.triangle_test != TriangleTest::Watertight) return false;
  if (!scene.has_bvhs) return may_have_quads(scene) && scene.kd_quads.frame.reach > 0.0f;
  const auto suits = [](const BvhView &tree) { return tree.frame.reach > 0.0f; };
  if (has_placements && scene.world.tree.root == bvh_empty) return suits(scene.bvhs.placements);
  return suits(scene.world.tree) && (!has_placements || suits(scene.bvhs.placements));
}

/// Whether they serve rays of paths, too: these leave surfaces, and the fast kernels have to be told which triangles they cannot
/// meet again. What is told of a placed triangle would be told of all of its placements; rays that pass triangles leave out those.
inline bool has_near_kernels_for_paths(const TraceScene &scene)
{
  return has_near_kernels(scene) && scene.scene.num_placements == 0 && !scene.scene.has_alpha_masks;
}

/// Whether they have warps that refill for the scene.
inline bool has_near_refill(const TraceScene &scene)
{
  return !scene.scene.has_alpha_masks || scene.scene.num_placements != 0;
}

GPURT_KERNELS_BEGIN

/// Whether they serve these rays, too.
bool suits_near_kernels(const TraceScene &scene, const Ray *rays, HitLayout layout, const void *results,
                        const RayOrder &order);

/// Answers all rays of the batch.
void launch_near(const TraceScene &scene, TraceQuery query, const Ray *rays, uint32_t num_rays,
                 HitLayout layout, void *results, const RayOrder &order, cudaStream_t stream);

/// The same by warps that refill, whatever the order of the rays; adds how often they did to `num_refills`. For scenes that
/// has_near_refill().
void launch_near_persistent(const TraceScene &scene, TraceQuery query, const Ray *rays, uint32_t num_rays,
                            HitLayout layout, void *results, const RayOrder &order,
                            unsigned long long *num_refills, cudaStream_t stream);

// Parts of it: a look at the rays' order; a thread a ray, in tiles where `width` is not 0; persistent warps that refill; what
// these leave over.
void launch_near_probe(const NearBatch &batch, uint32_t *probed, cudaStream_t stream);
void launch_bvh_plain(const TraceScene &scene, TraceQuery query, const NearBatch &batch, uint32_t width,
                      cudaStream_t stream);
void launch_bvh_refill(const TraceScene &scene, TraceQuery query, const NearBatch &batch,
                       cudaStream_t stream);
// Of scenes with alpha masks and without placements: a thread a ray, whatever the order of rays. Leaves nothing over.
void launch_bvh_masked(const TraceScene &scene, TraceQuery query, const NearBatch &batch, uint32_t width,
                       cudaStream_t stream);
// Of scenes with placements.
void launch_bvh_placed_plain(const TraceScene &scene, TraceQuery query, const NearBatch &batch,
                             uint32_t width, cudaStream_t stream);
void launch_bvh_placed_refill(const TraceScene &scene, TraceQuery query, const NearBatch &batch,
                              cudaStream_t stream);
void launch_quad_plain(const TraceScene &scene, TraceQuery query, const NearBatch &batch, uint32_t width,
                       cudaStream_t stream);
void launch_quad_refill(const TraceScene &scene, TraceQuery query, const NearBatch &batch,
                        cudaStream_t stream);
void launch_near_finish(const TraceScene &scene, TraceQuery query, const NearBatch &batch,
                        cudaStream_t stream);

GPURT_KERNELS_END

}  // namespace gpurt::cuda
