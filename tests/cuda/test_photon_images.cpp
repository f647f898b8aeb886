// Images by photon mapping have the same bits on a CUDA device as on the CPU, in every output, however the work is cut.
//
// The bodies take two devices; without a GPU they compare one CPU thread with all of them.
#include "pictures.h"

namespace gpurt_test {
namespace {

struct Pass {
  uint32_t width, height, spp;
  gpurt_photon_settings photon = GPURT_PHOTON_SETTINGS_INIT;
  uint32_t max_depth = 0, tile_size = 0;
  std::vector<gpurt_tile> tiles = {};
  uint32_t outputs = all_outputs | error_outputs;

  RenderOptions size() const
  {
    RenderOptions o;
    o.width = width;
    o.height = height;
    return o;
  }
};

Frame frame_of(gpurt_scene scene, const Pass &o, uint64_t first_sample = 0)
{
  gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
  desc.width = o.width;
  desc.height = o.height;
  desc.seed = 42;
  desc.outputs = o.outputs;
  desc.first_sample = first_sample;
  Frame frame;
  GPURT_EXPECT_OK(gpurt_frame_create(scene, &desc, frame.out()));
  return frame;
}

gpurt_result submit(gpurt_frame frame, const Pass &o, gpurt_job *job)
{
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.pipeline = GPURT_PIPELINE_PHOTON;
  desc.samples_per_pixel = o.spp;
  desc.max_depth = o.max_depth;
  desc.tile_size = o.tile_size;
  desc.photon = o.photon;
  return gpurt_frame_submit(frame, &desc, o.tiles.empty() ? nullptr : o.tiles.data(), o.tiles.size(), job);
}

void render_passes(gpurt_frame frame, const Pass &o)
{
  Job job;
  GPURT_ASSERT_OK(submit(frame, o, job.out()));
  GPURT_ASSERT_OK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
}

// Passes enough for a device that takes several at once; a size that is no multiple of tiles.
// The radius of the short form is none that a pilot finds, which would trace more photons than all passes.
Pass picture()
{
  Pass o{uint32_t(amount(161, 29)), uint32_t(amount(123, 23)), uint32_t(amount(12, 2))};
  o.max_depth = uint32_t(amount(0, 5));
  o.photon.photons_per_pass = uint32_t(amount(0, 3000));
  o.photon.initial_radius = is_short_form() ? 0.1f : 0.0f;
  return o;
}

void compare_passes(gpurt_device reference, gpurt_device tested, void (*fill)(gpurt_scene), const Pass &o,
                    gpurt_accel accel)
{
  SCOPED_TRACE(accel == GPURT_ACCEL_BVH ? "bvh" : "kdtree");
  const Scene a = make_scene(reference, fill, accel), b = make_scene(tested, fill, accel);
  const Frame expected = frame_of(a, o), whole = frame_of(b, o);
  render_passes(expected, o);
  render_passes(whole, o);
  const std::vector<OutputBits> bits = read_all(expected, o.size(), o.outputs);
  EXPECT_GT(mean(read_color(expected, o.size())), 0.0);
  expect_same(bits, read_all(whole, o.size(), o.outputs));
  const gpurt_statistics s = statistics(expected), t = statistics(whole);
  EXPECT_EQ(t.num_samples, s.num_samples);
  EXPECT_EQ(t.num_camera_rays, s.num_camera_rays);
  EXPECT_EQ(t.num_bounce_rays, s.num_bounce_rays);
  EXPECT_EQ(t.num_shadow_rays, s.num_shadow_rays);
  EXPECT_EQ(t.num_nonfinite, s.num_nonfinite);
  EXPECT_EQ(t.largest_sample, s.largest_sample);
  EXPECT_EQ(t.estimated_error, s.estimated_error);
  EXPECT_EQ(t.estimated_bias, s.estimated_bias);
  EXPECT_EQ(t.photon.initial_radius, s.photon.initial_radius);  // of the pilot
  EXPECT_EQ(t.photon_counters.num_emitted, s.photon_counters.num_emitted);
  EXPECT_EQ(t.photon_counters.num_rays, s.photon_counters.num_rays);
  EXPECT_EQ(t.photon_counters.num_stored, s.photon_counters.num_stored);
  EXPECT_EQ(t.photon_counters.num_gathered, s.photon_counters.num_gathered);
  EXPECT_EQ(t.photon_counters.num_visible, s.photon_counters.num_visible);
  EXPECT_EQ(t.photon_counters.smallest_radius, s.photon_counters.smallest_radius);
  EXPECT_GT(s.photon_counters.num_gathered, 0u);

  // Cut into odd tiles, half of the samples on the other device, then merged.
  Pass cut = o;
  cut.tile_size = 13;
  cut.spp = o.spp / 2;
  const uint32_t x = o.width / 3, y = o.height / 2;
  cut.tiles = {{x, 0, o.width, y}, {0, 0, x, o.height}, {x, y, o.width, o.height}};
  const Frame first = frame_of(b, o), second = frame_of(a, o, cut.spp);
  render_passes(first, cut);
  cut.spp = o.spp - cut.spp;
  render_passes(second, cut);
  GPURT_ASSERT_OK(gpurt_frame_merge(first, second));
  expect_same(bits, read_all(first, o.size(), o.outputs));
}

// Passes that go on from what the one before left: at once, and in odd tiles, stopped and gone on with.
void compare_estimator(gpurt_device reference, gpurt_device tested, void (*fill)(gpurt_scene),
                       gpurt_photon_estimator estimator)
{
  Pass o = picture();
  o.photon.estimator = estimator;
  if (estimator == GPURT_PHOTON_ESTIMATOR_PER_PIXEL) o.outputs = all_outputs;
  const Scene a = make_scene(reference, fill, GPURT_ACCEL_BVH), b = make_scene(tested, fill, GPURT_ACCEL_BVH);
  const Frame expected = frame_of(a, o), whole = frame_of(b, o), cut = frame_of(b, o);
  render_passes(expected, o);
  render_passes(whole, o);
  EXPECT_GT(mean(read_color(expected, o.size())), 0.0);
  const std::vector<OutputBits> bits = read_all(expected, o.size(), o.outputs);
  expect_same(bits, read_all(whole, o.size(), o.outputs));
  EXPECT_EQ(statistics(whole).estimated_error, statistics(expected).estimated_error);
  Pass part = o;
  part.tile_size = 13;
  part.spp = o.spp / 2;
  const uint32_t x = o.width / 3, y = o.height / 2;
  part.tiles = {{x, 0, o.width, y}, {0, 0, x, o.height}, {x, y, o.width, o.height}};
  render_passes(cut, part);
  part.spp = o.spp;
  render_passes(cut, part);
  expect_same(bits, read_all(cut, o.size(), o.outputs));
}

void compare_all(gpurt_device reference, gpurt_device tested, void (*fill)(gpurt_scene))
{
  for (gpurt_accel accel : {GPURT_ACCEL_KDTREE, GPURT_ACCEL_BVH}) {
    Pass o = picture();
    if (accel == GPURT_ACCEL_BVH) o.photon.initial_radius = 0;  // of the pilot
    compare_passes(reference, tested, fill, o, accel);
  }
  Pass cone = picture();
  cone.photon.kernel = GPURT_PHOTON_KERNEL_CONE;
  cone.photon.photons_per_pass = uint32_t(amount(50000, 3000));
  cone.max_depth = 5;
  cone.spp = uint32_t(amount(3, 2));
  compare_passes(reference, tested, fill, cone, GPURT_ACCEL_BVH);
  cone.photon.remedies = GPURT_PHOTON_REMEDY_NONE;
  compare_passes(reference, tested, fill, cone, GPURT_ACCEL_BVH);
  cone.photon.remedies = uint32_t(GPURT_PHOTON_REMEDY_CONTINUE) | GPURT_PHOTON_REMEDY_BOUNDARY;
  compare_passes(reference, tested, fill, cone, GPURT_ACCEL_KDTREE);
}

TEST(CudaPhotonImages, OfACornellBoxHaveTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  compare_all(make_device(GPURT_DEVICE_CPU), make_device(GPURT_DEVICE_CUDA), fill_cornell_box);
}

TEST(CudaPhotonImages, WithStatisticsOfPixelsHaveTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device cpu = make_device(GPURT_DEVICE_CPU), cuda = make_device(GPURT_DEVICE_CUDA);
  for (gpurt_photon_estimator estimator :
       {GPURT_PHOTON_ESTIMATOR_PER_PIXEL, GPURT_PHOTON_ESTIMATOR_ADAPTIVE}) {
    SCOPED_TRACE(estimator);
    compare_estimator(cpu, cuda, fill_cornell_box, estimator);
    compare_estimator(cpu, cuda, fill_everything, estimator);
  }
}

TEST(CudaPhotonImages, OfSurfacesThatBlendHaveTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device cpu = make_device(GPURT_DEVICE_CPU), cuda = make_device(GPURT_DEVICE_CUDA);
  for (void (*fill)(gpurt_scene) : {fill_veiled_box, fill_veiled_everything}) {
    for (gpurt_accel accel : {GPURT_ACCEL_KDTREE, GPURT_ACCEL_BVH})
      compare_passes(cpu, cuda, fill, picture(), accel);
  }
  compare_estimator(cpu, cuda, fill_veiled_everything, GPURT_PHOTON_ESTIMATOR_PER_PIXEL);
}

// Photons keep the medium that they fly through, and lamps send them by their textures.
TEST(CudaPhotonImages, OfTintedGlassAndTexturedLampsHaveTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device cpu = make_device(GPURT_DEVICE_CPU), cuda = make_device(GPURT_DEVICE_CUDA);
  for (gpurt_accel accel : {GPURT_ACCEL_KDTREE, GPURT_ACCEL_BVH})
    compare_passes(cpu, cuda, fill_tinted_box, picture(), accel);
  compare_estimator(cpu, cuda, fill_tinted_box, GPURT_PHOTON_ESTIMATOR_PER_PIXEL);
}

TEST(CudaPhotonImages, OfEverythingHaveTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  compare_all(make_device(GPURT_DEVICE_CPU), make_device(GPURT_DEVICE_CUDA), fill_everything);
}

// Passes then come in several maps, and paths in several waves.
TEST(CudaPhotonImages, AreTheSameInLittleMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  constexpr uint64_t mib = uint64_t(1) << 20;
  Pass o{uint32_t(amount(128, 64)), 64, uint32_t(amount(6, 1))};
  o.photon.initial_radius = is_short_form() ? 0.03f : 0.0f;
  const bool is_short = is_short_form();
  const Device roomy = make_device(is_short ? GPURT_DEVICE_CPU : GPURT_DEVICE_CUDA);
  const Scene a = make_scene(roomy, fill_cornell_box);
  for (const uint64_t limit : {6 * mib, amount(24, 10) * mib}) {
    // Some 0.87 of those of the short form are stored: more than half of the memory has room for, at 84 bytes each.
    o.photon.photons_per_pass = uint32_t(amount(300000, limit == 6 * mib ? 45000 : 75000));
    o.outputs = limit == 6 * mib ? all_outputs : all_outputs | error_outputs;
    const Frame expected = frame_of(a, o);
    render_passes(expected, o);
    EXPECT_EQ(statistics(expected).photon_counters.num_sub_passes, o.spp);
    const Device tight = make_device(GPURT_DEVICE_CUDA, 0, limit);
    const Scene b = make_scene(tight, fill_cornell_box);
    const Frame tested = frame_of(b, o);
    render_passes(tested, o);
    expect_same(read_all(expected, o.size(), o.outputs), read_all(tested, o.size(), o.outputs));
    EXPECT_GT(statistics(tested).photon_counters.num_sub_passes, o.spp);
    EXPECT_LE(statistics(tested).memory_peak_bytes, limit);
  }
}

TEST(CudaPhotonImages, NameWhatIsTooLargeForTheMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  // Room for the frame, which takes some 800 KB, and not for what passes work on, were it a thousand photons at a time.
  const Device device = make_device(GPURT_DEVICE_CUDA, 0, uint64_t(5) << 18);
  const Scene scene = make_scene(device, fill_cornell_box);
  Pass o{64, 64, 1};
  o.outputs = all_outputs;
  const Frame frame = frame_of(scene, o);
  Job job;
  GPURT_ASSERT_OK(submit(frame, o, job.out()));
  EXPECT_EQ(gpurt_job_wait(job, GPURT_WAIT_FOREVER), GPURT_ERROR_OUT_OF_MEMORY);
  EXPECT_NE(std::string(gpurt_last_error()).find("memory_limit_bytes"), std::string::npos)
      << gpurt_last_error();
}

TEST(CudaPhotonImages, StopSoonWhenCancelled)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  const Scene scene = make_scene(device, fill_cornell_box);
  // A radius of a quarter of the box: a gather takes its time.
  Pass o{1024, 1024, 1 << 20};
  o.photon.photons_per_pass = 1 << 20;
  for (const float radius : {0.0f, 0.25f}) {
    o.photon.initial_radius = radius;
    const Frame frame = frame_of(scene, o);
    Job job;
    GPURT_ASSERT_OK(submit(frame, o, job.out()));
    EXPECT_EQ(gpurt_job_wait(job, 1'000'000'000), GPURT_ERROR_TIMEOUT);
    GPURT_ASSERT_OK(gpurt_job_cancel(job));
    // What gpurt_job_cancel promises.
    EXPECT_EQ(gpurt_job_wait(job, 500'000'000), GPURT_ERROR_CANCELLED) << gpurt_last_error();
  }
}

TEST(CudaPhotonImages, RefuseSchedulesOfPathTracing)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  const Scene scene = make_scene(device, fill_cornell_box, GPURT_ACCEL_BVH);
  const Frame frame = frame_of(scene, {16, 16, 1});
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.pipeline = GPURT_PIPELINE_PHOTON;
  desc.schedule.shading = GPURT_SHADING_SORTED;
  Job job;
  EXPECT_EQ(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()), GPURT_ERROR_UNSUPPORTED);
  EXPECT_NE(std::string(gpurt_last_error()).find("photon mapping"), std::string::npos) << gpurt_last_error();
}

// Tests of two devices: scripts/gpu expects them where there are two.
TEST(CudaPair, SharesOutPassesOfPhotonMapping)
{
  if (num_cuda_devices() < 2) GTEST_SKIP() << "no two CUDA devices";
  for (void (*fill)(gpurt_scene) : {fill_cornell_box, fill_everything}) {
    compare_passes(make_device(GPURT_DEVICE_CUDA), make_cuda_devices({0, 1}), fill, picture(),
                   GPURT_ACCEL_BVH);
  }
}

TEST(CudaPair, RefusesStatisticsOfPixels)
{
  if (num_cuda_devices() < 2) GTEST_SKIP() << "no two CUDA devices";
  const Device device = make_cuda_devices({0, 1});
  const Scene scene = make_scene(device, fill_cornell_box);
  Pass o{16, 16, 1};
  o.photon.estimator = GPURT_PHOTON_ESTIMATOR_ADAPTIVE;
  const Frame frame = frame_of(scene, o);
  Job job;
  EXPECT_EQ(submit(frame, o, job.out()), GPURT_ERROR_UNSUPPORTED);
  EXPECT_NE(std::string(gpurt_last_error()).find("several devices"), std::string::npos) << gpurt_last_error();
}

TEST(PhotonImages, DoNotDependOnTheNumberOfThreads)
{
  Pass o{45, 33, 4};
  for (void (*fill)(gpurt_scene) : {fill_cornell_box, fill_everything, fill_tinted_box}) {
    compare_passes(make_device(GPURT_DEVICE_CPU, 1), make_device(GPURT_DEVICE_CPU, 0), fill, o,
                   GPURT_ACCEL_BVH);
  }
  for (gpurt_photon_estimator estimator :
       {GPURT_PHOTON_ESTIMATOR_PER_PIXEL, GPURT_PHOTON_ESTIMATOR_ADAPTIVE}) {
    compare_estimator(make_device(GPURT_DEVICE_CPU, 1), make_device(GPURT_DEVICE_CPU, 0), fill_everything,
                      estimator);
  }
}

}  // namespace
}  // namespace gpurt_test
