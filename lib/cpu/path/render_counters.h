// What the kernels of a thread counted, as backends report it.
#pragma once

#include <chrono>

#include "backend.h"
#include "core/path/path_pipeline.h"
#include "cpu/path/path_kernel.h"

namespace gpurt {

inline double steady_seconds()
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

inline RenderCounters counters_from(const PathKernelCounters &kernel, uint64_t num_samples)
{
  RenderCounters c;
  c.num_samples = num_samples;
  c.num_camera_rays = kernel.num_camera_rays;
  c.num_bounce_rays = kernel.num_bounce_rays;
  c.num_shadow_rays = kernel.num_shadow_rays;
  c.generate_seconds = kernel.stage_seconds[uint32_t(PathStage::Generate)];
  c.trace_seconds = kernel.stage_seconds[uint32_t(PathStage::Trace)];
  c.shade_seconds = kernel.stage_seconds[uint32_t(PathStage::Shade)];
  c.shadow_seconds = kernel.stage_seconds[uint32_t(PathStage::Shadow)];
  c.film_seconds = kernel.stage_seconds[uint32_t(PathStage::Film)];
  c.largest_sample = kernel.largest_sample;
  return c;
}

}  // namespace gpurt
