// Path-traced images have the same bits on every device, in every output, however the work is cut.
//
// The bodies take two devices; without a GPU they compare one CPU thread with all of them.
#include "pictures.h"

namespace gpurt_test {
namespace {

void compare_images(gpurt_device reference, gpurt_device tested, void (*fill)(gpurt_scene),
                    const RenderOptions &options, gpurt_accel accel)
{
  SCOPED_TRACE(accel == GPURT_ACCEL_BVH ? "bvh" : "kdtree");
  const Scene a = make_scene(reference, fill, accel), b = make_scene(tested, fill, accel);
  const Frame expected = make_frame(a, options, all_outputs), whole = make_frame(b, options, all_outputs);
  render(expected, options);
  render(whole, options);
  const std::vector<OutputBits> bits = read_all(expected, options);
  EXPECT_GT(mean(read_color(expected, options)), 0.0);
  expect_same(bits, read_all(whole, options));
  const gpurt_statistics s = statistics(expected), t = statistics(whole);
  EXPECT_EQ(s.num_samples, uint64_t(options.width) * options.height * options.spp);
  EXPECT_EQ(t.num_samples, s.num_samples);
  EXPECT_EQ(t.num_camera_rays, s.num_camera_rays);
  EXPECT_EQ(t.num_bounce_rays, s.num_bounce_rays);
  EXPECT_EQ(t.num_shadow_rays, s.num_shadow_rays);
  EXPECT_EQ(t.num_nonfinite, s.num_nonfinite);
  EXPECT_EQ(t.largest_sample, s.largest_sample);

  // Cut into odd tiles, in two jobs, the second half of the samples on the other device, then merged.
  RenderOptions cut = options;
  cut.tile_size = 13;
  cut.spp = options.spp / 2;
  const uint32_t x = options.width / 3, y = options.height / 2;
  cut.tiles = {{x, 0, options.width, y}, {0, 0, x, options.height}, {x, y, options.width, options.height}};
  const Frame first = make_frame(b, options, all_outputs);
  render(first, cut);
  gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
  desc.width = options.width;
  desc.height = options.height;
  desc.seed = options.seed;
  desc.outputs = all_outputs;
  desc.first_sample = cut.spp;
  Frame second;
  GPURT_ASSERT_OK(gpurt_frame_create(a, &desc, second.out()));
  cut.spp = options.spp - cut.spp;
  render(second, cut);
  GPURT_ASSERT_OK(gpurt_frame_merge(first, second));
  expect_same(bits, read_all(first, options));
}

RenderOptions picture(uint32_t width, uint32_t height, uint32_t spp)
{
  RenderOptions o;
  o.width = width;
  o.height = height;
  o.spp = spp;
  o.seed = 42;
  return o;
}

// No power of two, so that tiles end anywhere.
RenderOptions big_picture()
{
  RenderOptions o = picture(uint32_t(amount(321, 29)), uint32_t(amount(243, 23)), uint32_t(amount(32, 2)));
  o.max_depth = uint32_t(amount(0, 6));
  return o;
}

TEST(CudaImages, OfACornellBoxHaveTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  for (gpurt_accel accel : {GPURT_ACCEL_KDTREE, GPURT_ACCEL_BVH})
    compare_images(make_device(GPURT_DEVICE_CPU), make_device(GPURT_DEVICE_CUDA), fill_cornell_box,
                   big_picture(), accel);
}

TEST(CudaImages, OfEverythingHaveTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  for (gpurt_accel accel : {GPURT_ACCEL_KDTREE, GPURT_ACCEL_BVH})
    compare_images(make_device(GPURT_DEVICE_CPU), make_device(GPURT_DEVICE_CUDA), fill_everything,
                   big_picture(), accel);
}

// Surfaces that blend are met by chance: a function of ray and triangle.
TEST(CudaImages, OfSurfacesThatBlendHaveTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  for (void (*fill)(gpurt_scene) : {fill_veiled_box, fill_veiled_everything}) {
    for (gpurt_accel accel : {GPURT_ACCEL_KDTREE, GPURT_ACCEL_BVH})
      compare_images(make_device(GPURT_DEVICE_CPU), make_device(GPURT_DEVICE_CUDA), fill, big_picture(),
                     accel);
  }
}

// Glass that absorbs along paths and shadow rays, and lamps whose textures are met and drawn.
TEST(CudaImages, OfTintedGlassAndTexturedLampsHaveTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  for (gpurt_accel accel : {GPURT_ACCEL_KDTREE, GPURT_ACCEL_BVH})
    compare_images(make_device(GPURT_DEVICE_CPU), make_device(GPURT_DEVICE_CUDA), fill_tinted_box,
                   big_picture(), accel);
}

// Waves must shrink until they fit; the image may not change.
TEST(CudaImages, AreTheSameInLittleMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const uint32_t side = uint32_t(amount(128, 64));
  const RenderOptions options = picture(side, side, uint32_t(amount(16, 2)));
  const Device roomy = make_device(GPURT_DEVICE_CUDA),
               tight = make_device(GPURT_DEVICE_CUDA, 0, uint64_t(24) << 20);
  const Scene a = make_scene(roomy, fill_cornell_box), b = make_scene(tight, fill_cornell_box);
  const Frame expected = make_frame(a, options, all_outputs), tested = make_frame(b, options, all_outputs);
  render(expected, options);
  render(tested, options);
  expect_same(read_all(expected, options), read_all(tested, options));
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  GPURT_ASSERT_OK(gpurt_device_get_properties(tight, &properties));
  EXPECT_LE(properties.memory_peak_bytes, uint64_t(24) << 20);
}

TEST(CudaImages, StopSoonWhenCancelled)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  const Scene scene = make_scene(device, fill_cornell_box);
  RenderOptions options = picture(1024, 1024, 1 << 20);
  const Frame frame = make_frame(scene, options, all_outputs);
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.samples_per_pixel = options.spp;
  Job job;
  GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
  EXPECT_EQ(gpurt_job_wait(job, 1'000'000'000), GPURT_ERROR_TIMEOUT);
  GPURT_ASSERT_OK(gpurt_job_cancel(job));
  // What gpurt_job_cancel promises.
  EXPECT_EQ(gpurt_job_wait(job, 500'000'000), GPURT_ERROR_CANCELLED) << gpurt_last_error();
  EXPECT_GT(statistics(frame).num_samples, 0u);
}

// Tests of two devices: scripts/gpu expects them where there are two.
TEST(CudaPair, RendersTheBitsOfOneDevice)
{
  if (num_cuda_devices() < 2) GTEST_SKIP() << "no two CUDA devices";
  for (gpurt_accel accel : {GPURT_ACCEL_KDTREE, GPURT_ACCEL_BVH}) {
    for (void (*fill)(gpurt_scene) : {fill_cornell_box, fill_everything, fill_veiled_everything})
      compare_images(make_device(GPURT_DEVICE_CUDA), make_cuda_devices({0, 1}), fill, big_picture(), accel);
  }
}

// Enough work for every part of the queue to be large, with the devices in another order.
TEST(CudaPair, RendersALargePictureToTheBitsOfOneDevice)
{
  if (num_cuda_devices() < 2) GTEST_SKIP() << "no two CUDA devices";
  const RenderOptions options = picture(uint32_t(amount(1280, 160)), uint32_t(amount(720, 90)), 64);
  const Device one = make_device(GPURT_DEVICE_CUDA), two = make_cuda_devices({1, 0});
  const Scene a = make_scene(one, fill_everything), b = make_scene(two, fill_everything);
  const Frame expected = make_frame(a, options, all_outputs), tested = make_frame(b, options, all_outputs);
  render(expected, options);
  render(tested, options);
  expect_same(read_all(expected, options), read_all(tested, options));
}

TEST(CudaPair, RendersInLittleMemory)
{
  if (num_cuda_devices() < 2) GTEST_SKIP() << "no two CUDA devices";
  const RenderOptions options = picture(128, 128, 16);
  const Device roomy = make_device(GPURT_DEVICE_CUDA), tight = make_cuda_devices({0, 1}, uint64_t(24) << 20);
  const Scene a = make_scene(roomy, fill_cornell_box), b = make_scene(tight, fill_cornell_box);
  const Frame expected = make_frame(a, options, all_outputs), tested = make_frame(b, options, all_outputs);
  render(expected, options);
  render(tested, options);
  expect_same(read_all(expected, options), read_all(tested, options));
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  GPURT_ASSERT_OK(gpurt_device_get_properties(tight, &properties));
  EXPECT_EQ(properties.memory_limit_bytes, uint64_t(48) << 20);
  EXPECT_LE(properties.memory_peak_bytes, uint64_t(48) << 20);
  EXPECT_GT(properties.memory_used_bytes, 0u);
}

TEST(CudaPair, StopsSoonWhenCancelled)
{
  if (num_cuda_devices() < 2) GTEST_SKIP() << "no two CUDA devices";
  const Device device = make_cuda_devices({0, 1});
  const Scene scene = make_scene(device, fill_cornell_box);
  const RenderOptions options = picture(1024, 1024, 1 << 20);
  const Frame frame = make_frame(scene, options, all_outputs);
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.samples_per_pixel = options.spp;
  Job job;
  GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
  EXPECT_EQ(gpurt_job_wait(job, 1'000'000'000), GPURT_ERROR_TIMEOUT);
  GPURT_ASSERT_OK(gpurt_job_cancel(job));
  EXPECT_EQ(gpurt_job_wait(job, 500'000'000), GPURT_ERROR_CANCELLED) << gpurt_last_error();
  EXPECT_GT(statistics(frame).num_samples, 0u);
}

TEST(Images, OfACornellBoxDoNotDependOnTheNumberOfThreads)
{
  for (gpurt_accel accel : {GPURT_ACCEL_KDTREE, GPURT_ACCEL_BVH})
    compare_images(make_device(GPURT_DEVICE_CPU, 1), make_device(GPURT_DEVICE_CPU, 0), fill_cornell_box,
                   picture(48, 40, 8), accel);
}

TEST(Images, OfEverythingDoNotDependOnTheNumberOfThreads)
{
  for (gpurt_accel accel : {GPURT_ACCEL_KDTREE, GPURT_ACCEL_BVH}) {
    compare_images(make_device(GPURT_DEVICE_CPU, 1), make_device(GPURT_DEVICE_CPU, 0), fill_everything,
                   picture(48, 40, 8), accel);
    compare_images(make_device(GPURT_DEVICE_CPU, 1), make_device(GPURT_DEVICE_CPU, 0), fill_tinted_box,
                   picture(48, 40, 8), accel);
  }
}

TEST(Images, OfSurfacesThatBlendDoNotDependOnTheNumberOfThreads)
{
  compare_images(make_device(GPURT_DEVICE_CPU, 1), make_device(GPURT_DEVICE_CPU, 0), fill_veiled_everything,
                 picture(48, 40, 8), GPURT_ACCEL_BVH);
}

}  // namespace
}  // namespace gpurt_test
