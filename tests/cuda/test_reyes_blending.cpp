// REYES blends to the same bits on every device, in every output, with rays and without, however the work is cut and however
// little memory there is for fragments.
//
// The bodies take two devices; without a GPU they compare one CPU thread with all of them.
#include "reyes_pictures.h"

namespace gpurt_test {
namespace {

uint32_t add_pane(gpurt_scene scene, std::array<float, 3> color, float alpha,
                  gpurt_material_type type = GPURT_MATERIAL_LAMBERT)
{
  gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
  desc.type = type;
  desc.alpha = alpha;
  desc.blends = 1;
  desc.roughness = 0.4f;
  std::memcpy(desc.base_color, color.data(), sizeof desc.base_color);
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &desc, &id));
  return id;
}

void add_sun(gpurt_scene scene)
{
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  light.type = GPURT_LIGHT_DISTANT;
  for (float &c : light.intensity) c = 2;
  light.direction[0] = 0.5f;
  light.direction[1] = -1;
  light.direction[2] = -0.7f;
  uint32_t id;
  GPURT_EXPECT_OK(gpurt_scene_add_light(scene, &light, &id));
}

// Dented shells that blend, some in the same place, around and before one that does not: patches alone.
void add_shells(gpurt_scene scene, bool has_opaque)
{
  const std::array<float, 12> small = {0.6f, 0, 0, 0.3f, 0, 0.6f, 0, 0.2f, 0, 0, 0.6f, 0},
                              whole = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  const std::vector<PatchNet> nets = closed_patches(2, 0.3, 5);
  add_patches(scene, nets, add_pane(scene, {0.9f, 0.5f, 0.1f}, 0.4f, GPURT_MATERIAL_METAL), {whole});
  add_patches(scene, nets, add_pane(scene, {0.1f, 0.5f, 0.9f}, 0.7f), {whole, small});
  std::vector<PatchNet> twice = closed_patches(1, 0.1, 7);
  const std::vector<PatchNet> once = twice;
  twice.insert(twice.end(), once.begin(), once.end());
  add_patches(scene, twice, add_pane(scene, {0.1f, 0.9f, 0.2f}, 0.15f),
              {{0.4f, 0, 0, -0.8f, 0, 0.4f, 0, 0.5f, 0, 0, 0.4f, 1}});
  if (has_opaque) {
    add_patches(scene, once, add_material(scene, GPURT_MATERIAL_LAMBERT, {0.8f, 0.8f, 0.8f}),
                {{0.5f, 0, 0, -0.2f, 0, 0.5f, 0, -0.3f, 0, 0, 0.5f, 0.4f}});
    add_patches(scene, {flat_patch({-50, -1.1f, -50}, {100, 0, 0}, {0, 0, 100})});
  }
  add_sun(scene);
  add_camera(scene, {0, 0.3f, 3.5f}, 1.0f);
  std::mt19937_64 rng(4);
  add_turned_camera(scene, {0.1, 0.1, 0.05}, rng, 2.2f);
}
void fill_shells(gpurt_scene scene) { add_shells(scene, true); }
void fill_bare_shells(gpurt_scene scene) { add_shells(scene, false); }

// The same, with a lamp's worth of sky, balls of triangles and a sheet through the eye.
void fill_shells_and_meshes(gpurt_scene scene)
{
  add_shells(scene, true);
  const uint32_t glass = add_pane(scene, {0.9f, 0.9f, 1}, 0.3f, GPURT_MATERIAL_GLASS);
  add_mesh(scene, icosphere(2).map([](std::array<float, 3> v) {
    return std::array<float, 3>{v[0] * 0.3f + 0.8f, v[1] * 0.3f - 0.2f, v[2] * 0.3f + 1.2f};
  }),
           glass);
  add_mesh(scene, quad({-4, 0.5f, -4}, {-4, 0.5f, 4}, {4, -0.2f, 4}, {4, -0.2f, -4}), glass);
  add_patches(scene, {flat_patch({-30, 0.299f, -30}, {60, 0, 0}, {0, 0, 60})}, glass);
  set_environment(scene, 1);
}

