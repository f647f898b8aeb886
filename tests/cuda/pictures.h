// Scenes to render, and the bits of pictures.
#pragma once

#include "scenes.h"

namespace gpurt_test {

/// The Cornell box from quads: diffuse walls, a lamp below the ceiling, two boxes.
inline void fill_cornell_box(gpurt_scene scene)
{
  const uint32_t white = add_material(scene, GPURT_MATERIAL_LAMBERT, {0.73f, 0.71f, 0.68f});
  const uint32_t red = add_material(scene, GPURT_MATERIAL_LAMBERT, {0.61f, 0.05f, 0.04f});
  const uint32_t green = add_material(scene, GPURT_MATERIAL_LAMBERT, {0.10f, 0.42f, 0.08f});
  const uint32_t lamp = add_material(scene, GPURT_MATERIAL_LAMBERT, {0, 0, 0}, {17, 12, 4});
  Mesh walls = quad({-1, -1, 1}, {1, -1, 1}, {1, -1, -1}, {-1, -1, -1});
  walls.append(quad({-1, 1, -1}, {1, 1, -1}, {1, 1, 1}, {-1, 1, 1}));
  walls.append(quad({-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1}));
  add_mesh(scene, walls, white);
  add_mesh(scene, quad({-1, -1, 1}, {-1, -1, -1}, {-1, 1, -1}, {-1, 1, 1}), red);
  add_mesh(scene, quad({1, -1, -1}, {1, -1, 1}, {1, 1, 1}, {1, 1, -1}), green);
  add_mesh(
      scene,
      quad({-0.25f, 0.98f, -0.25f}, {0.25f, 0.98f, -0.25f}, {0.25f, 0.98f, 0.25f}, {-0.25f, 0.98f, 0.25f}),
      lamp);
  const auto turned = [](Mesh m, float c, float s, float x, float z) {
    return m.map([&](Vec v) { return Vec{c * v[0] + s * v[2] + x, v[1], -s * v[0] + c * v[2] + z}; });
  };
  add_mesh(scene, turned(box({-0.3f, -1, -0.3f}, {0.3f, -0.4f, 0.3f}), 0.9563f, -0.2924f, 0.35f, 0.35f),
           white);
  add_mesh(scene, turned(box({-0.3f, -1, -0.3f}, {0.3f, 0.2f, 0.3f}), 0.9511f, 0.309f, -0.35f, -0.3f), white);
  add_camera(scene, {0, 0, 3.4f}, 0.7f);
}

inline uint32_t add_texture(gpurt_scene scene, gpurt_texture_format format, uint32_t width, uint32_t height,
                            const void *texels, gpurt_wrap wrap, gpurt_filter filter)
{
  gpurt_texture_desc desc = GPURT_TEXTURE_DESC_INIT;
  desc.format = format;
  desc.width = width;
  desc.height = height;
  desc.wrap_u = desc.wrap_v = wrap;
  desc.filter = filter;
  desc.texels = texels;
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_texture(scene, &desc, &id));
  return id;
}

/// A mesh with texture coordinates of its places: scaled x, and scaled y + z. `smooth`: with the normals of a sphere about the
/// origin.
inline uint32_t add_textured_mesh(gpurt_scene scene, const Mesh &mesh, uint32_t material,
                                  std::array<float, 2> scale, bool smooth = false)
{
  std::vector<std::array<float, 2>> uvs;
  for (const Vec &v : mesh.vertices) uvs.push_back({scale[0] * v[0], scale[1] * (v[1] + v[2])});
  gpurt_mesh_desc desc = GPURT_MESH_DESC_INIT;
  desc.material = material;
  desc.vertices.data = mesh.vertices.data();
  desc.vertices.count = mesh.vertices.size();
  desc.indices.data = mesh.triangles.data();
  desc.indices.count = mesh.triangles.size();
  desc.uvs.data = uvs.data();
  desc.uvs.count = uvs.size();
  if (smooth) desc.normals = desc.vertices;
  uint32_t geometry = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_mesh(scene, &desc, &geometry));
  return geometry;
}

