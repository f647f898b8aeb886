// What photon mapping says about its own error, against scenes whose radiance is known.
#include <algorithm>
#include <cstdio>

#include "../support/gpurt_test.h"

namespace {

using namespace gpurt_test;

constexpr uint32_t error_outputs = 1u << GPURT_OUTPUT_BIAS | 1u << GPURT_OUTPUT_ERROR;

struct Work {
  uint32_t width = 24, spp = 16, max_depth = 0, outputs = error_outputs;
  float target_error = 0;
  uint64_t first_sample = 0;
  gpurt_pipeline pipeline = GPURT_PIPELINE_PHOTON;
  gpurt_photon_settings photon = GPURT_PHOTON_SETTINGS_INIT;
};

Frame frame_of(gpurt_scene scene, const Work &o)
{
  gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
  desc.width = desc.height = o.width;
  desc.outputs = o.outputs;
  desc.first_sample = o.first_sample;
  Frame frame;
  GPURT_EXPECT_OK(gpurt_frame_create(scene, &desc, frame.out()));
  return frame;
}

gpurt_result submit(gpurt_frame frame, const Work &o)
{
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.pipeline = o.pipeline;
  desc.samples_per_pixel = o.spp;
  desc.target_error = o.target_error;
  desc.max_depth = o.max_depth;
  desc.photon = o.photon;
  Job job;
  const gpurt_result result = gpurt_frame_submit(frame, &desc, nullptr, 0, job.out());
  return result != GPURT_OK ? result : gpurt_job_wait(job, GPURT_WAIT_FOREVER);
}

std::vector<float> read(gpurt_frame frame, const Work &o, gpurt_output output)
{
  std::vector<float> values(size_t(o.width) * o.width * 3);
  GPURT_EXPECT_OK(gpurt_frame_read(frame, output, values.data(), values.size() * sizeof(float)));
  return values;
}

gpurt_statistics statistics(gpurt_frame frame)
{
  gpurt_statistics s = GPURT_STATISTICS_INIT;
  GPURT_EXPECT_OK(gpurt_frame_get_statistics(frame, &s));
  return s;
}

// A closed cube of albedo 0.9 and emission 0.1: radiance is 1 everywhere, and all but the first two bounces are photons.
Scene make_furnace(gpurt_device device)
{
  Scene scene;
  GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
  gpurt_material_desc lamp = GPURT_MATERIAL_DESC_INIT;
  for (int k = 0; k < 3; ++k) lamp.base_color[k] = 0.9f, lamp.emission[k] = 0.1f;
  lamp.two_sided_emission = 1;
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &lamp, &id));
  Mesh m;
  for (const float s : {-1.0f, 1.0f}) {
    m.append(quad({-1, -1, s}, {1, -1, s}, {1, 1, s}, {-1, 1, s}));
    m.append(quad({-1, s, -1}, {1, s, -1}, {1, s, 1}, {-1, s, 1}));
    m.append(quad({s, -1, -1}, {s, 1, -1}, {s, 1, 1}, {s, -1, 1}));
  }
  add_mesh(scene, m, id);
  add_camera(scene, {0, 0, 0}, 2 * std::atan(1.0f));  // the wall z = -1
  commit(scene, GPURT_ACCEL_BVH);
  return scene;
}

class PhotonError : public testing::TestWithParam<gpurt_device_type> {
 protected:
  void SetUp() override
  {
    if (GetParam() == GPURT_DEVICE_CUDA && !has_cuda()) GTEST_SKIP() << "no CUDA device";
  }
  Device device_for() const { return make_device(GetParam()); }
};
INSTANTIATE_TEST_SUITE_P(Cpu, PhotonError, testing::Values(GPURT_DEVICE_CPU));
INSTANTIATE_TEST_SUITE_P(Cuda, PhotonError, testing::Values(GPURT_DEVICE_CUDA));

