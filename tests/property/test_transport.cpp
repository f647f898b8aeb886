// Closed forms of light transport: what a path tracer must get right whatever the sampling.
#include "../support/gpurt_test.h"

namespace {

using namespace gpurt_test;

// About 100 x 100 in 25 x 25 cells, rising by `slope` from 0 at x = 0, which is an edge.
Mesh sloping_floor(float slope)
{
  Mesh mesh;
  for (int y = 0; y <= 25; ++y) {
    for (int x = 0; x <= 25; ++x)
      mesh.vertices.push_back({4.0f * x - 48, 4.1f * y - 51, slope * (4.0f * x - 48)});
  }
  for (uint32_t y = 0; y < 25; ++y) {
    for (uint32_t x = 0; x < 25; ++x) {
      const uint32_t a = 26 * y + x;
      mesh.triangles.push_back({a, a + 1, a + 27});
      mesh.triangles.push_back({a, a + 27, a + 26});
    }
  }
  return mesh;
}

struct Method {
  const char *name;
  gpurt_device_type device;
  gpurt_accel accel;
};

class Transport : public testing::TestWithParam<Method> {
 protected:
  void SetUp() override
  {
    if (GetParam().device == GPURT_DEVICE_CUDA && !has_cuda()) GTEST_SKIP() << "no CUDA device";
  }
  Device make_device() const { return gpurt_test::make_device(GetParam().device); }
  gpurt_accel accel() const { return GetParam().accel; }
};
INSTANTIATE_TEST_SUITE_P(Accels, Transport,
                         testing::Values(Method{"kdtree", GPURT_DEVICE_CPU, GPURT_ACCEL_KDTREE},
                                         Method{"embree", GPURT_DEVICE_CPU, GPURT_ACCEL_EMBREE},
                                         Method{"cuda_kdtree", GPURT_DEVICE_CUDA, GPURT_ACCEL_KDTREE},
                                         Method{"cuda_bvh", GPURT_DEVICE_CUDA, GPURT_ACCEL_BVH}),
                         [](const auto &info) { return info.param.name; });

// Two sheets in front of each other take their opacity's share of what is behind: of light seen, of shadows, and of lamps
// that are drawn.
TEST_P(Transport, SheetsThatBlendTakeTheirShare)
{
  const auto sheet = [](gpurt_scene scene, float z, float alpha, float emission) {
    gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
    for (float &c : desc.base_color) c = 0;
    for (float &c : desc.emission) c = emission;
    desc.two_sided_emission = 1;
    desc.alpha = alpha;
    desc.blends = 1;
    uint32_t id = 0;
    GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &desc, &id));
    add_mesh(scene, quad({-9, -9, z}, {9, -9, z}, {9, 9, z}, {-9, 9, z}), id);
  };
  Device device = make_device();
  RenderOptions o{.width = 16, .height = 16, .spp = 256, .max_depth = 2};
  const double num = 16.0 * 16 * 256;
  // Seen directly: 0.25 of 2, then 0.75 x 0.5 of 0, then 0.375 of the sky.
  Scene seen;
  GPURT_ASSERT_OK(gpurt_scene_create(device, seen.out()));
  sheet(seen, 0, 0.25f, 2);
  sheet(seen, -1, 0.5f, 0);
  set_environment(seen, 1);
  add_camera(seen, {0, 0, 2}, 0.6f);
  commit(seen, accel());
  Frame frame = make_frame(seen, o);
  render(frame, o);
  // A sample's variance is at most 1.
  EXPECT_NEAR(mean(read_color(frame, o)), 0.25 * 2 + 0.375, 4 / std::sqrt(num));

  // A white wall behind a sheet that takes 0.4 of a distant light, which would light it to 1. Once with the eye between
  // them, so that the shadow alone counts, once in front of both.
  for (const float eye : {-1.0f, 2.0f}) {
    Scene wall;
    GPURT_ASSERT_OK(gpurt_scene_create(device, wall.out()));
    sheet(wall, 0, 0.4f, 0);
    add_mesh(wall, quad({-4, -4, -3}, {4, -4, -3}, {4, 4, -3}, {-4, 4, -3}));
    gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
    light.type = GPURT_LIGHT_DISTANT;
    light.direction[2] = -1;
    light.direction[1] = 0.1f;
    for (float &c : light.intensity) c = 3.14159265f * std::sqrt(1.01f);
    uint32_t id;
    GPURT_ASSERT_OK(gpurt_scene_add_light(wall, &light, &id));
    add_camera(wall, {0, 0, eye}, 0.6f);
    commit(wall, accel());
    Frame lit = make_frame(wall, o);
    render(lit, o);
    const double expected = eye < 0 ? 0.6 : 0.36;
    EXPECT_NEAR(mean(read_color(lit, o)), expected, 4 / std::sqrt(num));
  }

  // A sheet that emits and is all that there is to light the wall: half of it emits half as much as a whole one, drawn as a
  // lamp or met by chance.
  double whole = 0;
  for (const float alpha : {1.0f, 0.5f}) {
    Scene lamp;
    GPURT_ASSERT_OK(gpurt_scene_create(device, lamp.out()));
    sheet(lamp, 2, alpha, 1);
    add_mesh(lamp, quad({-4, -4, -3}, {4, -4, -3}, {4, 4, -3}, {-4, 4, -3}));
    add_camera(lamp, {0, 0, 1}, 0.6f);
    commit(lamp, accel());
    Frame lit = make_frame(lamp, o);
    render(lit, o);
    const double m = mean(read_color(lit, o));
    if (alpha == 1) whole = m;
    else EXPECT_NEAR(m, 0.5 * whole, 8 / std::sqrt(num));
  }
}

