// How far patches and the triangles that rays meet may be apart.
#pragma once

#include <cstdint>

namespace gpurt {

/// What is 0 sets no limit; both 0: 1e-4 of the diagonal of a geometry's control points, before it is placed.
struct PatchLimits {
  PatchLimits(float metres = 0) : tolerance(metres) {}
  bool operator==(const PatchLimits &) const = default;

  float tolerance;  // metres of the world
  float pixels = 0;
  // The picture whose pixels they are.
  uint32_t camera = 0;
  uint32_t width = 0, height = 0;  // 0: the camera's, else 512
};

}  // namespace gpurt
