// The one translation unit that holds tinygltf. It parses the structure of a document that check_gltf_schema has
// approved; buffers and images, where its own checks are few, are read here.
#include <fstream>  // which tinygltf forgets where it reads no files

#define TINYGLTF_IMPLEMENTATION
#include "scene/gltf_document.h"

#include <limits>
#include <set>

#include "scene/gltf_schema.h"

namespace gpurt {
namespace {

using nlohmann::json;

// What the loader knows; a file that requires another extension cannot be shown as it is meant.
const std::set<std::string> supported_extensions = {
    "GPURT_bezier_patches", "KHR_lights_punctual",    "KHR_materials_emissive_strength",
    "KHR_materials_ior",    "KHR_materials_specular", "KHR_materials_transmission",
    "KHR_materials_volume", "KHR_mesh_quantization",  "KHR_texture_transform",
};

// Drops what tinygltf would copy without use: its values take a hundred times the bytes of their text.
void drop_extras(json &value)
{
  if (value.is_object()) value.erase("extras");
  if (!value.is_structured()) return;
  for (json &member : value) drop_extras(member);
}

// Turns whole numbers beyond int, which tinygltf would truncate where it expects reals, into reals.
void widen_integers(json &value)
{
  if (value.is_structured()) {
    for (json &member : value) widen_integers(member);
  } else if (value.is_number_integer()) {
    const bool fits = value.is_number_unsigned()
                          ? value.get<uint64_t>() <= uint64_t(std::numeric_limits<int>::max())
                          : value.get<int64_t>() >= std::numeric_limits<int>::min();
    if (!fits) value = value.get<double>();
  }
}

void prune_extensions(json &value)
{
  if (value.is_array()) {
    for (json &element : value) prune_extensions(element);
  } else if (value.is_object()) {
    const auto extensions = value.find("extensions");
    if (extensions != value.end() && extensions->is_object()) {
      for (auto &[name, extension] : extensions->items()) {
        if (!supported_extensions.contains(name))
          extension = json::object();  // its name is enough for a warning
      }
    }
    for (auto &[key, member] : value.items()) prune_extensions(member);
  }
}

// The document for tinygltf: without buffers and images, and what is not used at all.
json structure_of(const json &document)
{
  json structure = json::object();
  for (const char *key :
       {"asset", "scene", "scenes", "nodes", "meshes", "materials", "textures", "samplers", "cameras",
        "accessors", "bufferViews", "extensions", "extensionsUsed", "extensionsRequired"}) {
    const auto member = document.find(key);
    if (member != document.end()) structure[key] = *member;
  }
  prune_extensions(structure);
  for (auto &[key, member] : structure.items()) {
    if (key != "scenes" && key != "cameras") drop_extras(member);
    // Sizes and offsets stay whole: tinygltf reads those with 64 bits.
    if (key != "accessors" && key != "bufferViews") widen_integers(member);
  }
  return structure;
}

std::string one_line(std::string text)
{
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
  for (char &c : text) c = c == '\n' ? ' ' : c;
  return text;
}

tinygltf::Model parse_structure(const GltfFile &file)
{
  const std::string text = structure_of(file.json).dump();
  tinygltf::TinyGLTF parser;
  tinygltf::Model model;
  std::string error, warning;
  bool is_parsed = false;
  try {
    is_parsed = parser.LoadASCIIFromString(&model, &error, &warning, text.data(), unsigned(text.size()), "",
                                           tinygltf::NO_REQUIRE);
  } catch (const std::bad_alloc &) {
    throw;
  } catch (const std::exception &e) {
    error = e.what();
  }
  if (!is_parsed || !error.empty()) {
    fail(GPURT_ERROR_IO, "{}: {}", file.path,
         error.empty() ? "is no readable glTF" : printable(one_line(error)));
  }
  return model;
}

}  // namespace

GltfDocument::GltfDocument(const std::string &path, std::function<void(const std::string &)> warn)
    : file_(read_gltf_file(path)), warn_(std::move(warn))
{
  for (const std::string &note : file_.notes) this->warn("{}", note);
  check_gltf_schema(file_);
  for (const json &name : file_.json.value("extensionsRequired", json::array())) {
    if (!supported_extensions.contains(name)) {
      fail("requires the extension {}, which this library does not know; export the file without it",
           printable(name.get<std::string>()));
    }
  }
  model_ = parse_structure(file_);
  load_buffers(file_.json);
  for (const json &image : file_.json.value("images", json::array())) {
    images_.push_back({image.value("uri", ""), image.value("bufferView", -1), image.value("name", "")});
  }
  const json animations = file_.json.value("animations", json::array());
  if (animations.is_array() && !animations.empty()) {
    this->warn("its animations are left out: the scene stands as its nodes say");
  }
  file_.json = {};
}

void GltfDocument::load_buffers(const json &json)
{
  const auto buffers = json.find("buffers");
  for (size_t i = 0; buffers != json.end() && i < buffers->size(); ++i) {
    const nlohmann::json &buffer = (*buffers)[i];
    const std::string what = gltf_label("buffer", i, buffer.value("name", ""));
    const uint64_t byte_length = buffer["byteLength"].get<uint64_t>();
    ByteSpan bytes;
    if (buffer.contains("uri")) {
      bytes = read_uri(file_, buffer["uri"], what);
    } else if (i == 0 && file_.binary_chunk.data) {
      bytes = file_.binary_chunk;
    } else {
      fail("{} has no uri{}", what, i == 0 && file_.is_binary ? ", and the file no binary chunk" : "");
    }
    if (bytes.size < byte_length) fail("{} states {} bytes, but has {}", what, byte_length, bytes.size);
    bytes.size = byte_length;
    buffers_.push_back(std::move(bytes));
  }
}

ByteSpan GltfDocument::buffer_view(int index, const std::string &what) const
{
  const tinygltf::BufferView &view = model_.bufferViews[size_t(index)];
  const ByteSpan &buffer = buffers_[size_t(view.buffer)];
  // Both are below 2^53: the sum cannot overflow.
  if (uint64_t(view.byteOffset) + view.byteLength > buffer.size) {
    fail("{}: buffer view {} covers bytes {} to {} of buffer {}, which has {}", what, index, view.byteOffset,
         uint64_t(view.byteOffset) + view.byteLength, view.buffer, buffer.size);
  }
  return {buffer.owner, buffer.data + view.byteOffset, view.byteLength};
}

bool GltfDocument::uses(const std::string &extension) const
{
  for (const std::string &name : model_.extensionsUsed) {
    if (name == extension) return true;
  }
  return false;
}

std::string gltf_label(const char *kind, size_t index, const std::string &name)
{
  return name.empty() ? fmt::format("{} {}", kind, index)
                      : fmt::format("{} {} ('{}')", kind, index, printable(name));
}

double gltf_number(const tinygltf::Value &object, const char *key, double value_if_absent)
{
  if (!object.IsObject() || !object.Has(key)) return value_if_absent;
  const tinygltf::Value &value = object.Get(key);
  return value.IsNumber() ? value.GetNumberAsDouble() : value_if_absent;
}

const tinygltf::Value *gltf_extension(const tinygltf::ExtensionMap &extensions, const char *name)
{
  const auto it = extensions.find(name);
  return it != extensions.end() ? &it->second : nullptr;
}

}  // namespace gpurt
