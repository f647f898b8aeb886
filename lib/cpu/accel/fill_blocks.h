// Copies triangles into the blocks of a leaf.
#pragma once

#include <algorithm>

#include "cpu/accel/triangle_block.h"
#include "scene/compiled_scene.h"

namespace gpurt {

inline uint64_t num_blocks(uint64_t num_triangles)
{
  return (num_triangles + triangles_per_block - 1) / triangles_per_block;
}

/// `references` count from the group's first triangle; there is at least one.
inline void fill_blocks(const CompiledScene &scene, uint32_t first_triangle, const uint32_t *references,
                        uint32_t count, TriangleBlock *blocks)
{
  for (uint32_t n = 0; n < num_blocks(count) * triangles_per_block; ++n) {
    const uint32_t triangle = first_triangle + references[std::min(n, count - 1)];
    TriangleBlock &block = blocks[n / triangles_per_block];
    const uint32_t lane = n % triangles_per_block;
    const UInt3 corner = scene.indices[triangle];
    const Vec3f p[3] = {scene.positions[corner.x], scene.positions[corner.y], scene.positions[corner.z]};
    for (int c = 0; c < 3; ++c) {
      for (int k = 0; k < 3; ++k) block.corner[c][k][lane] = at(p[c], k);
    }
    block.triangle[lane] = triangle;
  }
}

}  // namespace gpurt
