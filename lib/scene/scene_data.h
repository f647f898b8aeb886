// The scene as its author described it: what the ABI and the glTF loader fill and a commit reads. Everything in it has
// been validated: ids are in range, numbers are finite.
#pragma once

#include <array>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "core/scene/scene_view.h"

namespace gpurt {

/// A read-only array of T that may be strided and keeps its memory alive: a copy, or the caller's buffer.
template <class T>
class SharedArray {
 public:
  SharedArray() = default;
  /// Takes over a vector.
  explicit SharedArray(std::vector<T> values)
  {
    auto owned = std::make_shared<std::vector<T>>(std::move(values));
    data_ = reinterpret_cast<const std::byte *>(owned->data());
    count_ = owned->size();
    owner_ = std::move(owned);
  }
  /// Refers to memory of `owner`.
  SharedArray(std::shared_ptr<const void> owner, const void *data, uint64_t count, uint64_t stride_bytes)
      : owner_(std::move(owner)),
        data_(static_cast<const std::byte *>(data)),
        count_(count),
        stride_(stride_bytes)
  {}
  uint64_t size() const { return count_; }
  bool empty() const { return count_ == 0; }
  T operator[](uint64_t i) const
  {
    T value;
    std::memcpy(&value, data_ + i * stride_, sizeof(T));  // strides need not keep T's alignment
    return value;
  }

 private:
  std::shared_ptr<const void> owner_;
  const std::byte *data_ = nullptr;
  uint64_t count_ = 0;
  uint64_t stride_ = sizeof(T);
};

struct TextureData {
  uint32_t width = 0, height = 0;
  TexelFormat format = TexelFormat::Rgba8Srgb;
  Wrap wrap_u = Wrap::Repeat, wrap_v = Wrap::Repeat;
  bool nearest = false;
  std::shared_ptr<const std::vector<std::byte>> texels;  // row major, top row first
};

struct MeshData {
  SharedArray<Vec3f> vertices;
  SharedArray<UInt3> indices;  // never empty unless there are no triangles
  SharedArray<Vec3f> normals;  // empty, or one a vertex
  SharedArray<Vec2f> uvs;      // empty, or one a vertex
};

/// 16 control points a bicubic Bezier patch.
struct PatchData {
  SharedArray<Vec3f> control_points;
};

enum class GeometryKind { Mesh, Patches };

struct GeometryData {
  GeometryKind kind = GeometryKind::Mesh;
  uint32_t material = 0;  // index into SceneData::materials
  MeshData mesh;
  PatchData patches;
};

struct InstanceData {
  uint32_t geometry;
  Transform transform;  // as given in float
  /// The same transform before rounding, row by row: loaders that multiply node hierarchies keep it exact.
  std::array<double, 12> transform_double;
};

struct PointLightData {
  LightType type;  // Point, Spot or Distant
  Vec3f color, position, direction;
  float inner_cone_angle_rad, outer_cone_angle_rad;
};

struct EnvironmentData {
  Vec3f radiance{0, 0, 0};
  uint32_t texture = invalid_id;
};

struct CameraData {
  Transform transform;
  float yfov_rad;
  uint32_t width, height;  // 0: not said
};

/// White Lambertian.
inline Material default_material()
{
  return {
      MaterialType::Lambert, {1, 1, 1}, 1, 1.5f, 1, 0, {0, 0, 0}, invalid_id, 0, 0, invalid_id, {0, 0, 0}};
}

struct SceneData {
  std::vector<TextureData> textures;
  std::vector<Material> materials = {default_material()};  // 0 stays the default; indices here count from 0
  std::vector<GeometryData> geometries;
  std::vector<InstanceData> instances;
  std::vector<PointLightData> lights;
  std::vector<CameraData> cameras;
  EnvironmentData environment;
};

}  // namespace gpurt
