// Sheets whose textures leave strips of them: the same picture as of the strips alone.
#pragma once

#include "gpurt_test.h"

namespace gpurt_test {

/// A row of grey texels side by side, of which all channels are the same; not filtered.
inline uint32_t add_grey_strips(gpurt_scene scene, const std::vector<uint8_t> &greys)
{
  std::vector<uint8_t> texels;
  for (const uint8_t grey : greys) texels.insert(texels.end(), 4, grey);
  gpurt_texture_desc desc = GPURT_TEXTURE_DESC_INIT;
  desc.format = GPURT_TEXTURE_RGBA8_LINEAR;
  desc.width = uint32_t(greys.size());
  desc.height = 1;
  desc.filter = GPURT_FILTER_NEAREST;
  desc.wrap_u = desc.wrap_v = GPURT_WRAP_CLAMP;
  desc.texels = texels.data();
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_texture(scene, &desc, &id));
  return id;
}

/// White and opaque where there is a strip, else black and clear.
inline uint32_t add_strips(gpurt_scene scene, const std::vector<bool> &strips)
{
  std::vector<uint8_t> greys;
  for (const bool is_there : strips) greys.push_back(is_there ? 255 : 0);
  return add_grey_strips(scene, greys);
}

using Corners = std::array<std::array<float, 3>, 4>;

/// A sheet of two triangles; u goes from 0 at the edge of corners 0 and 3 to 1 at that of corners 1 and 2.
inline void add_sheet(gpurt_scene scene, const Corners &corners, uint32_t material)
{
  const Mesh mesh = quad(corners[0], corners[1], corners[2], corners[3]);
  const float uvs[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  gpurt_mesh_desc desc = GPURT_MESH_DESC_INIT;
  desc.material = material;
  desc.vertices.data = mesh.vertices.data();
  desc.vertices.count = mesh.vertices.size();
  desc.indices.data = mesh.triangles.data();
  desc.indices.count = mesh.triangles.size();
  desc.uvs.data = uvs;
  desc.uvs.count = 4;
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  GPURT_EXPECT_OK(gpurt_scene_add_mesh(scene, &desc, &instance.geometry));
  uint32_t id;
  GPURT_EXPECT_OK(gpurt_scene_add_instance(scene, &instance, &id));
}

/// The strips of such a sheet that are there, as sheets of their own.
inline void add_sheets(gpurt_scene scene, const Corners &corners, const std::vector<bool> &strips,
                       uint32_t material)
{
  const auto between = [&](size_t a, size_t b, float t) {
    std::array<float, 3> p;
    for (size_t k = 0; k < 3; ++k) p[k] = corners[a][k] + (corners[b][k] - corners[a][k]) * t;
    return p;
  };
  const float step = 1 / float(strips.size());
  for (size_t i = 0; i < strips.size(); ++i) {
    const float t = float(i) * step;
    if (strips[i])
      add_sheet(scene, {between(0, 1, t), between(0, 1, t + step), between(3, 2, t + step), between(3, 2, t)},
                material);
  }
}

}  // namespace gpurt_test
