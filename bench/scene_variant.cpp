#include "scene_variant.h"

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <random>

namespace {

using Json = nlohmann::ordered_json;

[[noreturn]] void end_with(const std::string &path, const char *what)
{
  std::fprintf(stderr, "error: %s: %s\n", path.c_str(), what);
  std::exit(1);
}

uint32_t word_at(const std::string &bytes, size_t at)
{
  uint32_t word;
  std::memcpy(&word, bytes.data() + at, sizeof word);
  return word;
}

void append_word(std::string &bytes, uint32_t word)
{
  bytes.append(reinterpret_cast<const char *>(&word), sizeof word);
}

void change_materials(Json &document, const SceneVariant &v)
{
  for (Json &material : document["materials"]) {
    Json &pbr = material["pbrMetallicRoughness"];
    if (v.rough_metal > 0) {
      pbr["metallicFactor"] = 1.0;
      pbr["roughnessFactor"] = v.rough_metal;
      material.erase("extensions");
    }
    if (v.alpha < 1) {
      if (!pbr.contains("baseColorFactor")) pbr["baseColorFactor"] = {1.0, 1.0, 1.0, 1.0};
      pbr["baseColorFactor"][3] = v.alpha;
      material["alphaMode"] = "BLEND";
    }
  }
}

// A node's model becomes children of it, on a lattice whose step is a third of the model's extent.
void copy_models(Json &document, unsigned copies)
{
  const unsigned edge = unsigned(std::ceil(std::cbrt(double(copies)) - 1e-9));
  const size_t num_nodes = document["nodes"].size();
  for (size_t i = 0; i < num_nodes; ++i) {
    if (!document["nodes"][i].contains("mesh")) continue;
    const size_t mesh = document["nodes"][i]["mesh"];
    const Json &primitive = document["meshes"][mesh]["primitives"][0];
    const Json &points = document["accessors"][size_t(primitive["attributes"]["POSITION"])];
    if (!primitive.contains("extensions") || points["count"] <= 16) continue;
    Json children = Json::array();
    for (unsigned k = 0; k < copies; ++k) {
      const unsigned place[] = {k % edge, k / edge % edge, k / edge / edge};
      Json translation = Json::array();
      for (size_t c = 0; c < 3; ++c) {
        const double extent = double(points["max"][c]) - double(points["min"][c]);
        translation.push_back((double(place[c]) - 0.5 * (edge - 1)) * extent / 3);
      }
      children.push_back(document["nodes"].size());
      document["nodes"].push_back({{"mesh", mesh}, {"translation", translation}});
    }
    document["nodes"][i].erase("mesh");
    document["nodes"][i]["children"] = children;
  }
}

}  // namespace

std::string write_variant(const std::string &path, const SceneVariant &variant)
{
  std::ifstream in(path, std::ios::binary);
  if (!in) end_with(path, "cannot be read");
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  // The header, and a chunk of JSON before that of the buffer.
  constexpr size_t text_at = 20;
  if (bytes.size() < text_at || bytes.compare(0, 4, "glTF") != 0) end_with(path, "is no glTF binary file");
  const size_t text_size = word_at(bytes, 12);
  if (text_size > bytes.size() - text_at) end_with(path, "ends within its first chunk");
  Json document = Json::parse(bytes.substr(text_at, text_size), nullptr, false);
  if (document.is_discarded()) end_with(path, "has a first chunk that is not JSON");
  change_materials(document, variant);
  if (variant.copies > 1) copy_models(document, variant.copies);
  std::string text = document.dump();
  text.resize((text.size() + 3) / 4 * 4, ' ');
  const std::string rest = bytes.substr(text_at + text_size);
  std::string out = bytes.substr(0, 8);
  append_word(out, uint32_t(text_at + text.size() + rest.size()));
  append_word(out, uint32_t(text.size()));
  out += "JSON" + text + rest;
  const std::filesystem::path to = std::filesystem::temp_directory_path() /
                                   ("bench_reyes_" + std::to_string(std::random_device()()) + ".glb");
  if (!(std::ofstream(to, std::ios::binary) << out)) end_with(to.string(), "cannot be written");
  return to.string();
}
