// Scenes from glTF 2.0 files.
#pragma once

#include <functional>
#include <string>

#include "scene/scene_data.h"

namespace gpurt {

/// Loads the default scene of a .glb or .gltf file. What has no exact counterpart in gpurt is approximated and named
/// in a call of `warn`. A damaged file throws IO with one line that names the file, the object and its defect.
///
/// Geometries are the primitives of the meshes that the scene uses, in the file's order; a mesh that several nodes
/// use is stored once. Instances follow the nodes, parents first.
SceneData load_gltf(const std::string &path, const std::function<void(const std::string &)> &warn);

}  // namespace gpurt
