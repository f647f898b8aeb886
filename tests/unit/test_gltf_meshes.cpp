// Every form in which glTF stores a mesh gives the same mesh; nodes place it.
#include "gltf_builder.h"

namespace gpurt {
namespace {

constexpr float pi_f = 3.14159265f;

void expect_point(Vec3f p, float x, float y, float z, float tolerance = 0)
{
  EXPECT_NEAR(p.x, x, tolerance);
  EXPECT_NEAR(p.y, y, tolerance);
  EXPECT_NEAR(p.z, z, tolerance);
}

const std::vector<float> square_points = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};

void expect_square(const SceneData &d, float tolerance = 0)
{
  ASSERT_EQ(d.geometries.size(), 1u);
  const MeshData &m = d.geometries[0].mesh;
  ASSERT_EQ(m.vertices.size(), 4u);
  for (int i = 0; i < 4; ++i) {
    const float *p = &square_points[size_t(3 * i)];
    expect_point(m.vertices[uint64_t(i)], p[0], p[1], p[2], tolerance);
  }
  ASSERT_EQ(m.indices.size(), 2u);
  EXPECT_EQ(m.indices[0].y, 1u);
  EXPECT_EQ(m.indices[1].x, 0u);
  EXPECT_EQ(m.indices[1].y, 2u);
  EXPECT_EQ(m.indices[1].z, 3u);
}

SceneData load(const GltfBuilder &b)
{
  GltfLoad l;
  return l.bytes(b.glb());
}

TEST(GltfMeshes, PlainSquare)
{
  const SceneData d = load(square());
  expect_square(d);
  expect_point(d.geometries[0].mesh.normals[2], 0, 0, 1);
  EXPECT_EQ(d.instances.size(), 1u);
}

TEST(GltfMeshes, IndexTypes)
{
  const auto with = [](auto type) {
    using T = decltype(type);
    GltfBuilder b = square();
    b.root["meshes"][0]["primitives"][0]["indices"] = b.accessor<T>({0, 1, 2, 0, 2, 3}, "SCALAR");
    expect_square(load(b));
  };
  with(uint8_t());
  with(uint16_t());
  with(uint32_t());
}

TEST(GltfMeshes, WithoutIndices)
{
  GltfBuilder b;
  b.node({{"mesh",
           b.mesh({{"attributes",
                    {{"POSITION", b.accessor<float>({0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 0, 0, 1, 0},
                                                    "VEC3")}}}})}});
  const SceneData d = load(b);
  ASSERT_EQ(d.geometries[0].mesh.indices.size(), 2u);
  EXPECT_EQ(d.geometries[0].mesh.indices[1].z, 5u);
}

TEST(GltfMeshes, Interleaved)
{
  GltfBuilder b = square();
  json &attributes = b.root["meshes"][0]["primitives"][0]["attributes"];
  attributes["POSITION"] = b.strided_accessor<float>(square_points, "VEC3", 32, 8);
  expect_square(load(b));
}

TEST(GltfMeshes, Quantized)
{
  const std::vector<int> corners = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
  const auto with = [&](auto type, int one, bool is_normalized) {
    using T = decltype(type);
    std::vector<T> values;
    for (int c : corners) values.push_back(T(c * one));
    GltfBuilder b = square();
    b.root["extensionsUsed"] = {"KHR_mesh_quantization"};
    b.root["meshes"][0]["primitives"][0]["attributes"]["POSITION"] =
        b.strided_accessor<T>(values, "VEC3", 8, 0, is_normalized);
    expect_square(load(b));
    b.root.erase("extensionsUsed");
    expect_contains(load_error(b), "KHR_mesh_quantization");
  };
  with(int8_t(), 127, true);
  with(uint8_t(), 255, true);
  with(int16_t(), 32767, true);
  with(uint16_t(), 65535, true);
  with(int8_t(), 1, false);
  with(uint8_t(), 1, false);
  with(int16_t(), 1, false);
  with(uint16_t(), 1, false);
}

TEST(GltfMeshes, QuantizedNormalsReachBothEnds)
{
  GltfBuilder b = square();
  b.root["extensionsUsed"] = {"KHR_mesh_quantization"};
  b.root["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] =
      b.strided_accessor<int8_t>({-128, 0, 0, -127, 0, 0, 127, 0, 0, 0, 64, 0}, "VEC3", 4, 0, true);
  const SceneData d = load(b);
  expect_point(d.geometries[0].mesh.normals[0], -1, 0, 0);
  expect_point(d.geometries[0].mesh.normals[1], -1, 0, 0);
  expect_point(d.geometries[0].mesh.normals[2], 1, 0, 0);
  expect_point(d.geometries[0].mesh.normals[3], 0, 64.0f / 127, 0);
}

TEST(GltfMeshes, NormalizedTextureCoordinates)
{
  GltfBuilder b = square();
  const int texture = b.add(
      "textures", {{"source", b.add("images", {{"bufferView", b.view(make_png(1, 1, {255, 255, 255, 255}))},
                                               {"mimeType", "image/png"}})}});
  b.add("materials", {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", texture}}}}}});
  json &primitive = b.root["meshes"][0]["primitives"][0];
  primitive["material"] = 0;
  primitive["attributes"]["TEXCOORD_0"] = b.accessor<uint8_t>({0, 0, 255, 0, 255, 255, 0, 255}, "VEC2", true);
  EXPECT_EQ(load(b).geometries[0].mesh.uvs[2].y, 1);
  primitive["attributes"]["TEXCOORD_0"] =
      b.accessor<uint16_t>({0, 0, 65535, 0, 65535, 65535, 0, 65535}, "VEC2", true);
  EXPECT_EQ(load(b).geometries[0].mesh.uvs[2].y, 1);

  // Moved by KHR_texture_transform: scaled, turned, then shifted.
  b.root["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] = {
      {"KHR_texture_transform", {{"offset", {0.5, 0.25}}, {"scale", {2, 3}}, {"rotation", pi_f / 2}}}};
  const SceneData d = load(b);
  // (1, 1) -> (2, 3) -> a quarter turn: (3, -2) -> (3.5, -1.75).
  EXPECT_NEAR(d.geometries[0].mesh.uvs[2].x, 3.5f, 1e-6f);
  EXPECT_NEAR(d.geometries[0].mesh.uvs[2].y, -1.75f, 1e-6f);
}

TEST(GltfMeshes, TheTextureNamesItsCoordinates)
{
  GltfBuilder b = square();
  const int texture =
      b.add("textures",
            {{"source", b.add("images", {{"bufferView", b.view(make_png(1, 1, {255, 255, 255, 255}))}})}});
  b.add("materials",
        {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", texture}, {"texCoord", 1}}}}}});
  json &primitive = b.root["meshes"][0]["primitives"][0];
  primitive["material"] = 0;
  GltfLoad missing;
  EXPECT_TRUE(missing.bytes(b.glb()).geometries[0].mesh.uvs.empty());
  expect_contains(missing.all_warnings(), "no TEXCOORD_1");
  primitive["attributes"]["TEXCOORD_1"] = b.accessor<float>({5, 5, 6, 6, 7, 7, 8, 8}, "VEC2");
  EXPECT_EQ(load(b).geometries[0].mesh.uvs[3].x, 8);
}

TEST(GltfMeshes, Sparse)
{
  // All four corners at the origin, then three of them moved; once over a stored base and once over none.
  for (bool has_base : {true, false}) {
    GltfBuilder b = square();
    const int base = b.accessor<float>(std::vector<float>(12, 0.0f), "VEC3");
    json &a = b.root["accessors"][size_t(base)];
    if (!has_base) a.erase("bufferView");
    const std::vector<float> values = {1, 0, 0, 1, 1, 0, 0, 1, 0};
    a["sparse"] = {{"count", 3},
                   {"indices", {{"bufferView", b.view({1, 2, 3})}, {"componentType", 5121}}},
                   {"values", {{"bufferView", b.view(GltfBuilder::bytes_of(values))}}}};
    b.root["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = base;
    expect_square(load(b));

    GltfBuilder bad = b;
    bad.root["accessors"][size_t(base)]["sparse"]["indices"]["bufferView"] = bad.view({1, 2, 4});
    expect_contains(load_error(bad), "sparse index 2 is 4");
    bad.root["accessors"][size_t(base)]["sparse"]["indices"]["bufferView"] = bad.view({1, 1, 2});
    expect_contains(load_error(bad), "not above");
    bad.root["accessors"][size_t(base)]["sparse"]["count"] = 5;
    expect_contains(load_error(bad), "5 sparse elements replace 4");
    bad = b;
    bad.root["accessors"][size_t(base)]["sparse"]["values"]["byteOffset"] = 4;
    expect_contains(load_error(bad), "sparse values");
  }
}

TEST(GltfMeshes, SparseIndexTypes)
{
  const auto with = [](auto type) {
    using T = decltype(type);
    GltfBuilder b = square();
    const int base = b.accessor<float>(std::vector<float>(12, 0.0f), "VEC3");
    const std::vector<T> indices = {1, 2, 3};
    const std::vector<float> values = {1, 0, 0, 1, 1, 0, 0, 1, 0};
    b.root["accessors"][size_t(base)]["sparse"] = {
        {"count", 3},
        {"indices",
         {{"bufferView", b.view(GltfBuilder::bytes_of(indices))},
          {"componentType", GltfBuilder::component_type<T>()}}},
        {"values", {{"bufferView", b.view(GltfBuilder::bytes_of(values))}}}};
    b.root["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = base;
    expect_square(load(b));
  };
  with(uint16_t());
  with(uint32_t());
}

TEST(GltfMeshes, StripsAndFansKeepTheWinding)
{
  for (bool has_indices : {true, false}) {
    for (int mode : {5, 6}) {
      GltfBuilder b;
      // Five points around; as a strip they zigzag.
      const std::vector<float> fan = {0, 0, 0, 2, 0, 0, 2, 1, 0, 1, 2, 0, 0, 1, 0};
      const std::vector<float> strip = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 2, 0};
      json primitive = {{"attributes", {{"POSITION", b.accessor<float>(mode == 6 ? fan : strip, "VEC3")}}},
                        {"mode", mode}};
      if (has_indices) primitive["indices"] = b.accessor<uint8_t>({0, 1, 2, 3, 4}, "SCALAR");
      b.node({{"mesh", b.mesh(primitive)}});
      const SceneData d = load(b);
      const MeshData &m = d.geometries[0].mesh;
      ASSERT_EQ(m.indices.size(), 3u);
      for (uint64_t i = 0; i < 3; ++i) {
        const UInt3 c = m.indices[i];
        const Vec3f n = cross(m.vertices[c.y] - m.vertices[c.x], m.vertices[c.z] - m.vertices[c.x]);
        EXPECT_GT(n.z, 0) << "mode " << mode << ", triangle " << i;
      }
    }
  }
}

TEST(GltfMeshes, PointsAndLinesAreLeftOut)
{
  for (int mode : {0, 1, 2, 3}) {
    GltfBuilder b = square();
    b.root["meshes"][0]["primitives"][0]["mode"] = mode;
    GltfLoad l;
    EXPECT_TRUE(l.bytes(b.glb()).geometries.empty());
    expect_contains(l.all_warnings(), mode == 0 ? "points" : "lines");
  }
}

TEST(GltfMeshes, Patches)
{
  GltfBuilder b;
  std::vector<float> points;
  for (int k = 0; k < 32; ++k) points.insert(points.end(), {float(k % 4), float(k / 4), 0});
  const int accessor = b.accessor<float>(points, "VEC3");
  b.root["extensionsUsed"] = {"GPURT_bezier_patches"};
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", accessor}}},
                           {"mode", 0},
                           {"extensions", {{"GPURT_bezier_patches", {{"controlPoints", accessor}}}}}})}});
  const SceneData d = load(b);
  ASSERT_EQ(d.geometries.size(), 1u);
  EXPECT_EQ(d.geometries[0].kind, GeometryKind::Patches);
  EXPECT_EQ(d.geometries[0].patches.control_points.size(), 32u);
  b.root["accessors"][size_t(accessor)]["count"] = 31;
  expect_contains(load_error(b), "31 control points");
}

TEST(GltfMeshes, ZeroNormalsAreReported)
{
  GltfBuilder b = square();
  b.root["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] =
      b.accessor<float>({0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, 1}, "VEC3");
  GltfLoad l;
  const SceneData d = l.bytes(b.glb());
  expect_contains(l.all_warnings(), "1 of its normals have no length");
  expect_point(compile_scene(d, 0).normals[1], 0, 0, 1);
}

TEST(GltfNodes, HierarchiesMultiplyInDouble)
{
  GltfBuilder b = square();
  b.root["nodes"][0]["translation"] = {1, 2, 3};
  const double s = std::sqrt(0.5);
  // A quarter turn about Z, and a matrix that scales by 2 and moves by (10, 0, 0), column by column.
  const int turned = b.node({{"rotation", {0, 0, s, s}}, {"children", {0}}}, false);
  b.node({{"matrix", {2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 10, 0, 0, 1}}, {"children", {turned}}});
  b.root["scenes"][0]["nodes"] = {2};
  const CompiledScene c = compile_scene(load(b), 0);
  // (0, 0, 0) -> (1, 2, 3) -> (-2, 1, 3) -> (6, 2, 6).
  expect_point(c.positions[0], 6, 2, 6, 1e-6f);
  // (1, 0, 0) -> (2, 2, 3) -> (-2, 2, 3) -> (6, 4, 6).
  expect_point(c.positions[1], 6, 4, 6, 1e-6f);
}

TEST(GltfNodes, MeshesAreShared)
{
  GltfBuilder b = square();
  b.node({{"mesh", 0}, {"translation", {5, 0, 0}}});
  b.node({{"mesh", 0}, {"scale", {-1, 1, 1}}});
  const SceneData d = load(b);
  EXPECT_EQ(d.geometries.size(), 1u);
  ASSERT_EQ(d.instances.size(), 3u);
  const CompiledScene c = compile_scene(d, 0);
  EXPECT_EQ(c.indices.size(), 2u);
  ASSERT_EQ(c.placements.size(), 3u);
  EXPECT_EQ(c.placements[1].object_to_world.m[0][3], 5);
  EXPECT_EQ(c.placements[2].flips, 1u);
}

TEST(GltfNodes, OtherScenesAreLeftOut)
{
  GltfBuilder b = square();
  b.node({{"mesh", 0}}, false);
  b.add("scenes", {{"nodes", {0, 1}}});
  EXPECT_EQ(load(b).instances.size(), 1u);
  b.root["scene"] = 1;
  EXPECT_EQ(load(b).instances.size(), 2u);
  b.root.erase("scene");
  b.root.erase("scenes");
  GltfLoad l;
  EXPECT_EQ(l.bytes(b.glb()).instances.size(), 2u);
  expect_contains(l.all_warnings(), "no scene");
}

TEST(GltfNodes, OnlyForestsAreTaken)
{
  GltfBuilder b = square();
  b.node({{"children", {0}}});
  expect_contains(load_error(b), "is a child of node 1");
  b.root["scenes"][0]["nodes"] = {1};
  EXPECT_EQ(load_error(b), "");
  b.node({{"children", {0}}});
  expect_contains(load_error(b), "child of both node 1 and node 2");
  b.root["nodes"][0]["children"] = {2};
  b.root["nodes"][1].erase("children");
  expect_contains(load_error(b), "its own ancestor");
  b.root["nodes"][0].erase("children");
  b.root["nodes"][2].erase("children");
  b.root["scenes"][0]["nodes"] = {0, 0};
  expect_contains(load_error(b), "twice");
}

TEST(GltfNodes, DeepHierarchiesNeedNoStack)
{
  GltfBuilder b = square();
  b.root["scenes"][0]["nodes"].clear();
  for (int i = 0; i < 20000; ++i) b.node({{"children", {i}}, {"translation", {0, 0, 0.5}}}, false);
  b.root["scenes"][0]["nodes"] = {20000};
  const SceneData d = load(b);
  ASSERT_EQ(d.instances.size(), 1u);
  EXPECT_EQ(d.instances[0].transform.m[2][3], 10000);
}

TEST(GltfNodes, FlattenedMeshesAreNamed)
{
  GltfBuilder b = square();
  b.root["nodes"][0]["scale"] = {1, 0, 1};
  b.root["nodes"][0]["name"] = "flat";
  GltfLoad l;
  EXPECT_TRUE(l.bytes(b.glb()).instances.empty());
  expect_contains(l.all_warnings(), "node 0 ('flat')");
}

TEST(GltfNodes, Cameras)
{
  GltfBuilder b = square();
  b.add("cameras", {{"type", "perspective"},
                    {"perspective", {{"yfov", 0.7}, {"znear", 0.1}}},
                    {"extras", {{"width", 640}, {"height", 480}}}});
  b.add("cameras",
        {{"type", "orthographic"}, {"orthographic", {{"xmag", 1}, {"ymag", 1}, {"zfar", 10}, {"znear", 0}}}});
  b.node({{"camera", 0}, {"translation", {1, 2, 3}}, {"scale", {4, 4, 4}}});
  b.node({{"camera", 1}});
  GltfLoad l;
  const SceneData d = l.bytes(b.glb());
  ASSERT_EQ(d.cameras.size(), 1u);
  EXPECT_EQ(d.cameras[0].yfov_rad, 0.7f);
  EXPECT_EQ(d.cameras[0].width, 640u);
  EXPECT_EQ(d.cameras[0].height, 480u);
  EXPECT_EQ(d.cameras[0].transform.m[1][3], 2);
  EXPECT_EQ(d.cameras[0].transform.m[0][0], 1);
  expect_contains(l.all_warnings(), "orthographic");
}

TEST(GltfNodes, Lights)
{
  GltfBuilder b = square();
  b.root["extensions"]["KHR_lights_punctual"]["lights"] = {
      {{"type", "point"}, {"color", {1, 0.5, 0}}, {"intensity", 10}, {"range", 3}},
      {{"type", "spot"},
       {"intensity", 5000000000},
       {"spot", {{"innerConeAngle", 0.1}, {"outerConeAngle", 0.2}}}},
      {{"type", "directional"}}};
  const double s = std::sqrt(0.5);
  for (int i = 0; i < 3; ++i) {
    // A quarter turn about X: -Z becomes +Y... then the light shines up.
    b.node({{"extensions", {{"KHR_lights_punctual", {{"light", i}}}}},
            {"rotation", {s, 0, 0, s}},
            {"translation", {1, 2, 3}},
            {"scale", {2, 2, 2}}});
  }
  GltfLoad l;
  const SceneData d = l.bytes(b.glb());
  ASSERT_EQ(d.lights.size(), 3u);
  EXPECT_EQ(d.lights[0].type, LightType::Point);
  expect_point(d.lights[0].color, 10, 5, 0);
  expect_point(d.lights[0].position, 1, 2, 3);
  EXPECT_EQ(d.lights[1].color.x, 5e9f);
  EXPECT_EQ(d.lights[1].outer_cone_angle_rad, 0.2f);
  expect_point(d.lights[1].direction, 0, 1, 0, 1e-6f);
  EXPECT_EQ(d.lights[2].type, LightType::Distant);
  expect_point(d.lights[2].color, 1, 1, 1);
  expect_contains(l.all_warnings(), "range");
}

}  // namespace
}  // namespace gpurt
