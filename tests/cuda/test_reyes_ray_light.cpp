// Micropolygons' own light that is found after visibility has the same bits on every device, in every output, however the work
// is cut and however little memory there is.
//
// The bodies take two devices; without a GPU they compare one CPU thread with all of them.
#include "reyes_pictures.h"

namespace gpurt_test {
namespace {

// A dented ball, its copy, and a floor through the eye's plane. `has_more`: a mesh, a sheet with holes, a lamp of patches and
// an environment.
void fill_shadowed(gpurt_scene scene, bool has_more)
{
  const std::vector<PatchNet> nets = closed_patches(3, 0.3, 5);
  add_patches(
      scene, nets, add_material(scene, GPURT_MATERIAL_METAL, {0.9f, 0.5f, 0.1f}, {0, 0, 0}, 0.4f),
      {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, {0.5f, 0, 0, 1.2f, 0, -0.5f, 0, 0.4f, 0, 0, 0.5f, 0.6f}});
  add_patches(scene, {flat_patch({-50, -1.1f, -50}, {100, 0, 0}, {0, 0, 100})},
              add_material(scene, GPURT_MATERIAL_LAMBERT, {0.1f, 0.5f, 0.9f}));
  for (const gpurt_light_type type : {GPURT_LIGHT_POINT, GPURT_LIGHT_SPOT, GPURT_LIGHT_DISTANT}) {
    gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
    light.type = type;
    for (float &c : light.intensity) c = type == GPURT_LIGHT_DISTANT ? 1.0f : 20.0f;
    light.position[0] = light.position[1] = light.position[2] = 2;
    light.direction[0] = 0.5f;
    light.direction[1] = light.direction[2] = -1;
    uint32_t id;
    GPURT_EXPECT_OK(gpurt_scene_add_light(scene, &light, &id));
  }
  if (has_more) {
    add_mesh(scene, icosphere(2).map([](std::array<float, 3> v) {
      return std::array<float, 3>{v[0] * 0.5f - 1.2f, v[1] * 0.5f, v[2] * 0.5f + 0.8f};
    }),
             add_material(scene, GPURT_MATERIAL_GLASS, {1, 1, 1}));
    std::vector<float> texels(16 * 16 * 4, 0.8f);
    for (size_t k = 0; k < 16 * 16; ++k) texels[4 * k + 3] = (k / 4 + k / 64) % 2 != 0 ? 1.0f : 0.0f;
    gpurt_material_desc holes = GPURT_MATERIAL_DESC_INIT;
    holes.base_color_texture = add_texture(scene, GPURT_TEXTURE_RGBA32F, 16, 16, texels.data(),
                                           GPURT_WRAP_CLAMP, GPURT_FILTER_NEAREST);
    holes.alpha_cutoff = 0.5f;
    uint32_t id = 0;
    GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &holes, &id));
    add_patches(scene, {flat_patch({-1, -1, 1.2f}, {1.5f, 0, 0}, {0, 1.5f, 0})}, id);
    add_patches(scene, closed_patches(1, 0, 3),
                add_material(scene, GPURT_MATERIAL_LAMBERT, {0.1f, 0.1f, 0.1f}, {2, 2, 3}),
                {{0.2f, 0, 0, -1.1f, 0, 0.2f, 0, 1.1f, 0, 0, 0.2f, 0.5f}});
    set_environment(scene, 0.2f);
  }
  add_camera(scene, {0, 0.3f, 3.5f}, 1.0f);
}
void fill_with_shadows(gpurt_scene scene) { fill_shadowed(scene, false); }
void fill_with_all_light(gpurt_scene scene) { fill_shadowed(scene, true); }

ReyesPicture picture(uint32_t spp, gpurt_reyes_shading shading, float rate = 0,
                     gpurt_reyes_filter filter = GPURT_REYES_FILTER_AUTO)
{
  const uint32_t side = uint32_t(amount(120, 32));
  ReyesPicture p = reyes_picture(side, side, spp, rate, filter);
  p.options.reyes.shading = shading;
  return p;
}

std::vector<ReyesPicture> pictures()
{
  std::vector<ReyesPicture> list = {
      picture(9, GPURT_REYES_SHADING_MICROPOLYGONS), picture(9, GPURT_REYES_SHADING_BLOCKS),
      picture(5, GPURT_REYES_SHADING_MICROPOLYGONS, 1.0f, GPURT_REYES_FILTER_MITCHELL),
      picture(40, GPURT_REYES_SHADING_BLOCKS, 4.0f), picture(2, GPURT_REYES_SHADING_MICROPOLYGONS, 60.0f)};
  list.push_back(list[0]);
  list.back().options.reyes.flatness = 0.9f;
  list.push_back(list[1]);
  list.back().options.reyes.no_shadows = 1;
  return list;
}

// Whole, in tiles, and sample by sample in parts that end within those that share a path, in the short form of some pictures.
void compare_light(gpurt_scene expected, gpurt_scene tested, ReyesPicture p)
{
  const uint32_t spp = p.options.spp;
  SCOPED_TRACE(testing::Message() << spp << " samples, shading " << p.options.reyes.shading << ", rate "
                                  << p.options.reyes.shading_rate);
  gpurt_statistics s = GPURT_STATISTICS_INIT, t = GPURT_STATISTICS_INIT;
  const std::vector<OutputBits> bits = bits_of(expected, p, &s);
  expect_same(bits, bits_of(tested, p, &t));
  EXPECT_EQ(t.largest_sample, s.largest_sample);
  EXPECT_GT(s.reyes_counters.num_shaded, 0u);
  p.options.tile_size = 29;
  expect_same(bits, bits_of(tested, p));
  if (is_short_form() && (spp != 9 || p.options.reyes.flatness != 0)) return;
  const Frame parts = frame_of(tested, p);
  for (const uint32_t n : {(spp + 2) / 3, spp}) {
    p.options.spp = n;
    render(parts, p.options);
  }
  expect_same(bits, read_all(parts, p.options));
}

