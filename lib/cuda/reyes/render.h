// REYES of one pass on a CUDA device.
#pragma once

#include "backend.h"
#include "cuda/accel/kernels.h"
#include "cuda/lanes.h"

namespace gpurt::cuda {

/// What REYES has to know of a committed scene beside its arrays, whose pointers are the device's.
struct ReyesDeviceScene {
  ReyesScene view;
  uint64_t num_roots;
  bool has_meshes;        // some of them are triangles
  bool has_found_light;   // lamps or an environment: light that rays from surfaces may meet
  bool has_blending;      // materials that let light through
  bool has_cutouts;       // others that have holes
  bool has_opaque;        // surfaces that do not blend
  bool may_show_nothing;  // some that blend let everything through in places
};

/// Renders the units of `pass`, which has settings of REYES. Returns when all are delivered or left out by cancellation.
/// The device must be current, and the schedule one with slots. Throws OUT_OF_MEMORY, and INVALID_ARGUMENT for more
/// primitives than ids.
void render_reyes_on_device(const RenderPass &pass, const TraceScene &scene, const ReyesDeviceScene &reyes,
                            const std::shared_ptr<DeviceMemory> &memory, LanePool &lanes);

/// How patches are cut and grids go through the stages. Throws UNSUPPORTED naming what there is not.
ReyesSchedule resolve_reyes_schedule(const Schedule &asked, const ReyesSettings &settings);

}  // namespace gpurt::cuda
