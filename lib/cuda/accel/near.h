// The fast kernels of bvhs and kd-trees as host code calls them: closest and any hits of scenes without placements and alpha masks, by the
// watertight test.
#pragma once

#include "cuda/accel/kernels.h"
#include "cuda/accel/tiled_rows.h"

namespace gpurt::cuda {

// What a ray may hit, till it is measured: a reference of the tree, or one of these.
constexpr uint32_t no_candidate = invalid_id;
constexpr uint32_t listed_candidate = invalid_id - 1;  // the ray is in a group of candidates, or listed
constexpr uint32_t max_candidates = 4;
struct CandidateGroup {
  uint32_t ray;
  uint32_t references[max_candidates];
};

/// Rays of a launch, where their results go, and what the kernels hand to one another.
struct NearBatch {
  const Ray *rays;
  uint32_t num_rays;
  HitLayout layout;  // of closest hits
  void *results;     // hits, or a byte a ray
  bool aligned_rays, aligned_results;
  uint32_t *next_ray;                   // the pool's counter
  const uint32_t *left_out, *ended_at;  // as in RayOrder
  const uint32_t *probed;  // what the rays' order was found to be, a Coherence; null: known before the launch
  uint32_t *num_groups;    // groups of candidates; those beyond the capacity are listed rays
  uint32_t *
      num_listed;  // rays that are left; where there are more than the list has room for, all are traced again
  uint32_t *candidates;  // [num_rays], of closest hits by warps that refill
  uint32_t
      *taken_before;  // [num_rays / 32, rounded up]: what the warp that took these 32 rays had taken before
  CandidateGroup *groups;
  uint32_t *listed;
  uint32_t group_capacity, list_capacity;
};

/// Whether the fast kernels can trace the scene.
inline bool has_near_kernels(const TraceScene &scene)
{
  return scene.triangle_test == TriangleTest::Watertight && scene.scene.num_placements == 0 &&
         !scene.scene.has_alpha_masks &&
         (scene.has_bvhs ? scene.world.tree.frame.reach : scene.near_kd.frame.reach) > 0.0f;
}

/// Answers all rays of the batch.
void launch_near(const TraceScene &scene, TraceQuery query, const Ray *rays, uint32_t num_rays,
                 HitLayout layout, void *results, const RayOrder &order, cudaStream_t stream);

// Parts of it: a look at the rays' order; a thread a ray, in tiles where `width` is not 0; persistent warps that refill; the
// hits that these found; rays with several candidates, and what is listed.
void launch_near_probe(const NearBatch &batch, uint32_t *probed, cudaStream_t stream);
void launch_near_plain(const TraceScene &scene, TraceQuery query, const NearBatch &batch, uint32_t width,
                       cudaStream_t stream);
void launch_near_refill(const TraceScene &scene, TraceQuery query, const NearBatch &batch,
                        cudaStream_t stream);
// The same for kd-trees.
void launch_near_kd_plain(const TraceScene &scene, TraceQuery query, const NearBatch &batch, uint32_t width,
                          cudaStream_t stream);
void launch_near_kd_refill(const TraceScene &scene, TraceQuery query, const NearBatch &batch,
                           cudaStream_t stream);
void launch_near_finish(const TraceScene &scene, TraceQuery query, const NearBatch &batch,
                        cudaStream_t stream);

}  // namespace gpurt::cuda
