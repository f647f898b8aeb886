#include "scene/gltf_accessors.h"

#include <algorithm>
#include <cstring>

#include "scene/parallel.h"

namespace gpurt {
namespace {

// An accessor without a buffer view holds zeros; a small file must not ask for many.
constexpr uint64_t max_zeros = uint64_t(1) << 24;

uint32_t component_bytes(int type)
{
  switch (type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return 1;
    case TINYGLTF_COMPONENT_TYPE_SHORT:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return 2;
    default:
      return 4;
  }
}

const char *component_name(int type)
{
  switch (type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
      return "BYTE";
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return "UNSIGNED_BYTE";
    case TINYGLTF_COMPONENT_TYPE_SHORT:
      return "SHORT";
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return "UNSIGNED_SHORT";
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
      return "UNSIGNED_INT";
    default:
      return "FLOAT";
  }
}

const char *element_name(int type)
{
  switch (type) {
    case TINYGLTF_TYPE_SCALAR:
      return "SCALAR";
    case TINYGLTF_TYPE_VEC2:
      return "VEC2";
    case TINYGLTF_TYPE_VEC3:
      return "VEC3";
    case TINYGLTF_TYPE_VEC4:
      return "VEC4";
    default:
      return "a matrix";
  }
}

template <class T>
T load(const uint8_t *p)
{
  T value;
  std::memcpy(&value, p, sizeof(T));
  return value;
}

// Source: glTF 2.0, Section 3.6.2.2 and 3.11: how normalised integers map to reals.
float load_component(const uint8_t *p, int type, bool is_normalized)
{
  switch (type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE: {
      const float x = load<int8_t>(p);
      return is_normalized ? std::max(x / 127.0f, -1.0f) : x;
    }
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE: {
      const float x = load<uint8_t>(p);
      return is_normalized ? x / 255.0f : x;
    }
    case TINYGLTF_COMPONENT_TYPE_SHORT: {
      const float x = load<int16_t>(p);
      return is_normalized ? std::max(x / 32767.0f, -1.0f) : x;
    }
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT: {
      const float x = load<uint16_t>(p);
      return is_normalized ? x / 65535.0f : x;
    }
    default:
      return load<float>(p);
  }
}

uint32_t load_index(const uint8_t *p, int type)
{
  switch (type) {
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return load<uint8_t>(p);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return load<uint16_t>(p);
    default:
      return load<uint32_t>(p);
  }
}

// Elements somewhere in a buffer, range checked.
struct Elements {
  ByteSpan bytes;                 // keeps the buffer alive
  const uint8_t *data = nullptr;  // null: zeros
  uint64_t stride = 0;
};

Elements find_elements(const GltfDocument &document, int view_index, uint64_t byte_offset, uint64_t count,
                       uint64_t element_bytes, bool may_be_strided, const std::string &what)
{
  Elements e;
  if (view_index < 0) return e;
  e.bytes = document.buffer_view(view_index, what);
  const uint64_t view_stride = document.model().bufferViews[size_t(view_index)].byteStride;
  e.stride = may_be_strided && view_stride != 0 ? view_stride : element_bytes;
  if (e.stride < element_bytes) {
    document.fail("{}: buffer view {} has a stride of {} bytes, less than the {} of an element", what,
                  view_index, e.stride, element_bytes);
  }
  // count < 2^32, stride <= 252, offset <= 2^53: no overflow.
  const uint64_t end = byte_offset + (count - 1) * e.stride + element_bytes;
  if (end > e.bytes.size) {
    document.fail("{}: {} elements end at byte {} of buffer view {}, which has {}", what, count, end,
                  view_index, e.bytes.size);
  }
  e.data = e.bytes.data + byte_offset;
  return e;
}

// The elements of a sparse accessor that differ from its base, by rising index.
struct SparseElements {
  std::vector<uint32_t> indices;
  Elements values;
};

SparseElements read_sparse(const GltfDocument &document, const tinygltf::Accessor &a, uint64_t element_bytes,
                           const std::string &what)
{
  SparseElements sparse;
  if (!a.sparse.isSparse) return sparse;
  const uint64_t count = uint64_t(a.sparse.count);
  if (count > a.count) document.fail("{}: {} sparse elements replace {}", what, count, a.count);
  const int type = a.sparse.indices.componentType;
  const Elements places =
      find_elements(document, a.sparse.indices.bufferView, uint64_t(a.sparse.indices.byteOffset), count,
                    component_bytes(type), false, what + ", sparse indices");
  sparse.values = find_elements(document, a.sparse.values.bufferView, uint64_t(a.sparse.values.byteOffset),
                                count, element_bytes, false, what + ", sparse values");
  sparse.indices.resize(count);
  for (uint64_t i = 0; i < count; ++i) {
    const uint32_t index = load_index(places.data + i * places.stride, type);
    if (index >= a.count) {
      document.fail("{}: sparse index {} is {}, but the accessor has {} elements", what, i, index, a.count);
    }
    if (i > 0 && index <= sparse.indices[i - 1])
      document.fail("{}: sparse index {} is not above the one before", what, i);
    sparse.indices[i] = index;
  }
  return sparse;
}

// convert(bytes) gives an element.
template <class T, class Convert>
std::vector<T> read_elements(const GltfDocument &document, const tinygltf::Accessor &a,
                             uint64_t element_bytes, bool may_be_strided, const std::string &what,
                             const Convert &convert)
{
  const Elements base =
      find_elements(document, a.bufferView, a.byteOffset, a.count, element_bytes, may_be_strided, what);
  if (!base.data && a.count > max_zeros) {
    document.fail("{}: {} elements without a buffer view are more than the {} allowed", what, a.count,
                  max_zeros);
  }
  const SparseElements sparse = read_sparse(document, a, element_bytes, what);
  std::vector<T> values(a.count);
  if (base.data) {
    parallel_for_each(a.count, [&](uint64_t i) { values[i] = convert(base.data + i * base.stride); });
  }
  for (size_t i = 0; i < sparse.indices.size(); ++i) {
    values[sparse.indices[i]] = convert(sparse.values.data + i * sparse.values.stride);
  }
  return values;
}

// What the specification, and KHR_mesh_quantization, let a semantic be stored as.
void check_component_type(const GltfDocument &document, const tinygltf::Accessor &a,
                          const std::string &semantic, const std::string &what)
{
  const int type = a.componentType;
  const bool is_byte = type == TINYGLTF_COMPONENT_TYPE_BYTE || type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE;
  const bool is_short =
      type == TINYGLTF_COMPONENT_TYPE_SHORT || type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT;
  const bool is_unsigned =
      type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE || type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT;
  if (type == TINYGLTF_COMPONENT_TYPE_FLOAT) return;
  if (semantic == "TEXCOORD" && (is_byte || is_short) && is_unsigned && a.normalized) return;
  const bool fits_quantization =
      (semantic == "POSITION" || semantic == "TEXCOORD")
          ? is_byte || is_short
          : semantic == "NORMAL" && (is_byte || is_short) && !is_unsigned && a.normalized;
  if (fits_quantization) {
    if (document.uses("KHR_mesh_quantization")) return;
    document.fail("{} is of {}, which takes the extension KHR_mesh_quantization; name it in extensionsUsed",
                  what, component_name(type));
  }
  document.fail("{} is of {}{}, which its use does not allow; store it as FLOAT", what,
                a.normalized ? "normalised " : "", component_name(type));
}

std::string accessor_label(const std::string &what, const std::string &semantic, int accessor)
{
  return fmt::format("{}: {} (accessor {})", what, semantic, accessor);
}

template <class T, int num_components>
SharedArray<T> read_vectors(const GltfDocument &document, int accessor, const std::string &semantic,
                            const std::string &primitive)
{
  const tinygltf::Accessor &a = document.model().accessors[size_t(accessor)];
  const std::string what = accessor_label(primitive, semantic, accessor);
  constexpr int expected = num_components == 3 ? TINYGLTF_TYPE_VEC3 : TINYGLTF_TYPE_VEC2;
  if (a.type != expected) {
    document.fail("{} is {} of {}; it must be {}", what, element_name(a.type),
                  component_name(a.componentType), element_name(expected));
  }
  check_component_type(document, a, semantic, what);
  const uint32_t size = component_bytes(a.componentType);
  return SharedArray<T>(
      read_elements<T>(document, a, size * num_components, true, what, [&](const uint8_t *p) {
        float c[num_components];
        for (int k = 0; k < num_components; ++k)
          c[k] = load_component(p + k * size, a.componentType, a.normalized);
        if constexpr (num_components == 3) {
          return T{c[0], c[1], c[2]};
        } else {
          return T{c[0], c[1]};
        }
      }));
}

}  // namespace

SharedArray<Vec3f> GltfAccessors::vec3(int accessor, const std::string &semantic, const std::string &what)
{
  SharedArray<Vec3f> &values = vec3_[{accessor, semantic}];
  if (values.empty()) values = read_vectors<Vec3f, 3>(document_, accessor, semantic, what);
  return values;
}

SharedArray<Vec2f> GltfAccessors::vec2(int accessor, const std::string &semantic, const std::string &what)
{
  SharedArray<Vec2f> &values = vec2_[{accessor, semantic}];
  if (values.empty()) values = read_vectors<Vec2f, 2>(document_, accessor, semantic, what);
  return values;
}

std::vector<uint32_t> GltfAccessors::indices(int accessor, uint64_t num_vertices,
                                             const std::string &primitive)
{
  const tinygltf::Accessor &a = document_.model().accessors[size_t(accessor)];
  const std::string what = accessor_label(primitive, "indices", accessor);
  const int type = a.componentType;
  const bool is_index = type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE ||
                        type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT ||
                        type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
  if (a.type != TINYGLTF_TYPE_SCALAR || !is_index || a.normalized) {
    document_.fail("{} are {} of {}{}; they must be SCALAR, unsigned and not normalised", what,
                   element_name(a.type), a.normalized ? "normalised " : "", component_name(type));
  }
  std::vector<uint32_t> values =
      read_elements<uint32_t>(document_, a, component_bytes(type), false, what,
                              [&](const uint8_t *p) { return load_index(p, type); });
  const uint64_t bad = find_first(values.size(), [&](uint64_t i) { return values[i] >= num_vertices; });
  if (bad != values.size()) {
    document_.fail("{}: index {} is {}, but there are {} vertices", what, bad, values[bad], num_vertices);
  }
  return values;
}

}  // namespace gpurt
