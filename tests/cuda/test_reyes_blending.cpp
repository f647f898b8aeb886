// REYES blends to the same bits on every device, in every output, with rays and without, however the work is cut and however
// little memory there is for fragments.
//
// The bodies take two devices; without a GPU they compare one CPU thread with all of them.
#include "reyes_blending_scenes.h"

namespace gpurt_test {
namespace {

std::vector<ReyesPicture> pictures()
{
  const uint32_t side = uint32_t(amount(110, 24));
  return {reyes_picture(side, side, 9), reyes_picture(side, side, 4, 1.0f, GPURT_REYES_FILTER_AUTO, 1),
          reyes_picture(side, side, 20, 6.0f),
          reyes_picture(side, side, 3, 30.0f, GPURT_REYES_FILTER_GAUSSIAN),
          reyes_picture(side, side, 2, 0.5f, GPURT_REYES_FILTER_MITCHELL)};
}

std::vector<ReyesPicture> unshadowed(std::vector<ReyesPicture> list)
{
  for (ReyesPicture &p : list) p.options.reyes.no_shadows = 1;
  return list;
}

TEST(CudaReyesBlending, OfShellsHasTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device cpu = make_device(GPURT_DEVICE_CPU), cuda = make_device(GPURT_DEVICE_CUDA);
  compare_devices(cpu, cuda, fill_shells, pictures());
  const std::vector<ReyesPicture> all = pictures(),
                                  some = is_short_form() ? std::vector<ReyesPicture>{all[0], all[3]} : all;
  compare_devices(cpu, cuda, fill_shells, unshadowed(some));
  compare_devices(cpu, cuda, fill_bare_shells, unshadowed(some));
  compare_devices(cpu, cuda, fill_bare_shells, {pictures()[0]});
}

TEST(CudaReyesBlending, OfMeshesAndPatchesHasTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device cpu = make_device(GPURT_DEVICE_CPU), cuda = make_device(GPURT_DEVICE_CUDA);
  compare_devices(cpu, cuda, fill_shells_and_meshes, pictures());
  compare_devices(cpu, cuda, fill_shells_and_meshes, unshadowed({pictures()[0]}));
  ReyesPicture flat = pictures()[0];
  flat.options.reyes.flatness = 0.4f;
  ReyesPicture large = pictures()[0];
  large.options.reyes.shading_rate = 100;
  compare_devices(cpu, cuda, fill_shells_and_meshes, {flat, large});
}

// Textures, holes, lamps that blend, instances.
TEST(CudaReyesBlending, OfEverythingHasTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device cpu = make_device(GPURT_DEVICE_CPU), cuda = make_device(GPURT_DEVICE_CUDA);
  std::vector<ReyesPicture> list = pictures();
  for (ReyesPicture &p : list) p.camera = 0;
  compare_devices(cpu, cuda, fill_veiled_everything, list);
  compare_devices(cpu, cuda, fill_veiled_box, {pictures()[0]});
}

// Parts of the samples take turns.
TEST(CudaReyesBlending, IsTheSameInLittleMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const uint32_t side = uint32_t(amount(24, 12));
  ReyesPicture p = reyes_picture(side, side, 9);
  const bool is_short = is_short_form();
  const std::vector<uint64_t> kibibytes =
      is_short ? std::vector<uint64_t>{8192, 2048, 512}
               : std::vector<uint64_t>{32768, 8192, 3072, 2048, 1536, 1024, 512};
  const auto fill_many = is_short ? fill_sheets<60, 10> : fill_sheets<300, 10>;
  for (const bool has_shadows : {false, true}) {
    if (is_short && !has_shadows) continue;
    p.options.reyes.no_shadows = has_shadows ? 0 : 1;
    const Scene cpu = scene_of(make_device(GPURT_DEVICE_CPU), fill_many);
    EXPECT_LT(shrink_memory(fill_many, p, bits_of(cpu, p), 0, kibibytes), uint64_t(4) << 20);
  }
  const Scene cpu = scene_of(make_device(GPURT_DEVICE_CPU), fill_shells_and_meshes);
  EXPECT_LT(shrink_memory(fill_shells_and_meshes, p, bits_of(cpu, p), 0, kibibytes), uint64_t(4) << 20);
}

TEST(CudaReyesBlending, IsTheSameEveryTime)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  const Scene scene = scene_of(device, fill_shells_and_meshes);
  const ReyesPicture p = reyes_picture(100, 100, 9);
  const std::vector<OutputBits> bits = bits_of(scene, p);
  for (uint64_t i = 0; i < amount(10, 2); ++i) expect_same(bits, bits_of(scene, p));
}

TEST(CudaReyesBlending, StopsSoonWhenCancelled)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  const Scene scene = scene_of(device, fill_shells_and_meshes);
  const ReyesPicture p = reyes_picture(1024, 1024, 1 << 20);
  const Frame frame = frame_of(scene, p);
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.pipeline = GPURT_PIPELINE_REYES;
  desc.samples_per_pixel = p.options.spp;
  Job job;
  GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
  EXPECT_EQ(gpurt_job_wait(job, 1'000'000'000), GPURT_ERROR_TIMEOUT);
  GPURT_ASSERT_OK(gpurt_job_cancel(job));
  EXPECT_EQ(gpurt_job_wait(job, 500'000'000), GPURT_ERROR_CANCELLED) << gpurt_last_error();
}

TEST(ReyesBlending, DoesNotDependOnTheNumberOfThreads)
{
  const Device one = make_device(GPURT_DEVICE_CPU, 1), all = make_device(GPURT_DEVICE_CPU, 0);
  compare_devices(one, all, fill_shells_and_meshes, {reyes_picture(40, 40, 4)});
  compare_devices(one, all, fill_sheets<300, 10>, {reyes_picture(12, 12, 4)});
}

}  // namespace
}  // namespace gpurt_test
