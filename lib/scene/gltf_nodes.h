// The node hierarchy of a glTF scene: where meshes, cameras and lights stand.
#pragma once

#include <vector>

#include "scene/affine.h"
#include "scene/gltf_document.h"

namespace gpurt {

/// A node of the scene and the product of the transforms from its root down, in double precision.
struct GltfPlacedNode {
  int node;
  AffineDouble to_world;
};

/// The nodes of the default scene, parents before children, in the file's order. Throws IO where the hierarchy is no
/// forest, or a transform is not finite or not affine.
std::vector<GltfPlacedNode> place_gltf_nodes(const GltfDocument &document);

/// The index of the default scene, or -1.
int default_gltf_scene(const GltfDocument &document);

}  // namespace gpurt