// A mirror throws the light of a spot on the floor, brightest in the middle: blur makes it darker there.
class SmoothSpot {
 public:
  static constexpr double outer = 0.25, intensity = 30, albedo = 0.5;
  static constexpr double height = 2.9 + 3;  // from the lamp's image in the mirror to the floor

  Scene make(gpurt_device device) const
  {
    Scene scene;
    GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
    const float a = float(albedo);
    add_mesh(scene, quad({-3, -3, -2}, {3, -3, -2}, {3, 3, -2}, {-3, 3, -2}),
             add_material(scene, GPURT_MATERIAL_LAMBERT, {a, a, a}));
    add_mesh(scene, quad({-1, -1, 1}, {1, -1, 1}, {1, 1, 1}, {-1, 1, 1}),
             add_material(scene, GPURT_MATERIAL_MIRROR, {1, 1, 1}));
    gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
    light.type = GPURT_LIGHT_SPOT;
    light.position[2] = -1.9f;
    light.direction[2] = 1;
    light.outer_cone_angle_rad = float(outer);
    for (float &c : light.intensity) c = float(intensity);
    uint32_t id;
    GPURT_EXPECT_OK(gpurt_scene_add_light(scene, &light, &id));
    add_camera(scene, {0, 0, 0}, 2 * std::atan(0.4f));  // sees 1.6 x 1.6 of the floor
    commit(scene, GPURT_ACCEL_BVH);
    return scene;
  }

  static double radiance(double x, double y)
  {
    const double d2 = height * height + x * x + y * y, cosine = height / std::sqrt(d2);
    const double f = (cosine - std::cos(outer)) / (1 - std::cos(outer));
    return f > 0 ? albedo / 3.14159265358979 * intensity * f * f * cosine / d2 : 0;
  }
};

// The radius is so large that the mean of all passes is dark by some 4 %; the noise of that is a tenth of it.
TEST_P(PhotonError, TellsTheBlurOfSmoothLight)
{
  const Scene scene = SmoothSpot().make(device_for());
  for (const gpurt_photon_kernel kernel : {GPURT_PHOTON_KERNEL_CONSTANT, GPURT_PHOTON_KERNEL_CONE}) {
    Work o;
    o.width = 16;
    o.spp = 12;
    o.max_depth = 3;
    o.photon.photons_per_pass = 16384;
    o.photon.initial_radius = kernel == GPURT_PHOTON_KERNEL_CONE ? 0.5f : 0.4f;
    o.photon.kernel = kernel;
    const Frame frame = frame_of(scene, o);
    ASSERT_EQ(submit(frame, o), GPURT_OK) << gpurt_last_error();
    const auto color = read(frame, o, GPURT_OUTPUT_COLOR), bias = read(frame, o, GPURT_OUTPUT_BIAS),
               error = read(frame, o, GPURT_OUTPUT_ERROR);
    double stated = 0, made = 0, all = 0;
    uint32_t num_within = 0;
    for (uint32_t y = 0; y < o.width; ++y) {
      for (uint32_t x = 0; x < o.width; ++x) {
        const double scale = 1.6 / o.width;
        const double exact = SmoothSpot::radiance((x + 0.5) * scale - 0.8, (y + 0.5) * scale - 0.8);
        const size_t i = 3 * (size_t(y) * o.width + x);
        stated += double(bias[i]);
        made += double(color[i]) - exact;
        all += exact;
        num_within += std::abs(double(color[i]) - exact) <= double(error[i]);
      }
    }
    std::printf("kernel %d: bias %.4f of the light, stated %.4f; %u of %u within the stated error\n",
                int(kernel), made / all, stated / all, num_within, o.width * o.width);
    EXPECT_LT(made / all, -0.02);
    EXPECT_NEAR(stated / made, 1, 0.2);
    EXPECT_GE(num_within, o.width * o.width * 95 / 100);
    // relMSE: the light is about 0.1, so the floor of 0.01 halves it.
    const gpurt_statistics s = statistics(frame);
    EXPECT_GT(s.estimated_bias, 0);
    EXPECT_GT(s.estimated_error, s.estimated_bias);
  }
}

