// What a path-traced frame is made with: everything that decides the image's bits beside the scene.
#pragma once

#include "core/math/vec.h"

namespace gpurt {

struct Camera {
  Transform camera_to_world;  // orthonormal
  float tan_half_yfov;
  uint32_t width, height;
};

struct PathSettings {
  Camera camera;
  uint64_t seed;
  uint32_t frame_index;
  uint32_t max_depth;  // emission seen directly is 1, direct light 2
};

}  // namespace gpurt
