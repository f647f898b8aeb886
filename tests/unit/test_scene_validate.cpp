// The rules of scene descriptions: what is refused, with which words, and that the scene stays as it was.
#include <cmath>
#include <limits>

#include "scene/trigonometry.h"
#include "scene_builders.h"

namespace gpurt {
namespace {

constexpr float nan = std::numeric_limits<float>::quiet_NaN();
constexpr float inf = std::numeric_limits<float>::infinity();

TextureData make_texture(uint32_t width, uint32_t height, std::vector<float> values)
{
  auto bytes = std::make_shared<std::vector<std::byte>>(values.size() * sizeof(float));
  if (!bytes->empty()) std::memcpy(bytes->data(), values.data(), bytes->size());
  TextureData t;
  t.width = width;
  t.height = height;
  t.format = TexelFormat::Rgba32f;
  t.texels = bytes;
  return t;
}

TEST(SceneValidate, NamesTheFirstBadVertexAmongAMillion)
{
  std::vector<Vec3f> vertices(1000000, {1, 2, 3});
  vertices[777777].y = nan;
  vertices[900000].y = inf;
  SceneData d;
  expect_contains(error_of([&] { add_mesh(d, make_mesh(vertices, {{0, 1, 2}}), 0); }),
                  "vertex 777777 is not finite");
  EXPECT_TRUE(d.geometries.empty());
}

TEST(SceneValidate, NamesTheFirstBadIndex)
{
  std::vector<UInt3> triangles(100000, {0, 1, 2});
  triangles[70000] = {0, 3, 1};
  triangles[70001] = {9, 9, 9};
  SceneData d;
  expect_contains(error_of([&] { add_mesh(d, make_mesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, triangles), 0); }),
                  "index 210001 (corner 1 of triangle 70000) is 3, but there are 3 vertices");
  EXPECT_TRUE(d.geometries.empty());
}

TEST(SceneValidate, AttributesComeOneAVertex)
{
  SceneData d;
  MeshData mesh = unit_triangle();
  mesh.normals = SharedArray<Vec3f>(std::vector<Vec3f>(2, {0, 0, 1}));
  expect_contains(error_of([&] { add_mesh(d, mesh, 0); }), "2 normals for 3 vertices");
  mesh = unit_triangle();
  mesh.uvs = SharedArray<Vec2f>(std::vector<Vec2f>(4));
  expect_contains(error_of([&] { add_mesh(d, mesh, 0); }), "4 texture coordinates for 3 vertices");
  mesh.uvs = SharedArray<Vec2f>(std::vector<Vec2f>{{0, 0}, {0, 0}, {0, inf}});
  expect_contains(error_of([&] { add_mesh(d, mesh, 0); }), "texture coordinate 2 is not finite");
  expect_contains(error_of([&] { add_mesh(d, unit_triangle(), 1); }), "no material 1");
}

TEST(SceneValidate, ReadsStridedMemoryAndNothingPastIt)
{
  // Vertices 20 bytes apart, the last one at the very end.
  std::vector<std::byte> memory(2 * 20 + 12);
  for (int i = 0; i < 3; ++i) {
    const Vec3f v{float(i), float(i * i), 0};
    std::memcpy(memory.data() + 20 * i, &v, 12);
  }
  auto owner = std::make_shared<std::vector<std::byte>>(memory);
  SceneData d;
  MeshData mesh;
  mesh.vertices = SharedArray<Vec3f>(owner, owner->data(), 3, 20);
  mesh.indices = sequential_triangles(3);
  add_instance(d, add_mesh(d, mesh, 0), identity_affine);
  const CompiledScene s = compile_scene(d, 0);
  EXPECT_EQ(s.positions[2].y, 4);
  EXPECT_EQ(s.indices[0].z, 2u);
  expect_contains(error_of([] { sequential_triangles(4); }), "multiple of 3");
}

TEST(SceneValidate, Patches)
{
  SceneData d;
  expect_contains(error_of([&] { add_patches(d, {SharedArray<Vec3f>(std::vector<Vec3f>(17))}, 0); }),
                  "17 control points");
  std::vector<Vec3f> points(32);
  points[20].z = nan;
  expect_contains(error_of([&] { add_patches(d, {SharedArray<Vec3f>(points)}, 0); }),
                  "control point 20 is not finite");
}

TEST(SceneValidate, TransformsAreInvertible)
{
  SceneData d;
  const uint32_t g = add_mesh(d, unit_triangle(), 0);
  expect_contains(error_of([&] { add_instance(d, g + 1, identity_affine); }), "no geometry 1");
  expect_contains(error_of([&] { add_instance(d, g, scaling(1, 0, 1)); }), "cannot be inverted");
  // Linearly dependent rows whose determinant rounds to something tiny.
  AffineDouble t{0.1, 0.2, 0.3, 0, 0.7, 0.9, 1.1, 0, 0, 0, 0, 0};
  for (int j = 0; j < 3; ++j) t[8 + j] = t[j] + t[4 + j];
  expect_contains(error_of([&] { add_instance(d, g, t); }), "cannot be inverted");
  t = identity_affine;
  t[7] = nan;
  expect_contains(error_of([&] { add_instance(d, g, t); }), "row 1, column 3");
  t[7] = 1e300;
  expect_contains(error_of([&] { add_instance(d, g, t); }), "row 1, column 3");
  expect_contains(error_of([&] { add_instance(d, g, scaling(1, 1e-44, 1)); }),
                  "inverse of the transform exceeds");
  EXPECT_TRUE(d.instances.empty());
  add_instance(d, g, scaling(1e-6, 1e6, -1));
  add_instance(d, g, to_float(scaling(1e-20, 1e-20, 1e-20)));
  EXPECT_EQ(d.instances.size(), 2u);
}

TEST(SceneValidate, Materials)
{
  SceneData d;
  MaterialSettings m;
  const auto refused = [&](const MaterialSettings &bad, const char *words) {
    expect_contains(error_of([&] { add_material(d, bad); }), words);
  };
  m.base_color.y = 1.5f;
  refused(m, "green is 1.5");
  m = {};
  m.type = MaterialType::Metal;
  m.roughness = 0;
  refused(m, "roughness is 0");
  m.roughness = nan;
  refused(m, "roughness");
  m = {};
  m.type = MaterialType::Glass;
  m.ior = -1;
  refused(m, "index of refraction");
  m = {};
  m.emission.z = inf;
  refused(m, "emission");
  m.emission.z = -1;
  refused(m, "negative");
  m = {};
  m.base_color_texture = 0;
  refused(m, "texture that does not exist");
  m = {};
  m.type = MaterialType(9);
  refused(m, "no material type 9");
  EXPECT_EQ(d.materials.size(), 1u);

  m = {};
  m.type = MaterialType::Metal;
  m.roughness = 0.5f;
  EXPECT_EQ(add_material(d, m), 1u);
  EXPECT_EQ(d.materials[1].alpha_ggx, 0.25f);
  m.type = MaterialType::Glass;
  EXPECT_EQ(d.materials[add_material(d, m)].ior, 1.5f);
}

TEST(SceneValidate, Absorption)
{
  SceneData d;
  MaterialSettings m;
  m.attenuation_color = {0.5f, 1, 1.5f};
  expect_contains(error_of([&] { add_material(d, m); }), "attenuation_color's blue is 1.5");
  m.attenuation_color = {0.5f, 1, 0};
  m.attenuation_distance = nan;
  expect_contains(error_of([&] { add_material(d, m); }), "attenuation_distance is nan");
  m.attenuation_distance = 2;
  EXPECT_EQ(d.materials[add_material(d, m)].absorption.x, 0) << "no glass";
  m.type = MaterialType::Glass;
  const Vec3f absorption = d.materials[add_material(d, m)].absorption;
  EXPECT_EQ(absorption.x, float(std::log(2.0) / 2));
  EXPECT_EQ(absorption.y, 0);
  EXPECT_EQ(absorption.z, infinity);
  m.attenuation_distance = 0;
  EXPECT_EQ(d.materials[add_material(d, m)].absorption.z, 0) << "no distance";
  for (const double x : {1e-30, 0.1, 0.7071, 0.999999, 1.0, 1.5, 3e38})
    EXPECT_NEAR(natural_logarithm(x), std::log(x), 1e-15 * std::fabs(std::log(x)) + 1e-21) << x;
}

TEST(SceneValidate, Textures)
{
  SceneData d;
  expect_contains(error_of([&] { add_texture(d, make_texture(0, 1, {})); }), "0 x 1");
  expect_contains(error_of([&] { add_texture(d, make_texture(2, 1, {1, 2, 3, 4})); }), "16 bytes");
  expect_contains(error_of([&] { add_texture(d, make_texture(1, 1, {1, nan, 3, 4})); }),
                  "channel 1 of the texel at (0, 0)");
  expect_contains(error_of([&] { add_texture(d, make_texture(70000, 1, {})); }), "at most 65536");
  const uint32_t bright = add_texture(d, make_texture(1, 2, {0, 0, 0, 1, 0, 5, 0, 1}));
  MaterialSettings m;
  m.base_color_texture = bright;
  expect_contains(error_of([&] { add_material(d, m); }), "texel at (0, 1) is 5");
  set_environment(d, {{1, 1, 1}, bright});
  m = {};
  m.emission_texture = 9;
  expect_contains(error_of([&] { add_material(d, m); }), "emission names a texture that does not exist");
  m.emission_texture = bright;
  m.emission = {1, 1e38f, 1};
  expect_contains(error_of([&] { add_material(d, m); }), "texel at (0, 1) is 5; radiance");
  m.emission = {1, 1, 1};
  EXPECT_EQ(d.materials[add_material(d, m)].emission_texture, bright);
  m.emission = {0, 0, 0};
  EXPECT_EQ(d.materials[add_material(d, m)].emission_texture, invalid_id) << "no lamp";
  const uint32_t negative = add_texture(d, make_texture(1, 1, {0, -1, 0, 1}));
  expect_contains(error_of([&] { set_environment(d, {{1, 1, 1}, negative}); }), "must not be negative");
  m.emission_texture = negative;
  expect_contains(error_of([&] { add_material(d, m); }), "must not be negative");
  expect_contains(error_of([&] { set_environment(d, {{1, 1, 1}, 7}); }), "does not exist");
  expect_contains(error_of([&] { set_environment(d, {{nan, 1, 1}, invalid_id}); }), "radiance");
  EXPECT_EQ(d.environment.texture, bright);
}

TEST(SceneValidate, Lights)
{
  SceneData d;
  expect_contains(error_of([&] { add_light(d, {LightType::Point, {-1, 0, 0}, {}, {}, 0, 0}); }), "intensity");
  expect_contains(error_of([&] { add_light(d, {LightType::Point, {1, 0, 0}, {nan, 0, 0}, {}, 0, 0}); }),
                  "position");
  expect_contains(error_of([&] { add_light(d, {LightType::Distant, {1, 0, 0}, {}, {0, 0, 0}, 0, 0}); }),
                  "direction is zero");
  expect_contains(error_of([&] { add_light(d, {LightType::Spot, {1, 0, 0}, {}, {0, 0, 1}, 0.5f, 0.4f}); }),
                  "cone angles");
  expect_contains(error_of([&] { add_light(d, {LightType::Spot, {1, 0, 0}, {}, {0, 0, 1}, 0.5f, 2}); }),
                  "cone angles");
  expect_contains(error_of([&] { add_light(d, {LightType::Triangle, {1, 0, 0}, {}, {0, 0, 1}, 0, 0}); }),
                  "emit");
  EXPECT_TRUE(d.lights.empty());
  add_light(d, {LightType::Spot, {1, 0, 0}, {}, {0, 0, 1e-30f}, 0, 0});
  EXPECT_EQ(d.lights[0].direction.z, 1);
  EXPECT_EQ(d.lights[0].outer_cone_angle_rad, float(pi / 4));
}

TEST(SceneValidate, CamerasKeepTheirViewAndLoseTheirScale)
{
  SceneData d;
  expect_contains(error_of([&] { add_camera(d, scaling(1, 1, 0), 1, 0, 0); }), "flattens");
  expect_contains(error_of([&] { add_camera(d, identity_affine, 4, 0, 0); }), "yfov");
  expect_contains(error_of([&] { add_camera(d, identity_affine, -1, 0, 0); }), "yfov");
  AffineDouble t = multiply(translation(1, 2, 3), scaling(1e-6, 2e-6, 1e-6));
  add_camera(d, t, 0, 640, 480);
  const CameraData &c = d.cameras[0];
  EXPECT_EQ(c.yfov_rad, float(pi / 4));
  EXPECT_EQ(c.transform.m[0][0], 1);
  EXPECT_EQ(c.transform.m[1][1], 1);
  EXPECT_EQ(c.transform.m[2][2], 1);
  EXPECT_EQ(c.transform.m[2][3], 3);
  add_camera(d, scaling(-1, 1, 1), 1, 0, 0);
  EXPECT_EQ(d.cameras[1].transform.m[0][0], -1);
}

}  // namespace
}  // namespace gpurt
