// What becomes of glTF's materials, textures and environments.
#include <cmath>

#include "core/scene/texture.h"
#include "gltf_builder.h"

namespace gpurt {
namespace {

struct LoadedMaterial {
  Material material;
  std::string warnings;
};

LoadedMaterial load_material(const json &material)
{
  GltfBuilder b = square();
  b.add("materials", material);
  b.root["meshes"][0]["primitives"][0]["material"] = 0;
  GltfLoad l;
  const SceneData d = l.bytes(b.glb());
  return {d.materials[d.geometries[0].material], l.all_warnings()};
}

json pbr(double metallic, double roughness, std::vector<double> color = {0.25, 0.5, 0.75, 1})
{
  return {{"metallicFactor", metallic}, {"roughnessFactor", roughness}, {"baseColorFactor", color}};
}

TEST(GltfMaterials, ExactCounterparts)
{
  LoadedMaterial m = load_material({{"pbrMetallicRoughness", pbr(0, 1)},
                                    {"extensions", {{"KHR_materials_specular", {{"specularFactor", 0}}}}}});
  EXPECT_EQ(m.material.type, MaterialType::Lambert);
  EXPECT_EQ(m.material.base_color.y, 0.5f);
  EXPECT_EQ(m.warnings, "");

  m = load_material({{"pbrMetallicRoughness", pbr(1, 0)}});
  EXPECT_EQ(m.material.type, MaterialType::Mirror);
  EXPECT_EQ(m.material.base_color.z, 0.75f);
  EXPECT_EQ(m.warnings, "");

  m = load_material({{"pbrMetallicRoughness", pbr(1, 0.5)}});
  EXPECT_EQ(m.material.type, MaterialType::Metal);
  EXPECT_EQ(m.material.alpha_ggx, 0.25f);
  EXPECT_EQ(m.warnings, "");

  m = load_material({{"pbrMetallicRoughness", pbr(0, 0)},
                     {"extensions",
                      {{"KHR_materials_transmission", {{"transmissionFactor", 1}}},
                       {"KHR_materials_ior", {{"ior", 1.33}}},
                       {"KHR_materials_volume", {{"thicknessFactor", 1}}}}}});
  EXPECT_EQ(m.material.type, MaterialType::Glass);
  EXPECT_EQ(m.material.ior, 1.33f);
  EXPECT_EQ(m.material.absorption.x, 0);
  EXPECT_EQ(m.warnings, "");

  m = load_material(
      {{"pbrMetallicRoughness", pbr(0, 0)},
       {"extensions",
        {{"KHR_materials_transmission", {{"transmissionFactor", 1}}},
         {"KHR_materials_volume",
          {{"thicknessFactor", 1}, {"attenuationDistance", 0.5}, {"attenuationColor", {0.25, 1, 0}}}}}}});
  EXPECT_EQ(m.material.absorption.x, float(2 * std::log(4.0)));
  EXPECT_EQ(m.material.absorption.y, 0);
  EXPECT_EQ(m.material.absorption.z, infinity);
  EXPECT_EQ(m.warnings, "");

  m = load_material({{"pbrMetallicRoughness", pbr(0, 1, {0, 0, 0, 1})},
                     {"emissiveFactor", {1, 0.5, 0}},
                     {"extensions",
                      {{"KHR_materials_emissive_strength", {{"emissiveStrength", 10000000000}}},
                       {"KHR_materials_specular", {{"specularFactor", 0}}}}}});
  EXPECT_EQ(m.material.emission.x, 1e10f);
  EXPECT_EQ(m.material.emission.y, 5e9f);
  EXPECT_EQ(m.material.two_sided_emission, 0u);
  EXPECT_EQ(m.warnings, "");
}

TEST(GltfMaterials, DoubleSidedLampsEmitFromBothSides)
{
  const LoadedMaterial m = load_material({{"doubleSided", true}, {"emissiveFactor", {1, 1, 1}}});
  EXPECT_EQ(m.material.two_sided_emission, 1u);
}

TEST(GltfMaterials, TheDefaultIsARoughMetal)
{
  GltfBuilder b = square();
  GltfLoad l;
  const SceneData d = l.bytes(b.glb());
  EXPECT_EQ(d.materials[d.geometries[0].material].type, MaterialType::Metal);
  EXPECT_EQ(d.materials[d.geometries[0].material].alpha_ggx, 1);
}

TEST(GltfMaterials, MasksAndBlending)
{
  LoadedMaterial m =
      load_material({{"pbrMetallicRoughness", pbr(1, 1, {1, 1, 1, 0.3})}, {"alphaMode", "MASK"}});
  EXPECT_EQ(m.material.alpha_cutoff, 0.5f);
  EXPECT_EQ(m.material.alpha, 0.3f);
  m = load_material({{"pbrMetallicRoughness", pbr(1, 1)}, {"alphaMode", "MASK"}, {"alphaCutoff", 0.25}});
  EXPECT_EQ(m.material.alpha_cutoff, 0.25f);
  m = load_material({{"pbrMetallicRoughness", pbr(1, 1, {1, 1, 1, 0.3})}, {"alphaMode", "BLEND"}});
  EXPECT_EQ(m.material.alpha_cutoff, 0);
  EXPECT_EQ(m.material.alpha, 0.3f);
  EXPECT_EQ(m.material.blends, 1u);
  EXPECT_EQ(m.warnings.find("blend"), std::string::npos);
  // Nothing passes: opaque.
  m = load_material({{"pbrMetallicRoughness", pbr(1, 1)}, {"alphaMode", "BLEND"}});
  EXPECT_EQ(m.material.blends, 0u);
  m = load_material({{"pbrMetallicRoughness", pbr(1, 1, {1, 1, 1, 0.3})}});
  EXPECT_EQ(m.material.alpha_cutoff, 0);
}

// What has no counterpart goes to the nearest of the four, and one line names the material and all it lost.
TEST(GltfMaterials, ApproximationsAreNamed)
{
  LoadedMaterial m = load_material(
      {{"name", "paint"},
       {"pbrMetallicRoughness", pbr(0.3, 0.4)},
       {"extensions",
        {{"KHR_materials_clearcoat", {{"clearcoatFactor", 1}}}, {"KHR_materials_unlit", json::object()}}}});
  EXPECT_EQ(m.material.type, MaterialType::Lambert);
  expect_contains(m.warnings, "material 0 ('paint')");
  for (const char *word :
       {"metallic 0.3", "specular layer", "KHR_materials_clearcoat", "KHR_materials_unlit"}) {
    expect_contains(m.warnings, word);
  }
  EXPECT_EQ(std::count(m.warnings.begin(), m.warnings.end(), '\n'), 1);
  m = load_material({{"pbrMetallicRoughness", pbr(0.7, 0.4)}});
  EXPECT_EQ(m.material.type, MaterialType::Metal);
  expect_contains(m.warnings, "metallic 0.7 (taken as 1)");
  m = load_material({{"pbrMetallicRoughness", pbr(0, 0.2)},
                     {"extensions", {{"KHR_materials_transmission", {{"transmissionFactor", 0.9}}}}}});
  EXPECT_EQ(m.material.type, MaterialType::Glass);
  for (const char *word : {"transmission 0.9", "roughness 0.2", "thin walls"})
    expect_contains(m.warnings, word);
  // Within thin walls there is no way to absorb on.
  m = load_material(
      {{"pbrMetallicRoughness", pbr(0, 0)},
       {"extensions",
        {{"KHR_materials_transmission", {{"transmissionFactor", 1}}},
         {"KHR_materials_volume", {{"attenuationDistance", 0.5}, {"attenuationColor", {0.25, 1, 0}}}}}}});
  EXPECT_EQ(m.material.absorption.x, 0);
  expect_contains(m.warnings, "thin walls");
  m = load_material({{"pbrMetallicRoughness", pbr(1, 1e-6)}});
  EXPECT_EQ(m.material.type, MaterialType::Mirror);
  expect_contains(m.warnings, "roughness 1e-06");
}

struct Textured {
  GltfBuilder builder = square();
  int image(std::vector<uint8_t> file)
  {
    return builder.add("images", {{"bufferView", builder.view(file)}, {"mimeType", "image/png"}});
  }
  SceneData load(std::string *warnings = nullptr)
  {
    GltfLoad l;
    SceneData d = l.bytes(builder.glb());
    if (warnings) *warnings = l.all_warnings();
    return d;
  }
};

TEST(GltfTextures, AreDecodedWithTheirSampler)
{
  Textured t;
  const int image = t.image(make_png(2, 1, {255, 0, 128, 255, 0, 255, 0, 64}));
  const int sampler = t.builder.add("samplers", {{"wrapS", 33071}, {"wrapT", 33648}, {"magFilter", 9728}});
  t.builder.add("textures", {{"source", image}, {"sampler", sampler}});
  t.builder.add("textures", {{"source", image}});
  t.builder.add("materials", {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}});
  t.builder.add("materials", {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 1}}}}}});
  t.builder.root["meshes"][0]["primitives"][0]["material"] = 0;
  json second = t.builder.root["meshes"][0]["primitives"][0];
  second["material"] = 1;
  t.builder.root["meshes"][0]["primitives"].push_back(second);
  const SceneData d = t.load();
  ASSERT_EQ(d.textures.size(), 2u);
  EXPECT_EQ(d.textures[0].wrap_u, Wrap::Clamp);
  EXPECT_EQ(d.textures[0].wrap_v, Wrap::Mirror);
  EXPECT_TRUE(d.textures[0].nearest);
  EXPECT_FALSE(d.textures[1].nearest);
  EXPECT_EQ(d.textures[0].texels, d.textures[1].texels) << "one image is kept once";
  const CompiledScene c = compile_scene(d, 0);
  const Texel texel = fetch_texel(c.textures[0], 0, 0);
  EXPECT_EQ(texel.r, 1);
  EXPECT_NEAR(texel.b, 0.2158605f, 1e-6f);  // 128 of sRGB
  EXPECT_EQ(fetch_texel(c.textures[0], 1, 0).a, 64.0f / 255);
}

