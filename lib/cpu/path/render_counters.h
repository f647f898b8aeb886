// What the kernels of a thread counted, as backends report it.
#pragma once

#include "backend.h"
#include "core/path/path_pipeline.h"
#include "cpu/path/path_kernel.h"
#include "steady_seconds.h"

namespace gpurt {

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
