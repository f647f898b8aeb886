// The bytes of a glTF file: its JSON, its binary chunk, and the files beside it. Nothing here is trusted.
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace gpurt {

using ByteArray = std::shared_ptr<const std::vector<uint8_t>>;

/// Bytes of a larger array, which it keeps alive.
struct ByteSpan {
  ByteArray owner;
  const uint8_t *data = nullptr;
  uint64_t size = 0;
};

struct GltfFile {
  std::string path;
  nlohmann::json json;
  bool is_binary = false;
  ByteSpan binary_chunk;           // of a .glb; empty if it has none
  std::vector<std::string> notes;  // oddities that do no harm
};

/// Reads a .glb or .gltf file, told apart by their first bytes. Throws IO naming the file and its defect.
GltfFile read_gltf_file(const std::string &path);

/// The bytes that a URI of the file names: a data: URI, or a file in the same folder or below. `what` names the object
/// for errors. URIs that lead elsewhere are refused.
ByteSpan read_uri(const GltfFile &file, const std::string &uri, const std::string &what);

/// The path that such a URI names; throws IO for one that leads outside the folder of `file`.
std::string resolve_uri(const GltfFile &file, const std::string &uri, const std::string &what);

/// Printable part of a text that came from a file, cut to a length that suits a message.
std::string printable(const std::string &text);

}  // namespace gpurt
