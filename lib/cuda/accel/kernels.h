// The query kernels as host code calls them.
#pragma once

#include <cuda_runtime_api.h>

#include "core/accel/bvh_accel.h"
#include "core/accel/hit_ids.h"
#include "core/accel/kd_accel.h"
#include "core/accel/kd_quad.h"
#include "core/scene/scene_view.h"

// Kernels and what starts them stand between these: the same files are compiled once more to count lanes, in a namespace of
// their own (cuda/accel/counting).
#ifndef GPURT_KERNELS
#define GPURT_KERNELS plain
#endif
#define GPURT_KERNELS_BEGIN inline namespace GPURT_KERNELS {
#define GPURT_KERNELS_END }

namespace gpurt::cuda {

class SliceSize;  // cuda/accel/ray_slices.h

#if defined(GPURT_COUNTS_LANES)
constexpr bool counts_lanes = true;
#else
constexpr bool counts_lanes = false;
#endif

/// What a query kernel reads; all pointers lead to device memory.
struct TraceScene {
  SliceSize *slices;  // of the host: how many rays are launched at a time
  KdAccelView kd_trees;
  BvhAccelView bvhs;
  bool has_bvhs;                       // else kd-trees
  BvhGroupView world;                  // of bvhs.groups[0]
  KdQuadView kd_quads;                 // of kd_trees.groups[0]; nodes may be null
  const LeafTriangle *near_triangles;  // that the fast kernels name, of either
  int num_sms;                         // of the device
  bool is_cached;  // trees and their triangles are no larger than the device's second-level cache
  SceneView scene;
  TriangleTest triangle_test;
};

/// Whether neighbours in a batch go nearly the same way; values of gpurt::Coherence.
enum class Coherence : uint32_t { Auto = 0, Coherent = 1, Incoherent = 2 };

enum class TraceQuery : uint32_t { Closest, Any };

/// How a closest hit is written: Hit, FullHit or CompactHit.
enum class HitLayout : uint32_t { Internal, Full, Compact };

/// What is known of the order of rays, and memory for kernels that use it.
struct RayOrder {
  Coherence coherence = Coherence::Incoherent;
  uint32_t width = 0;  // rays are those of an image, row by row, of this many; 0: not
  uint32_t *scratch =
      nullptr;  // trace_scratch_words(num_rays) words of device memory; null: kernels without are taken
  // Triangles that a ray is known not to meet, invalid_id for none; null: nothing is known. Closest hits look at the first
  // alone.
  const uint32_t *left_out = nullptr, *ended_at = nullptr;
};
/// What kernels of persistent threads with stacks are called, whichever serve the scene.
constexpr const char *persistent_kernel_name = "kernel of persistent threads with stacks";

GPURT_KERNELS_BEGIN

uint64_t trace_scratch_words(uint64_t num_rays);

// Each starts its kernels on the stream and returns. Rays and hits need the alignment of their members alone; fewer than
// 2^31 rays at a time.
void launch_closest(const TraceScene &scene, const Ray *rays, uint64_t num_rays, HitLayout layout, void *hits,
                    const RayOrder &order, cudaStream_t stream);
void launch_any(const TraceScene &scene, const Ray *rays, uint64_t num_rays, uint8_t *occluded,
                const RayOrder &order, cudaStream_t stream);

GPURT_KERNELS_END

/// The number of crossings of every ray; a triangle that lies in several leaves counts several times.
void launch_count_all(const TraceScene &scene, const Ray *rays, uint64_t num_rays, uint64_t *counts,
                      cudaStream_t stream);
/// Lists the crossings of ray i from listed[offsets[i] - first_listed] on, sorts them and drops repetitions; counts[i]
/// are left. `offsets` are the sums of what launch_count_all counted.
void launch_list_all(const TraceScene &scene, const Ray *rays, uint64_t num_rays, const uint64_t *offsets,
                     uint64_t first_listed, Hit *listed, uint64_t *counts, cudaStream_t stream);
/// Writes them from hits[hit_offsets[i] - first_hit] on. `hit_offsets` are the sums of what launch_list_all counted.
void launch_write_all(const SceneView &scene, uint64_t num_rays, const uint64_t *offsets,
                      uint64_t first_listed, const Hit *listed, const uint64_t *hit_offsets,
                      uint64_t first_hit, bool compact, void *hits, cudaStream_t stream);

/// triangles[i] = the triangle references[i] of the group that begins at first_triangle.
void launch_gather_leaf_triangles(const SceneView &scene, uint32_t first_triangle, const uint32_t *references,
                                  uint64_t num_references, LeafTriangle *triangles, cudaStream_t stream);

/// Bytes of scratch memory that scan_counts wants for n values.
uint64_t scan_scratch_bytes(uint64_t n);
/// sums[i] = base + counts[0] + ... + counts[i - 1]. `counts` and `sums` may be the same array.
void scan_counts(const uint64_t *counts, uint64_t n, uint64_t base, uint64_t *sums, void *scratch,
                 uint64_t scratch_bytes, cudaStream_t stream);

}  // namespace gpurt::cuda
