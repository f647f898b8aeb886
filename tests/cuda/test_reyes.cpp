// REYES has the same bits on every device, in every output, however the work is cut and however little memory there is.
//
// The bodies take two devices; without a GPU they compare one CPU thread with all of them.
#include <filesystem>

#include "kernel_launches.h"
#include "reyes_pictures.h"

namespace gpurt_test {
namespace {

// A closed surface, seen from within and from outside, with every patch twice: ties everywhere.
void fill_closed(gpurt_scene scene)
{
  std::vector<PatchNet> nets = closed_patches(2, 0.2, 9);
  const std::vector<PatchNet> once = nets;
  nets.insert(nets.end(), once.begin(), once.end());
  add_patches(scene, nets, add_material(scene, GPURT_MATERIAL_LAMBERT, {0.9f, 0.5f, 0.1f}));
  add_patches(scene, once, add_material(scene, GPURT_MATERIAL_LAMBERT, {0.1f, 0.5f, 0.9f}),
              {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, {0.5f, 0, 0, 1.2f, 0, -0.5f, 0, 0, 0, 0, 0.5f, 0}});
  set_environment(scene, 1);
  add_camera(scene, {0.3f, 0.1f, 3}, 1.0f);
  std::mt19937_64 rng(4);
  add_turned_camera(scene, {0.3, 0.1, 0.2}, rng, 1.5f);
  add_turned_camera(scene, {0.5, -0.3, 0.3}, rng, 2.5f);
}

// Patches through the eye, one that lies in it, and a mesh.
void fill_at_the_eye(gpurt_scene scene)
{
  add_patches(scene, {flat_patch({-50, -0.001f, -50}, {100, 0, 0}, {0, 0, 100}),
                      flat_patch({1e-4f, -1, -1}, {0, 2, 0}, {0, 0, 2}),
                      flat_patch({-1, 1e-6f, -3}, {2, 0, 0}, {0, 0, 6}),
                      flat_patch({-1, -1, 0}, {2, 0, 0}, {0, 2, 0})});
  add_mesh(scene, quad({-4, 0.5f, -4}, {-4, 0.5f, 4}, {4, -0.2f, 4}, {4, -0.2f, -4}), 0);
  add_mesh(scene, icosphere(2).map([](std::array<float, 3> v) {
    return std::array<float, 3>{v[0] * 0.3f - 0.5f, v[1] * 0.3f + 0.2f, v[2] * 0.3f - 1.5f};
  }));
  set_environment(scene, 1);
  add_camera(scene, {0, 0, 0}, 1.2f);
}

// A point and a distant light.
void add_lights_without_area(gpurt_scene scene)
{
  for (const gpurt_light_type type : {GPURT_LIGHT_POINT, GPURT_LIGHT_DISTANT}) {
    gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
    light.type = type;
    for (float &c : light.intensity) c = type == GPURT_LIGHT_POINT ? 20.0f : 1.0f;
    light.position[0] = light.position[1] = light.position[2] = 2;
    light.direction[0] = 0.5f;
    light.direction[1] = -1;
    uint32_t id;
    GPURT_EXPECT_OK(gpurt_scene_add_light(scene, &light, &id));
  }
}

// Points and a distant light alone: without shadows no ray is needed.
void fill_lit(gpurt_scene scene)
{
  add_patches(scene, closed_patches(2, 0.3, 5),
              add_material(scene, GPURT_MATERIAL_METAL, {0.9f, 0.5f, 0.1f}, {0, 0, 0}, 0.4f));
  add_mesh(scene, icosphere(2).map([](std::array<float, 3> v) {
    return std::array<float, 3>{v[0] * 0.5f - 1.2f, v[1] * 0.5f, v[2] * 0.5f + 0.8f};
  }),
           add_material(scene, GPURT_MATERIAL_GLASS, {1, 1, 1}));
  add_mesh(scene, quad({-4, -1.2f, 4}, {4, -1.2f, 4}, {4, -1.2f, -4}, {-4, -1.2f, -4}), 0);
  add_lights_without_area(scene);
  add_camera(scene, {0, 0.3f, 3.5f}, 1.0f);
}

// Many small patches, so that lists of little room fill up.
void fill_many(gpurt_scene scene)
{
  const std::vector<PatchNet> nets = closed_patches(10, 0.05, 3);
  std::vector<std::array<float, 12>> places;
  for (int i = 0; i < 4; ++i) {
    const float x = 1.5f * float(i % 2) - 0.75f, y = 1.5f * float(i / 2) - 0.75f;
    places.push_back({0.8f, 0, 0, x, 0, 0.8f, 0, y, 0, 0, 0.8f, -0.3f * float(i)});
  }
  add_patches(scene, nets, 0, places);
  set_environment(scene, 1);
  add_camera(scene, {0, 0, 3}, 1.0f);
}

std::vector<ReyesPicture> everything_pictures()
{
  const uint32_t w = uint32_t(amount(160, 48)), h = uint32_t(amount(121, 40));
  return {reyes_picture(w, h, 9), reyes_picture(w, h, 2, 4.0f, GPURT_REYES_FILTER_GAUSSIAN),
          reyes_picture(w, h, 5, 256.0f, GPURT_REYES_FILTER_MITCHELL)};
}

std::vector<ReyesPicture> closed_pictures()
{
  const uint32_t side = uint32_t(amount(128, 40));
  return {reyes_picture(side, side, 9), reyes_picture(side, side, 4, 1.0f, GPURT_REYES_FILTER_AUTO, 1),
          reyes_picture(side, side, 3, 30.0f, GPURT_REYES_FILTER_GAUSSIAN, 2)};
}

TEST(CudaReyes, OfEverythingHasTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  compare_devices(make_device(GPURT_DEVICE_CPU), make_device(GPURT_DEVICE_CUDA), fill_everything,
                  everything_pictures());
}

TEST(CudaReyes, OfCoincidentPatchesHasTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  compare_devices(make_device(GPURT_DEVICE_CPU), make_device(GPURT_DEVICE_CUDA), fill_closed,
                  closed_pictures());
}

std::vector<ReyesPicture> unshadowed_pictures()
{
  const uint32_t side = uint32_t(amount(120, 40));
  std::vector<ReyesPicture> pictures = {reyes_picture(side, side, 9),
                                        reyes_picture(side, side, 4, 1.0f, GPURT_REYES_FILTER_MITCHELL)};
  for (ReyesPicture &p : pictures) p.options.reyes.no_shadows = 1;
  return pictures;
}

TEST(CudaReyes, OfUnshadowedLightHasTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device cpu = make_device(GPURT_DEVICE_CPU), cuda = make_device(GPURT_DEVICE_CUDA);
  compare_devices(cpu, cuda, fill_lit, unshadowed_pictures());
  compare_devices(cpu, cuda, fill_everything, {unshadowed_pictures()[0]});
  compare_devices(cpu, cuda, fill_tinted_box, {unshadowed_pictures()[0], everything_pictures()[0]});
}

// Light of micropolygons: of their own alone, so in frames of few outputs.
std::vector<float> own_light(gpurt_scene scene, const ReyesPicture &p)
{
  gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
  desc.width = p.options.width;
  desc.height = p.options.height;
  desc.seed = p.options.seed;
  desc.outputs = 1u << GPURT_OUTPUT_COLOR | 1u << GPURT_OUTPUT_ALPHA | 1u << GPURT_OUTPUT_VARIANCE;
  Frame frame;
  GPURT_EXPECT_OK(gpurt_frame_create(scene, &desc, frame.out()));
  render(frame, p.options);
  std::vector<float> values(size_t(desc.width) * desc.height * 7);
  const size_t n = size_t(desc.width) * desc.height * sizeof(float);
  GPURT_EXPECT_OK(gpurt_frame_read(frame, GPURT_OUTPUT_COLOR, values.data(), 3 * n));
  GPURT_EXPECT_OK(gpurt_frame_read(frame, GPURT_OUTPUT_VARIANCE, values.data() + 3 * (n / 4), 3 * n));
  GPURT_EXPECT_OK(gpurt_frame_read(frame, GPURT_OUTPUT_ALPHA, values.data() + 6 * (n / 4), n));
  return values;
}

std::vector<ReyesPicture> own_light_pictures()
{
  const uint32_t side = uint32_t(amount(150, 40));
  std::vector<ReyesPicture> pictures = {reyes_picture(side, side, 9),
                                        reyes_picture(side, side, 5, 1.0f, GPURT_REYES_FILTER_MITCHELL),
                                        reyes_picture(side, side, 16, 2.0f), reyes_picture(side, side, 20),
                                        reyes_picture(side, side, 9, 60.0f)};
  for (ReyesPicture &p : pictures) {
    p.options.reyes.no_shadows = 1;
    p.options.reyes.shading = GPURT_REYES_SHADING_MICROPOLYGONS;
  }
  pictures.push_back(pictures[0]);
  pictures.back().options.reyes.shading = GPURT_REYES_SHADING_BLOCKS;
  return pictures;
}

// Dented metal, patches that coincide in two colours, and one through the eye.
void fill_own_light(gpurt_scene scene)
{
  const std::vector<PatchNet> nets = closed_patches(3, 0.3, 5);
  add_patches(scene, nets, add_material(scene, GPURT_MATERIAL_METAL, {0.9f, 0.5f, 0.1f}, {0, 0, 0}, 0.4f),
              {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, {0.5f, 0, 0, 1.2f, 0, -0.5f, 0, 0, 0, 0, 0.5f, 0}});
  const uint32_t blue = add_material(scene, GPURT_MATERIAL_LAMBERT, {0.1f, 0.5f, 0.9f});
  add_patches(scene, {flat_patch({-50, -1.1f, -50}, {100, 0, 0}, {0, 0, 100})}, blue);
  add_patches(scene, {flat_patch({-50, -1.1f, -50}, {0, 0, 100}, {100, 0, 0})});
  add_lights_without_area(scene);
  add_camera(scene, {0, 0.3f, 3.5f}, 1.0f);
}

void compare_own_light(gpurt_scene expected, gpurt_scene tested, ReyesPicture p)
{
  SCOPED_TRACE(testing::Message() << p.options.spp << " samples, shading rate "
                                  << p.options.reyes.shading_rate << ", filter " << p.options.reyes.filter);
  const std::vector<float> values = own_light(expected, p);
  const auto differ = [&] {
    const std::vector<float> others = own_light(tested, p);
    size_t n = 0;
    for (size_t i = 0; i < values.size(); ++i) n += std::memcmp(&values[i], &others[i], sizeof(float)) != 0;
    return n;
  };
  EXPECT_EQ(differ(), 0u) << "of " << values.size() << " numbers";
  p.options.tile_size = 29;
  EXPECT_EQ(differ(), 0u) << "of " << values.size() << " numbers, in tiles";
}

TEST(CudaReyes, OfMicropolygonsOwnLightHasTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Scene a = scene_of(make_device(GPURT_DEVICE_CPU), fill_own_light),
              b = scene_of(make_device(GPURT_DEVICE_CUDA), fill_own_light);
  for (const ReyesPicture &p : own_light_pictures()) compare_own_light(a, b, p);
}

// A patch so close to the eye that what is diced of it cannot all be projected.
void fill_own_light_at_the_eye(gpurt_scene scene)
{
  add_patches(scene, {flat_patch({-50, -1e-4f, -50}, {100, 0, 0}, {0, 0, 100})},
              add_material(scene, GPURT_MATERIAL_LAMBERT, {0.1f, 0.5f, 0.9f}));
  add_lights_without_area(scene);
  add_camera(scene, {0, 0, 0}, 1.0f);
}

// Light is added up before it is known whether micropolygons were left to the general kernels, and again if so.
TEST(CudaReyes, AddsOwnLightUpAgainWhereMicropolygonsWereLeft)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device cuda = make_device(GPURT_DEVICE_CUDA);
  const std::string rest = "REYES stages 'dice' and 'sample', any micropolygons",
                    sums = "REYES stage 'resolve' of micropolygons' own light, pixels";
  const ReyesPicture p = own_light_pictures()[0];
  for (void (*fill)(gpurt_scene) : {fill_own_light, fill_own_light_at_the_eye}) {
    const bool leaves = fill == fill_own_light_at_the_eye;
    const Scene a = scene_of(make_device(GPURT_DEVICE_CPU), fill), b = scene_of(cuda, fill);
    const uint64_t rest_before = launches_of(cuda, rest), sums_before = launches_of(cuda, sums);
    own_light(b, p);
    EXPECT_EQ(launches_of(cuda, rest) - rest_before, leaves ? 1u : 0u);
    EXPECT_EQ(launches_of(cuda, sums) - sums_before, leaves ? 2u : 1u);
    compare_own_light(a, b, p);
  }
}

TEST(Reyes, OfMicropolygonsOwnLightDoesNotDependOnTheNumberOfThreads)
{
  const Scene a = scene_of(make_device(GPURT_DEVICE_CPU, 1), fill_own_light),
              b = scene_of(make_device(GPURT_DEVICE_CPU, 0), fill_own_light);
  compare_own_light(a, b, own_light_pictures()[0]);
}

TEST(CudaReyes, AtTheEyeHasTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const uint32_t side = uint32_t(amount(100, 32));
  compare_devices(make_device(GPURT_DEVICE_CPU), make_device(GPURT_DEVICE_CUDA), fill_at_the_eye,
                  {reyes_picture(side, side, 9), reyes_picture(side, side, 4, 64.0f)});
}

// Flat regions diced coarser, and triangles of every size, in front of the eye and through it.
std::vector<ReyesPicture> flat_pictures(uint32_t num_cameras)
{
  std::vector<ReyesPicture> pictures;
  const uint32_t side = uint32_t(amount(150, 28));
  for (const float flatness : {0.05f, 0.25f, 0.95f, 10.0f}) {
    pictures.push_back(
        reyes_picture(side, side, 9, 0, GPURT_REYES_FILTER_AUTO, uint32_t(pictures.size()) % num_cameras));
    pictures.back().options.reyes.flatness = flatness;
  }
  pictures.push_back(reyes_picture(side, side, 3, 2.0f, GPURT_REYES_FILTER_GAUSSIAN));
  pictures.back().options.reyes.flatness = 0.5f;
  for (const float rate : {16.0f, 64.0f, 256.0f}) {
    pictures.push_back(reyes_picture(side, side, 9, rate));
    pictures.back().options.reyes.flatness = 0.5f;
  }
  return pictures;
}

// Of a scene after the first one: in the short form a little, a very flat one and one of large micropolygons.
std::vector<ReyesPicture> other_flat_pictures()
{
  const std::vector<ReyesPicture> all = flat_pictures(1);
  return is_short_form() ? std::vector<ReyesPicture>{all[0], all[3], all[6]} : all;
}

TEST(CudaReyes, OfFlatRegionsHasTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device cpu = make_device(GPURT_DEVICE_CPU), cuda = make_device(GPURT_DEVICE_CUDA);
  compare_devices(cpu, cuda, fill_closed, flat_pictures(3));
  compare_devices(cpu, cuda, fill_at_the_eye, other_flat_pictures());
  compare_devices(cpu, cuda, fill_lit, other_flat_pictures());
  const Scene a = scene_of(cpu, fill_own_light), b = scene_of(cuda, fill_own_light);
  ReyesPicture p = own_light_pictures()[0];
  for (const float flatness : {0.1f, 0.9f}) {
    p.options.reyes.flatness = flatness;
    compare_own_light(a, b, p);
  }
}

// Rows 47 and 49 of the catalogue: batches, lists that are full, small groups.
TEST(CudaReyes, IsTheSameInLittleMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const uint32_t side = uint32_t(amount(200, 100));
  const ReyesPicture p = reyes_picture(side, side, 9);
  const Device roomy = make_device(GPURT_DEVICE_CUDA);
  const Scene a = scene_of(roomy, fill_many);
  gpurt_statistics s = GPURT_STATISTICS_INIT;
  const std::vector<OutputBits> bits = bits_of(a, p, &s);
  for (const uint64_t mebibytes : {96, 48, 24}) {
    SCOPED_TRACE(mebibytes);
    const Device tight = make_device(GPURT_DEVICE_CUDA, 0, mebibytes << 20);
    const Scene b = scene_of(tight, fill_many);
    gpurt_statistics t = GPURT_STATISTICS_INIT;
    expect_same(bits, bits_of(b, p, &t));
    std::printf("%llu MiB: %llu primitives a batch, %llu grids, %llu bytes\n", (unsigned long long)mebibytes,
                (unsigned long long)t.reyes_counters.largest_bucket,
                (unsigned long long)t.reyes_counters.num_grids,
                (unsigned long long)t.reyes_counters.working_bytes);
    gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
    GPURT_ASSERT_OK(gpurt_device_get_properties(tight, &properties));
    EXPECT_LE(properties.memory_peak_bytes, mebibytes << 20);
  }
}

// Lists of large triangles and of micropolygons of some pixels that are full: from as little memory as there is an image in.
TEST(CudaReyes, OfLargeMicropolygonsIsTheSameInLittleMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const uint32_t side = uint32_t(amount(200, 64));
  const Scene a = scene_of(make_device(GPURT_DEVICE_CUDA), fill_at_the_eye);
  for (const auto &[filter, rate] :
       {std::pair{GPURT_REYES_FILTER_BOX, 150.0f}, {GPURT_REYES_FILTER_GAUSSIAN, 16.0f}}) {
    const ReyesPicture p = reyes_picture(side, side, 9, rate, filter);
    const std::vector<OutputBits> bits = bits_of(a, p);
    int num_images = 0;
    // The film alone takes 7.5, or 0.8 in the short form.
    for (uint64_t mebibytes = amount(8, 4); mebibytes <= 64 && num_images < 2; ++mebibytes) {
      SCOPED_TRACE(mebibytes);
      const Scene b = scene_of(make_device(GPURT_DEVICE_CUDA, 0, mebibytes << 20), fill_at_the_eye);
      gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
      desc.pipeline = GPURT_PIPELINE_REYES;
      desc.samples_per_pixel = p.options.spp;
      desc.max_depth = p.options.max_depth;
      desc.reyes = p.options.reyes;
      const Frame frame = frame_of(b, p);
      Job job;
      GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
      const gpurt_result result = gpurt_job_wait(job, GPURT_WAIT_FOREVER);
      if (result == GPURT_ERROR_OUT_OF_MEMORY) continue;
      ASSERT_EQ(result, GPURT_OK) << gpurt_last_error();
      expect_same(bits, read_all(frame, p.options));
      std::printf("%llu MiB were enough\n", (unsigned long long)mebibytes);
      ++num_images;
    }
    EXPECT_EQ(num_images, 2);
  }
}

TEST(CudaReyes, IsTheSameEveryTime)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  const Scene scene = scene_of(device, fill_closed);
  const ReyesPicture p = reyes_picture(100, 100, 9);
  const std::vector<OutputBits> bits = bits_of(scene, p);
  for (uint64_t i = 0; i < amount(10, 2); ++i) expect_same(bits, bits_of(scene, p));
}