std::vector<ReyesPicture> pictures()
{
  const uint32_t side = uint32_t(amount(110, 36));
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
  compare_devices(cpu, cuda, fill_shells, unshadowed(pictures()));
  compare_devices(cpu, cuda, fill_bare_shells, unshadowed(pictures()));
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
  compare_devices(cpu, cuda, fill_shells_and_meshes, {flat});
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

// Sheets one behind the other, in no order.
template <int num, int thousandths>
void fill_sheets(gpurt_scene scene)
{
  Random random(6);
  std::vector<uint32_t> order(num);
  for (int i = 0; i < num; ++i) order[size_t(i)] = uint32_t(i);
  for (uint32_t i = num; i > 1; --i) std::swap(order[i - 1], order[random.below(i)]);
  const float alpha = float(thousandths) / 1000;
  const uint32_t panes[] = {add_pane(scene, {0.9f, 0.5f, 0.1f}, alpha),
                            add_pane(scene, {0.1f, 0.5f, 0.9f}, alpha)};
  Mesh sheets[2];
  for (const uint32_t i : order) {
    const float z = -2 * float(i) / num;
    sheets[i % 2].append(quad({-3, -3, z}, {3, -3, z}, {3, 3, z}, {-3, 3, z}));
  }
  for (int k = 0; k < 2; ++k) add_mesh(scene, sheets[k], panes[k]);
  add_sun(scene);
  add_camera(scene, {0, 0, 3}, 0.8f);
}

// Images in little more memory than a commit takes: there is room for few fragments.
template <class Fill>
void shrink_memory(const Fill &fill, const ReyesPicture &p, const std::vector<OutputBits> &bits)
{
  const auto peak = [](gpurt_device device) {
    gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
    GPURT_EXPECT_OK(gpurt_device_get_properties(device, &properties));
    return properties.memory_peak_bytes;
  };
  const Device roomy = make_device(GPURT_DEVICE_CUDA);
  const Scene whole = scene_of(roomy, fill);
  const uint64_t committed = peak(roomy);
  uint64_t least = UINT64_MAX;
  for (const uint64_t kibibytes : {32768, 8192, 3072, 2048, 1536, 1024, 512}) {
    SCOPED_TRACE(kibibytes);
    const uint64_t limit = committed + (kibibytes << 10);
    const Device tight = make_device(GPURT_DEVICE_CUDA, 0, limit);
    const Scene scene = scene_of(tight, fill);
    const Frame frame = frame_of(scene, p);
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.pipeline = GPURT_PIPELINE_REYES;
    desc.samples_per_pixel = p.options.spp;
    desc.max_depth = p.options.max_depth;
    desc.reyes = p.options.reyes;
    Job job;
    GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
    const gpurt_result result = gpurt_job_wait(job, GPURT_WAIT_FOREVER);
    if (result == GPURT_ERROR_OUT_OF_MEMORY) break;
    GPURT_ASSERT_OK(result);
    expect_same(bits, read_all(frame, p.options));
    EXPECT_LE(peak(tight), limit);
    least = statistics(frame).reyes_counters.working_bytes;
  }
  std::printf("%.1f MiB were enough\n", double(least) / (1 << 20));
  EXPECT_LT(least, uint64_t(4) << 20);
}

// Parts of the samples take turns.
TEST(CudaReyesBlending, IsTheSameInLittleMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const uint32_t side = uint32_t(amount(24, 12));
  ReyesPicture p = reyes_picture(side, side, 9);
  for (const bool has_shadows : {false, true}) {
    p.options.reyes.no_shadows = has_shadows ? 0 : 1;
    const Scene cpu = scene_of(make_device(GPURT_DEVICE_CPU), fill_sheets<300, 10>);
    shrink_memory(fill_sheets<300, 10>, p, bits_of(cpu, p));
  }
  const Scene cpu = scene_of(make_device(GPURT_DEVICE_CPU), fill_shells_and_meshes);
  shrink_memory(fill_shells_and_meshes, p, bits_of(cpu, p));
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
