// Path tracing of one pass on a CUDA device.
#pragma once

#include "backend.h"
#include "cuda/accel/kernels.h"
#include "cuda/lanes.h"

namespace gpurt::cuda {

struct WaveCounters;

/// What waves counted, as backends report it.
RenderCounters counters_from(const WaveCounters &wave);

/// Renders the units of `pass`. Returns when all are delivered or left out by cancellation. The device must be current.
void render_on_device(const RenderPass &pass, const TraceScene &scene,
                      const std::shared_ptr<DeviceMemory> &memory, LanePool &lanes);

}  // namespace gpurt::cuda
