// Copies geometries into the arrays of a compiled scene: as they are, or placed in world space.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/reyes/patch_cells.h"
#include "scene/affine.h"
#include "scene/scene_data.h"

namespace gpurt {

/// A geometry in the form of a mesh, whatever its kind: sizes and values, computed when they are asked for.
class GeometrySource {
 public:
  virtual ~GeometrySource() = default;
  virtual uint64_t num_vertices() const = 0;
  virtual uint64_t num_triangles() const = 0;
  virtual bool has_normals() const = 0;
  virtual bool has_uvs() const = 0;

  /// Writes num_triangles corners, counted from `first_vertex`; `swap`: the second and third are exchanged.
  virtual void store_triangles(UInt3 *corners, uint32_t first_vertex, bool swap) const = 0;
  /// Writes num_vertices points, moved by `transform` in double precision and rounded once; null: as they are.
  virtual void store_positions(Vec3f *positions, const AffineDouble *transform) const = 0;
  /// Writes num_vertices unit normals; `inverse` is that of the transform; null: object space.
  virtual void store_normals(Vec3f *normals, const AffineDouble *inverse) const = 0;
  virtual void store_uvs(Vec2f *uvs) const = 0;
};

/// The source refers to `geometry` and, for patches, to their `cells`.
std::unique_ptr<GeometrySource> make_source(const GeometryData &geometry, std::span<const PatchCells> cells);

}  // namespace gpurt
