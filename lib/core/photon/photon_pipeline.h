// The order of photon mapping's stages, once for every executor.
//
// An executor offers what path_pipeline.h lists, and
//   store(slots, n)   keeps the photons that are there (bounce > 0)
// Stages: emit, trace photons, (the backend builds a grid,) visible points, gather, resolve.
#pragma once

#include "core/path/path_pipeline.h"
#include "core/photon/disc_area.h"
#include "core/photon/near_vertex.h"

namespace gpurt {

GPURT_FUNCTIONS_BEGIN

// Traces photons first .. first + num_photons - 1 of a pass.
template <class Executor>
void trace_photons(Executor &exec, const SceneView &scene, const EmissionView &emission,
                   const PhotonUnit &unit, const PhotonWave &wave, uint32_t num_photons)
{
  exec.for_each(PathStage::Generate, num_photons, EmitPhotons{scene, emission, unit, wave});
  uint32_t num_rays = exec.compact_rays(wave.next_rays, num_photons, wave.rays);
  for (uint32_t num_hits = 1; num_rays != 0; ++num_hits) {
    exec.trace_closest(wave.rays.rays, wave.hits, num_rays);
    exec.for_each(PathStage::Shade, num_rays, ScatterPhoton{scene, unit, wave, num_hits});
    exec.store(wave.slots, num_rays);
    num_rays = exec.compact_rays(wave.next_rays, num_rays, wave.rays);
  }
}

// Lets the paths go on whose points of this depth have surfaces near them. The shadow rays of the step are done with.
template <class Executor>
void pass_near_points(Executor &exec, const PhotonPass &pass, const PathWave &wave, VisiblePoint *points,
                      uint32_t depth, uint32_t num_rays)
{
  if (!(pass.remedies & remedy_continue)) return;
  for (uint32_t k = 0; k < num_near_rays; ++k) {
    exec.for_each(PathStage::Generate, num_rays, AimNearRay{wave, points, pass, depth, k});
    const uint32_t num_aimed = exec.compact_shadows(wave.shadows, num_rays, wave.shadow_queue);
    if (num_aimed == 0) break;
    exec.trace_occluded(wave.shadow_queue.rays, wave.occluded, num_aimed);
    exec.for_each(PathStage::Shadow, num_aimed, PassNearPoint{wave, points});
  }
}

// Follows the unit's paths to their visible points. `film` takes what the eye rays met; its arrays may be null.
template <class Executor>
void trace_visible_points(Executor &exec, const SceneView &scene, const PathSettings &settings,
                          const PhotonPass &pass, const PathUnit &unit, const PathWave &wave,
                          const FilmView &film, VisiblePoint *points, uint32_t num_paths)
{
  exec.for_each(PathStage::Generate, num_paths, GenerateCameraRays{settings, unit, wave});
  uint32_t num_rays = num_paths;
  for (uint32_t depth = 1; num_rays != 0; ++depth) {
    exec.trace_closest(wave.rays.rays, wave.hits, num_rays);
    if (depth == 1 && (film.features != nullptr || film.first_hits != nullptr)) {
      const uint32_t num_pixels = min(film.width * film.height, num_paths);
      exec.for_each(PathStage::Film, num_pixels, AddFeatures{{scene, settings, film}, unit, wave, num_paths});
    }
    exec.for_each(PathStage::Shade, num_rays, ShadeEyeVertex{scene, settings, wave, points, depth});
    const uint32_t num_shadows = exec.compact_shadows(wave.shadows, num_rays, wave.shadow_queue);
    exec.trace_occluded(wave.shadow_queue.rays, wave.occluded, num_shadows);
    exec.for_each(PathStage::Shadow, num_shadows, AddDirectLight{wave});
    pass_near_points(exec, pass, wave, points, depth, num_rays);
    num_rays = exec.compact_rays(wave.next_rays, num_rays, wave.rays);
  }
}

// Measures how much of each visible point's disc lies on a surface.
template <class Executor>
void measure_discs(Executor &exec, const SceneView &scene, const PhotonPass &pass, const PathWave &wave,
                   VisiblePoint *points, uint32_t num_paths)
{
  if (!(pass.remedies & remedy_boundary)) return;
  for (uint32_t k = 0; k < max_disc_trials; ++k) {
    exec.for_each(PathStage::Generate, num_paths, AimDiscProbe{wave, points, pass, k});
    const uint32_t num_rays = exec.compact_rays(wave.next_rays, num_paths, wave.rays);
    if (num_rays == 0) break;
    exec.trace_closest(wave.rays.rays, wave.hits, num_rays);
    exec.for_each(PathStage::Shade, num_rays, EndDiscTrials{scene, wave, points, pass, k});
  }
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