// Discs at the edges of the wall lie on it in part: that is no blur, since the light is even. Their bias, were it taken for
// blur, is up to a sixth of the light.
TEST_P(PhotonError, DoesNotTakeRimsForBlur)
{
  const Scene scene = make_furnace(device_for());
  Work o;
  o.spp = 24;
  o.max_depth = 200;
  o.photon.photons_per_pass = 8192;
  o.photon.initial_radius = 0.3f;
  const Frame frame = frame_of(scene, o);
  ASSERT_EQ(submit(frame, o), GPURT_OK) << gpurt_last_error();
  const auto color = read(frame, o, GPURT_OUTPUT_COLOR), bias = read(frame, o, GPURT_OUTPUT_BIAS),
             error = read(frame, o, GPURT_OUTPUT_ERROR);
  uint32_t num_within = 0;
  for (size_t i = 0; i < color.size(); ++i) num_within += std::abs(color[i] - 1) <= error[i];
  // Of pixels 0.4 r from an edge.
  double rim = 0;
  for (uint32_t k = 3; k + 3 < o.width; ++k) {
    const auto at = [&](uint32_t x, uint32_t y) { return double(bias[3 * (size_t(y) * o.width + x)]); };
    rim += (at(k, 1) + at(k, o.width - 2) + at(1, k) + at(o.width - 2, k)) / (4 * (o.width - 6));
  }
  std::printf("stated bias %.4f, at edges %.4f; %.1f %% within the stated error, which is %.3f\n", mean(bias),
              rim, 100.0 * num_within / double(color.size()), mean(error));
  EXPECT_LT(std::abs(mean(bias)), 0.01);
  EXPECT_LT(std::abs(rim), 0.02);
  EXPECT_GE(num_within, color.size() * 95 / 100);
  EXPECT_LT(mean(error), 0.5);
}

// The corner of two walls that reflect all light, on a plain that does, under a sky of radiance 1: radiance is 1 everywhere.
// Photons leave through the disc around the plain, so that one in thousands comes near what the camera sees.
Scene make_corner_under_sky(gpurt_device device)
{
  Scene scene;
  GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
  const uint32_t white = add_material(scene, GPURT_MATERIAL_LAMBERT, {1, 1, 1});
  Mesh m = quad({-30, -30, -1}, {30, -30, -1}, {30, 30, -1}, {-30, 30, -1});
  m.append(quad({-1, -1, -1}, {-1, 1, -1}, {-1, 1, 1}, {-1, -1, 1}));
  m.append(quad({-1, -1, -1}, {1, -1, -1}, {1, -1, 1}, {-1, -1, 1}));
  add_mesh(scene, m, white);
  set_environment(scene, 1);
  add_camera(scene, {0.5f, 0.5f, 3}, 2 * std::atan(0.4f));
  commit(scene, GPURT_ACCEL_BVH);
  return scene;
}

double relmse_of_ones(const std::vector<float> &color)
{
  double sum = 0;
  for (const float x : color) sum += (double(x) - 1) * (double(x) - 1) / 1.01;
  return sum / double(color.size());
}

