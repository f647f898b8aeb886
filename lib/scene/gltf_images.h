// Images of a glTF file as textures.
#pragma once

#include <map>
#include <string>

#include "scene/gltf_document.h"
#include "scene/scene_data.h"

namespace gpurt {

/// The texels of an image, as add_texture takes them.
struct DecodedImage {
  uint32_t width = 0, height = 0;
  TexelFormat format = TexelFormat::Rgba8Srgb;
  std::shared_ptr<const std::vector<std::byte>> texels;
};

class GltfImages {
 public:
  GltfImages(const GltfDocument &document, SceneData &scene) : document_(document), scene_(scene) {}

  /// Adds a texture of the file, decoded from sRGB, to the scene; returns its index, or invalid_id for a texture
  /// without an image (whose extension has one that this library does not read).
  uint32_t load_texture(int texture);

  /// Mean of the channels of a texture, each in [0, 1]; `is_srgb`: of linear light.
  struct Mean {
    double rgba[4];
  };
  bool mean_of_texture(int texture, bool is_srgb, Mean &mean);

 private:
  const DecodedImage &decode(int image);

  const GltfDocument &document_;
  SceneData &scene_;
  std::map<int, DecodedImage> images_;
  std::map<int, uint32_t> textures_;
};

/// Decodes a PNG or JPEG file. 8-bit images keep their sRGB codes; 16-bit ones become linear floats. Throws IO with a
/// message that starts with `what`.
DecodedImage decode_image(const ByteSpan &bytes, const std::string &what);

/// Decodes a Radiance .hdr file to linear floats.
DecodedImage decode_hdr(const ByteSpan &bytes, const std::string &what);

}  // namespace gpurt
