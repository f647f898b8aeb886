// Lamps with textures: they light as what of them shines does, by every way that light is found.
#include <cstdio>

#include "../support/textures.h"

namespace {

using namespace gpurt_test;

struct Method {
  const char *name;
  gpurt_device_type device;
  gpurt_accel accel;
  gpurt_pipeline pipeline;
};

class LampTextures : public testing::TestWithParam<Method> {
 protected:
  void SetUp() override
  {
    if (GetParam().device == GPURT_DEVICE_CUDA && !has_cuda()) GTEST_SKIP() << "no CUDA device";
  }
};
INSTANTIATE_TEST_SUITE_P(
    Methods, LampTextures,
    testing::Values(Method{"path", GPURT_DEVICE_CPU, GPURT_ACCEL_KDTREE, GPURT_PIPELINE_PATH},
                    Method{"photon", GPURT_DEVICE_CPU, GPURT_ACCEL_BVH, GPURT_PIPELINE_PHOTON},
                    Method{"reyes", GPURT_DEVICE_CPU, GPURT_ACCEL_BVH, GPURT_PIPELINE_REYES},
                    Method{"cuda_path", GPURT_DEVICE_CUDA, GPURT_ACCEL_KDTREE, GPURT_PIPELINE_PATH},
                    Method{"cuda_photon", GPURT_DEVICE_CUDA, GPURT_ACCEL_BVH, GPURT_PIPELINE_PHOTON}),
    [](const auto &info) { return info.param.name; });

uint32_t add_lamp(gpurt_scene scene, std::array<float, 3> emission, uint32_t texture, bool two_sided = false)
{
  gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
  for (size_t k = 0; k < 3; ++k) desc.base_color[k] = 0, desc.emission[k] = emission[k];
  desc.emission_texture = texture;
  desc.two_sided_emission = two_sided;
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &desc, &id));
  return id;
}

// Of a rectangle that faces a patch from distance 1, one corner above the patch, sides x and y.
double form_factor(double x, double y)
{
  const double a = std::sqrt(1 + x * x), b = std::sqrt(1 + y * y);
  return (x / a * std::atan(y / a) + y / b * std::atan(x / b)) / (2 * M_PI);
}

// A square lamp of half edge 1 at distance 2 whose texture leaves a quarter of it, seen from a small patch below its centre.
TEST_P(LampTextures, AStripOfALampLightsByItsFormFactor)
{
  const Device device = make_device(GetParam().device);
  const auto lit = [&](const std::vector<bool> &strips) {
    Scene scene;
    GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
    add_mesh(scene, quad({-0.01f, -0.01f, 0}, {0.01f, -0.01f, 0}, {0.01f, 0.01f, 0}, {-0.01f, 0.01f, 0}),
             add_material(scene, GPURT_MATERIAL_LAMBERT, {0.5f, 0.5f, 0.5f}));
    // Seen from below, u goes with x.
    add_sheet(scene, Corners{{{-1, 1, 2}, {1, 1, 2}, {1, -1, 2}, {-1, -1, 2}}},
              add_lamp(scene, {3, 3, 3}, add_strips(scene, strips)));
    add_camera(scene, {0, 0, 1}, 0.005f);
    commit(scene, GetParam().accel);
    RenderOptions o{.width = 64, .height = 64, .spp = 64, .max_depth = 2};
    o.pipeline = GetParam().pipeline;
    const Frame frame = make_frame(scene, o);
    render(frame, o);
    return mean(read_color(frame, o));
  };
  const double edge = 2 * (form_factor(0.5, 0.5) - form_factor(0.25, 0.5)),
               middle = 2 * form_factor(0.25, 0.5);
  // A sample's deviation is below twice its mean.
  const double noise = 2 / std::sqrt(64.0 * 64 * 64);
  EXPECT_NEAR(lit({false, false, false, true}), 0.5 * 3 * edge, 4 * noise * 0.5 * 3 * edge);
  EXPECT_NEAR(lit({false, true, false, false}), 0.5 * 3 * middle, 4 * noise * 0.5 * 3 * middle);
  EXPECT_NEAR(lit({true, true, false, false}), 0.5 * 3 * (edge + middle),
              4 * noise * 0.5 * 3 * (edge + middle));
}

