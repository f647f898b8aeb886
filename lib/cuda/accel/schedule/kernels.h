// The scheduled query kernels as host code calls them: other ways through a tree than a thread's fused loop, with the same
// hits bit for bit.
//
// Those of kd-trees exist for the watertight test, once for scenes without alpha masks and shared geometries, once for all
// others.
#pragma once

#include "core/accel/kd_traverse.h"
#include "cuda/accel/kernels.h"

namespace gpurt::cuda {

/// What the kernels count, in device memory.
struct DeviceCounters {
  unsigned long long ray_refills, list_overflows, mode_switches, packets, shared_triangles;
};

/// Where persistent threads draw their work from: how much is gone, in device memory, 0 before the launch.
struct RayPool {
  unsigned long long *num_drawn;
};

/// Rays and what becomes of them. Closest hits go to `hits`, any hits to `occluded`; the other one is null.
struct RayBatch {
  const Ray *rays;
  uint64_t num_rays;
  HitLayout layout;
  void *hits;
  uint8_t *occluded;
};

/// Leaves that a list holds.
constexpr uint32_t leaf_list_size = 8;

/// A leaf on a ray's list.
struct ListedLeaf {
  uint32_t first, count;
  float begin;  // of the leaf's interval along the ray
};

/// Where rays stand between the two kernels, for up to `capacity` of them; arrays of arrays have `capacity` columns.
struct LeafListState {
  uint32_t capacity;
  KdEntry *stacks;     // [kd_max_depth]
  ListedLeaf *leaves;  // [leaf_list_size]
  uint32_t *num_todo, *num_leaves;
  Hit *hits;                       // best so far, t in the units of the prepared ray
  uint32_t *active[2];             // rays that have leaves left, of this round and of the next
  unsigned long long *num_active;  // of the next round
};

GPURT_KERNELS_BEGIN

/// Rays drawn from a pool, their lanes refilled as they run dry; traversal with a stack.
void launch_persistent_stack(const TraceScene &scene, const RayBatch &batch, RayPool pool,
                             DeviceCounters *counters, cudaStream_t stream);

/// The same in bvhs, by any triangle test: a warp draws 32 rays and traces them to their ends.
void launch_persistent_rays(const TraceScene &scene, const RayBatch &batch, RayPool pool,
                            DeviceCounters *counters, cudaStream_t stream);

/// A warp's rays traverse together and share triangles. `pool` is null for a regular launch.
void launch_packets(const TraceScene &scene, const RayBatch &batch, RayPool pool, DeviceCounters *counters,
                    cudaStream_t stream);

/// Warps that switch between selecting leaves and testing triangles. `pool` is null for a regular launch.
void launch_uber(const TraceScene &scene, const RayBatch &batch, RayPool pool, DeviceCounters *counters,
                 cudaStream_t stream);

/// Selects leaves for `num_active` rays: those of state.active[0], or in the first round all of the batch.
void launch_select_leaves(const TraceScene &scene, const RayBatch &batch, const LeafListState &state,
                          uint32_t num_active, bool is_first, RayPool pool, DeviceCounters *counters,
                          cudaStream_t stream);
/// Tests their triangles; rays that are not done go to state.active[1].
void launch_intersect_leaves(const TraceScene &scene, const RayBatch &batch, const LeafListState &state,
                             uint32_t num_active, bool is_first, RayPool pool, DeviceCounters *counters,
                             cudaStream_t stream);
/// Traces shared geometries and writes the results of the whole batch.
void launch_finish_lists(const TraceScene &scene, const RayBatch &batch, const LeafListState &state,
                         cudaStream_t stream);

GPURT_KERNELS_END

}  // namespace gpurt::cuda