TEST(CudaReyes, StopsSoonWhenCancelled)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  const Scene scene = scene_of(device, fill_closed);
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
  EXPECT_GT(statistics(frame).num_samples, 0u);
}

TEST(CudaReyes, RefusesSchedulesWithEyeRays)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  const Scene scene = scene_of(device, fill_many);
  const Frame frame = frame_of(scene, reyes_picture(32, 32, 4));
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.pipeline = GPURT_PIPELINE_REYES;
  desc.schedule.generation = GPURT_GENERATION_REFILLED;
  Job job;
  EXPECT_EQ(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()), GPURT_ERROR_UNSUPPORTED);
}

// The scenes beside the checkout, where they are there.
class CudaReyesScenes : public testing::TestWithParam<const char *> {};
INSTANTIATE_TEST_SUITE_P(Files, CudaReyesScenes,
                         testing::Values("teapot_patches", "killeroo_patches", "bigguy_patches",
                                         "eye_split_patches", "eye_split_tunnel_patches", "killeroo_tess",
                                         "cornell"),
                         [](const auto &info) { return std::string(info.param); });

TEST_P(CudaReyesScenes, HaveTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const char *folder = std::getenv("GPURT_TEST_SCENES");
  const std::filesystem::path path = std::filesystem::path(folder != nullptr ? folder : "../shared/scenes") /
                                     (std::string(GetParam()) + ".glb");
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is not there";
  const Device cpu = make_device(GPURT_DEVICE_CPU), cuda = make_device(GPURT_DEVICE_CUDA);
  Scene a, b;
  GPURT_ASSERT_OK(gpurt_scene_load(cpu, path.c_str(), a.out()));
  GPURT_ASSERT_OK(gpurt_scene_load(cuda, path.c_str(), b.out()));
  commit(a, GPURT_ACCEL_BVH);
  commit(b, GPURT_ACCEL_BVH);
  ReyesPicture p = reyes_picture(uint32_t(amount(256, 64)), uint32_t(amount(192, 48)), 9);
  compare(a, b, p);
  p.options.reyes.no_shadows = 1;
  compare(a, b, p);
  p.options.reyes.flatness = 0.25f;
  compare(a, b, p);
  p.options.reyes.flatness = 0;
  const std::string name = GetParam();
  if (name != "killeroo_patches" && name != "bigguy_patches") return;
  p.options.reyes.shading = GPURT_REYES_SHADING_MICROPOLYGONS;
  compare_own_light(a, b, p);
}