// Catalogue row 24: a white sphere under a unit sky sends out what it receives.
TEST_P(Transport, FurnaceOfAWhiteSphereUnderAUnitSkyIsOne)
{
  Device device = make_device();
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_mesh(scene, icosphere(4), add_material(scene, GPURT_MATERIAL_LAMBERT, {1, 1, 1}));
  set_environment(scene, 1);
  add_camera(scene, {0, 0, 4}, 0.6f);
  commit(scene, accel());
  const RenderOptions o{.spp = 64};
  Frame frame = make_frame(scene, o);
  render(frame, o);
  // The sphere is convex, so every path meets the sky after one bounce: exact up to rounding.
  for (float c : read_color(frame, o)) ASSERT_NEAR(c, 1.0f, 0.002f);
}

// Within a closed sphere of albedo 1/2 with a point light of intensity pi at the centre, direct light is 1/2, and every
// further bounce half of the one before.
TEST_P(Transport, ClosedSphereWithAPointLightSumsTheGeometricSeries)
{
  Device device = make_device();
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_mesh(scene, icosphere(5), add_material(scene, GPURT_MATERIAL_LAMBERT, {0.5f, 0.5f, 0.5f}));
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  for (float &c : light.intensity) c = 3.14159265f;
  uint32_t id;
  GPURT_ASSERT_OK(gpurt_scene_add_light(scene, &light, &id));
  add_camera(scene, {0, 0, 0.1f}, 1.0f);
  commit(scene, accel());
  for (const uint32_t depth : {2u, 3u, 17u}) {
    const RenderOptions o{.spp = 256, .max_depth = depth};
    Frame frame = make_frame(scene, o);
    render(frame, o);
    const double expected = 1 - std::pow(0.5, double(depth) - 1);
    // Level 5 facets lie up to 0.0006 within the unit sphere, and irradiance goes with the squared distance: 0.002.
    EXPECT_NEAR(mean(read_color(frame, o)), expected, 0.003 * expected) << "max_depth " << depth;
  }
}

void expect_exact_floor(gpurt_device device, gpurt_accel accel, gpurt_triangle_test test, float slope,
                        std::array<float, 3> direction)
{
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_mesh(scene, sloping_floor(slope), add_material(scene, GPURT_MATERIAL_LAMBERT, {0.25f, 0.5f, 0.75f}));
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  light.type = GPURT_LIGHT_DISTANT;
  for (int i = 0; i < 3; ++i) {
    light.intensity[i] = 2;
    light.direction[i] = direction[i];
  }
  uint32_t id;
  GPURT_ASSERT_OK(gpurt_scene_add_light(scene, &light, &id));
  add_camera(scene, {0, 0, 4}, 0.6f);
  commit(scene, accel, test);
  const RenderOptions o{.spp = 4};
  Frame frame = make_frame(scene, o);
  render(frame, o);
  const std::vector<float> color = read_color(frame, o);
  for (size_t i = 0; i < color.size(); i += 3) {
    for (int c = 0; c < 3; ++c) ASSERT_NEAR(color[i + c], 0.25 * (c + 1) * 2 * -direction[2] / M_PI, 1e-6);
  }
}

// A Lambertian floor under a distant light: radiance = albedo E cos / pi, without noise. The floor lies on a coordinate
// plane, or leaves it by so little that its own height says nothing of how far a computed hit is off it.
TEST_P(Transport, DistantLightOnAFloorIsExact)
{
  const Device device = make_device();
  for (const gpurt_triangle_test test : {GPURT_TRIANGLE_WATERTIGHT, GPURT_TRIANGLE_MOLLER_TRUMBORE}) {
    for (const float slope : {0.0f, 1.2e-17f, 1e-9f}) {
      for (int i = 1; i < 9; ++i) {
        SCOPED_TRACE(testing::Message()
                     << "triangle test " << test << ", slope " << slope << ", light " << i);
        const float z = 0.1f * float(i), r = std::sqrt(1 - z * z), angle = 2.4f * float(i);
        expect_exact_floor(device, accel(), test, slope, {r * std::cos(angle), r * std::sin(angle), -z});
      }
    }
  }
}

