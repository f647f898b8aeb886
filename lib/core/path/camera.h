// Eye rays of a pinhole camera.
#pragma once

#include "core/accel/ray.h"
#include "core/path/path_settings.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

// The ray through raster position (x, y), in pixels from the top left corner. Its direction has unit length;
// `depth_per_t` turns its t into the distance from the camera's plane.
GPURT_INLINE Ray camera_ray(const Camera &camera, float x, float y, float &depth_per_t)
{
  const float scale = 2.0f * camera.tan_half_yfov / float(camera.height);
  const Vec3f d = normalize(
      Vec3f{(x - 0.5f * float(camera.width)) * scale, (0.5f * float(camera.height) - y) * scale, -1.0f});
  depth_per_t = -d.z;
  const Transform &m = camera.camera_to_world;
  return {{m.m[0][3], m.m[1][3], m.m[2][3]}, 0.0f, transform_vector(m, d), infinity};
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
