// The inner loops of photon mapping on one CPU thread, compiled once per instruction set.
#pragma once

#include "core/photon/estimator.h"
#include "cpu/path/path_kernel.h"

namespace gpurt {

// Photons that a wave leaves behind; the array has room for all that it can leave.
struct PhotonChunk {
  Photon *photons;
  uint64_t num;
};

struct PhotonKernelCounters {
  PathKernelCounters path;
  uint64_t num_photon_rays, num_gathered, num_visible;
  double photon_seconds, emit_seconds, scatter_seconds, gather_seconds;
};

struct PhotonKernels {
  /// Traces photons unit.first .. unit.first + num_photons - 1.
  void (*trace)(const CpuAccel &accel, const SceneView &scene, const EmissionView &emission,
                const PhotonUnit &unit, const PhotonWave &wave, uint32_t num_photons, PhotonChunk &chunk,
                double (*seconds)(), PhotonKernelCounters &counters);
  /// Finds the visible points of the unit's paths and adds what they gather from the grid to `sums`. `statistics` are those
  /// of the frame's pixels; null for memoryless passes.
  void (*gather)(const CpuAccel &accel, const SceneView &scene, const PathSettings &settings,
                 const PhotonPass &pass, const PhotonGrid &grid, const PathUnit &unit, const PathWave &wave,
                 const FilmView &film, const PixelStatistics *statistics, VisiblePoint *points,
                 const PhotonSums &sums, uint32_t num_paths, double (*seconds)(),
                 PhotonKernelCounters &counters);
  /// Adds the paths that were gathered last to the film.
  void (*resolve)(const PhotonPass &pass, const PathUnit &unit, const PathWave &wave, const FilmView &film,
                  const VisiblePoint *points, const PhotonSums &sums, uint32_t num_paths,
                  PhotonKernelCounters &counters);
  /// Finds visible points alone.
  void (*find_points)(const CpuAccel &accel, const SceneView &scene, const PathSettings &settings,
                      const PathUnit &unit, const PathWave &wave, VisiblePoint *points, uint32_t num_paths,
                      double (*seconds)());
};

/// The kernels for an instruction set variant, by its name.
const PhotonKernels &photon_kernels(const char *isa_name);

}  // namespace gpurt
