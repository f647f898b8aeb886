// Micropolygons' own light: that of the surface, without bias, whatever tiles, threads and memory; on the CPU and on a CUDA
// device. And one image for all schedules.
#include "../support/reyes_renders.h"

namespace {

using namespace gpurt_test;

class ReyesShading : public ::testing::TestWithParam<gpurt_device_type> {
 protected:
  void SetUp() override
  {
    if (GetParam() == GPURT_DEVICE_CUDA && !has_cuda()) GTEST_SKIP() << "no CUDA device";
  }
};

constexpr uint32_t kept_outputs =
    1u << GPURT_OUTPUT_COLOR | 1u << GPURT_OUTPUT_ALPHA | 1u << GPURT_OUTPUT_SAMPLE_COUNT;

RenderOptions shading_options(gpurt_reyes_shading shading, uint32_t size, uint32_t spp)
{
  RenderOptions o;
  o.width = o.height = size;
  o.spp = spp;
  o.seed = 3;
  o.pipeline = GPURT_PIPELINE_REYES;
  o.reyes.no_shadows = 1;
  o.reyes.shading = shading;
  o.max_depth = 2;
  return o;
}

// Dented balls of metal and chalk, with every patch of one of them twice in other colours: ties everywhere.
Scene balls(gpurt_device device)
{
  Scene scene;
  GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
  const std::vector<PatchNet> nets = closed_patches(2, 0.2, 9);
  std::vector<PatchNet> twice = nets;
  twice.insert(twice.end(), nets.begin(), nets.end());
  add_patches(scene, twice, add_material(scene, GPURT_MATERIAL_LAMBERT, {0.9f, 0.5f, 0.1f}));
  add_patches(scene, nets, add_material(scene, GPURT_MATERIAL_LAMBERT, {0.1f, 0.5f, 0.9f}));
  add_patches(scene, nets, add_material(scene, GPURT_MATERIAL_METAL, {0.9f, 0.8f, 0.7f}, {0, 0, 0}, 0.5f),
              {{0.5f, 0, 0, 1.1f, 0, -0.5f, 0, 0.2f, 0, 0, 0.5f, 0.4f}});
  add_patches(scene, {PatchNet(nets[0])}, add_material(scene, GPURT_MATERIAL_MIRROR, {1, 1, 1}),
              {{1, 0, 0, -1.2f, 0, 1, 0, 0.5f, 0, 0, 1, 0}});
  add_light(scene, GPURT_LIGHT_POINT, 20);
  add_light(scene, GPURT_LIGHT_SPOT, 9);
  add_light(scene, GPURT_LIGHT_DISTANT, 0.5f);
  add_camera(scene, {0.3f, 0.1f, 3}, 1.0f);
  coarse_commit(scene);
  return scene;
}

// Under the Gaussian micropolygons are larger by default, at about the error of a box: mean squared differences from images of
// many more micropolygons with the same samples, of several balls, since their numbers go in powers of two.
TEST_P(ReyesShading, FiltersChooseHowLargeMicropolygonsAre)
{
  const Device device = make_device(GetParam());
  double error[4] = {};
  for (int ball = 0; ball < 4; ++ball) {
    Scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
    add_patches(scene, closed_patches(1 + ball, 0.2, uint64_t(9 + ball)),
                add_material(scene, GPURT_MATERIAL_LAMBERT, {0.9f, 0.5f, 0.1f}));
    add_light(scene, GPURT_LIGHT_POINT, 20);
    add_camera(scene, {0.3f, 0.1f, 3}, 1.0f);
    coarse_commit(scene);
    const auto render_at = [&](gpurt_reyes_filter filter, float rate, gpurt_statistics &s) {
      RenderOptions o = shading_options(GPURT_REYES_SHADING_MICROPOLYGONS, 64, 25);
      o.reyes.filter = filter;
      o.reyes.shading_rate = rate;
      const Frame frame = make_frame(scene, o, kept_outputs);
      render(frame, o);
      s = statistics_of(frame);
      return read_color(frame, o);
    };
    for (const gpurt_reyes_filter filter :
         {GPURT_REYES_FILTER_BOX, GPURT_REYES_FILTER_GAUSSIAN, GPURT_REYES_FILTER_MITCHELL}) {
      gpurt_statistics fine = GPURT_STATISTICS_INIT, chosen = GPURT_STATISTICS_INIT,
                       quarter = GPURT_STATISTICS_INIT;
      const std::vector<float> expected = render_at(filter, 1.0f / 64, fine),
                               color = render_at(filter, 0, chosen),
                               at_quarter = render_at(filter, 0.25f, quarter);
      for (size_t k = 0; k < color.size(); ++k)
        error[filter] += double(color[k] - expected[k]) * double(color[k] - expected[k]);
      const bool is_gaussian = filter == GPURT_REYES_FILTER_GAUSSIAN;
      EXPECT_EQ(chosen.reyes.shading_rate, is_gaussian ? 0.375f : 0.25f);
      if (is_gaussian) {
        EXPECT_LT(double(chosen.reyes_counters.num_micropolygons),
                  0.9 * double(quarter.reyes_counters.num_micropolygons));
      } else {
        EXPECT_EQ(color, at_quarter);
      }
    }
  }
  std::printf("box %.3g, Gaussian %.3g, Mitchell %.3g\n", error[1], error[2], error[3]);
  // Of two models they were 0.9 to 1.5 times a box's (docs/reyes.md).
  EXPECT_LT(error[GPURT_REYES_FILTER_GAUSSIAN], 1.5 * error[GPURT_REYES_FILTER_BOX]);
}

// A sheet under a distant light has one colour: E cos(theta) albedo / pi. Each sample is rounded, their mean is not.
TEST_P(ReyesShading, KeepsTheMeanOfLight)
{
  const Device device = make_device(GetParam());
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_patches(scene, {flat_patch({-2, -2, 0}, {4, 0, 0}, {0, 4, 0})},
              add_material(scene, GPURT_MATERIAL_LAMBERT, {0.77f, 0.0123f, 0.31f}));
  add_light(scene, GPURT_LIGHT_DISTANT, 3);
  add_camera(scene, {0, 0, 2}, 1.0f);
  coarse_commit(scene);
  const double cosine = 1 / std::sqrt(0.09 + 0.04 + 1);
  const double expected[3] = {0.77 * 3 * cosine / M_PI, 0.0123 * 3 * cosine / M_PI,
                              0.31 * 2.1 * cosine / M_PI};
  for (const gpurt_reyes_shading shading : {GPURT_REYES_SHADING_MICROPOLYGONS, GPURT_REYES_SHADING_BLOCKS}) {
    const RenderOptions o = shading_options(shading, 64, 4);
    const Frame frame = make_frame(scene, o, kept_outputs);
    render(frame, o);
    const std::vector<float> color = read_color(frame, o);
    // A sample is off by less than 1/128 of the largest component, or 1/64 in blue; the mean of N points by that over
    // sqrt(12 N) times five. Samples of a micropolygon share its rounding, and there are a quarter as many blocks.
    const double num_points = 64 * 64 * (shading == GPURT_REYES_SHADING_BLOCKS ? 1 : 4) * 0.5;
    for (int c = 0; c < 3; ++c) {
      const double step = expected[0] * (c == 2 ? 1.0 / 64 : 1.0 / 128);
      double sum = 0;
      for (size_t i = size_t(c); i < color.size(); i += 3) {
        ASSERT_NEAR(color[i], expected[c], step) << "component " << c;
        sum += color[i];
      }
      EXPECT_NEAR(sum / (64 * 64), expected[c], 5 * step / std::sqrt(12 * num_points)) << "component " << c;
    }
  }
}

// Means over parts of the image: those of light at samples, which draw one of the lights each.
TEST_P(ReyesShading, LightsAsSamplesDo)
{
  const Device device = make_device(GetParam());
  const Scene scene = balls(device);
  constexpr uint32_t size = 64;
  const RenderOptions exact = shading_options(GPURT_REYES_SHADING_SAMPLES, size, 64);
  const Frame reference = make_frame(scene, exact, kept_outputs);
  render(reference, exact);
  const std::vector<float> expected = read_color(reference, exact);
  for (const gpurt_reyes_shading shading : {GPURT_REYES_SHADING_MICROPOLYGONS, GPURT_REYES_SHADING_BLOCKS}) {
    const RenderOptions o = shading_options(shading, size, 16);
    const Frame frame = make_frame(scene, o, kept_outputs);
    render(frame, o);
    const std::vector<float> color = read_color(frame, o);
    const double overall = mean(color), wanted = mean(expected);
    // Where surfaces coincide, samples take the lower root and micropolygons the brighter one: chalk of two colours.
    EXPECT_NEAR(overall, wanted, 0.02 * wanted);
    // The metal ball alone, to the right of the others.
    double sum[2] = {0, 0};
    for (uint32_t y = 20; y < 40; ++y) {
      for (uint32_t x = 48; x < 58; ++x) {
        for (uint32_t c = 0; c < 3; ++c) {
          sum[0] += expected[(y * size + x) * 3 + c];
          sum[1] += color[(y * size + x) * 3 + c];
        }
      }
    }
    EXPECT_GT(sum[0], 0);
    EXPECT_NEAR(sum[1], sum[0], 0.02 * sum[0]);
  }
}

TEST_P(ReyesShading, HasTheSameBitsForAnyTilesThreadsAndMemory)
{
  std::vector<std::vector<float>> first;
  const uint64_t little_memory = uint64_t(GetParam() == GPURT_DEVICE_CUDA ? 20 : 12) << 20;
  for (const auto &[threads, tile, limit] :
       {std::tuple{1u, 64u, uint64_t(0)}, {2u, 7u, uint64_t(0)}, {1u, 256u, little_memory}}) {
    const Device device = make_device(GetParam(), threads, limit);
    const Scene scene = balls(device);
    size_t at = 0;
    for (const gpurt_reyes_shading shading :
         {GPURT_REYES_SHADING_MICROPOLYGONS, GPURT_REYES_SHADING_BLOCKS}) {
      for (const gpurt_reyes_filter filter : {GPURT_REYES_FILTER_BOX, GPURT_REYES_FILTER_MITCHELL}) {
        RenderOptions o = shading_options(shading, 60, 9);
        o.reyes.filter = filter;
        o.tile_size = tile;
        const Frame frame = make_frame(scene, o, kept_outputs);
        render(frame, o);
        const std::vector<float> color = read_color(frame, o);
        if (first.size() <= at) first.push_back(color);
        ASSERT_EQ(std::memcmp(first[at].data(), color.data(), color.size() * sizeof(float)), 0)
            << threads << " threads, tiles of " << tile << ", filter " << filter << ", shading " << shading;
        ++at;
      }
    }
  }
}

// What was shaded once for a frame is the same in the next job, and counts of points say what it cost.
TEST_P(ReyesShading, GoesOnAndCounts)
{
  const Device device = make_device(GetParam(), 1);
  const Scene scene = balls(device);
  RenderOptions o = shading_options(GPURT_REYES_SHADING_MICROPOLYGONS, 64, 16);
  o.tile_size = 64;
  const Frame whole = make_frame(scene, o, kept_outputs);
  render(whole, o);
  const Frame parts = make_frame(scene, o, kept_outputs);
  for (const uint32_t spp : {3u, 16u}) {
    o.spp = spp;
    render(parts, o);
  }
  EXPECT_EQ(read_color(whole, o), read_color(parts, o));
  const gpurt_statistics micropolygons = statistics_of(whole);
  EXPECT_EQ(micropolygons.reyes_counters.num_shaded, micropolygons.reyes_counters.num_micropolygons);
  EXPECT_EQ(micropolygons.num_shadow_rays, 0u);
  o.reyes.shading = GPURT_REYES_SHADING_BLOCKS;
  const Frame blocks = make_frame(scene, o, kept_outputs);
  render(blocks, o);
  const gpurt_statistics s = statistics_of(blocks);
  EXPECT_EQ(s.reyes_counters.num_micropolygons, micropolygons.reyes_counters.num_micropolygons);
  EXPECT_LT(s.reyes_counters.num_shaded, micropolygons.reyes_counters.num_shaded / 3);
  EXPECT_GE(s.reyes_counters.num_shaded, micropolygons.reyes_counters.num_shaded / 4);
}

// A white texture changes no bit: CPU devices shade surfaces that have one point by point, others eight points at a time.
TEST_P(ReyesShading, IsThatOfAWhiteTexture)
{
  const Device device = make_device(GetParam(), 1);
  std::vector<float> plain[4];
  for (const bool has_texture : {false, true}) {
    Scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
    const float white[4] = {1, 1, 1, 1};
    gpurt_texture_desc texture = GPURT_TEXTURE_DESC_INIT;
    texture.format = GPURT_TEXTURE_RGBA32F;
    texture.width = texture.height = 1;
    texture.filter = GPURT_FILTER_NEAREST;
    texture.texels = white;
    uint32_t white_id = 0;
    GPURT_ASSERT_OK(gpurt_scene_add_texture(scene, &texture, &white_id));
    const std::vector<PatchNet> nets = closed_patches(2, 0.2, 9);
    for (const gpurt_material_type type : {GPURT_MATERIAL_LAMBERT, GPURT_MATERIAL_METAL}) {
      gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
      desc.type = type;
      desc.roughness = 0.4f;
      desc.base_color[0] = 0.9f;
      desc.base_color[1] = 0.3f;
      desc.base_color_texture = has_texture ? white_id : 0;
      uint32_t material = 0;
      GPURT_ASSERT_OK(gpurt_scene_add_material(scene, &desc, &material));
      add_patches(
          scene, nets, material,
          {{0.5f, 0, 0, type == GPURT_MATERIAL_METAL ? 0.6f : -0.6f, 0, -0.5f, 0, 0.2f, 0, 0, 0.5f, 0.4f}});
    }
    add_light(scene, GPURT_LIGHT_POINT, 20);
    add_light(scene, GPURT_LIGHT_SPOT, 9);
    add_light(scene, GPURT_LIGHT_DISTANT, 0.5f);
    add_camera(scene, {0.3f, 0.1f, 3}, 1.0f);
    coarse_commit(scene);
    int at = 0;
    for (const gpurt_reyes_shading shading :
         {GPURT_REYES_SHADING_MICROPOLYGONS, GPURT_REYES_SHADING_BLOCKS}) {
      for (const float rate : {0.25f, 4.0f}) {
        RenderOptions o = shading_options(shading, 72, 9);
        o.reyes.shading_rate = rate;
        const Frame frame = make_frame(scene, o, kept_outputs);
        render(frame, o);
        const std::vector<float> color = read_color(frame, o);
        if (!has_texture) plain[at] = color;
        else EXPECT_EQ(std::memcmp(plain[at].data(), color.data(), color.size() * sizeof(float)), 0);
        ++at;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Cpu, ReyesShading, ::testing::Values(GPURT_DEVICE_CPU));
INSTANTIATE_TEST_SUITE_P(Cuda, ReyesShading, ::testing::Values(GPURT_DEVICE_CUDA));

}  // namespace
