#include "cuda/device_scene.h"

#include <map>

namespace gpurt::cuda {

DeviceScene::DeviceScene(const CompiledScene &scene, const std::shared_ptr<DeviceMemory> &memory,
                         cudaStream_t stream)
    : memory_(memory), stream_(stream), view_(scene.view())
{
  // The view's counts and constants stay as they are; every pointer is replaced.
  view_.positions = keep(scene.positions, "the scene's positions");
  view_.indices = keep(scene.indices, "the scene's triangles");
  view_.triangle_segment = keep(scene.triangle_segment, "the scene's triangles");
  view_.normals = keep(scene.normals, "the scene's normals");
  view_.uvs = keep(scene.uvs, "the scene's texture coordinates");
  view_.segments = keep(scene.segments, "the scene's segments");
  view_.groups = keep(scene.groups, "the scene's groups");
  view_.placements = keep(scene.placements, "the scene's placements");
  view_.materials = keep(scene.materials, "the scene's materials");
  view_.lights = keep(scene.lights, "the scene's lights");
  view_.light_bundles = keep(scene.light_bundles, "the scene's light tree");
  view_.environment.row_cdf = keep(scene.environment_rows, "the environment's table");
  view_.environment.column_cdf = keep(scene.environment_columns, "the environment's table");
  // Textures may share texels, as the environment's does with the one that it was made of.
  std::map<const void *, const void *> on_device;
  for (const auto &texels : scene.texture_data) {
    const auto [it, is_new] = on_device.try_emplace(texels->data());
    if (is_new) it->second = keep(*texels, "the scene's textures");
  }
  std::vector<Texture> textures = scene.textures;
  for (Texture &texture : textures) texture.texels = on_device.at(texture.texels);
  view_.textures = keep(textures, "the scene's textures");
  reyes_ = scene.reyes_view();
  reyes_.scene = view_;
  reyes_.control_points = keep(scene.control_points, "the scene's patches");
  reyes_.patches = keep(scene.patch_ranges, "the scene's patches");
  reyes_.cells = keep(scene.patch_cells, "the scene's patches");
  reyes_.ranges = keep(scene.root_ranges, "the scene's patches");
}

template <class T>
const T *DeviceScene::keep(const std::vector<T> &values, const char *what)
{
  if (values.empty()) return nullptr;
  DeviceBuffer<std::byte> buffer = upload(memory_, std::as_bytes(std::span(values)), what, stream_);
  bytes_ += buffer.bytes();
  buffers_.push_back(std::move(buffer));
  return reinterpret_cast<const T *>(buffers_.back().data());
}

}  // namespace gpurt::cuda