TEST(Reyes, OfEverythingDoesNotDependOnTheNumberOfThreads)
{
  compare_devices(make_device(GPURT_DEVICE_CPU, 1), make_device(GPURT_DEVICE_CPU, 0), fill_everything,
                  {reyes_picture(48, 40, 9)});
}

TEST(Reyes, OfCoincidentPatchesDoesNotDependOnTheNumberOfThreads)
{
  compare_devices(
      make_device(GPURT_DEVICE_CPU, 1), make_device(GPURT_DEVICE_CPU, 0), fill_closed,
      {reyes_picture(48, 40, 9), reyes_picture(40, 40, 4, 30.0f, GPURT_REYES_FILTER_GAUSSIAN, 2)});
}

TEST(Reyes, OfUnshadowedLightDoesNotDependOnTheNumberOfThreads)
{
  compare_devices(make_device(GPURT_DEVICE_CPU, 1), make_device(GPURT_DEVICE_CPU, 0), fill_lit,
                  {unshadowed_pictures()[0]});
}

TEST(Reyes, AtTheEyeDoesNotDependOnTheNumberOfThreads)
{
  compare_devices(make_device(GPURT_DEVICE_CPU, 1), make_device(GPURT_DEVICE_CPU, 0), fill_at_the_eye,
                  {reyes_picture(48, 40, 9)});
}

// Tests of two devices: scripts/gpu expects them where there are two.
TEST(CudaPair, RendersReyesToTheBitsOfOneDevice)
{
  if (num_cuda_devices() < 2) GTEST_SKIP() << "no two CUDA devices";
  const Device one = make_device(GPURT_DEVICE_CUDA), two = make_cuda_devices({1, 0});
  const uint32_t width = uint32_t(amount(1280, 160)), height = uint32_t(amount(720, 90));
  ReyesPicture with_light = reyes_picture(width, height, 4),
               with_slots = reyes_picture(width, height, 9, 1.0f);
  with_light.options.reyes.no_shadows = 1;
  with_slots.options.reyes.fragment_slots = 2;
  for (void (*fill)(gpurt_scene) : {fill_cornell_box, fill_everything, fill_veiled_everything})
    compare_devices(one, two, fill, {with_light, with_slots, reyes_picture(width, height, 2)});
}

}  // namespace
}  // namespace gpurt_test
