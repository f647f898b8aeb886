// Small glTF files made in memory, and loading them.
#pragma once

#include <unistd.h>

#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "scene/gltf.h"
#include "scene_builders.h"

namespace gpurt {

using nlohmann::json;

/// A folder that is gone when the test ends.
class TemporaryFolder {
 public:
  TemporaryFolder()
  {
    std::string name = (std::filesystem::temp_directory_path() / "gpurt_test_XXXXXX").string();
    if (!mkdtemp(name.data())) throw std::runtime_error("cannot make a temporary folder");
    path_ = name;
  }
  ~TemporaryFolder() { std::filesystem::remove_all(path_); }
  std::string operator/(const std::string &name) const { return (path_ / name).string(); }

 private:
  std::filesystem::path path_;
};

inline void write_file(const std::string &path, const void *data, size_t size)
{
  std::ofstream stream(path, std::ios::binary);
  stream.write(static_cast<const char *>(data), std::streamsize(size));
  ASSERT_TRUE(stream.good());
}

/// A document under construction, with one buffer.
struct GltfBuilder {
  json root = {{"asset", {{"version", "2.0"}}}, {"scene", 0}, {"scenes", {{{"nodes", json::array()}}}}};
  std::vector<uint8_t> bin;

  int add(const char *array, json object)
  {
    if (!root.contains(array)) root[array] = json::array();
    root[array].push_back(std::move(object));
    return int(root[array].size()) - 1;
  }
  int view(const std::vector<uint8_t> &bytes, int stride = 0)
  {
    while (bin.size() % 4 != 0) bin.push_back(0);
    json v = {{"buffer", 0}, {"byteOffset", bin.size()}, {"byteLength", bytes.size()}};
    if (stride != 0) v["byteStride"] = stride;
    bin.insert(bin.end(), bytes.begin(), bytes.end());
    return add("bufferViews", v);
  }
  template <class T>
  static std::vector<uint8_t> bytes_of(const std::vector<T> &values)
  {
    std::vector<uint8_t> bytes(values.size() * sizeof(T));
    std::memcpy(bytes.data(), values.data(), bytes.size());
    return bytes;
  }
  template <class T>
  static int component_type()
  {
    if (std::is_same_v<T, int8_t>) return 5120;
    if (std::is_same_v<T, uint8_t>) return 5121;
    if (std::is_same_v<T, int16_t>) return 5122;
    if (std::is_same_v<T, uint16_t>) return 5123;
    if (std::is_same_v<T, uint32_t>) return 5125;
    return 5126;
  }
  static int num_components(const std::string &type)
  {
    return type == "SCALAR" ? 1 : type == "VEC2" ? 2 : type == "VEC3" ? 3 : 4;
  }
  /// An accessor of tightly packed values.
  template <class T>
  int accessor(const std::vector<T> &values, const std::string &type, bool is_normalized = false)
  {
    json a = {{"bufferView", view(bytes_of(values))},
              {"componentType", component_type<T>()},
              {"count", values.size() / size_t(num_components(type))},
              {"type", type}};
    if (is_normalized) a["normalized"] = true;
    return add("accessors", a);
  }
  /// The same values, each element followed by padding.
  template <class T>
  int strided_accessor(const std::vector<T> &values, const std::string &type, int stride, int offset,
                       bool is_normalized = false)
  {
    const size_t n = size_t(num_components(type)), count = values.size() / n;
    std::vector<uint8_t> bytes(size_t(offset) + (count - 1) * size_t(stride) + n * sizeof(T), 0xcd);
    for (size_t i = 0; i < count; ++i) {
      std::memcpy(bytes.data() + size_t(offset) + i * size_t(stride), &values[i * n], n * sizeof(T));
    }
    json a = {{"bufferView", view(bytes, stride)},
              {"byteOffset", offset},
              {"componentType", component_type<T>()},
              {"count", count},
              {"type", type}};
    if (is_normalized) a["normalized"] = true;
    return add("accessors", a);
  }
  int mesh(json primitive) { return add("meshes", {{"primitives", {std::move(primitive)}}}); }
  int node(json object, bool is_root = true)
  {
    const int index = add("nodes", std::move(object));
    if (is_root) root["scenes"][0]["nodes"].push_back(index);
    return index;
  }

  json finished() const
  {
    json j = root;
    if (!bin.empty()) j["buffers"] = {{{"byteLength", bin.size()}}};
    return j;
  }
  std::vector<uint8_t> glb() const { return glb_of(finished().dump(), bin); }