TEST(CudaReyesRayLight, OfShadowsHasTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Scene a = scene_of(make_device(GPURT_DEVICE_CPU), fill_with_shadows),
              b = scene_of(make_device(GPURT_DEVICE_CUDA), fill_with_shadows);
  for (const ReyesPicture &p : pictures()) compare_light(a, b, p);
}

TEST(CudaReyesRayLight, OfAllLightsHasTheBitsOfTheCpu)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device cpu = make_device(GPURT_DEVICE_CPU), cuda = make_device(GPURT_DEVICE_CUDA);
  const Scene a = scene_of(cpu, fill_with_all_light), b = scene_of(cuda, fill_with_all_light);
  for (const ReyesPicture &p : pictures()) compare_light(a, b, p);
  const Scene c = scene_of(cpu, fill_everything), d = scene_of(cuda, fill_everything);
  compare_light(c, d, pictures()[0]);
}

// As many points as the CPU's buckets find, but for those that several of them see; and a ray to each light at most.
TEST(CudaReyesRayLight, LightsWhatIsSeenOnce)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Scene a = scene_of(make_device(GPURT_DEVICE_CPU), fill_with_shadows),
              b = scene_of(make_device(GPURT_DEVICE_CUDA), fill_with_shadows);
  const ReyesPicture p = picture(32, GPURT_REYES_SHADING_MICROPOLYGONS);
  gpurt_statistics s = GPURT_STATISTICS_INIT, t = GPURT_STATISTICS_INIT;
  bits_of(a, p, &s);
  bits_of(b, p, &t);
  EXPECT_LE(t.reyes_counters.num_shaded, s.reyes_counters.num_shaded);
  EXPECT_GT(double(t.reyes_counters.num_shaded), 0.9 * double(s.reyes_counters.num_shaded));
  EXPECT_LE(t.num_shadow_rays, 3 * t.reyes_counters.num_shaded);
  EXPECT_GT(t.num_shadow_rays, t.reyes_counters.num_shaded / 2);
  EXPECT_EQ(t.num_bounce_rays, 0u);
}

TEST(CudaReyesRayLight, IsTheSameInLittleMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const ReyesPicture p = picture(9, GPURT_REYES_SHADING_MICROPOLYGONS);
  for (const auto &fill : {fill_with_shadows, fill_with_all_light}) {
    const Scene a = scene_of(make_device(GPURT_DEVICE_CUDA), fill);
    const std::vector<OutputBits> bits = bits_of(a, p);
    for (const uint64_t mebibytes : {64, 16}) {
      SCOPED_TRACE(mebibytes);
      const Device tight = make_device(GPURT_DEVICE_CUDA, 0, mebibytes << 20);
      const Scene b = scene_of(tight, fill);
      expect_same(bits, bits_of(b, p));
      gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
      GPURT_ASSERT_OK(gpurt_device_get_properties(tight, &properties));
      EXPECT_LE(properties.memory_peak_bytes, mebibytes << 20);
    }
  }
}

TEST(CudaReyesRayLight, IsTheSameEveryTime)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Scene scene = scene_of(make_device(GPURT_DEVICE_CUDA), fill_with_all_light);
  const ReyesPicture p = picture(9, GPURT_REYES_SHADING_BLOCKS);
  const std::vector<OutputBits> bits = bits_of(scene, p);
  for (uint64_t i = 0; i < amount(5, 2); ++i) expect_same(bits, bits_of(scene, p));
}

// Shading before visibility has schedules of its own, which light after it cannot follow.
TEST(CudaReyesRayLight, RefusesStagesBeforeVisibility)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Scene scene = scene_of(make_device(GPURT_DEVICE_CUDA), fill_with_shadows);
  const ReyesPicture p = picture(4, GPURT_REYES_SHADING_MICROPOLYGONS);
  const Frame frame = frame_of(scene, p);
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.pipeline = GPURT_PIPELINE_REYES;
  desc.reyes = p.options.reyes;
  for (const gpurt_traversal traversal : {GPURT_TRAVERSAL_UBER, GPURT_TRAVERSAL_LEAF_LISTS}) {
    desc.schedule.traversal = traversal;
    Job job;
    EXPECT_EQ(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()), GPURT_ERROR_UNSUPPORTED);
    EXPECT_NE(std::string(gpurt_last_error()).find("set no_shadows"), std::string::npos)
        << gpurt_last_error();
  }
}

TEST(ReyesRayLight, DoesNotDependOnTheNumberOfThreads)
{
  const Device one = make_device(GPURT_DEVICE_CPU, 1), all = make_device(GPURT_DEVICE_CPU, 0);
  for (const auto &fill : {fill_with_shadows, fill_with_all_light}) {
    const Scene a = scene_of(one, fill), b = scene_of(all, fill);
    compare_light(a, b, picture(9, GPURT_REYES_SHADING_BLOCKS, 1.0f));
  }
}

}  // namespace
}  // namespace gpurt_test