TEST_P(PhotonError, CountsOnPhotonsThatHaveNotCome)
{
  const Scene scene = make_corner_under_sky(device_for());
  Work o;
  o.max_depth = 200;
  double least = 1e30;
  std::vector<double> ratios;
  for (const uint32_t photons : {64u, 1024u, 16384u}) {
    for (const float radius : {0.1f, 0.4f}) {
      o.photon.photons_per_pass = photons;
      o.photon.initial_radius = radius;
      o.spp = 32;
      const Frame frame = frame_of(scene, o);
      ASSERT_EQ(submit(frame, o), GPURT_OK) << gpurt_last_error();
      const double made = relmse_of_ones(read(frame, o, GPURT_OUTPUT_COLOR));
      const gpurt_statistics s = statistics(frame);
      std::printf("%5u photons, radius %.1f, %6llu gathered: relMSE %.3g, stated %.3g\n", photons,
                  double(radius), static_cast<unsigned long long>(s.photon_counters.num_gathered), made,
                  s.estimated_error);
      ratios.push_back(s.estimated_error / made);
      least = std::min(least, ratios.back());
    }
  }
  EXPECT_GT(least, 0.8);
  // Where photons are many the estimate is one, and not a wild guess.
  EXPECT_LT(ratios.back(), 12);
}

// No photon at all: what one would add to every pixel.
TEST_P(PhotonError, DoesNotTakeDarknessForCertain)
{
  const Scene scene = make_corner_under_sky(device_for());
  Work o;
  o.spp = 2;
  o.max_depth = 200;
  o.photon.photons_per_pass = 4;
  o.photon.initial_radius = 0.01f;
  const Frame frame = frame_of(scene, o);
  ASSERT_EQ(submit(frame, o), GPURT_OK) << gpurt_last_error();
  const gpurt_statistics s = statistics(frame);
  ASSERT_EQ(s.photon_counters.num_gathered, 0u);
  // Three of 8, each of the flux pi^2 R^2 / 4 on pi r^2, in one of two samples of each pixel; radiance is below 1.
  const double r = s.photon_counters.smallest_radius, photon = 60.0 * 60.0 / 2 / (4 * r * r);
  EXPECT_GT(s.estimated_error, 3 * photon * photon / 4 / 1.01 * 0.9);
}

// Discs of 1/24 of the picture at most, however few photons come.
TEST_P(PhotonError, ChoosesDiscsThatAreSmallInThePicture)
{
  const Scene scene = make_corner_under_sky(device_for());
  Work o;
  o.spp = 1;
  o.width = 64;
  o.outputs = 0;
  const Frame frame = frame_of(scene, o);
  ASSERT_EQ(submit(frame, o), GPURT_OK) << gpurt_last_error();
  // 3.2 of the floor across 16 points.
  const float radius = statistics(frame).photon.initial_radius;
  EXPECT_GT(radius, 0.01f);
  EXPECT_LE(radius, 3.2f / 16 / 3 * 1.001f);
}

