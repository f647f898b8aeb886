#include "scene/gltf_file.h"

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "error.h"

namespace gpurt {
namespace {

constexpr uint64_t max_file_bytes = uint64_t(1) << 32;
constexpr uint64_t max_json_bytes = uint64_t(1) << 29;
constexpr int max_json_depth = 128;  // recursion of those who read the document
constexpr uint32_t chunk_json = 0x4e4f534a, chunk_binary = 0x004e4942;

uint32_t load_u32(const uint8_t *p)  // little endian, as the format is
{
  return uint32_t(p[0]) | uint32_t(p[1]) << 8 | uint32_t(p[2]) << 16 | uint32_t(p[3]) << 24;
}

ByteArray read_file(const std::string &path)
{
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) fail(GPURT_ERROR_IO, "{}: no such file", path);
  if (!std::filesystem::is_regular_file(status)) fail(GPURT_ERROR_IO, "{}: not a regular file", path);
  const uint64_t size = std::filesystem::file_size(path, error);
  if (error) fail(GPURT_ERROR_IO, "{}: cannot be read: {}", path, error.message());
  if (size > max_file_bytes) {
    fail(GPURT_ERROR_IO, "{}: {} bytes are more than the 4 GiB that glTF can address; split the scene", path,
         size);
  }
  std::ifstream stream(path, std::ios::binary);
  if (!stream) fail(GPURT_ERROR_IO, "{}: cannot be read: {}", path, std::strerror(errno));
  auto bytes = std::make_shared<std::vector<uint8_t>>(size);
  stream.read(reinterpret_cast<char *>(bytes->data()), std::streamsize(size));
  if (uint64_t(stream.gcount()) != size) fail(GPURT_ERROR_IO, "{}: cannot be read to its end", path);
  return bytes;
}

// Recursive readers follow; a text that nests without end must not exhaust the stack.
void check_depth(const std::string &path, const char *text, uint64_t size)
{
  int depth = 0;
  bool in_string = false;
  for (uint64_t i = 0; i < size; ++i) {
    const char c = text[i];
    if (in_string) {
      if (c == '\\') ++i;
      else if (c == '"') in_string = false;
    } else if (c == '"') {
      in_string = true;
    } else if (c == '[' || c == '{') {
      if (++depth > max_json_depth) {
        fail(GPURT_ERROR_IO, "{}: the JSON nests deeper than {} levels at byte {}", path, max_json_depth, i);
      }
    } else if (c == ']' || c == '}') {
      --depth;
    }
  }
}

nlohmann::json parse_json(const std::string &path, const uint8_t *data, uint64_t size)
{
  if (size > max_json_bytes) {
    fail(GPURT_ERROR_IO,
         "{}: {} bytes of JSON are more than this library reads ({}); move data to the binary buffer", path,
         size, max_json_bytes);
  }
  const char *text = reinterpret_cast<const char *>(data);
  check_depth(path, text, size);
  try {
    return nlohmann::json::parse(text, text + size);
  } catch (const nlohmann::json::parse_error &e) {
    if (e.byte > size)
      fail(GPURT_ERROR_IO, "{}: the JSON ends before it is complete, after {} bytes; export the file again",
           path, size);
    fail(GPURT_ERROR_IO, "{}: the JSON is damaged at byte {} of {}; export the file again", path, e.byte,
         size);
  } catch (const nlohmann::json::exception &e) {
    fail(GPURT_ERROR_IO, "{}: the JSON is damaged: {}", path, printable(e.what()));
  }
}

void read_binary_gltf(GltfFile &file, const ByteArray &bytes)
{
  const std::string &path = file.path;
  const uint8_t *data = bytes->data();
  const uint64_t size = bytes->size();
  if (size < 20) fail(GPURT_ERROR_IO, "{}: {} bytes are too few for a binary glTF file", path, size);
  const uint32_t version = load_u32(data + 4), length = load_u32(data + 8);
  if (version != 2) {
    fail(GPURT_ERROR_IO, "{}: binary glTF version {}; this library reads version 2: convert the file", path,
         version);
  }
  if (length > size) {
    fail(GPURT_ERROR_IO, "{}: cut off: its header states {} bytes, but it has {}", path, length, size);
  }
  if (length < 20)
    fail(GPURT_ERROR_IO, "{}: its header states a length of {} bytes, too few for any content", path, length);
  if (length < size)
    file.notes.push_back(fmt::format("{} bytes after the stated end are ignored", size - length));

  bool has_json = false;
  uint64_t position = 12;
  for (int chunk = 0; length - position >= 8; ++chunk) {
    const uint64_t chunk_length = load_u32(data + position);
    const uint32_t type = load_u32(data + position + 4);
    position += 8;
    if (chunk_length > length - position) {
      fail(GPURT_ERROR_IO, "{}: chunk {} states {} bytes, but {} are left in the file", path, chunk,
           chunk_length, length - position);
    }
    if (chunk == 0 && type != chunk_json) {
      fail(GPURT_ERROR_IO, "{}: its first chunk is of type 0x{:08x}, not JSON", path, type);
    }
    if (chunk == 0) {
      uint64_t text_length = chunk_length;  // padded with spaces, by some writers with zeros
      while (text_length > 0 &&
             (data[position + text_length - 1] == 0 || data[position + text_length - 1] == ' '))
        --text_length;
      file.json = parse_json(path, data + position, text_length);
      has_json = true;
    } else if (type == chunk_binary && !file.binary_chunk.data) {
      file.binary_chunk = {bytes, data + position, chunk_length};
    }
    // The next chunk starts at a multiple of 4.
    position += chunk_length + (-chunk_length & 3);
    if (position > length) position = length;
  }
  if (!has_json) fail(GPURT_ERROR_IO, "{}: has no JSON chunk", path);
}

int base64_value(char c)
{
  if (c >= 'A' && c <= 'Z') return c - 'A';
  if (c >= 'a' && c <= 'z') return c - 'a' + 26;
  if (c >= '0' && c <= '9') return c - '0' + 52;
  if (c == '+') return 62;
  if (c == '/') return 63;
  return -1;
}

ByteSpan decode_data_uri(const GltfFile &file, const std::string &uri, const std::string &what)
{
  const size_t comma = uri.find(',');
  if (comma == std::string::npos || uri.compare(comma - std::min<size_t>(comma, 7), 7, ";base64") != 0) {
    fail(GPURT_ERROR_IO, "{}: {}: its data URI is not base64", file.path, what);
  }
  size_t end = uri.size();
  while (end > comma + 1 && uri[end - 1] == '=') --end;
  auto bytes = std::make_shared<std::vector<uint8_t>>();
  bytes->reserve((end - comma) / 4 * 3 + 3);
  uint32_t bits = 0;
  int num_bits = 0;
  for (size_t i = comma + 1; i < end; ++i) {
    const int value = base64_value(uri[i]);
    if (value < 0) {
      fail(GPURT_ERROR_IO, "{}: {}: character {} of its data URI is not base64", file.path, what,
           i - comma - 1);
    }
    bits = bits << 6 | uint32_t(value);
    num_bits += 6;
    if (num_bits >= 8) {
      num_bits -= 8;
      bytes->push_back(uint8_t(bits >> num_bits));
    }
  }
  return {bytes, bytes->data(), bytes->size()};
}

int hex_value(char c)
{
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

std::string percent_decode(const std::string &uri)
{
  std::string text;
  for (size_t i = 0; i < uri.size(); ++i) {
    const bool is_escape =
        uri[i] == '%' && i + 2 < uri.size() && hex_value(uri[i + 1]) >= 0 && hex_value(uri[i + 2]) >= 0;
    if (is_escape) {
      text += char(hex_value(uri[i + 1]) * 16 + hex_value(uri[i + 2]));
      i += 2;
    } else {
      text += uri[i];
    }
  }
  return text;
}

}  // namespace

std::string printable(const std::string &text)
{
  std::string result;
  for (char c : text) {
    if (result.size() >= 80) return result + "...";
    result += (c >= 0 && c < ' ') || c == 0x7f ? ' ' : c;
  }
  return result;
}

GltfFile read_gltf_file(const std::string &path)
{
  GltfFile file;
  file.path = path;
  const ByteArray bytes = read_file(path);
  size_t start = 0;
  while (start < bytes->size() && std::strchr(" \t\r\n\xef\xbb\xbf", char((*bytes)[start])) &&
         (*bytes)[start] != 0)
    ++start;
  if (bytes->size() >= 4 && std::memcmp(bytes->data(), "glTF", 4) == 0) {
    file.is_binary = true;
    read_binary_gltf(file, bytes);
  } else if (start < bytes->size() && (*bytes)[start] == '{') {
    file.json = parse_json(path, bytes->data(), bytes->size());
  } else {
    fail(GPURT_ERROR_IO, "{}: not a glTF file: it starts neither with 'glTF' nor with JSON", path);
  }
  if (!file.json.is_object()) fail(GPURT_ERROR_IO, "{}: its JSON is no object", path);
  return file;
}

std::string resolve_uri(const GltfFile &file, const std::string &uri, const std::string &what)
{
  const std::string text = percent_decode(uri);
  const std::filesystem::path relative(text);
  bool leads_outside = text.empty() || relative.is_absolute() || text.find('\\') != std::string::npos ||
                       text.find('\0') != std::string::npos || text.find("://") != std::string::npos;
  for (const auto &part : relative) leads_outside |= part == "..";
  if (leads_outside) {
    fail(GPURT_ERROR_IO, "{}: {} names '{}'; only files in the folder of the scene are read: move it there",
         file.path, what, printable(text));
  }
  return (std::filesystem::path(file.path).parent_path() / relative).string();
}

ByteSpan read_uri(const GltfFile &file, const std::string &uri, const std::string &what)
{
  if (uri.compare(0, 5, "data:") == 0) return decode_data_uri(file, uri, what);
  const std::string path = resolve_uri(file, uri, what);
  try {
    const ByteArray bytes = read_file(path);
    return {bytes, bytes->data(), bytes->size()};
  } catch (const Error &e) {
    fail(e.result(), "{}: {}: {}", file.path, what, e.what());
  }
}

}  // namespace gpurt
