#include "scene/gltf_images.h"

#define STB_IMAGE_IMPLEMENTATION
#define STB_IMAGE_STATIC
#define STBI_NO_STDIO
#define STBI_ONLY_PNG
#define STBI_ONLY_JPEG
#define STBI_ONLY_HDR
#define STBI_MAX_DIMENSIONS 65536
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
#include <stb/stb_image.h>
#pragma GCC diagnostic pop

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <vector>

#include "core/math/functions.h"
#include "scene/parallel.h"
#include "scene/validate.h"

namespace gpurt {
namespace {

constexpr uint64_t max_texels = uint64_t(1) << 28;

// No PNG or JPEG holds more texels in a byte: deflate shrinks to 1/1032 at most, and a byte has at most 8 texels of one
// bit. A file that claims more is damaged, and would cost memory before that shows.
constexpr uint64_t max_texels_per_byte = 8 * 1032;

template <class T>
using Pixels = std::unique_ptr<T, decltype([](T *p) { stbi_image_free(p); })>;

struct Size {
  uint64_t width, height;
};

Size read_size(const ByteSpan &bytes, const std::string &what, const char *kinds)
{
  if (bytes.size > uint64_t(std::numeric_limits<int>::max())) {
    fail(GPURT_ERROR_IO, "{}: {} bytes are too many for an image", what, bytes.size);
  }
  int width = 0, height = 0, channels = 0;
  if (!stbi_info_from_memory(bytes.data, int(bytes.size), &width, &height, &channels)) {
    fail(GPURT_ERROR_IO, "{}: is no readable {} image ({} bytes): {}", what, kinds, bytes.size,
         stbi_failure_reason());
  }
  if (width <= 0 || height <= 0 || uint64_t(width) * uint64_t(height) > max_texels) {
    fail(GPURT_ERROR_IO, "{}: {} x {} texels are more than the {} allowed; scale the image down", what, width,
         height, max_texels);
  }
  if (uint64_t(width) * uint64_t(height) / max_texels_per_byte > bytes.size) {
    fail(GPURT_ERROR_IO, "{}: damaged: {} bytes cannot hold {} x {} texels", what, bytes.size, width, height);
  }
  return {uint64_t(width), uint64_t(height)};
}

[[noreturn]] void fail_decoding(const std::string &what)
{
  const char *reason = stbi_failure_reason();
  if (std::string(reason) == "outofmem")
    fail(GPURT_ERROR_OUT_OF_MEMORY, "{}: no memory for its texels", what);
  fail(GPURT_ERROR_IO, "{}: the image is damaged: {}", what, reason);
}

DecodedImage copy_pixels(Size size, TexelFormat format, const void *pixels, uint64_t bytes_per_texel)
{
  const auto *first = static_cast<const std::byte *>(pixels);
  return {
      uint32_t(size.width), uint32_t(size.height), format,
      std::make_shared<std::vector<std::byte>>(first, first + size.width * size.height * bytes_per_texel)};
}

// The sRGB curve of IEC 61966-2-1 for 16-bit codes.
const std::vector<float> &srgb16_table()
{
  static const std::vector<float> table = [] {
    std::vector<float> t(65536);
    parallel_for_each(t.size(), [&](uint64_t i) {
      const double c = double(i) / 65535.0, a = (c + 0.055) / 1.055;
      t[i] = float(c <= 0.04045 ? c / 12.92 : a * a * fifth_root(a * a));
    });
    return t;
  }();
  return table;
}

DecodedImage decode_16_bit(const ByteSpan &bytes, Size size, const std::string &what)
{
  int width, height, channels;
  const Pixels<stbi_us> pixels(
      stbi_load_16_from_memory(bytes.data, int(bytes.size), &width, &height, &channels, 4));
  if (!pixels) fail_decoding(what);
  auto texels = std::make_shared<std::vector<std::byte>>(size.width * size.height * 16);
  const std::vector<float> &linear = srgb16_table();
  parallel_for_each(size.width * size.height, [&](uint64_t i) {
    const stbi_us *p = pixels.get() + 4 * i;
    const float rgba[4] = {linear[p[0]], linear[p[1]], linear[p[2]], float(p[3]) / 65535.0f};
    std::memcpy(texels->data() + 16 * i, rgba, 16);
  });
  return {uint32_t(size.width), uint32_t(size.height), TexelFormat::Rgba32f, texels};
}

Wrap wrap_mode(int mode)
{
  if (mode == TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE) return Wrap::Clamp;
  if (mode == TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT) return Wrap::Mirror;
  return Wrap::Repeat;
}

}  // namespace

DecodedImage decode_image(const ByteSpan &bytes, const std::string &what)
{
  if (bytes.size < 4 || stbi_is_hdr_from_memory(bytes.data, int(std::min<uint64_t>(bytes.size, 1 << 20)))) {
    fail(GPURT_ERROR_IO, "{}: is no PNG or JPEG image ({} bytes)", what, bytes.size);
  }
  const Size size = read_size(bytes, what, "PNG or JPEG");
  if (stbi_is_16_bit_from_memory(bytes.data, int(bytes.size))) return decode_16_bit(bytes, size, what);
  int width, height, channels;
  const Pixels<stbi_uc> pixels(
      stbi_load_from_memory(bytes.data, int(bytes.size), &width, &height, &channels, 4));
  if (!pixels) fail_decoding(what);
  return copy_pixels(size, TexelFormat::Rgba8Srgb, pixels.get(), 4);
}

DecodedImage decode_hdr(const ByteSpan &bytes, const std::string &what)
{
  if (bytes.size < 4 || !stbi_is_hdr_from_memory(bytes.data, int(std::min<uint64_t>(bytes.size, 1 << 20)))) {
    fail(GPURT_ERROR_IO, "{}: is no Radiance .hdr image", what);
  }
  const Size size = read_size(bytes, what, "Radiance .hdr");
  int width, height, channels;
  const Pixels<float> pixels(
      stbi_loadf_from_memory(bytes.data, int(bytes.size), &width, &height, &channels, 4));
  if (!pixels) fail_decoding(what);
  return copy_pixels(size, TexelFormat::Rgba32f, pixels.get(), 16);
}

const DecodedImage &GltfImages::decode(int image)
{
  const auto known = images_.find(image);
  if (known != images_.end()) return known->second;
  const GltfImage &source = document_.images()[size_t(image)];
  const std::string label = gltf_label("image", size_t(image), source.name);
  const ByteSpan bytes = source.buffer_view >= 0 ? document_.buffer_view(source.buffer_view, label)
                                                 : read_uri(document_.file(), source.uri, label);
  return images_[image] = decode_image(bytes, document_.file().path + ": " + label);
}

uint32_t GltfImages::load_texture(int index)
{
  const auto known = textures_.find(index);
  if (known != textures_.end()) return known->second;
  const tinygltf::Texture &texture = document_.model().textures[size_t(index)];
  if (texture.source < 0) return invalid_id;
  const DecodedImage &image = decode(texture.source);
  TextureData data;
  data.width = image.width;
  data.height = image.height;
  data.format = image.format;
  data.texels = image.texels;
  if (texture.sampler >= 0) {
    const tinygltf::Sampler &sampler = document_.model().samplers[size_t(texture.sampler)];
    data.wrap_u = wrap_mode(sampler.wrapS);
    data.wrap_v = wrap_mode(sampler.wrapT);
    data.nearest = sampler.magFilter == TINYGLTF_TEXTURE_FILTER_NEAREST;
  }
  const std::string what = gltf_label("texture", size_t(index), texture.name);
  return textures_[index] = document_.checked(what, [&] { return add_texture(scene_, data); });
}

bool GltfImages::mean_of_texture(int index, bool is_srgb, Mean &mean)
{
  const tinygltf::Texture &texture = document_.model().textures[size_t(index)];
  if (texture.source < 0) return false;
  const DecodedImage &image = decode(texture.source);
  const uint64_t num_texels = uint64_t(image.width) * image.height;
  if (image.format == TexelFormat::Rgba32f) {
    double sums[4] = {};
    for (uint64_t i = 0; i < num_texels; ++i) {
      float rgba[4];
      std::memcpy(rgba, image.texels->data() + 16 * i, 16);
      for (int c = 0; c < 4; ++c) {
        // 16-bit images were decoded as colours; where they hold numbers, the curve is taken back.
        const bool is_curved = c < 3 && !is_srgb;
        const auto &table = srgb16_table();
        sums[c] += is_curved
                       ? double(std::lower_bound(table.begin(), table.end(), rgba[c]) - table.begin()) / 65535
                       : rgba[c];
      }
    }
    for (int c = 0; c < 4; ++c) mean.rgba[c] = sums[c] / double(num_texels);
    return true;
  }
  // Of 8-bit codes, how often each occurs says all.
  std::array<std::array<uint64_t, 256>, 4> histogram{};
  for (uint64_t i = 0; i < 4 * num_texels; ++i) histogram[i % 4][uint8_t((*image.texels)[i])]++;
  for (int c = 0; c < 4; ++c) {
    double sum = 0;
    for (uint32_t code = 0; code < 256; ++code) {
      sum += double(histogram[c][code]) * (is_srgb && c < 3 ? double(linear_from_srgb8(code)) : code / 255.0);
    }
    mean.rgba[c] = sum / double(num_texels);
  }
  return true;
}

}  // namespace gpurt
