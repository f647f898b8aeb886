// Jobs of photon mapping that render for a time choose their photons and radius by trial passes, and say what they chose.
#include <cstring>

#include "../support/gpurt_test.h"

namespace {

using namespace gpurt_test;

constexpr uint32_t side = 8, few_photons = 64;

Mesh room()
{
  Mesh m = quad({-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1});
  m.append(quad({-1, -1, 1}, {1, -1, 1}, {1, -1, -1}, {-1, -1, -1}));
  m.append(quad({-1, -1, 1}, {-1, -1, -1}, {-1, 1, -1}, {-1, 1, 1}));
  return m;
}

class PhotonTrials : public testing::TestWithParam<gpurt_device_type> {
 protected:
  void SetUp() override
  {
    if (GetParam() == GPURT_DEVICE_CUDA && !has_cuda()) GTEST_SKIP() << "no CUDA device";
    device_ = make_device(GetParam());
    GPURT_ASSERT_OK(gpurt_scene_create(device_, scene_.out()));
    add_mesh(scene_, room(), add_material(scene_, GPURT_MATERIAL_LAMBERT, {0.7f, 0.7f, 0.7f}));
    add_mesh(scene_,
             quad({-0.3f, 0.95f, -0.3f}, {0.3f, 0.95f, -0.3f}, {0.3f, 0.95f, 0.3f}, {-0.3f, 0.95f, 0.3f}),
             add_material(scene_, GPURT_MATERIAL_LAMBERT, {0, 0, 0}, {6, 5, 4}));
    add_camera(scene_, {0, 0, 0.9f}, 1.2f);
    commit(scene_, GPURT_ACCEL_BVH);
  }

  Frame frame() { return make_frame(scene_, {.width = side, .height = side, .seed = 3}); }

  static gpurt_result render(gpurt_frame frame, uint32_t spp, double seconds,
                             const gpurt_photon_settings &photon)
  {
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.pipeline = GPURT_PIPELINE_PHOTON;
    desc.samples_per_pixel = spp;
    desc.max_depth = 3;
    desc.time_limit_s = seconds;
    desc.photon = photon;
    Job job;
    const gpurt_result result = gpurt_frame_submit(frame, &desc, nullptr, 0, job.out());
    return result != GPURT_OK ? result : gpurt_job_wait(job, GPURT_WAIT_FOREVER);
  }

  static gpurt_statistics statistics(gpurt_frame frame)
  {
    gpurt_statistics s = GPURT_STATISTICS_INIT;
    GPURT_EXPECT_OK(gpurt_frame_get_statistics(frame, &s));
    return s;
  }

  static std::vector<float> color_of(gpurt_frame frame)
  {
    RenderOptions o;
    o.width = o.height = side;
    return read_color(frame, o);
  }

  Device device_;
  Scene scene_;
};
INSTANTIATE_TEST_SUITE_P(Cpu, PhotonTrials, testing::Values(GPURT_DEVICE_CPU));
INSTANTIATE_TEST_SUITE_P(Cuda, PhotonTrials, testing::Values(GPURT_DEVICE_CUDA));

// The time is so long that trials fit into it whatever machine this is, and the samples are few.
constexpr double long_time = 1e6;

TEST_P(PhotonTrials, ChooseWhatRendersTheSameBitsWhenAskedFor)
{
  gpurt_photon_settings photon = GPURT_PHOTON_SETTINGS_INIT;
  photon.initial_radius = 0.125f;
  const Frame tried = frame(), usual = frame();
  GPURT_ASSERT_OK(render(tried, 1, long_time, photon));
  GPURT_ASSERT_OK(render(usual, 1, 0, photon));
  const gpurt_statistics s = statistics(tried);
  EXPECT_NE(std::strstr(s.reason, "trial passes"), nullptr) << s.reason;
  EXPECT_EQ(std::strstr(statistics(usual).reason, "trial"), nullptr);
  EXPECT_EQ(s.samples_per_pixel, 1u);
  EXPECT_EQ(s.photon.initial_radius, 0.125f) << "it was asked for";
  // With a pass alone there is no time to save: as many as may be.
  EXPECT_EQ(s.photon.photons_per_pass, 32 * statistics(usual).photon.photons_per_pass);
  EXPECT_EQ(s.photon_counters.num_emitted, s.photon.photons_per_pass) << "trials are not the frame's";
  const Frame same = frame();
  GPURT_ASSERT_OK(render(same, 1, 0, s.photon));
  EXPECT_EQ(color_of(same), color_of(tried));
}

TEST_P(PhotonTrials, LeaveAloneWhatIsAskedFor)
{
  gpurt_photon_settings photon = GPURT_PHOTON_SETTINGS_INIT;
  photon.photons_per_pass = few_photons;
  photon.initial_radius = 0.125f;
  const Frame both = frame();
  GPURT_ASSERT_OK(render(both, 2, long_time, photon));
  EXPECT_EQ(statistics(both).photon.initial_radius, 0.125f);
  EXPECT_EQ(std::strstr(statistics(both).reason, "trial"), nullptr);
  // A frame that goes on has the settings of its samples.
  photon.initial_radius = 0;
  const Frame more = frame();
  GPURT_ASSERT_OK(render(more, 2, 0, photon));
  const float radius = statistics(more).photon.initial_radius;
  GPURT_ASSERT_OK(render(more, 4, long_time, photon));
  EXPECT_EQ(statistics(more).photon.initial_radius, radius);
  EXPECT_EQ(std::strstr(statistics(more).reason, "trial"), nullptr);
}

}  // namespace
