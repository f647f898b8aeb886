// Four triangles side by side, for vector instructions: what leaves of the CPU's trees hold.
#pragma once

#include <cstdint>

namespace gpurt {

constexpr uint32_t triangles_per_block = 4;

/// The last triangle is repeated to fill a leaf's last block.
struct alignas(16) TriangleBlock {
  float corner[3][3][triangles_per_block];  // [corner][axis][triangle]
  uint32_t triangle[triangles_per_block];   // indices into SceneView::indices
};

}  // namespace gpurt