/// Everything that a scene can have: each material, textures in each format, wrap and filter, alpha masks, smooth
/// normals, shared and mirrored instances, lamps that are shared, each punctual light, an environment image, patches.
inline void fill_everything(gpurt_scene scene)
{
  Random random(5);
  std::vector<uint8_t> bytes(37 * 23 * 4);
  for (uint8_t &b : bytes) b = uint8_t(random.bits() >> 24);
  std::vector<float> floats(16 * 8 * 4);
  for (float &f : floats) f = random.unit();
  std::vector<float> sky(64 * 32 * 4);
  for (size_t i = 0; i < sky.size(); ++i) sky[i] = (i / 4 == 10 * 64 + 20 ? 200.0f : 0.4f) * random.unit();
  const uint32_t srgb = add_texture(scene, GPURT_TEXTURE_RGBA8_SRGB, 37, 23, bytes.data(), GPURT_WRAP_MIRROR,
                                    GPURT_FILTER_LINEAR);
  const uint32_t linear = add_texture(scene, GPURT_TEXTURE_RGBA8_LINEAR, 37, 23, bytes.data(),
                                      GPURT_WRAP_REPEAT, GPURT_FILTER_NEAREST);
  const uint32_t real =
      add_texture(scene, GPURT_TEXTURE_RGBA32F, 16, 8, floats.data(), GPURT_WRAP_CLAMP, GPURT_FILTER_LINEAR);
  const uint32_t sky_texture =
      add_texture(scene, GPURT_TEXTURE_RGBA32F, 64, 32, sky.data(), GPURT_WRAP_REPEAT, GPURT_FILTER_LINEAR);
  const auto textured = [&](gpurt_material_type type, uint32_t texture, float roughness, float cutoff) {
    gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
    desc.type = type;
    desc.base_color_texture = texture;
    desc.roughness = roughness;
    desc.alpha_cutoff = cutoff;
    desc.alpha = 0.9f;
    uint32_t id = 0;
    GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &desc, &id));
    return id;
  };
  const auto add = [&](const Mesh &mesh, uint32_t material, bool smooth, float uv_scale, bool with_instance) {
    const uint32_t geometry = add_textured_mesh(scene, mesh, material, {uv_scale, uv_scale}, smooth);
    if (with_instance) place(scene, geometry, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0});
    return geometry;
  };
  add(quad({-6, -1, 6}, {6, -1, 6}, {6, -1, -6}, {-6, -1, -6}), textured(GPURT_MATERIAL_LAMBERT, srgb, 1, 0),
      false, 0.7f, true);
  const Mesh sphere = icosphere(3);
  const uint32_t materials[] = {add_material(scene, GPURT_MATERIAL_MIRROR, {0.9f, 0.8f, 0.7f}),
                                add_material(scene, GPURT_MATERIAL_GLASS, {0.9f, 1, 0.9f}),
                                textured(GPURT_MATERIAL_METAL, real, 0.3f, 0),
                                add_material(scene, GPURT_MATERIAL_METAL, {1, 0.7f, 0.3f}, {0, 0, 0}, 0.05f),
                                textured(GPURT_MATERIAL_LAMBERT, linear, 1, 0)};
  for (int i = 0; i < 5; ++i) {
    const uint32_t geometry = add(sphere, materials[i], i != 4, 1.3f, false);
    const float x = float(i) - 2;
    place(scene, geometry, {0.5f, 0, 0, x, 0, 0.5f, 0, -0.5f, 0, 0, 0.5f, 0});
    if (i % 2 == 0)
      place(scene, geometry, {-0.25f, 0, 0.1f, x, 0, 0.3f, 0, 0.6f, 0, 0, 0.25f, -1});  // mirrored, sheared
  }
  add(quad({-2, -1, -1.5f}, {2, -1, -1.5f}, {2, 1.5f, -1.5f}, {-2, 1.5f, -1.5f}),
      textured(GPURT_MATERIAL_LAMBERT, linear, 1, 0.4f), false, 0.9f, true);
  gpurt_material_desc lamp = GPURT_MATERIAL_DESC_INIT;
  lamp.emission[0] = 6;
  lamp.emission[1] = 5;
  lamp.emission[2] = 4;
  lamp.two_sided_emission = 1;
  uint32_t lamp_id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &lamp, &lamp_id));
  const uint32_t bulb = add(icosphere(1), lamp_id, false, 1, false);
  for (int i = 0; i < 6; ++i)
    place(scene, bulb, {0.05f, 0, 0, float(i) - 2.5f, 0, 0.05f, 0, 1, 0, 0, i % 2 ? -0.05f : 0.05f, 0.8f});
  for (gpurt_light_type type : {GPURT_LIGHT_POINT, GPURT_LIGHT_SPOT, GPURT_LIGHT_DISTANT}) {
    gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
    light.type = type;
    for (float &c : light.intensity) c = type == GPURT_LIGHT_DISTANT ? 0.5f : 3.0f;
    light.position[0] = type == GPURT_LIGHT_SPOT ? -2.0f : 2.0f;
    light.position[1] = 2;
    light.position[2] = 1;
    light.direction[0] = 0.4f;
    light.direction[1] = -1;
    light.direction[2] = -0.3f;
    uint32_t id;
    GPURT_EXPECT_OK(gpurt_scene_add_light(scene, &light, &id));
  }
  gpurt_environment_desc environment = GPURT_ENVIRONMENT_DESC_INIT;
  environment.texture = sky_texture;
  for (float &c : environment.radiance) c = 1;
  GPURT_EXPECT_OK(gpurt_scene_set_environment(scene, &environment));
  std::vector<Vec> control;
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column)
      control.push_back({0.6f * float(column) - 3.2f, 0.2f * float(row * column % 3), 0.5f * float(row) - 1});
  }
  gpurt_patches_desc patches = GPURT_PATCHES_DESC_INIT;
  patches.material = materials[3];
  patches.control_points.data = control.data();
  patches.control_points.count = control.size();
  uint32_t patch_geometry;
  GPURT_EXPECT_OK(gpurt_scene_add_patches(scene, &patches, &patch_geometry));
  place(scene, patch_geometry, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0});
  add_camera(scene, {0, 0.2f, 4.5f}, 0.8f);
}

