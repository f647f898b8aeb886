// Glass that absorbs, against closed forms: light seen through it, light within it, photons that come through.
#include "../support/gpurt_test.h"

namespace {

using namespace gpurt_test;

struct Method {
  const char *name;
  gpurt_device_type device;
  gpurt_accel accel;
  gpurt_pipeline pipeline;
};

class Absorption : public testing::TestWithParam<Method> {
 protected:
  void SetUp() override
  {
    if (GetParam().device == GPURT_DEVICE_CUDA && !has_cuda()) GTEST_SKIP() << "no CUDA device";
  }
};
INSTANTIATE_TEST_SUITE_P(
    Methods, Absorption,
    testing::Values(Method{"path", GPURT_DEVICE_CPU, GPURT_ACCEL_KDTREE, GPURT_PIPELINE_PATH},
                    Method{"photon", GPURT_DEVICE_CPU, GPURT_ACCEL_BVH, GPURT_PIPELINE_PHOTON},
                    Method{"cuda_path", GPURT_DEVICE_CUDA, GPURT_ACCEL_KDTREE, GPURT_PIPELINE_PATH},
                    Method{"cuda_photon", GPURT_DEVICE_CUDA, GPURT_ACCEL_BVH, GPURT_PIPELINE_PHOTON}),
    [](const auto &info) { return info.param.name; });

constexpr double ior = 1.5, reflectance = 0.04;  // at a right angle
// What glass leaves after `thickness`: red half, green all, blue nothing.
constexpr double thickness = 0.5;
constexpr double left_after_thickness[3] = {0.5, 1, 0};

uint32_t add_tinted_glass(gpurt_scene scene, std::array<float, 3> color, float distance)
{
  gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
  desc.type = GPURT_MATERIAL_GLASS;
  desc.ior = float(ior);
  desc.attenuation_distance = distance;
  for (size_t k = 0; k < 3; ++k) desc.attenuation_color[k] = color[k];
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &desc, &id));
  return id;
}

Mesh slab(float half_width, float z0, float z1)
{
  const float w = half_width;
  Mesh m = quad({-w, -w, z1}, {w, -w, z1}, {w, w, z1}, {-w, w, z1});
  m.append(quad({-w, w, z0}, {w, w, z0}, {w, -w, z0}, {-w, -w, z0}));
  m.append(quad({-w, -w, z0}, {w, -w, z0}, {w, -w, z1}, {-w, -w, z1}));
  m.append(quad({w, w, z0}, {-w, w, z0}, {-w, w, z1}, {w, w, z1}));
  m.append(quad({w, -w, z0}, {w, w, z0}, {w, w, z1}, {w, -w, z1}));
  m.append(quad({-w, w, z0}, {-w, -w, z0}, {-w, -w, z1}, {-w, w, z1}));
  return m;
}

std::array<double, 3> mean_color(gpurt_scene scene, const RenderOptions &o)
{
  const Frame frame = make_frame(scene, o);
  render(frame, o);
  const std::vector<float> color = read_color(frame, o);
  std::array<double, 3> sum = {0, 0, 0};
  for (size_t i = 0; i < color.size(); ++i) sum[i % 3] += double(color[i]) / (double(color.size()) / 3);
  return sum;
}

// All orders of reflection between the sides of a slab, seen at a right angle under a unit sky. The slab is one of two
// instances that are four times as large as their geometry: distances are those of the world.
TEST_P(Absorption, ASlabUnderAUnitSkyShowsTheSeries)
{
  const Device device = make_device(GetParam().device);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  const uint32_t geometry = add_mesh(scene, slab(5, 0, float(thickness / 4)),
                                     add_tinted_glass(scene, {0.25f, 1, 0}, float(2 * thickness)), false);
  for (const float x : {0.0f, 1000.0f}) {
    gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
    instance.geometry = geometry;
    for (int k = 0; k < 3; ++k) instance.transform[5 * k] = 4;
    instance.transform[3] = x;
    uint32_t id;
    GPURT_ASSERT_OK(gpurt_scene_add_instance(scene, &instance, &id));
  }
  set_environment(scene, 1);
  add_camera(scene, {0, 0, 2}, 0.01f);
  commit(scene, GetParam().accel);
  RenderOptions o{.width = 64, .height = 64, .spp = 16, .max_depth = 32};
  o.pipeline = GetParam().pipeline;
  const std::array<double, 3> seen = mean_color(scene, o);
  for (size_t k = 0; k < 3; ++k) {
    const double left = left_after_thickness[k], r = reflectance, t2 = (1 - r) * (1 - r);
    const double expected = r + t2 * (left + r * left * left) / (1 - r * r * left * left);
    // A sample lies between 0 and 1; green loses nothing.
    const double noise = std::sqrt(0.25 / (64.0 * 64 * 16));
    EXPECT_NEAR(seen[k], expected, k == 1 ? 1e-4 : 4 * noise) << "colour " << k;
  }
}

