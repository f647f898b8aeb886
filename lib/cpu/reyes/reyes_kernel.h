// REYES on one CPU thread: a bucket of the image, compiled once per instruction set.
#pragma once

#include "core/accel/ray.h"
#include "core/path/path_settings.h"
#include "core/reyes/bound.h"
#include "core/reyes/reyes_scene.h"
#include "cpu/path/path_kernel.h"

namespace gpurt {

struct FilmView;
struct Fragment;
struct PathWave;
struct WideKernels;

// Pixels [x0, x1) x [y0, y1) with samples first_sample .. first_sample + num_samples - 1.
struct ReyesBucket {
  uint32_t x0, y0, x1, y1;
  uint64_t first_sample, num_samples;
  const uint32_t *roots;  // what may be seen there; null: all roots of the scene
  uint64_t num_roots;
  bool has_found_light;     // lamps or an environment: light that rays from surfaces may meet
  bool lights_by_rays;      // micropolygons' own light is found after visibility; see ray_light.h
  const WideKernels *wide;  // null: the processor has no vectors of 512 bits
};

// One thread's memory for the samples of a bucket.
struct ReyesMemory {
  float *place_x, *place_y;  // sample by sample: from the corner of its pixel, in pixels
  float *weight;             // of a sample's radiance
  float *x, *y, *z, *u, *v;  // as in SampleBlock: sorted by cells
  uint32_t *root;
  uint32_t *slot;   // where a sample lies in the sorted arrays
  uint32_t *first;  // of each cell
};

// A micropolygon, a block of them or a sample's point of a mesh, and its light.
struct ShadedPoint {
  uint32_t slot;   // of a sample that sees it
  uint32_t group;  // of the samples that it is for
  Vec3f light;
};

// Besides, where micropolygons' own light is found by rays.
struct PointMemory {
  ShadedPoint *points;  // as many as samples
  uint32_t *point_of;   // of each sample, by its slot
  uint32_t *table;      // of points, by their hashes
  uint32_t table_size;  // a power of two, above the number of samples
};

// Besides, for a bucket with surfaces that blend. All but the fragments are of a sample, by its slot.
struct BlendMemory {
  Fragment *fragments;
  uint64_t
      capacity;  // of these: one at least, or all slots, for each sample of smallest_blend_edge x smallest_blend_edge pixels
  uint32_t *count;     // of a sample's fragments
  uint32_t *first;     // of them
  Fragment *last;      // the last one that was shaded
  float *through;      // what is seen behind it
  float *to_standing;  // shares until the surface that stands for the sample; below 0 after it
  Vec3f *radiance;
  Hit *standing;    // what stands for the sample in outputs that do not blend
  uint32_t *owner;  // of each path of a wave: its sample
};

// Buckets are not made smaller than that for want of room for fragments.
constexpr uint32_t smallest_blend_edge = 8;

// What a thread spent and did.
struct ReyesKernelCounters {
  uint64_t num_patches, num_triangles, num_splits, num_culled, num_grids, num_micropolygons, num_fragments,
      num_shaded, largest_queue, largest_fragments, num_lost_fragments;
  double split_seconds, dice_seconds, sample_seconds;
  PathKernelCounters path;  // of shading
};

// Cells of a bucket's samples at most: half a pixel each, with four pixels around for filters.
constexpr uint64_t largest_cells(uint64_t bucket_edge) { return 4 * (bucket_edge + 8) * (bucket_edge + 8); }

struct ReyesKernels {
  /// Bounds of roots first .. first + n - 1 on the image, and how near to the eye their points are; empty boxes have x0 > x1.
  void (*bound)(const ReyesScene &scene, const Camera &camera, uint64_t first, uint32_t n, RasterBox *boxes,
                float *least_w);
  /// Finds what every sample of the bucket sees.
  void (*find_visible)(const ReyesScene &scene, const PathSettings &settings, const ReyesSettings &reyes,
                       const ReyesBucket &bucket, const ReyesMemory &memory, double (*seconds)(),
                       ReyesKernelCounters &counters);
  /// Shades what samples see and adds them to the bucket's film, a wave of at most wave_capacity at a time.
  void (*shade)(const CpuAccel &accel, const ReyesScene &scene, const PathSettings &settings,
                const ReyesSettings &reyes, const ReyesBucket &bucket, const ReyesMemory &memory,
                const PointMemory &points, const PathWave &wave, uint32_t wave_capacity, const FilmView &film,
                double (*seconds)(), ReyesKernelCounters &counters);
  /// Both, for scenes with surfaces that blend. Pixel (x, y) of the frame is pixel (x - bucket.x0, y - bucket.y0) of the film.
  void (*blend)(const CpuAccel &accel, const ReyesScene &scene, const PathSettings &settings,
                const ReyesSettings &reyes, const ReyesBucket &bucket, const ReyesMemory &memory,
                const BlendMemory &blend, const PathWave &wave, uint32_t wave_capacity, const FilmView &film,
                double (*seconds)(), ReyesKernelCounters &counters);
};

/// The kernels for an instruction set variant, by its name.
const ReyesKernels &reyes_kernels(const char *isa_name);

}  // namespace gpurt
