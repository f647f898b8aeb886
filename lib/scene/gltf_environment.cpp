#include "scene/gltf_environment.h"

#include <algorithm>
#include <cctype>
#include <cstring>
#include <filesystem>

#include "image/exr.h"
#include "scene/gltf_images.h"
#include "scene/validate.h"

namespace gpurt {
namespace {

bool has_extension(const std::string &path, const char *wanted)
{
  std::string extension = std::filesystem::path(path).extension().string();
  for (char &c : extension) c = char(std::tolower(uint8_t(c)));
  return extension == wanted;
}

DecodedImage read_exr(const std::string &path)
{
  const ImageRgba image = read_exr_rgba(path);
  auto texels = std::make_shared<std::vector<std::byte>>(image.pixels.size() * sizeof(float));
  std::memcpy(texels->data(), image.pixels.data(), texels->size());
  return {image.width, image.height, TexelFormat::Rgba32f, texels};
}

// Colours outside the gamut have negative components: there is no such light.
uint64_t clamp_negative(DecodedImage &image)
{
  auto texels = std::make_shared<std::vector<std::byte>>(*image.texels);
  uint64_t num_clamped = 0;
  for (uint64_t i = 0; i < uint64_t(image.width) * image.height * 4; ++i) {
    float x;
    std::memcpy(&x, texels->data() + i * sizeof(float), sizeof(float));
    if (i % 4 == 3 || !(x < 0)) continue;
    x = 0;
    std::memcpy(texels->data() + i * sizeof(float), &x, sizeof(float));
    num_clamped++;
  }
  if (num_clamped > 0) image.texels = texels;
  return num_clamped;
}

uint32_t load_image(const GltfDocument &document, const std::string &uri, const std::string &what,
                    SceneData &scene)
{
  const std::string path = resolve_uri(document.file(), uri, what);
  DecodedImage image;
  if (has_extension(path, ".exr")) {
    image = read_exr(path);
  } else if (has_extension(path, ".hdr")) {
    image = decode_hdr(read_uri(document.file(), uri, what), document.file().path + ": " + what);
  } else {
    document.fail("{}: '{}' is neither .exr nor .hdr", what, printable(uri));
  }
  if (const uint64_t num_clamped = clamp_negative(image)) {
    document.warn("{}: {} negative values of '{}' are taken as 0", what, num_clamped, printable(uri));
  }
  TextureData texture;
  texture.width = image.width;
  texture.height = image.height;
  texture.format = image.format;
  texture.wrap_v = Wrap::Clamp;
  texture.texels = image.texels;
  return document.checked(what + ": '" + printable(uri) + "'", [&] { return add_texture(scene, texture); });
}

}  // namespace

void load_gltf_environment(const GltfDocument &document, const tinygltf::Value &extras, SceneData &scene)
{
  if (!extras.IsObject() || !extras.Has("environment")) return;
  const std::string what = "the scene's extras.environment";
  const tinygltf::Value &e = extras.Get("environment");
  if (!e.IsObject() || !e.Has("type") || !e.Get("type").IsString()) {
    document.fail("{} needs a type, 'constant' or 'latlong'", what);
  }
  const std::string &type = e.Get("type").Get<std::string>();
  EnvironmentData environment;
  if (type == "constant") {
    const tinygltf::Value none;
    const tinygltf::Value &radiance = e.Has("radiance") ? e.Get("radiance") : none;
    float rgb[3];
    bool is_ok = radiance.IsArray() && radiance.ArrayLen() == 3;
    for (int c = 0; is_ok && c < 3; ++c) {
      is_ok = radiance.Get(c).IsNumber();
      rgb[c] = is_ok ? float(radiance.Get(c).GetNumberAsDouble()) : 0;
    }
    if (!is_ok) document.fail("{}.radiance must be three numbers", what);
    environment.radiance = {rgb[0], rgb[1], rgb[2]};
  } else if (type == "latlong") {
    if (!e.Has("image") || !e.Get("image").IsString()) document.fail("{}.image must name a file", what);
    if (e.Has("strength") && !e.Get("strength").IsNumber())
      document.fail("{}.strength must be a number", what);
    const float strength = float(gltf_number(e, "strength", 1));
    environment.radiance = {strength, strength, strength};
    environment.texture = load_image(document, e.Get("image").Get<std::string>(), what, scene);
  } else {
    document.fail("{}.type is '{}'; it must be 'constant' or 'latlong'", what, printable(type));
  }
  document.checked(what, [&] { set_environment(scene, environment); });
}

}  // namespace gpurt
