// Primitives of glTF meshes as geometries.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "scene/gltf_accessors.h"
#include "scene/gltf_document.h"
#include "scene/gltf_materials.h"
#include "scene/scene_data.h"

namespace gpurt {

class GltfMeshes {
 public:
  GltfMeshes(const GltfDocument &document, GltfMaterials &materials, SceneData &scene);

  /// Adds the primitives of a mesh to the scene.
  void load(int mesh);
  /// Geometries of a mesh that was loaded.
  const std::vector<uint32_t> &geometries(int mesh) const { return geometries_[size_t(mesh)]; }
  /// Warns of what the loaded primitives have without counterpart here, once a kind.
  void report_losses() const;

 private:
  void load_primitive(const tinygltf::Primitive &primitive, const std::string &what,
                      std::vector<uint32_t> &out);
  MeshData read_mesh(const tinygltf::Primitive &primitive, const GltfTextureCoordinates &coordinates,
                     const std::string &what);
  std::vector<UInt3> read_triangles(const tinygltf::Primitive &primitive, uint64_t num_vertices,
                                    const std::string &what);
  void note_losses(const tinygltf::Primitive &primitive, const std::string &what);

  const GltfDocument &document_;
  GltfMaterials &materials_;
  SceneData &scene_;
  GltfAccessors accessors_;
  std::vector<std::vector<uint32_t>> geometries_;
  std::map<std::string, std::vector<std::string>> losses_;  // kind: primitives
};

}  // namespace gpurt
