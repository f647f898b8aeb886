// The environment that the extras of a glTF scene name:
//   {"environment": {"type": "constant", "radiance": [r, g, b]}}
//   {"environment": {"type": "latlong", "image": "file.exr", "strength": s}}
#pragma once

#include "scene/gltf_document.h"
#include "scene/scene_data.h"

namespace gpurt {

/// Sets the environment of `scene`. Images are .exr or .hdr files in the folder of the scene.
void load_gltf_environment(const GltfDocument &document, const tinygltf::Value &extras, SceneData &scene);

}  // namespace gpurt
