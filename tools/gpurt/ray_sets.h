// Rays that benchmarks trace: those that a frame would trace, and some without any order.
#pragma once

#include <vector>

#include "cli.h"

namespace cli {

struct RaySet {
  const char *name;
  gpurt_query query;
  std::vector<gpurt_ray> rays;
};

struct RaySetOptions {
  uint32_t width = 0, height = 0, camera = 0;
};

/// Primary (camera), diffuse (cosine-distributed from what the camera sees), ao (any hit within a tenth of the scene) and
/// random rays, about one a pixel each. The scene is committed and has the camera.
std::vector<RaySet> make_ray_sets(gpurt_scene scene, const RaySetOptions &options);

}  // namespace cli
