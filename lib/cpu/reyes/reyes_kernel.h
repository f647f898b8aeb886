// REYES on one CPU thread: a bucket of the image, compiled once per instruction set.
#pragma once

#include "core/accel/ray.h"
#include "core/path/path_settings.h"
#include "core/reyes/bound.h"
#include "core/reyes/reyes_scene.h"
#include "cpu/path/path_kernel.h"

namespace gpurt {

struct FilmView;
struct PathWave;

// Pixels [x0, x1) x [y0, y1) with samples first_sample .. first_sample + num_samples - 1.
struct ReyesBucket {
  uint32_t x0, y0, x1, y1;
  uint64_t first_sample, num_samples;
  const uint32_t *roots;  // what may be seen there, in ascending order; null: all roots of the scene
  uint64_t num_roots;
  bool has_found_light;  // lamps or an environment: light that rays from surfaces may meet
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

// What a thread spent and did.
struct ReyesKernelCounters {
  uint64_t num_patches, num_triangles, num_splits, num_culled, num_grids, num_micropolygons, num_fragments,
      num_shaded, largest_queue;
  double split_seconds, dice_seconds, sample_seconds;
  PathKernelCounters path;  // of shading
};

// Cells of a bucket's samples at most: half a pixel each, with four pixels around for filters.
constexpr uint64_t largest_cells(uint64_t bucket_edge) { return 4 * (bucket_edge + 8) * (bucket_edge + 8); }

struct ReyesKernels {
  /// Bounds of roots first .. first + n - 1 on the image; empty boxes have x0 > x1.
  void (*bound)(const ReyesScene &scene, const Camera &camera, uint64_t first, uint32_t n, RasterBox *boxes);
  /// Finds what every sample of the bucket sees.
  void (*find_visible)(const ReyesScene &scene, const PathSettings &settings, const ReyesSettings &reyes,
                       const ReyesBucket &bucket, const ReyesMemory &memory, double (*seconds)(),
                       ReyesKernelCounters &counters);
  /// Shades what samples see and adds them to the bucket's film, a wave of at most wave_capacity at a time.
  void (*shade)(const CpuAccel &accel, const ReyesScene &scene, const PathSettings &settings,
                const ReyesSettings &reyes, const ReyesBucket &bucket, const ReyesMemory &memory,
                const PathWave &wave, uint32_t wave_capacity, const FilmView &film, double (*seconds)(),
                ReyesKernelCounters &counters);
};

/// The kernels for an instruction set variant, by its name.
const ReyesKernels &reyes_kernels(const char *isa_name);

}  // namespace gpurt