/// A sheet that lets part of light pass: as its texture says, which has all of 0 to 1, where it has one.
inline uint32_t add_veil(gpurt_scene scene, gpurt_material_type type, float alpha, uint32_t texture = 0,
                         std::array<float, 3> emission = {0, 0, 0})
{
  gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
  desc.type = type;
  desc.alpha = alpha;
  desc.blends = 1;
  desc.base_color_texture = texture;
  desc.two_sided_emission = 1;
  std::memcpy(desc.emission, emission.data(), sizeof desc.emission);
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &desc, &id));
  return id;
}

/// The Cornell box with sheets that blend in it, one of them a lamp: all in the world, so that kernels have masks alone.
inline void fill_veiled_box(gpurt_scene scene)
{
  fill_cornell_box(scene);
  for (int i = 0; i < 5; ++i) {
    const float z = 0.3f * float(i) - 0.5f, alpha = 0.1f + 0.2f * float(i);
    const gpurt_material_type type = i == 1 ? GPURT_MATERIAL_MIRROR : GPURT_MATERIAL_LAMBERT;
    add_mesh(scene,
             quad({-0.8f, -0.9f, z}, {0.7f, -0.9f, z}, {0.7f, 0.6f, z + 0.2f}, {-0.8f, 0.6f, z + 0.2f}),
             add_veil(scene, type, alpha));
  }
  add_mesh(scene, quad({-0.9f, 0, -0.5f}, {-0.9f, 0, 0.5f}, {-0.9f, 0.5f, 0.5f}, {-0.9f, 0.5f, -0.5f}),
           add_veil(scene, GPURT_MATERIAL_LAMBERT, 0.3f, 0, {3, 4, 5}));
}

