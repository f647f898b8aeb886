// The path tracer's inner loop on one CPU thread: a wave of paths, compiled once per instruction set.
#pragma once

#include "core/path/path_settings.h"
#include "core/scene/scene_view.h"
#include "cpu/accel/cpu_accel.h"

namespace gpurt {

struct FilmView;
struct PathUnit;
struct PathWave;

// What a thread spent and did; plain numbers, so that no library type crosses into the per-instruction-set code.
struct PathKernelCounters {
  uint64_t num_camera_rays, num_bounce_rays, num_shadow_rays;
  double stage_seconds[5];  // by PathStage
  float largest_sample;
};

// Renders paths 0 .. num_paths - 1 of the unit into its film; the wave has room for them.
using PathKernel = void (*)(const CpuAccel &accel, const SceneView &scene, const PathSettings &settings,
                            const PathUnit &unit, const PathWave &wave, const FilmView &film,
                            uint32_t num_paths, double (*seconds)(), PathKernelCounters &counters);

}  // namespace gpurt
