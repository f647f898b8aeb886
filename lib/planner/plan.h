// The planner: puts values for settings that were left to the library, and says why.
#pragma once

#include <string>
#include <vector>

#include "backend.h"

namespace gpurt {

/// Vertices of paths, where the caller leaves it open.
constexpr uint32_t default_max_depth = 17;

/// How a commit builds, and why.
struct BuildPlan {
  BuildOptions options;  // the accelerator is resolved, but where the backend has to look at the scene
  std::string reason;    // of the accelerator
  std::vector<std::string> warnings;  // settings that have no effect with this accelerator
};

/// Throws INVALID_ARGUMENT for settings out of range, UNSUPPORTED for an accelerator that the device does not have.
BuildPlan plan_build(const gpurt_build_desc &desc, const DeviceInfo &device, bool has_imported_trees);

/// What a job renders with, and why.
struct RenderPlan {
  gpurt_render_desc desc;  // pipeline, depth and the way to stop are resolved; tile_size 0 is left to the job
  std::string reason;
};

/// Throws INVALID_ARGUMENT, UNSUPPORTED.
RenderPlan plan_render(const gpurt_render_desc &desc);

}  // namespace gpurt
