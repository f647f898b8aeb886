// Runs stages one after another on the calling thread, for the loops that are compiled once per instruction set.
#pragma once

#include "core/path/path_pipeline.h"
#include "cpu/path/path_kernel.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN
namespace {

class SerialExecutor {
 public:
  SerialExecutor(const CpuAccel &accel, double (*seconds)(), PathKernelCounters &counters)
      : accel_(accel), seconds_(seconds), counters_(counters), last_(seconds())
  {}
  template <class Stage>
  void for_each(PathStage id, uint32_t n, const Stage &stage)
  {
    for (uint32_t i = 0; i < n; ++i) stage(i);
    charge(id);
  }

  void trace_closest(const Ray *rays, Hit *hits, uint32_t n)
  {
    accel_.closest(accel_, rays, hits, n);
    (is_first_trace_ ? counters_.num_camera_rays : counters_.num_bounce_rays) += n;
    is_first_trace_ = false;
    charge(PathStage::Trace);
  }

  void trace_occluded(const Ray *rays, uint8_t *occluded, uint32_t n)
  {
    if (n != 0) accel_.occluded(accel_, rays, occluded, n);
    counters_.num_shadow_rays += n;
    charge(PathStage::Shadow);
  }

  uint32_t compact_rays(const RayQueue &from, uint32_t n, const RayQueue &to)
  {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < n; ++i) {
      if (from.rays[i].tmax < 0.0f) continue;
      to.rays[kept] = from.rays[i];
      to.paths[kept++] = from.paths[i];
    }
    return kept;
  }

  uint32_t compact_shadows(const ShadowQueue &from, uint32_t n, const ShadowQueue &to)
  {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < n; ++i) {
      if (from.rays[i].tmax < 0.0f) continue;
      to.rays[kept] = from.rays[i];
      to.paths[kept] = from.paths[i];
      to.contributions[kept++] = from.contributions[i];
    }
    return kept;
  }

 protected:
  void charge(PathStage id)
  {
    const double now = seconds_();
    counters_.stage_seconds[uint32_t(id)] += now - last_;
    last_ = now;
  }

  const CpuAccel &accel_;
  double (*seconds_)();
  PathKernelCounters &counters_;
  double last_;
  bool is_first_trace_ = true;
};

}  // namespace
GPURT_FUNCTIONS_END
}  // namespace gpurt