/// Everything, and sheets, balls and lamps that blend, textured and shared.
inline void fill_veiled_everything(gpurt_scene scene)
{
  fill_everything(scene);
  Random random(17);
  std::vector<uint8_t> texels(32 * 32 * 4);
  for (uint8_t &t : texels) t = uint8_t(random.bits() >> 24);
  const uint32_t texture = add_texture(scene, GPURT_TEXTURE_RGBA8_SRGB, 32, 32, texels.data(),
                                       GPURT_WRAP_REPEAT, GPURT_FILTER_LINEAR);
  const auto add = [&](const Mesh &mesh, uint32_t material) {
    return add_textured_mesh(scene, mesh, material, {1.7f, 1.7f});
  };
  place(scene,
        add(quad({-3, -1, 1.2f}, {3, -1, 1.2f}, {3, 1.5f, 1.2f}, {-3, 1.5f, 1.2f}),
            add_veil(scene, GPURT_MATERIAL_LAMBERT, 0.6f, texture)),
        {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0});
  const uint32_t balls[] = {
      add(icosphere(2), add_veil(scene, GPURT_MATERIAL_GLASS, 0.5f)),
      add(icosphere(2), add_veil(scene, GPURT_MATERIAL_METAL, 0.9f, texture)),
      add(icosphere(1), add_veil(scene, GPURT_MATERIAL_LAMBERT, 0.7f, texture, {5, 4, 2}))};
  for (int i = 0; i < 6; ++i) {
    const float s = i % 3 == 2 ? 0.1f : 0.35f, x = float(i) - 2.5f;
    place(scene, balls[i % 3], {i % 2 ? s : -s, 0, 0, x, 0, s, 0, 0.1f, 0, 0, s, 0.7f});
  }
}

/// A material with every field of glass that absorbs, or of a lamp with a texture.
inline uint32_t add_tinted_glass(gpurt_scene scene, std::array<float, 3> color, float distance)
{
  gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
  desc.type = GPURT_MATERIAL_GLASS;
  desc.attenuation_distance = distance;
  std::memcpy(desc.attenuation_color, color.data(), sizeof desc.attenuation_color);
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &desc, &id));
  return id;
}
inline uint32_t add_textured_lamp(gpurt_scene scene, std::array<float, 3> emission, uint32_t texture,
                                  bool two_sided)
{
  gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
  std::memcpy(desc.emission, emission.data(), sizeof desc.emission);
  desc.emission_texture = texture;
  desc.two_sided_emission = two_sided;
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &desc, &id));
  return id;
}

/// The Cornell box with glass that absorbs, an opaque ball within one of its solids, a mask, and lamps with textures, one of
/// them shared and mirrored.
inline void fill_tinted_box(gpurt_scene scene)
{
  fill_cornell_box(scene);
  const auto ball = [](float x, float y, float z, float radius) {
    return icosphere(3).map(
        [&](Vec v) { return Vec{radius * v[0] + x, radius * v[1] + y, radius * v[2] + z}; });
  };
  const uint32_t red = add_tinted_glass(scene, {0.9f, 0.2f, 0.05f}, 0.3f),
                 blue = add_tinted_glass(scene, {0, 0.5f, 1}, 0.2f);
  add_mesh(scene, ball(0.35f, -0.15f, 0.35f, 0.25f), red);
  add_mesh(scene, ball(-0.4f, -0.7f, 0.5f, 0.28f), blue);
  add_mesh(scene, ball(-0.4f, -0.7f, 0.5f, 0.1f),
           add_material(scene, GPURT_MATERIAL_LAMBERT, {0.8f, 0.8f, 0.8f}));
  Random random(23);
  std::vector<uint8_t> texels(16 * 16 * 4);
  for (size_t i = 0; i < texels.size(); ++i) texels[i] = i / 4 % 3 == 0 ? 0 : uint8_t(random.bits() >> 24);
  const uint32_t texture = add_texture(scene, GPURT_TEXTURE_RGBA8_SRGB, 16, 16, texels.data(),
                                       GPURT_WRAP_REPEAT, GPURT_FILTER_LINEAR);
  gpurt_material_desc mask = GPURT_MATERIAL_DESC_INIT;
  mask.base_color_texture = texture;
  mask.alpha_cutoff = 0.4f;
  uint32_t masked = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &mask, &masked));
  const auto add = [&](const Mesh &mesh, uint32_t material) {
    return add_textured_mesh(scene, mesh, material, {1.3f, 1.7f});
  };
  place(scene,
        add(quad({0.1f, 0.2f, -0.8f}, {0.9f, 0.2f, -0.8f}, {0.9f, 0.9f, -0.6f}, {0.1f, 0.9f, -0.6f}), masked),
        {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0});
  place(scene,
        add(quad({-0.9f, 0, -0.5f}, {-0.9f, 0, 0.5f}, {-0.9f, 0.5f, 0.5f}, {-0.9f, 0.5f, -0.5f}),
            add_textured_lamp(scene, {3, 4, 5}, texture, true)),
        {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0});
  const uint32_t bulb = add(icosphere(1), add_textured_lamp(scene, {9, 6, 3}, texture, false));
  for (int i = 0; i < 3; ++i)
    place(scene, bulb,
          {i == 1 ? -0.06f : 0.06f, 0, 0, 0.5f * float(i) - 0.4f, 0, 0.06f, 0, 0.5f, 0, 0, 0.06f, 0.6f});
}

