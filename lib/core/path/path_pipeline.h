// The order of a path tracer's stages, once for every executor.
//
// An executor offers
//   for_each(stage_id, n, stage)             runs stage(0) .. stage(n - 1)
//   trace_closest(rays, hits, n)             and trace_occluded(rays, occluded, n)
//   compact_rays(from, n, to)                keeps the rays that are there (tmax >= 0), in order; returns their number
//   compact_shadows(from, n, to)
// Source: Laine, Karras and Aila 2013 for the split into stages; the talk for their names.
#pragma once

#include "core/path/path_wave.h"

namespace gpurt {

enum class PathStage : uint32_t { Generate = 0, Trace = 1, Shade = 2, Shadow = 3, Film = 4, Count = 5 };

GPURT_FUNCTIONS_BEGIN

// Renders paths 0 .. num_paths - 1 of the unit into `film`.
template <class Executor>
void trace_paths(Executor &exec, const SceneView &scene, const PathSettings &settings, const PathUnit &unit,
                 const PathWave &wave, const FilmView &film, uint32_t num_paths)
{
  exec.for_each(PathStage::Generate, num_paths, GenerateCameraRays{settings, unit, wave});
  const uint32_t num_pixels = min(film.width * film.height, num_paths);
  uint32_t num_rays = num_paths;
  for (uint32_t depth = 1; num_rays != 0; ++depth) {
    exec.trace_closest(wave.rays.rays, wave.hits, num_rays);
    if (depth == 1 && (film.features != nullptr || film.first_hits != nullptr)) {
      exec.for_each(PathStage::Film, num_pixels, AddFeatures{{scene, settings, film}, unit, wave, num_paths});
    }
    exec.for_each(PathStage::Shade, num_rays, ShadePathVertex{scene, settings, wave, depth});
    const uint32_t num_shadows = exec.compact_shadows(wave.shadows, num_rays, wave.shadow_queue);
    exec.trace_occluded(wave.shadow_queue.rays, wave.occluded, num_shadows);
    exec.for_each(PathStage::Shadow, num_shadows, AddDirectLight{wave});
    num_rays = exec.compact_rays(wave.next_rays, num_rays, wave.rays);
  }
  exec.for_each(PathStage::Film, num_pixels, AddSamples{unit, wave, film, num_paths});
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