TEST_P(PhotonError, StopsByNoiseAndBiasTogether)
{
  const Scene scene = SmoothSpot().make(device_for());
  Work o;
  o.spp = 0;
  o.width = 12;
  o.max_depth = 3;
  o.outputs = 0;
  o.photon.photons_per_pass = 4096;
  o.photon.initial_radius = 0.6f;
  o.target_error = 1.5e-3f;
  const Frame frame = frame_of(scene, o);
  ASSERT_EQ(submit(frame, o), GPURT_OK) << gpurt_last_error();
  const gpurt_statistics s = statistics(frame);
  EXPECT_GT(s.estimated_bias, 0);
  EXPECT_LE(s.estimated_error, double(o.target_error));
  std::printf("stopped at %u samples: estimated error %.2e, of which bias %.2e\n",
              unsigned(s.samples_per_pixel), s.estimated_error, s.estimated_bias);
  // Noise alone would have stopped at the first look.
  EXPECT_GT(s.samples_per_pixel, 32u);
  // Samples that do not tell it do not become such.
  Work plain = o;
  plain.target_error = 0;
  plain.spp = 2;
  const Frame other = frame_of(scene, plain);
  ASSERT_EQ(submit(other, plain), GPURT_OK);
  EXPECT_LT(statistics(other).estimated_bias, 0);
  EXPECT_EQ(submit(other, o), GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_NE(std::string(gpurt_last_error()).find("GPURT_OUTPUT_BIAS"), std::string::npos)
      << gpurt_last_error();
}

// By two workers, one of which hands its part over in a file; and a frame without samples takes over what a file has.
TEST_P(PhotonError, IsTheSameOfMergedParts)
{
  const Scene scene = make_furnace(device_for());
  Work o;
  o.width = 12;
  o.spp = 5;
  o.photon.photons_per_pass = 2048;
  o.photon.initial_radius = 0.3f;
  const Frame whole = frame_of(scene, o), first = frame_of(scene, o);
  ASSERT_EQ(submit(whole, o), GPURT_OK);
  Work part = o;
  part.spp = 2;
  ASSERT_EQ(submit(first, part), GPURT_OK);
  part.first_sample = 2;
  part.spp = 3;
  const Frame second = frame_of(scene, part);
  ASSERT_EQ(submit(second, part), GPURT_OK);
  const std::string path = testing::TempDir() + "/photon_error.gpurt";
  GPURT_ASSERT_OK(gpurt_frame_save(second, path.c_str()));
  GPURT_ASSERT_OK(gpurt_frame_load_state(first, path.c_str()));
  for (const gpurt_output output : {GPURT_OUTPUT_COLOR, GPURT_OUTPUT_BIAS, GPURT_OUTPUT_ERROR})
    EXPECT_EQ(read(first, o, output), read(whole, o, output)) << output;
  EXPECT_EQ(statistics(first).estimated_bias, statistics(whole).estimated_bias);

  Work by_error = o;
  by_error.outputs = 0;
  by_error.spp = 4;
  by_error.target_error = 1e-9f;  // so that the frame keeps what tells it
  const Frame told = frame_of(scene, by_error), taken = frame_of(scene, by_error);
  ASSERT_EQ(submit(told, by_error), GPURT_OK);
  GPURT_ASSERT_OK(gpurt_frame_save(told, path.c_str()));
  GPURT_ASSERT_OK(gpurt_frame_load_state(taken, path.c_str()));
  EXPECT_GE(statistics(told).estimated_bias, 0);
  EXPECT_EQ(statistics(taken).estimated_bias, statistics(told).estimated_bias);
  // One that has samples without it does not.
  by_error.target_error = 0;
  by_error.first_sample = 100;
  const Frame plain = frame_of(scene, by_error);
  ASSERT_EQ(submit(plain, by_error), GPURT_OK);
  EXPECT_EQ(gpurt_frame_load_state(plain, path.c_str()), GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_NE(std::string(gpurt_last_error()).find("bias"), std::string::npos) << gpurt_last_error();
  std::remove(path.c_str());
}

TEST_P(PhotonError, IsRefusedWhereItIsNotKnown)
{
  const Scene scene = make_furnace(device_for());
  const auto refused = [&](Work o) {
    o.spp = o.target_error > 0 ? 0 : 1;
    const Frame frame = frame_of(scene, o);
    EXPECT_EQ(submit(frame, o), GPURT_ERROR_UNSUPPORTED);
    return std::string(gpurt_last_error());
  };
  Work path;
  path.pipeline = GPURT_PIPELINE_PATH;
  EXPECT_NE(refused(path).find("GPURT_OUTPUT_BIAS"), std::string::npos);
  Work per_pixel;
  per_pixel.photon.estimator = GPURT_PHOTON_ESTIMATOR_PER_PIXEL;
  per_pixel.outputs = 1u << GPURT_OUTPUT_ERROR;
  EXPECT_NE(refused(per_pixel).find("GPURT_OUTPUT_ERROR"), std::string::npos);
  per_pixel.outputs = 0;
  per_pixel.target_error = 0.1f;
  EXPECT_NE(refused(per_pixel).find("target_error"), std::string::npos);
  per_pixel.target_error = 0;
  per_pixel.photon.kernel = GPURT_PHOTON_KERNEL_CONE;
  EXPECT_NE(refused(per_pixel).find("kernel"), std::string::npos);
}

// Estimators whose passes depend on those before: the same image in one go, in two, and by way of a file.
TEST_P(PhotonError, EstimatorsWithAMemoryGoOnAndDoNotMerge)
{
  const Device device = device_for();
  const Scene furnace = make_furnace(device), spot = SmoothSpot().make(device);
  for (const gpurt_photon_estimator estimator :
       {GPURT_PHOTON_ESTIMATOR_PER_PIXEL, GPURT_PHOTON_ESTIMATOR_ADAPTIVE}) {
    SCOPED_TRACE(estimator);
    Work o;
    o.width = 16;
    o.spp = 6;
    o.max_depth = 200;
    o.outputs = 0;
    o.photon.photons_per_pass = 4096;
    o.photon.initial_radius = 0.3f;
    o.photon.estimator = estimator;
    const Frame whole = frame_of(furnace, o), parts = frame_of(furnace, o), taken = frame_of(furnace, o);
    ASSERT_EQ(submit(whole, o), GPURT_OK) << gpurt_last_error();
    Work part = o;
    part.spp = 2;
    ASSERT_EQ(submit(parts, part), GPURT_OK);
    const std::string path = testing::TempDir() + "/photon_memory.gpurt";
    GPURT_ASSERT_OK(gpurt_frame_save(parts, path.c_str()));
    GPURT_ASSERT_OK(gpurt_frame_load_state(taken, path.c_str()));
    ASSERT_EQ(submit(parts, o), GPURT_OK);
    o.photon = GPURT_PHOTON_SETTINGS_INIT;  // those of the samples
    ASSERT_EQ(submit(taken, o), GPURT_OK);
    const std::vector<float> color = read(whole, o, GPURT_OUTPUT_COLOR);
    EXPECT_EQ(read(parts, o, GPURT_OUTPUT_COLOR), color);
    EXPECT_EQ(read(taken, o, GPURT_OUTPUT_COLOR), color);
    EXPECT_EQ(statistics(taken).photon.estimator, estimator);

    EXPECT_EQ(gpurt_frame_merge(whole, parts), GPURT_ERROR_UNSUPPORTED);
    EXPECT_NE(std::string(gpurt_last_error()).find("MEMORYLESS"), std::string::npos) << gpurt_last_error();
    EXPECT_EQ(gpurt_frame_load_state(whole, path.c_str()), GPURT_ERROR_UNSUPPORTED);
    std::remove(path.c_str());
    EXPECT_EQ(read(whole, o, GPURT_OUTPUT_COLOR), color);

    // 4 sigma of the mean are 1 % here.
    Work more = part;
    more.spp = 16;
    const Frame many = frame_of(furnace, more);
    ASSERT_EQ(submit(many, more), GPURT_OK);
    EXPECT_NEAR(mean(read(many, more, GPURT_OUTPUT_COLOR)), 1, 0.01);

    // Where there is light in part, radii fall to about what it needs.
    more.max_depth = 3;
    more.photon.initial_radius = 0.5f;
    more.spp = 32;
    const Frame spotted = frame_of(spot, more);
    ASSERT_EQ(submit(spotted, more), GPURT_OK);
    const auto image = read(spotted, more, GPURT_OUTPUT_COLOR);
    double off = 0, all = 0;
    for (uint32_t y = 0; y < more.width; ++y) {
      for (uint32_t x = 0; x < more.width; ++x) {
        const double scale = 1.6 / more.width;
        const double exact = SmoothSpot::radiance((x + 0.5) * scale - 0.8, (y + 0.5) * scale - 0.8);
        off += double(image[3 * (size_t(y) * more.width + x)]) - exact;
        all += exact;
      }
    }
    std::printf("estimator %d: bias %.4f of the light after 32 passes\n", int(estimator), off / all);
    EXPECT_LT(std::abs(off / all), 0.05) << "the blur of the first pass is 10 %";
  }
}

}  // namespace
