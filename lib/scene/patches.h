// Bicubic Bezier patches as triangles.
//
// Every patch of a geometry is cut into rate x rate cells of two triangles each. Triangle t belongs to patch
// t / (2 rate^2); within it cells follow row by row (u fastest), the lower right triangle first. Vertices on the
// boundary of a patch have the same bits as those of a neighbour that shares the four boundary points, in either order:
// the mesh is watertight wherever the patches are.
#pragma once

#include <cstdint>

#include "scene/affine.h"
#include "scene/scene_data.h"

namespace gpurt {

/// The rate at which no point of the patches is further than `tolerance` from its triangles, once placements have made
/// distances `stretch` times as large. `tolerance` 0 means 1e-4 of the diagonal of the control points' bounds. Throws
/// INVALID_ARGUMENT naming the tolerance where that takes more than 2^28 triangles.
uint32_t tessellation_rate(const PatchData &patches, float tolerance, double stretch = 1);

/// No point of the patches is further than this from its triangles, in object space.
double tessellation_error(const PatchData &patches, uint32_t rate);

/// The mesh of `patches` at `rate`; values are computed when they are asked for.
class TessellatedPatches {
 public:
  TessellatedPatches(const PatchData &patches, uint32_t rate);

  uint64_t num_patches() const { return num_patches_; }
  uint64_t num_vertices() const { return num_patches_ * vertices_per_patch_; }
  uint64_t num_triangles() const { return num_patches_ * 2 * rate_ * rate_; }
  UInt3 triangle(uint64_t i) const;
  Vec3d vertex(uint64_t i) const;
  /// Unit length, along dS/du x dS/dv; at poles its limit from within the patch.
  Vec3d normal(uint64_t i) const;
  Vec2f uv(uint64_t i) const;

 private:
  struct Location {
    uint64_t patch;
    uint64_t i, j;  // u = i / rate, v = j / rate
  };
  Location locate(uint64_t vertex) const;

  const PatchData &patches_;
  uint64_t rate_, vertices_per_patch_, num_patches_;
};

}  // namespace gpurt