// Direct sight, mirrors, rough metal and diffuse surfaces: all weights of next-event estimation against the BSDF's own
// directions. The lamp with a texture against the strips that it leaves.
TEST_P(LampTextures, LightAsTheirStripsAlone)
{
  const Device device = make_device(GetParam().device);
  const std::vector<uint8_t> greys = {0, 51, 0, 0, 255};  // of which 51 is a fifth
  const auto lit = [&](bool has_texture, gpurt_pipeline pipeline, bool two_sided) {
    Scene scene;
    GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
    add_mesh(scene, quad({-1, -1, 1}, {1, -1, 1}, {1, -1, -1}, {-1, -1, -1}),
             add_material(scene, GPURT_MATERIAL_LAMBERT, {0.8f, 0.7f, 0.5f}));
    add_mesh(scene, quad({-1, -1, 1}, {-1, -1, -1}, {-1, 1, -1}, {-1, 1, 1}),
             add_material(scene, GPURT_MATERIAL_METAL, {0.9f, 0.8f, 0.7f}, {0, 0, 0}, 0.35f));
    add_mesh(scene, quad({1, -1, -1}, {1, -1, 1}, {1, 1, 1}, {1, 1, -1}),
             add_material(scene, GPURT_MATERIAL_MIRROR, {0.9f, 0.9f, 0.9f}));
    add_mesh(scene, quad({-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1}),
             add_material(scene, GPURT_MATERIAL_LAMBERT, {0.6f, 0.7f, 0.8f}));
    const Corners corners{
        {{-0.5f, 0.6f, -0.4f}, {0.5f, 0.6f, -0.4f}, {0.5f, 0.5f, 0.4f}, {-0.5f, 0.5f, 0.4f}}};
    if (has_texture) {
      add_sheet(scene, corners, add_lamp(scene, {6, 5, 4}, add_grey_strips(scene, greys), two_sided));
    } else {
      add_sheets(scene, corners, {false, true, false, false, false},
                 add_lamp(scene, {1.2f, 1, 0.8f}, 0, two_sided));
      add_sheets(scene, corners, {false, false, false, false, true},
                 add_lamp(scene, {6, 5, 4}, 0, two_sided));
      // The rest of the lamp is black, and stands in the way of light.
      add_sheets(scene, corners, {true, false, true, true, false},
                 add_material(scene, GPURT_MATERIAL_LAMBERT, {0, 0, 0}));
    }
    add_camera(scene, {0, 0, 2.2f}, 0.9f);
    commit(scene, GetParam().accel);
    const RenderOptions o{.width = 24, .height = 24};
    const Frame frame = make_frame(scene, o);
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.pipeline = pipeline;
    // Direct light is the noise of both, so photon mapping takes many passes, of few photons.
    desc.samples_per_pixel = 512;
    desc.max_depth = GetParam().pipeline == GPURT_PIPELINE_REYES ? 2 : 0;
    if (pipeline == GPURT_PIPELINE_PHOTON) {
      desc.photon.photons_per_pass = 2048;
      desc.photon.initial_radius = 0.04f;
    }
    Job job;
    GPURT_EXPECT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
    GPURT_EXPECT_OK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
    return mean(read_color(frame, o));
  };
  for (const bool two_sided : {false, true}) {
    const double textured = lit(true, GetParam().pipeline, two_sided);
    const double strips_alone = lit(false, GPURT_PIPELINE_PATH, two_sided);
    std::printf("textured %.5f, strips %.5f, ratio %.4f\n", textured, strips_alone, textured / strips_alone);
    EXPECT_NEAR(textured / strips_alone, 1, 0.01);
  }
}

// Seen directly, a lamp is its texels, not its mean.
TEST_P(LampTextures, ShowTheirTexels)
{
  const Device device = make_device(GetParam().device);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_sheet(scene, Corners{{{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}}},
            add_lamp(scene, {1, 2, 3}, add_strips(scene, {false, true, true, false})));
  add_camera(scene, {0, 0, 2}, 2 * std::atan(0.5f));
  commit(scene, GetParam().accel);
  RenderOptions o{.width = 32, .height = 32, .spp = 4};
  o.pipeline = GetParam().pipeline;
  const Frame frame = make_frame(scene, o);
  render(frame, o);
  const std::vector<float> color = read_color(frame, o);
  for (uint32_t y = 0; y < 32; ++y) {
    for (uint32_t x = 0; x < 32; ++x) {
      for (uint32_t k = 0; k < 3; ++k)
        ASSERT_EQ(color[(y * 32 + x) * 3 + k], x >= 8 && x < 24 ? float(k + 1) : 0.0f) << x << " " << y;
    }
  }
}

}  // namespace
