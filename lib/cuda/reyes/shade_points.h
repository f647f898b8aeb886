// Stage 'shade' of micropolygons after visibility as host code calls it.
#pragma once

#include "cuda/reyes/stages.h"

namespace gpurt::cuda {

/// Points of a group, in device memory. A sample is called by the number of its path.
struct PointView {
  EyeHits eye;          // eye.unit is the whole group
  float edge2;          // of micropolygons of meshes: dice_triangle.h
  uint32_t is_sampled;  // 1: light is found by paths
  uint32_t num_samples;
  uint32_t *table;      // of samples that stand for points, by hashes of these; invalid_id: nothing
  uint32_t table_mask;  // a power of two less 1, above the number of samples
  uint32_t *point_of;   // [samples]: the one that stands for what it sees; invalid_id: it sees nothing
  uint32_t *points;     // those that stand for points
  uint32_t *num_points;
  Vec3f *light;  // [samples], of those
};

/// Samples of meshes learn which micropolygon they see; `spots` are those of view.eye.
void launch_dice_triangles(const PointView &view, unsigned long long *spots, cudaStream_t stream);
/// Finds the points that samples see; the table is empty and num_points 0 before.
void launch_find_points(const PointView &view, cudaStream_t stream);
/// Points first .. first + n - 1 as paths of a wave whose eye rays' hits are known.
void launch_point_paths(const PointView &view, const PathWave &wave, uint32_t first, uint32_t n,
                        cudaStream_t stream);
/// Their rays to a light without extent, into the wave's slots; paths without light before the first one.
void launch_point_shadows(const PointView &view, const PathWave &wave, uint32_t light, uint32_t first,
                          uint32_t n, cudaStream_t stream);
void launch_clear_paths(const PathWave &wave, uint32_t n, cudaStream_t stream);
/// What the paths found is the light of the points.
void launch_keep_point_light(const PointView &view, const PathWave &wave, uint32_t first, uint32_t n,
                             cudaStream_t stream);
/// Adds samples with the light of their points to a film of zeros.
void launch_resolve_points(const PointView &view, const FilmView &film, uint32_t num_pixels,
                           uint32_t *largest_bits, cudaStream_t stream);

}  // namespace gpurt::cuda