TEST(GltfTextures, SixteenBitsStayFine)
{
  Textured t;
  // One texel: red 0x8000, green 0x0001, blue 0xffff, alpha 0x4000, big endian.
  const int image = t.image(make_png(1, 1, {0x80, 0x00, 0x00, 0x01, 0xff, 0xff, 0x40, 0x00}, 16));
  t.builder.add("textures", {{"source", image}});
  t.builder.add("materials", {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}});
  t.builder.root["meshes"][0]["primitives"][0]["material"] = 0;
  const SceneData d = t.load();
  ASSERT_EQ(d.textures[0].format, TexelFormat::Rgba32f);
  const CompiledScene c = compile_scene(d, 0);
  const Texel texel = fetch_texel(c.textures[0], 0, 0);
  EXPECT_NEAR(texel.r, std::pow((0x8000 / 65535.0 + 0.055) / 1.055, 2.4), 1e-7);
  EXPECT_NEAR(texel.g, 1 / 65535.0 / 12.92, 1e-9);
  EXPECT_EQ(texel.b, 1);
  EXPECT_EQ(texel.a, 0x4000 / 65535.0f);
}

TEST(GltfTextures, NumbersInTexturesActByTheirMean)
{
  Textured t;
  // Roughness is green, metallic blue: means 0.5 and 1.
  const int image = t.image(make_png(2, 1, {0, 255, 255, 255, 0, 0, 255, 255}));
  t.builder.add("textures", {{"source", image}});
  t.builder.add("materials", {{"pbrMetallicRoughness",
                               {{"metallicRoughnessTexture", {{"index", 0}}},
                                {"baseColorTexture", {{"index", 0}, {"texCoord", 1}}}}},
                              {"emissiveTexture", {{"index", 0}}},
                              {"emissiveFactor", {1, 1, 1}}});
  t.builder.root["meshes"][0]["primitives"][0]["material"] = 0;
  std::string warnings;
  const SceneData d = t.load(&warnings);
  const Material &m = d.materials[d.geometries[0].material];
  EXPECT_EQ(m.type, MaterialType::Metal);
  EXPECT_EQ(m.alpha_ggx, 0.25f);
  EXPECT_EQ(m.emission.x, 0);
  EXPECT_EQ(m.emission.y, 0.5f);
  EXPECT_EQ(m.emission.z, 1);
  expect_contains(warnings, "metallic-roughness texture");
  expect_contains(warnings, "emissive texture at other coordinates");
  EXPECT_EQ(m.emission_texture, invalid_id);
}

