#include "glb_writer.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <stdexcept>

namespace cli::scenes {

static_assert(std::endian::native == std::endian::little, "glTF is little-endian");

namespace {

using Json = nlohmann::ordered_json;

// Six digits after the point are a micrometre: shorter text and no difference.
double rounded(double x)
{
  const double r = std::round(x * 1e6) * 1e-6;
  return r == 0 ? 0 : std::stod(std::to_string(r));
}

Json array_of(Vec3 v) { return {rounded(v.x), rounded(v.y), rounded(v.z)}; }

Json lambert(const char *name, Vec3 color)
{
  return {{"name", name},
          {"doubleSided", true},
          {"pbrMetallicRoughness",
           {{"baseColorFactor", {rounded(color.x), rounded(color.y), rounded(color.z), 1}},
            {"metallicFactor", 0},
            {"roughnessFactor", 1}}},
          {"extensions", {{"KHR_materials_specular", {{"specularFactor", 0}}}}}};
}

Json metallic(const char *name, Vec3 color, double roughness)
{
  return {{"name", name},
          {"doubleSided", true},
          {"pbrMetallicRoughness",
           {{"baseColorFactor", {rounded(color.x), rounded(color.y), rounded(color.z), 1}},
            {"metallicFactor", 1},
            {"roughnessFactor", rounded(roughness)}}}};
}

}  // namespace

GlbWriter::GlbWriter()
{
  gltf_ = {{"asset", {{"version", "2.0"}, {"generator", "gpurt scene"}}},
           {"scene", 0},
           {"scenes", {{{"nodes", Json::array()}}}},
           {"nodes", Json::array()},
           {"meshes", Json::array()},
           {"materials", Json::array()},
           {"accessors", Json::array()},
           {"bufferViews", Json::array()}};
}

int GlbWriter::add_view(const void *data, size_t size_bytes, int target)
{
  binary_.resize((binary_.size() + 3) / 4 * 4);  // accessors must be aligned
  Json view = {{"buffer", 0}, {"byteOffset", binary_.size()}, {"byteLength", size_bytes}};
  if (target != 0) view["target"] = target;
  binary_.append(static_cast<const char *>(data), size_bytes);
  gltf_["bufferViews"].push_back(view);
  return int(gltf_["bufferViews"].size()) - 1;
}

void GlbWriter::use_extension(const char *name)
{
  Json &used = gltf_["extensionsUsed"];
  if (std::find(used.begin(), used.end(), name) == used.end()) used.push_back(name);
}

int GlbWriter::add_texture(const char *name, const std::vector<uint8_t> &png, bool repeats)
{
  constexpr int linear = 9729, repeat = 10497, clamp = 33071;
  const int wrap = repeats ? repeat : clamp;
  gltf_["images"].push_back(
      {{"name", name}, {"mimeType", "image/png"}, {"bufferView", add_view(png.data(), png.size(), 0)}});
  gltf_["samplers"].push_back(
      {{"magFilter", linear}, {"minFilter", linear}, {"wrapS", wrap}, {"wrapT", wrap}});
  gltf_["textures"].push_back(
      {{"source", gltf_["images"].size() - 1}, {"sampler", gltf_["samplers"].size() - 1}});
  return int(gltf_["textures"].size()) - 1;
}

int GlbWriter::add_material(Json material, const std::vector<const char *> &extensions)
{
  for (const char *extension : extensions) use_extension(extension);
  gltf_["materials"].push_back(std::move(material));
  return int(gltf_["materials"].size()) - 1;
}

int GlbWriter::add_lambert(const char *name, Vec3 color, int texture)
{
  Json material = lambert(name, color);
  if (texture >= 0) material["pbrMetallicRoughness"]["baseColorTexture"] = {{"index", texture}};
  return add_material(std::move(material), {"KHR_materials_specular"});
}

int GlbWriter::add_mask(const char *name, int texture)
{
  Json material = lambert(name, {1, 1, 1});
  material["pbrMetallicRoughness"]["baseColorTexture"] = {{"index", texture}};
  material["alphaMode"] = "MASK";
  material["alphaCutoff"] = 0.5;
  return add_material(std::move(material), {"KHR_materials_specular"});
}

int GlbWriter::add_mirror(const char *name, Vec3 color) { return add_material(metallic(name, color, 0), {}); }
int GlbWriter::add_metal(const char *name, Vec3 color, double roughness)
{
  return add_material(metallic(name, color, roughness), {});
}

int GlbWriter::add_glass(const char *name, Vec3 tint, double ior)
{
  Json material = {{"name", name},
                   {"pbrMetallicRoughness",
                    {{"baseColorFactor", {rounded(tint.x), rounded(tint.y), rounded(tint.z), 1}},
                     {"metallicFactor", 0},
                     {"roughnessFactor", 0}}},
                   {"extensions",
                    {{"KHR_materials_transmission", {{"transmissionFactor", 1}}},
                     {"KHR_materials_ior", {{"ior", rounded(ior)}}},
                     {"KHR_materials_volume", {{"thicknessFactor", 1}}}}}};
  return add_material(std::move(material),
                      {"KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume"});
}

int GlbWriter::add_lamp(const char *name, Vec3 radiance)
{
  // glTF's factor is at most 1; the strength carries the rest.
  const double strength = std::max({radiance.x, radiance.y, radiance.z});
  Json material = lambert(name, {0, 0, 0});
  material.erase("doubleSided");
  material["emissiveFactor"] = {radiance.x / strength, radiance.y / strength, radiance.z / strength};
  material["extensions"]["KHR_materials_emissive_strength"] = {{"emissiveStrength", rounded(strength)}};
  return add_material(std::move(material), {"KHR_materials_specular", "KHR_materials_emissive_strength"});
}

int GlbWriter::add_vectors(const std::vector<Vec3> &values, bool with_bounds)
{
  std::vector<float> floats;
  floats.reserve(values.size() * 3);
  for (Vec3 v : values) floats.insert(floats.end(), {float(v.x), float(v.y), float(v.z)});
  constexpr int array_buffer = 34962, float_type = 5126;
  Json accessor = {{"bufferView", add_view(floats.data(), floats.size() * sizeof(float), array_buffer)},
                   {"componentType", float_type},
                   {"count", values.size()},
                   {"type", "VEC3"}};
  if (with_bounds) {
    for (const char *which : {"min", "max"}) {
      Json bound = Json::array();
      for (size_t c = 0; c < 3; ++c) {
        float extreme = floats[c];
        for (size_t i = c; i < floats.size(); i += 3)
          extreme = which[1] == 'i' ? std::min(extreme, floats[i]) : std::max(extreme, floats[i]);
        bound.push_back(extreme);
      }
      accessor[which] = bound;
    }
  }
  gltf_["accessors"].push_back(accessor);
  return int(gltf_["accessors"].size()) - 1;
}

int GlbWriter::add_mesh(const char *name, const std::vector<std::pair<const Mesh *, int>> &parts)
{
  constexpr int array_buffer = 34962, element_buffer = 34963, float_type = 5126, uint_type = 5125,
                ushort_type = 5123;
  Json primitives = Json::array();
  uint64_t num_triangles = 0;
  for (const auto &[mesh, material] : parts) {
    Json attributes = {{"POSITION", add_vectors(mesh->positions, true)}};
    if (!mesh->normals.empty()) attributes["NORMAL"] = add_vectors(mesh->normals, false);
    if (!mesh->uvs.empty()) {
      std::vector<float> uvs;
      for (const auto &uv : mesh->uvs) uvs.insert(uvs.end(), {float(uv[0]), float(uv[1])});
      gltf_["accessors"].push_back(
          {{"bufferView", add_view(uvs.data(), uvs.size() * sizeof(float), array_buffer)},
           {"componentType", float_type},
           {"count", mesh->uvs.size()},
           {"type", "VEC2"}});
      attributes["TEXCOORD_0"] = gltf_["accessors"].size() - 1;
    }
    // 65535 is reserved.
    const bool is_small = mesh->positions.size() < 65535;
    std::vector<uint16_t> shorts;
    if (is_small) {
      for (const auto &t : mesh->triangles)
        shorts.insert(shorts.end(), {uint16_t(t[0]), uint16_t(t[1]), uint16_t(t[2])});
    }
    const int view = is_small ? add_view(shorts.data(), shorts.size() * sizeof(uint16_t), element_buffer)
                              : add_view(mesh->triangles.data(),
                                         mesh->triangles.size() * sizeof(mesh->triangles[0]), element_buffer);
    gltf_["accessors"].push_back({{"bufferView", view},
                                  {"componentType", is_small ? ushort_type : uint_type},
                                  {"count", mesh->triangles.size() * 3},
                                  {"type", "SCALAR"}});
    primitives.push_back(
        {{"attributes", attributes}, {"indices", gltf_["accessors"].size() - 1}, {"material", material}});
    num_triangles += mesh->triangles.size();
  }
  gltf_["meshes"].push_back({{"name", name}, {"primitives", primitives}});
  mesh_triangles_.push_back(num_triangles);
  num_stored_triangles_ += num_triangles;
  return int(gltf_["meshes"].size()) - 1;
}

GlbWriter::Json &GlbWriter::node(const char *name, const Matrix &matrix)
{
  Json node = {{"name", name}};
  Json columns = Json::array();
  const Matrix identity;
  bool is_identity = true;
  for (int c = 0; c < 4; ++c) {
    for (int r = 0; r < 3; ++r) {
      columns.push_back(rounded(matrix.m[r][c]));
      is_identity &= matrix.m[r][c] == identity.m[r][c];
    }
    columns.push_back(c == 3 ? 1 : 0);
  }
  if (!is_identity) node["matrix"] = columns;
  gltf_["scenes"][0]["nodes"].push_back(gltf_["nodes"].size());
  gltf_["nodes"].push_back(node);
  return gltf_["nodes"].back();
}

void GlbWriter::place(const char *name, int mesh, const Matrix &matrix)
{
  node(name, matrix)["mesh"] = mesh;
  num_placed_triangles_ += mesh_triangles_[size_t(mesh)];
}

void GlbWriter::add_camera(const Matrix &matrix, double yfov_rad, int width, int height)
{
  gltf_["cameras"].push_back(
      {{"type", "perspective"},
       {"perspective", {{"yfov", yfov_rad}, {"aspectRatio", double(width) / height}, {"znear", 0.01}}},
       {"extras", {{"width", width}, {"height", height}}}});
  node("camera", matrix)["camera"] = gltf_["cameras"].size() - 1;
}

int GlbWriter::add_light(Json light)
{
  use_extension("KHR_lights_punctual");
  Json &lights = gltf_["extensions"]["KHR_lights_punctual"]["lights"];
  lights.push_back(std::move(light));
  return int(lights.size()) - 1;
}

void GlbWriter::add_directional_light(Vec3 shines_to, Vec3 irradiance)
{
  const double strength = std::max({irradiance.x, irradiance.y, irradiance.z});
  const int light = add_light({{"type", "directional"},
                               {"color", array_of(irradiance * (1 / strength))},
                               {"intensity", rounded(strength)}});
  const Vec3 up = std::abs(normalize(shines_to).y) > 0.99 ? Vec3{0, 0, 1} : Vec3{0, 1, 0};
  node("sun", look_at({0, 0, 0}, shines_to, up))["extensions"]["KHR_lights_punctual"]["light"] = light;
}

void GlbWriter::add_point_light(Vec3 position, Vec3 intensity)
{
  const double strength = std::max({intensity.x, intensity.y, intensity.z});
  const int light = add_light(
      {{"type", "point"}, {"color", array_of(intensity * (1 / strength))}, {"intensity", strength}});
  node("point_light", translation(position))["extensions"]["KHR_lights_punctual"]["light"] = light;
}

void GlbWriter::set_environment(Vec3 radiance)
{
  gltf_["scenes"][0]["extras"]["environment"] = {{"type", "constant"}, {"radiance", array_of(radiance)}};
}

void GlbWriter::set_environment(const std::string &file_name, std::vector<uint8_t> hdr)
{
  gltf_["scenes"][0]["extras"]["environment"] = {{"type", "latlong"}, {"image", file_name}, {"strength", 1}};
  companions_.emplace_back(file_name, std::move(hdr));
}

std::string GlbWriter::bytes() const
{
  std::string binary = binary_;
  binary.resize((binary.size() + 3) / 4 * 4);
  Json gltf = gltf_;
  gltf["buffers"] = {{{"byteLength", binary.size()}}};
  std::string text = gltf.dump();
  text.resize((text.size() + 3) / 4 * 4, ' ');
  const uint64_t total = 12 + 8 + text.size() + 8 + binary.size();
  if (total > 0xffffffffu)
    throw std::runtime_error("the scene is larger than the 4 GiB that a .glb file can hold");
  std::string file;
  file.reserve(total);
  const auto put = [&](uint32_t word) { file.append(reinterpret_cast<const char *>(&word), sizeof word); };
  put(0x46546c67);  // "glTF"
  put(2);
  put(uint32_t(total));
  put(uint32_t(text.size()));
  put(0x4e4f534a);  // "JSON"
  file += text;
  put(uint32_t(binary.size()));
  put(0x004e4942);  // "BIN"
  file += binary;
  return file;
}

}  // namespace cli::scenes
