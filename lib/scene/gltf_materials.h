// glTF materials as the nearest of gpurt's four.
//
//   glTF                                                    here
//   transmission from 1/2 up, metallic below 1/2            glass, smooth, a closed solid
//   KHR_materials_volume with a thickness                   glass that absorbs
//   metallic from 1/2 up, roughness 0                       mirror that reflects the base colour
//   metallic from 1/2 up, roughness above 0                 metal: GGX, alpha = roughness^2, F0 = base colour
//   all else                                                Lambertian
//   emissiveFactor x KHR_materials_emissive_strength        radiance; from the back too where doubleSided
//   emissiveTexture                                         multiplies it, at the base colour's coordinates
//   alphaMode MASK                                          holes below alphaCutoff
//
// What a material loses is named in one warning.
#pragma once

#include <map>

#include "scene/gltf_document.h"
#include "scene/gltf_images.h"
#include "scene/scene_data.h"
#include "scene/validate.h"

namespace gpurt {

/// Which texture coordinates a material's texture reads, and how they are moved first (KHR_texture_transform).
struct GltfTextureCoordinates {
  bool is_used = false;
  int set = 0;
  bool is_transformed = false;
  double transform[6] = {1, 0, 0, 0, 1, 0};  // 2 rows of 3

  bool operator==(const GltfTextureCoordinates &) const = default;
};

struct GltfLoadedMaterial {
  uint32_t material = 0;  // index into SceneData::materials
  GltfTextureCoordinates coordinates;
};

class GltfMaterials {
 public:
  GltfMaterials(const GltfDocument &document, GltfImages &images, SceneData &scene)
      : document_(document), images_(images), scene_(scene)
  {}

  /// Adds a material to the scene when it is first asked for; -1 is glTF's default material.
  const GltfLoadedMaterial &load(int material);

 private:
  GltfLoadedMaterial convert(const tinygltf::Material &material, const std::string &label);

  const GltfDocument &document_;
  GltfImages &images_;
  SceneData &scene_;
  std::map<int, GltfLoadedMaterial> materials_;
};

}  // namespace gpurt