// Irradiance under a square lamp: the closed form for a differential patch facing a parallel rectangle.
TEST_P(Transport, SquareLampMatchesTheFormFactor)
{
  Device device = make_device();
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_mesh(scene, quad({-0.01f, -0.01f, 0}, {0.01f, -0.01f, 0}, {0.01f, 0.01f, 0}, {-0.01f, 0.01f, 0}),
           add_material(scene, GPURT_MATERIAL_LAMBERT, {0.5f, 0.5f, 0.5f}));
  // One lamp of half edge 1 at distance 2, shining down; the camera looks from below its plane beside the axis.
  add_mesh(scene, quad({-1, -1, 2}, {-1, 1, 2}, {1, 1, 2}, {1, -1, 2}),
           add_material(scene, GPURT_MATERIAL_LAMBERT, {0, 0, 0}, {3, 3, 3}));
  add_camera(scene, {0, 0, 1}, 0.005f);
  commit(scene, accel());
  const RenderOptions o{.width = 8, .height = 8, .spp = 1024};
  Frame frame = make_frame(scene, o);
  render(frame, o);
  const double x = 0.5;  // half edge over distance
  const double quarter = x / std::sqrt(1 + x * x) * std::atan(x / std::sqrt(1 + x * x)) * 2 / (2 * M_PI);
  const double expected = 0.5 * 3 * 4 * quarter;
  EXPECT_NEAR(mean(read_color(frame, o)), expected, 0.002 * expected);
}

// Glass loses nothing: a unit sky seen through glass spheres is a unit sky.
TEST_P(Transport, GlassAndMirrorUnderAUnitSkyAreInvisible)
{
  Device device = make_device();
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_mesh(scene, icosphere(3), add_material(scene, GPURT_MATERIAL_GLASS, {1, 1, 1}));
  add_mesh(scene, icosphere(3).map([](auto v) { return std::array<float, 3>{v[0] + 2, v[1], v[2]}; }),
           add_material(scene, GPURT_MATERIAL_MIRROR, {1, 1, 1}));
  set_environment(scene, 1);
  add_camera(scene, {1, 0, 6}, 0.7f);
  commit(scene, accel());
  const RenderOptions o{.spp = 64, .max_depth = 256};
  Frame frame = make_frame(scene, o);
  render(frame, o);
  // What is lost are paths that total reflection between facets holds inside beyond max_depth: 2.9e-3 of the picture at
  // 16, 1.2e-3 at 64.
  EXPECT_NEAR(mean(read_color(frame, o)), 1.0, 1e-3);
}

// Catalogue row 49: the same bits for thread counts, tile sizes, tile orders, and after stopping and going on.
TEST(Determinism, ImageBitsDependOnNothingButTheSettings)
{
  const auto image = [](uint32_t threads, const RenderOptions &o, bool in_two_steps) {
    Device device = make_device(GPURT_DEVICE_CPU, threads);
    Scene scene;
    GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
    add_mesh(scene, icosphere(3),
             add_material(scene, GPURT_MATERIAL_METAL, {0.9f, 0.6f, 0.3f}, {0, 0, 0}, 0.3f));
    add_mesh(scene, quad({-3, -1, 3}, {3, -1, 3}, {3, -1, -3}, {-3, -1, -3}),
             add_material(scene, GPURT_MATERIAL_LAMBERT, {0.7f, 0.7f, 0.7f}));
    add_mesh(scene, quad({-1, 3, -1}, {1, 3, -1}, {1, 3, 1}, {-1, 3, 1}),
             add_material(scene, GPURT_MATERIAL_LAMBERT, {0, 0, 0}, {5, 4, 3}));
    set_environment(scene, 0.1f);
    add_camera(scene, {0, 0.5f, 5}, 0.8f);
    commit(scene);
    Frame frame = make_frame(scene, o);
    if (in_two_steps) {
      RenderOptions half = o;
      half.spp = o.spp / 2;
      render(frame, half);
    }
    render(frame, o);
    return read_color(frame, o);
  };
  RenderOptions o{.width = 150, .height = 101, .spp = 8};
  const std::vector<float> expected = image(1, o, false);
  EXPECT_GT(mean(expected), 0.05);
  EXPECT_EQ(image(2, o, false), expected);
  for (uint32_t tile : {37u, 128u}) {
    o.tile_size = tile;
    EXPECT_EQ(image(2, o, false), expected) << "tiles of " << tile;
  }
  o.tile_size = 0;
  EXPECT_EQ(image(2, o, true), expected) << "in two steps";
  for (uint32_t y = 0; y < 101; y += 37) {
    for (uint32_t x = 0; x < 150; x += 37)
      o.tiles.push_back({x, y, std::min(x + 37, 150u), std::min(y + 37, 101u)});
  }
  std::shuffle(o.tiles.begin(), o.tiles.end(), std::mt19937(5));
  EXPECT_EQ(image(2, o, false), expected) << "tiles in random order";
}

}  // namespace
