// Values of glTF accessors, whatever form they are stored in: strided, sparse, normalised, of any component type.
#pragma once

#include <map>
#include <string>

#include "scene/gltf_document.h"
#include "scene/scene_data.h"

namespace gpurt {

class GltfAccessors {
 public:
  explicit GltfAccessors(const GltfDocument &document) : document_(document) {}

  /// Values as floats. `semantic` decides which component types are allowed; `what` names the primitive for errors.
  /// An accessor that is asked for again shares its memory.
  SharedArray<Vec3f> vec3(int accessor, const std::string &semantic, const std::string &what);
  SharedArray<Vec2f> vec2(int accessor, const std::string &semantic, const std::string &what);

  /// Indices below `num_vertices`.
  std::vector<uint32_t> indices(int accessor, uint64_t num_vertices, const std::string &what);

  uint64_t count(int accessor) const { return document_.model().accessors[size_t(accessor)].count; }

 private:
  const GltfDocument &document_;
  std::map<std::pair<int, std::string>, SharedArray<Vec3f>> vec3_;
  std::map<std::pair<int, std::string>, SharedArray<Vec2f>> vec2_;
};

}  // namespace gpurt
