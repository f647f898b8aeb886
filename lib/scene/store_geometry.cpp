#include "scene/store_geometry.h"

#include <unordered_map>

#include "scene/parallel.h"
#include "scene/patches.h"

namespace gpurt {
namespace {

class MeshSurface {
 public:
  explicit MeshSurface(const MeshData &mesh) : mesh_(mesh) { find_missing_normals(); }
  uint64_t num_vertices() const { return mesh_.vertices.size(); }
  uint64_t num_triangles() const { return mesh_.indices.size(); }
  bool has_normals() const { return !mesh_.normals.empty(); }
  bool has_uvs() const { return !mesh_.uvs.empty(); }
  UInt3 triangle(uint64_t i) const { return mesh_.indices[i]; }
  Vec3d vertex(uint64_t i) const { return to_double(mesh_.vertices[i]); }
  Vec2f uv(uint64_t i) const { return mesh_.uvs[i]; }
  Vec3d normal(uint64_t i) const
  {
    const Vec3d n = to_double(mesh_.normals[i]);
    return is_zero(n) ? missing_.at(i) : normalize(n);
  }

 private:
  // A zero normal stands for the mean normal of the faces around its vertex, weighted by area.
  void find_missing_normals()
  {
    const auto is_missing = [this](uint64_t i) { return is_zero(to_double(mesh_.normals[i])); };
    uint64_t i = find_first(mesh_.normals.size(), is_missing);
    if (i == mesh_.normals.size()) return;
    for (; i < mesh_.normals.size(); ++i) {
      if (is_missing(i)) missing_[i] = {0, 0, 0};
    }
    std::unordered_map<uint64_t, Vec3d> first_face;
    for (uint64_t t = 0; t < mesh_.indices.size(); ++t) {
      const UInt3 corner = mesh_.indices[t];
      Vec3d face{0, 0, 0};
      bool is_known = false;
      for (uint32_t k : {corner.x, corner.y, corner.z}) {
        const auto found = missing_.find(k);
        if (found == missing_.end()) continue;
        if (!is_known) {
          const Vec3d a = vertex(corner.x);
          face = cross(vertex(corner.y) - a, vertex(corner.z) - a);
          is_known = true;
        }
        found->second = found->second + face;
        if (!is_zero(face)) first_face.try_emplace(k, face);
      }
    }
    for (auto &[k, n] : missing_) {
      // Faces may cancel, as on a sheet with two sides; then the first one decides.
      if (is_zero(n)) {
        const auto face = first_face.find(k);
        n = face != first_face.end() ? face->second
                                     : Vec3d{0, 0, 1};  // no face has an area: nothing is hit here
      }
      n = normalize(n);
    }
  }

  const MeshData &mesh_;
  std::unordered_map<uint64_t, Vec3d> missing_;
};

class PatchSurface : public TessellatedPatches {
 public:
  using TessellatedPatches::TessellatedPatches;
  bool has_normals() const { return true; }
  bool has_uvs() const { return true; }
};

template <class Surface>
class SurfaceSource final : public GeometrySource {
 public:
  template <class... Args>
  explicit SurfaceSource(Args &&...args) : surface_(std::forward<Args>(args)...)
  {}
  uint64_t num_vertices() const override { return surface_.num_vertices(); }
  uint64_t num_triangles() const override { return surface_.num_triangles(); }
  bool has_normals() const override { return surface_.has_normals(); }
  bool has_uvs() const override { return surface_.has_uvs(); }

  void store_triangles(UInt3 *corners, uint32_t first_vertex, bool swap) const override
  {
    parallel_for_each(num_triangles(), [&](uint64_t i) {
      const UInt3 c = surface_.triangle(i);
      const UInt3 shifted{first_vertex + c.x, first_vertex + c.y, first_vertex + c.z};
      corners[i] = swap ? UInt3{shifted.x, shifted.z, shifted.y} : shifted;
    });
  }
  void store_positions(Vec3f *positions, const AffineDouble *transform) const override
  {
    parallel_for_each(num_vertices(), [&](uint64_t i) {
      const Vec3d p = surface_.vertex(i);
      positions[i] = to_float(transform ? transform_point(*transform, p) : p);
    });
  }
  void store_normals(Vec3f *normals, const AffineDouble *inverse) const override
  {
    parallel_for_each(num_vertices(), [&](uint64_t i) {
      const Vec3d n = surface_.normal(i);
      normals[i] = to_float(inverse ? normalize(transform_normal(*inverse, n)) : n);
    });
  }
  void store_uvs(Vec2f *uvs) const override
  {
    parallel_for_each(num_vertices(), [&](uint64_t i) { uvs[i] = surface_.uv(i); });
  }

 private:
  Surface surface_;
};

}  // namespace

std::unique_ptr<GeometrySource> make_source(const GeometryData &geometry, std::span<const PatchCells> cells)
{
  if (geometry.kind == GeometryKind::Patches) {
    return std::make_unique<SurfaceSource<PatchSurface>>(geometry.patches, cells);
  }
  return std::make_unique<SurfaceSource<MeshSurface>>(geometry.mesh);
}

}  // namespace gpurt
