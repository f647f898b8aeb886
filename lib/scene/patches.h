// Bicubic Bezier patches as triangles.
//
// Every patch has as many cells along u and along v as its own curvature wants; every edge has the largest number that one of
// the patches at it wants, so that all of them have the same vertices there (core/reyes/patch_cells.h). Vertices on a
// boundary have the same bits in all patches that share its four points, in either order: the mesh is watertight wherever
// the patches are, within a geometry and from one to the next.
//
// Why not a number of the edge's curve alone, as micropolygons have it: an edge may be straight while the surface next
// to it is not, and triangles that lie on a long straight segment leave such a surface by more than the bound.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/reyes/patch_cells.h"
#include "scene/affine.h"
#include "scene/patch_limits.h"
#include "scene/scene_data.h"

namespace gpurt {

/// Patches of one geometry, and how they are placed.
struct PatchSource {
  const PatchData *patches;
  uint32_t geometry;  // for messages
  double stretch;     // placements make distances as many times as large at most
  AffineDouble place = identity_affine;
  uint32_t space = 0;  // `place` leads there; patches share boundaries with those of the same space alone
  /// What PatchLimits::pixels allows each of them, in object space; empty: no limit in pixels.
  std::vector<double> pixel_limits = {};
};

/// The cells with which no point of the patches is further than the limits from its triangles once they are placed, for
/// each source. Throws INVALID_ARGUMENT naming the geometry and the limit where a source takes more than 2^28 triangles.
std::vector<std::vector<PatchCells>> cut_patches(const std::vector<PatchSource> &sources,
                                                 const PatchLimits &limits);

/// For each patch: none of its points is further than this from its triangles, in object space.
std::vector<double> tessellation_errors(const PatchData &patches, std::span<const PatchCells> cells);
/// The largest of them.
double tessellation_error(const PatchData &patches, std::span<const PatchCells> cells);

/// A patch's own position and normal at (u, v), of 16 control points. The normal has unit length and lies along
/// dS/du x dS/dv; at poles it is the limit from within the patch.
Vec3d position_on_patch(const Vec3f *points, double u, double v);
Vec3d normal_on_patch(const Vec3f *points, double u, double v);

/// The mesh of `patches`; values are computed when they are asked for. Refers to what it is given.
class TessellatedPatches {
 public:
  TessellatedPatches(const PatchData &patches, std::span<const PatchCells> cells);

  uint64_t num_patches() const { return cells_.size(); }
  uint64_t num_vertices() const { return first_vertex_.back(); }
  uint64_t num_triangles() const { return num_triangles_; }
  UInt3 triangle(uint64_t i) const;
  Vec3d vertex(uint64_t i) const;
  /// Unit length, along dS/du x dS/dv; at poles its limit from within the patch.
  Vec3d normal(uint64_t i) const;
  Vec2f uv(uint64_t i) const;

 private:
  struct Location {
    uint64_t patch;
    CellParameter u, v;
  };
  Location locate(uint64_t vertex) const;

  const PatchData &patches_;
  std::span<const PatchCells> cells_;
  std::vector<uint64_t> first_vertex_;  // of each patch; the last one ends them
  uint64_t num_triangles_ = 0;
};

/// The patch that a triangle belongs to, of the cells of one geometry.
uint64_t patch_of_triangle(std::span<const PatchCells> cells, uint64_t triangle);

}  // namespace gpurt