  static void put_u32(std::vector<uint8_t> &out, uint32_t x)
  {
    for (int i = 0; i < 4; ++i) out.push_back(uint8_t(x >> (8 * i)));
  }
  static std::vector<uint8_t> glb_of(std::string text, std::vector<uint8_t> bin)
  {
    while (text.size() % 4 != 0) text += ' ';
    while (bin.size() % 4 != 0) bin.push_back(0);
    std::vector<uint8_t> out = {'g', 'l', 'T', 'F'};
    put_u32(out, 2);
    put_u32(out, uint32_t(12 + 8 + text.size() + (bin.empty() ? 0 : 8 + bin.size())));
    put_u32(out, uint32_t(text.size()));
    put_u32(out, 0x4e4f534a);
    out.insert(out.end(), text.begin(), text.end());
    if (!bin.empty()) {
      put_u32(out, uint32_t(bin.size()));
      put_u32(out, 0x004e4942);
      out.insert(out.end(), bin.begin(), bin.end());
    }
    return out;
  }
};

/// Loads bytes as the file NAME of a fresh folder; warnings are kept.
struct GltfLoad {
  std::vector<std::string> warnings;

  SceneData bytes(const std::vector<uint8_t> &data, const std::string &name = "test.glb")
  {
    TemporaryFolder folder;
    write_file(folder / name, data.data(), data.size());
    return file(folder / name);
  }
  SceneData file(const std::string &path)
  {
    return load_gltf(path, [this](const std::string &text) { warnings.push_back(text); });
  }
  std::string all_warnings() const
  {
    std::string text;
    for (const std::string &w : warnings) text += w + "\n";
    return text;
  }
};

/// The message that loading a document ends with; "" if it loads. Messages are one line and name the file.
inline std::string load_error(const std::vector<uint8_t> &glb)
{
  GltfLoad load;
  try {
    load.bytes(glb);
  } catch (const Error &e) {
    EXPECT_EQ(e.result(), GPURT_ERROR_IO) << e.what();
    const std::string text = e.what();
    EXPECT_EQ(text.find('\n'), std::string::npos) << text;
    EXPECT_NE(text.find("test.glb: "), std::string::npos) << text;
    return text;
  }
  return "";
}
inline std::string load_error(const GltfBuilder &b) { return load_error(b.glb()); }

/// Two triangles of a unit square, with everything in the plainest form; node 0 shows mesh 0.
inline GltfBuilder square()
{
  GltfBuilder b;
  const int positions = b.accessor<float>({0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0}, "VEC3");
  const int normals = b.accessor<float>({0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, "VEC3");
  const int uvs = b.accessor<float>({0, 0, 1, 0, 1, 1, 0, 1}, "VEC2");
  const int indices = b.accessor<uint16_t>({0, 1, 2, 0, 2, 3}, "SCALAR");
  b.node(
      {{"mesh", b.mesh({{"attributes", {{"POSITION", positions}, {"NORMAL", normals}, {"TEXCOORD_0", uvs}}},
                        {"indices", indices}})}});
  return b;
}

/// A small PNG file: 8-bit RGBA, stored without compression.
std::vector<uint8_t> make_png(uint32_t width, uint32_t height, const std::vector<uint8_t> &rgba,
                              int bits = 8);

inline uint32_t crc32_of(const uint8_t *data, size_t size)
{
  uint32_t crc = 0xffffffffu;
  for (size_t i = 0; i < size; ++i) {
    crc ^= data[i];
    for (int k = 0; k < 8; ++k) crc = crc & 1 ? crc >> 1 ^ 0xedb88320u : crc >> 1;
  }
  return ~crc;
}

inline std::vector<uint8_t> make_png(uint32_t width, uint32_t height, const std::vector<uint8_t> &rgba,
                                     int bits)
{
  const auto put = [](std::vector<uint8_t> &out, uint32_t x) {
    for (int i = 3; i >= 0; --i) out.push_back(uint8_t(x >> (8 * i)));
  };
  std::vector<uint8_t> out = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  const auto chunk = [&](const char *type, const std::vector<uint8_t> &data) {
    put(out, uint32_t(data.size()));
    const size_t start = out.size();
    out.insert(out.end(), type, type + 4);
    out.insert(out.end(), data.begin(), data.end());
    put(out, crc32_of(out.data() + start, out.size() - start));
  };
  std::vector<uint8_t> header;
  put(header, width);
  put(header, height);
  header.insert(header.end(), {uint8_t(bits), 6, 0, 0, 0});
  chunk("IHDR", header);
  const size_t row = size_t(width) * 4 * size_t(bits / 8);
  std::vector<uint8_t> raw;
  for (uint32_t y = 0; y < height; ++y) {
    raw.push_back(0);
    raw.insert(raw.end(), rgba.begin() + std::ptrdiff_t(y * row),
               rgba.begin() + std::ptrdiff_t((y + 1) * row));
  }
  std::vector<uint8_t> zlib = {0x78, 0x01, 0x01};  // one stored block
  zlib.push_back(uint8_t(raw.size()));
  zlib.push_back(uint8_t(raw.size() >> 8));
  zlib.push_back(uint8_t(~raw.size()));
  zlib.push_back(uint8_t(~raw.size() >> 8));
  zlib.insert(zlib.end(), raw.begin(), raw.end());
  uint32_t a = 1, b = 0;
  for (uint8_t x : raw) {
    a = (a + x) % 65521;
    b = (b + a) % 65521;
  }
  put(zlib, b << 16 | a);
  chunk("IDAT", zlib);
  chunk("IEND", {});
  return out;
}

}  // namespace gpurt