// A floor within the glass, lit by a point light within: shadow rays, and the way back to the eye, lie in the medium though
// they do not end on glass from within. Radiance that leaves the glass shrinks by the squared index.
TEST_P(Absorption, AFloorWithinTheGlassIsLitThroughIt)
{
  const Device device = make_device(GetParam().device);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  constexpr double height = 0.4, below = 1;  // of the light above the floor, of the floor below the surface
  add_mesh(scene, slab(5, -2, 0), add_tinted_glass(scene, {0.5f, 1, 0.125f}, float(thickness)));
  add_mesh(scene, quad({-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1}),
           add_material(scene, GPURT_MATERIAL_LAMBERT, {0.5f, 0.5f, 0.5f}));
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  light.position[2] = float(height - below);
  for (float &c : light.intensity) c = 10;
  uint32_t id;
  GPURT_ASSERT_OK(gpurt_scene_add_light(scene, &light, &id));
  add_camera(scene, {0, 0, 2}, 0.002f);
  commit(scene, GetParam().accel);
  RenderOptions o{.width = 64, .height = 64, .spp = 16, .max_depth = 3};
  o.pipeline = GetParam().pipeline;
  const std::array<double, 3> seen = mean_color(scene, o);
  const double per_thickness[3] = {0.5, 1, 0.125};
  for (size_t k = 0; k < 3; ++k) {
    const double left = std::pow(per_thickness[k], (height + below) / thickness);
    const double expected = (1 - reflectance) / (ior * ior) * left * 0.5 / M_PI * 10 / (height * height);
    // One sample in 25 goes to the sky by reflection: 0.2 of its mean in deviation.
    EXPECT_NEAR(seen[k], expected, expected * 4 * 0.21 / std::sqrt(64.0 * 64 * 16)) << "colour " << k;
  }
}

// An eye within the slab: its first rays start in a medium of which they learn where they come out. Radiance within glass is
// larger by the squared index.
TEST_P(Absorption, AnEyeWithinTheGlassSeesThroughIt)
{
  const Device device = make_device(GetParam().device);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_mesh(scene, slab(5, 0, float(thickness)), add_tinted_glass(scene, {0.5f, 1, 0.125f}, float(thickness)));
  set_environment(scene, 1);
  constexpr double deep = 0.2;
  add_camera(scene, {0, 0, float(deep)}, 0.01f);
  commit(scene, GetParam().accel);
  RenderOptions o{.width = 64, .height = 64, .spp = 16, .max_depth = 32};
  o.pipeline = GetParam().pipeline;
  const std::array<double, 3> seen = mean_color(scene, o);
  const double per_thickness[3] = {0.5, 1, 0.125};
  for (size_t k = 0; k < 3; ++k) {
    const double left = std::pow(per_thickness[k], deep / thickness);
    const double expected = ior * ior * left * (1 - reflectance) / (1 - reflectance * per_thickness[k]);
    // One sample in 25 is reflected, and loses at most all.
    EXPECT_NEAR(seen[k], expected, ior * ior * left * 4 * 0.2 / std::sqrt(64.0 * 64 * 16)) << "colour " << k;
  }
}

// A distant light through a slab onto a floor, which no shadow ray finds: up to max_depth 4 photons that pass both sides at
// once. Roulette takes them where the glass absorbs, so that those that come through carry what they carry without it.
TEST_P(Absorption, PhotonsComeThroughByTheLaw)
{
  if (GetParam().pipeline != GPURT_PIPELINE_PHOTON) GTEST_SKIP() << "photons alone find this light";
  const Device device = make_device(GetParam().device);
  uint64_t stored_of_clear = 0;
  for (const std::array<float, 3> color :
       {std::array<float, 3>{1, 1, 1}, std::array<float, 3>{0.5f, 1, 0.25f},
        std::array<float, 3>{0.25f, 0, 0.125f}}) {
    Scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
    add_mesh(scene, slab(0.6f, 0, float(thickness)), add_tinted_glass(scene, color, float(thickness)));
    add_mesh(scene,
             quad({-0.6f, -0.6f, -0.5f}, {0.6f, -0.6f, -0.5f}, {0.6f, 0.6f, -0.5f}, {-0.6f, 0.6f, -0.5f}),
             add_material(scene, GPURT_MATERIAL_LAMBERT, {0.5f, 0.5f, 0.5f}));
    gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
    light.type = GPURT_LIGHT_DISTANT;
    light.direction[2] = -1;
    for (float &c : light.intensity) c = 3;
    uint32_t id;
    GPURT_ASSERT_OK(gpurt_scene_add_light(scene, &light, &id));
    add_camera(scene, {0, 0, -0.05f}, 1.0f);
    commit(scene, GetParam().accel);

    gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
    frame_desc.width = frame_desc.height = 16;
    Frame frame;
    GPURT_ASSERT_OK(gpurt_frame_create(scene, &frame_desc, frame.out()));
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.pipeline = GPURT_PIPELINE_PHOTON;
    desc.samples_per_pixel = 64;
    desc.max_depth = 4;
    desc.photon.initial_radius = 0.05f;
    desc.photon.photons_per_pass = 16384;
    Job job;
    GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
    GPURT_ASSERT_OK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
    const std::vector<float> seen = read_color(frame, {.width = 16, .height = 16});
    gpurt_statistics statistics = GPURT_STATISTICS_INIT;
    GPURT_ASSERT_OK(gpurt_frame_get_statistics(frame, &statistics));
    const uint64_t stored = statistics.photon_counters.num_stored;
    if (stored_of_clear == 0) stored_of_clear = stored;
    const double most = std::max({color[0], color[1], color[2]});
    EXPECT_NEAR(double(stored) / double(stored_of_clear), most, 0.02 * most);
    for (size_t k = 0; k < 3; ++k) {
      double sum = 0;
      for (size_t i = k; i < seen.size(); i += 3) sum += double(seen[i]) / (double(seen.size()) / 3);
      const double expected = 0.5 / M_PI * 3 * (1 - reflectance) * (1 - reflectance) * double(color[k]);
      // Some 15000 photons at least; where there are fewer, fewer are seen.
      EXPECT_NEAR(sum, expected, 0.03 * expected) << "colour " << k;
    }
  }
}

}  // namespace