TEST(GltfTextures, LampsShineThroughThem)
{
  Textured t;
  const int image = t.image(make_png(2, 1, {255, 255, 255, 255, 0, 0, 0, 255}));
  t.builder.add("textures", {{"source", image}});
  const json moved = {{"index", 0}, {"extensions", {{"KHR_texture_transform", {{"scale", {0.5, 1}}}}}}};
  for (const bool has_base : {false, true}) {
    json pbr = json::object();
    if (has_base) pbr["baseColorTexture"] = moved;
    t.builder.root["materials"] = json::array();
    t.builder.add(
        "materials",
        {{"pbrMetallicRoughness", pbr}, {"emissiveTexture", moved}, {"emissiveFactor", {1, 0.5, 0}}});
    t.builder.root["meshes"][0]["primitives"][0]["material"] = 0;
    std::string warnings;
    const SceneData d = t.load(&warnings);
    const Material &m = d.materials[d.geometries[0].material];
    ASSERT_EQ(d.textures.size(), 1u);
    EXPECT_EQ(m.emission_texture, 0u);
    EXPECT_EQ(m.emission.y, 0.5f);
    EXPECT_EQ(warnings.find("emissive"), std::string::npos) << warnings;
    EXPECT_EQ(d.geometries[0].mesh.uvs[2].x, 0.5f) << "its coordinates count";
  }
}

TEST(GltfTextures, UnusedImagesAreNotRead)
{
  Textured t;
  t.image({1, 2, 3});
  EXPECT_TRUE(t.load().textures.empty());
}