constexpr uint32_t error_outputs = 1u << GPURT_OUTPUT_BIAS | 1u << GPURT_OUTPUT_ERROR;  // of photon mapping
constexpr uint32_t all_outputs =
    ((1u << GPURT_OUTPUT_COUNT) - 1) & ~(1u << GPURT_OUTPUT_TIME) & ~error_outputs;

struct OutputBits {
  const char *name;
  std::vector<uint32_t> words;
};

inline std::vector<OutputBits> read_all(gpurt_frame frame, const RenderOptions &o,
                                        uint32_t wanted = all_outputs)
{
  const struct {
    gpurt_output output;
    const char *name;
    uint32_t components;
  } outputs[] = {{GPURT_OUTPUT_COLOR, "color", 3},
                 {GPURT_OUTPUT_ALPHA, "alpha", 1},
                 {GPURT_OUTPUT_DEPTH, "depth", 1},
                 {GPURT_OUTPUT_NORMAL, "normal", 3},
                 {GPURT_OUTPUT_ALBEDO, "albedo", 3},
                 {GPURT_OUTPUT_POSITION, "position", 3},
                 {GPURT_OUTPUT_PRIMITIVE, "primitive", 1},
                 {GPURT_OUTPUT_INSTANCE, "instance", 1},
                 {GPURT_OUTPUT_SAMPLE_COUNT, "sample count", 1},
                 {GPURT_OUTPUT_VARIANCE, "variance", 3},
                 {GPURT_OUTPUT_BIAS, "bias", 3},
                 {GPURT_OUTPUT_ERROR, "error", 3}};
  std::vector<OutputBits> all;
  for (const auto &out : outputs) {
    if (!(wanted & 1u << out.output)) continue;
    std::vector<uint32_t> words(size_t(o.width) * o.height * out.components);
    GPURT_EXPECT_OK(gpurt_frame_read(frame, out.output, words.data(), words.size() * sizeof(uint32_t)));
    all.push_back({out.name, std::move(words)});
  }
  return all;
}

inline void expect_same(const std::vector<OutputBits> &expected, const std::vector<OutputBits> &tested)
{
  for (size_t i = 0; i < expected.size(); ++i) {
    uint64_t num_different = 0;
    size_t first = 0;
    for (size_t k = 0; k < expected[i].words.size(); ++k) {
      if (expected[i].words[k] == tested[i].words[k]) continue;
      if (num_different++ == 0) first = k;
    }
    EXPECT_EQ(num_different, 0u) << expected[i].name << " differs, first in value " << first << ": "
                                 << std::hex << expected[i].words[first] << " and " << tested[i].words[first];
  }
}

inline gpurt_statistics statistics(gpurt_frame frame)
{
  gpurt_statistics s = GPURT_STATISTICS_INIT;
  GPURT_EXPECT_OK(gpurt_frame_get_statistics(frame, &s));
  return s;
}

inline Scene make_scene(gpurt_device device, void (*fill)(gpurt_scene),
                        gpurt_accel accel = GPURT_ACCEL_KDTREE)
{
  Scene scene;
  GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
  fill(scene);
  commit(scene, accel);
  return scene;
}

}  // namespace gpurt_test