TEST(GltfTextures, DataUrisAndFilesBeside)
{
  TemporaryFolder folder;
  const std::vector<uint8_t> png = make_png(1, 1, {255, 255, 255, 255});
  write_file(folder / "my picture.png", png.data(), png.size());
  GltfBuilder b = square();
  b.add("images", {{"uri", "my%20picture.png"}});
  b.add("textures", {{"source", 0}});
  b.add("materials", {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}});
  b.root["meshes"][0]["primitives"][0]["material"] = 0;
  // A .gltf whose buffer is a file too.
  json j = b.finished();
  j["buffers"][0]["uri"] = "data.bin";
  write_file(folder / "data.bin", b.bin.data(), b.bin.size());
  std::string text = j.dump();
  write_file(folder / "scene.gltf", text.data(), text.size());
  GltfLoad l;
  EXPECT_EQ(l.file(folder / "scene.gltf").textures.size(), 1u);

  // The same in base64.
  const char *const code = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string base64;
  for (size_t i = 0; i < b.bin.size(); i += 3) {
    uint32_t bits = 0;
    for (size_t k = 0; k < 3; ++k) bits = bits << 8 | (i + k < b.bin.size() ? b.bin[i + k] : 0);
    for (int k = 3; k >= 0; --k)
      base64 += i + size_t(3 - k) > b.bin.size() ? '=' : code[bits >> (6 * k) & 63];
  }
  j["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64;
  text = j.dump();
  write_file(folder / "scene.gltf", text.data(), text.size());
  const SceneData d = l.file(folder / "scene.gltf");
  EXPECT_EQ(d.geometries[0].mesh.vertices[2].x, 1);

  for (const char *uri : {"../up.bin", "a/../../up.bin", "/etc/passwd", "http://host/x.bin", "",
                          "%2e%2e/up.bin", "..\\up.bin"}) {
    j["buffers"][0]["uri"] = uri;
    text = j.dump();
    write_file(folder / "scene.gltf", text.data(), text.size());
    expect_contains(error_of([&] { l.file(folder / "scene.gltf"); }), "only files in the folder");
  }
  j["buffers"][0]["uri"] = "missing.bin";
  text = j.dump();
  write_file(folder / "scene.gltf", text.data(), text.size());
  expect_contains(error_of([&] { l.file(folder / "scene.gltf"); }), "no such file");
}

TEST(GltfEnvironment, Constant)
{
  GltfBuilder b = square();
  b.root["scenes"][0]["extras"]["environment"] = {{"type", "constant"}, {"radiance", {1, 2.5, 5000000000}}};
  GltfLoad l;
  const SceneData d = l.bytes(b.glb());
  EXPECT_EQ(d.environment.radiance.y, 2.5f);
  EXPECT_EQ(d.environment.radiance.z, 5e9f);
  EXPECT_EQ(d.environment.texture, invalid_id);
  const auto refused = [&](const json &environment, const char *words) {
    b.root["scenes"][0]["extras"]["environment"] = environment;
    expect_contains(load_error(b), words);
  };
  refused({{"type", "constant"}}, "three numbers");
  refused({{"type", "constant"}, {"radiance", {1, 2}}}, "three numbers");
  refused({{"type", "constant"}, {"radiance", {1, -2, 0}}}, "negative");
  refused({{"type", "sphere"}}, "'sphere'");
  refused(7, "needs a type");
  refused({{"type", "latlong"}}, "must name a file");
  refused({{"type", "latlong"}, {"image", "../secret.exr"}}, "only files in the folder");
  refused({{"type", "latlong"}, {"image", "sky.jpg"}}, "neither .exr nor .hdr");
  refused({{"type", "latlong"}, {"image", "missing.hdr"}}, "no such file");
}

TEST(GltfEnvironment, RadianceFile)
{
  TemporaryFolder folder;
  // Two texels of RGBE: (1, 0.5, 0.25) and (2, 0, 0); uncompressed.
  std::string hdr = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n";
  for (int x : {128, 64, 32, 129, 128, 0, 0, 130}) hdr += char(x);
  write_file(folder / "sky.hdr", hdr.data(), hdr.size());
  GltfBuilder b = square();
  b.root["scenes"][0]["extras"]["environment"] = {{"type", "latlong"}, {"image", "sky.hdr"}, {"strength", 3}};
  const std::vector<uint8_t> glb = b.glb();
  write_file(folder / "scene.glb", glb.data(), glb.size());
  GltfLoad l;
  const SceneData d = l.file(folder / "scene.glb");
  ASSERT_EQ(d.textures.size(), 1u);
  EXPECT_EQ(d.environment.radiance.x, 3);
  const CompiledScene c = compile_scene(d, 0);
  EXPECT_EQ(fetch_texel(c.textures[0], 0, 0).g, 0.5f);
  EXPECT_EQ(fetch_texel(c.textures[0], 1, 0).r, 2);
}

}  // namespace
}  // namespace gpurt
