// REYES' schedules on CUDA devices: kernels of their own, counters that say what they did, and one image.
#include "../support/patch_shapes.h"
#include "kernel_launches.h"
#include "scenes.h"

namespace gpurt_test {
namespace {

struct Choice {
  gpurt_launch launch;
  gpurt_traversal traversal;
  gpurt_compaction compaction = GPURT_COMPACTION_AUTO;
};

const std::vector<Choice> choices = {
    {GPURT_LAUNCH_AUTO, GPURT_TRAVERSAL_AUTO},
    {GPURT_LAUNCH_REGULAR, GPURT_TRAVERSAL_STACK},
    {GPURT_LAUNCH_PERSISTENT, GPURT_TRAVERSAL_STACK},
    {GPURT_LAUNCH_ROUNDS, GPURT_TRAVERSAL_LEAF_LISTS},
    {GPURT_LAUNCH_REGULAR, GPURT_TRAVERSAL_LEAF_LISTS},
    {GPURT_LAUNCH_PERSISTENT, GPURT_TRAVERSAL_UBER},
    {GPURT_LAUNCH_ROUNDS, GPURT_TRAVERSAL_UBER},
    {GPURT_LAUNCH_REGULAR, GPURT_TRAVERSAL_STACK, GPURT_COMPACTION_BLOCK_SCAN},
    {GPURT_LAUNCH_REGULAR, GPURT_TRAVERSAL_STACK, GPURT_COMPACTION_PYRAMID},
    {GPURT_LAUNCH_REGULAR, GPURT_TRAVERSAL_STACK, GPURT_COMPACTION_NAIVE_SCAN},
    {GPURT_LAUNCH_REGULAR, GPURT_TRAVERSAL_LEAF_LISTS, GPURT_COMPACTION_LIBRARY_SCAN}};

// Many dented patches, some behind each other, a floor that one block alone could not cut, and a wall through the eye.
Scene scene_on(gpurt_device device, int num_behind = 0)
{
  Scene scene;
  GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
  const std::vector<PatchNet> nets = closed_patches(6, 0.1, 3);
  std::vector<std::array<float, 12>> placements = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                                                   {0.5f, 0, 0, 1.2f, 0, 0.5f, 0, 0, 0, 0, 0.5f, 0.3f}};
  for (int k = 1; k <= num_behind; ++k)
    placements.push_back({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -0.1f * float(k)});
  add_patches(scene, nets, add_material(scene, GPURT_MATERIAL_METAL, {0.9f, 0.5f, 0.1f}, {0, 0, 0}, 0.4f),
              placements);
  add_patches(scene, {flat_patch({-50, -1.1f, -50}, {100, 0, 0}, {0, 0, 100}),
                      flat_patch({1.5f, -1, -1}, {0, 2, 0}, {0, 0, 6})});
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  for (float &c : light.intensity) c = 20;
  light.position[0] = light.position[1] = light.position[2] = 2;
  uint32_t id;
  GPURT_EXPECT_OK(gpurt_scene_add_light(scene, &light, &id));
  add_camera(scene, {0.3f, 0.3f, 3.5f}, 1.0f);
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_BVH;
  build.patch_tolerance = 0.01f;
  GPURT_EXPECT_OK(gpurt_scene_commit(scene, &build));
  return scene;
}

gpurt_render_desc description(const Choice &choice, gpurt_reyes_shading shading)
{
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.pipeline = GPURT_PIPELINE_REYES;
  desc.samples_per_pixel = 9;
  desc.reyes.no_shadows = 1;
  desc.reyes.shading = shading;
  desc.schedule.launch = choice.launch;
  desc.schedule.traversal = choice.traversal;
  desc.schedule.compaction = choice.compaction;
  return desc;
}

std::vector<float> picture(gpurt_scene scene, const Choice &choice, gpurt_reyes_shading shading,
                           uint32_t size, gpurt_statistics &facts)
{
  RenderOptions o;
  o.width = o.height = size;
  const Frame frame = make_frame(scene, o);
  const gpurt_render_desc desc = description(choice, shading);
  Job job;
  GPURT_EXPECT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
  GPURT_EXPECT_OK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
  facts = GPURT_STATISTICS_INIT;
  GPURT_EXPECT_OK(gpurt_frame_get_statistics(frame, &facts));
  return read_color(frame, o);
}

bool has_same_bits(const std::vector<float> &a, const std::vector<float> &b)
{
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

TEST(CudaReyesSchedules, GiveOneImageAndCountWhatTheyDid)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  const Scene scene = scene_on(device);
  const std::string fused = "REYES stages 'dice', 'shade' and 'sample'";
  const std::vector<const char *> split_kernels = {
      "", "REYES stage 'split', a level", "REYES stage 'split', queues of blocks", "REYES stage 'split'"};
  for (const gpurt_reyes_shading shading :
       {GPURT_REYES_SHADING_SAMPLES, GPURT_REYES_SHADING_MICROPOLYGONS, GPURT_REYES_SHADING_BLOCKS}) {
    std::vector<float> expected;
    gpurt_statistics first = GPURT_STATISTICS_INIT;
    for (const Choice &choice : choices) {
      const bool is_fused = choice.traversal <= GPURT_TRAVERSAL_STACK;
      if (shading == GPURT_REYES_SHADING_SAMPLES && !is_fused) continue;
      SCOPED_TRACE(testing::Message()
                   << "shading " << shading << ", launch " << choice.launch << ", traversal "
                   << choice.traversal << ", compaction " << choice.compaction);
      const gpurt_launch launch = choice.launch != GPURT_LAUNCH_AUTO ? choice.launch : GPURT_LAUNCH_ROUNDS;
      const bool is_mapped = choice.compaction != GPURT_COMPACTION_AUTO;
      const std::string split_kernel = std::string(split_kernels[launch]) + (is_mapped ? " mapped" : "");
      const uint64_t split_before = launches_of(device, split_kernel),
                     unmapped_before = launches_of(device, "REYES' queue unmapped"),
                     fused_before = launches_of(device, fused),
                     dice_before = launches_of(device, "REYES stage 'dice'"),
                     shade_before = launches_of(device, "REYES stage 'shade'"),
                     sample_before = launches_of(device, "REYES stage 'sample'"),
                     uber_before = launches_of(device, fused + ", by what waits");
      gpurt_statistics s;
      const std::vector<float> color = picture(scene, choice, shading, 300, s);
      if (expected.empty()) {
        expected = color;
        first = s;
        EXPECT_GT(mean(color), 0.01);
      }
      EXPECT_TRUE(has_same_bits(color, expected));
      const gpurt_reyes_counters &c = s.reyes_counters;
      EXPECT_EQ(c.num_micropolygons, first.reyes_counters.num_micropolygons);
      EXPECT_EQ(c.num_grids, first.reyes_counters.num_grids);
      EXPECT_EQ(c.num_splits, first.reyes_counters.num_splits);
      EXPECT_EQ(s.schedule.launch, launch);
      EXPECT_EQ(s.schedule.traversal, is_fused ? GPURT_TRAVERSAL_STACK : choice.traversal);
      // Kernels of their own.
      const uint64_t num_split = launches_of(device, split_kernel) - split_before;
      EXPECT_GT(num_split, 0u);
      if (launch == GPURT_LAUNCH_REGULAR) EXPECT_EQ(num_split, c.split_rounds);
      else EXPECT_GT(c.split_rounds, launch == GPURT_LAUNCH_ROUNDS ? 1u : 3u);
      // Queues whose places are sums: of what waits, and of what is to be diced.
      EXPECT_EQ(launches_of(device, "REYES' queue unmapped") - unmapped_before,
                is_mapped ? c.split_rounds : 0u);
      EXPECT_EQ(s.schedule_counters.compactions, is_mapped ? 2 * c.split_rounds : 0u);
      if (launch == GPURT_LAUNCH_PERSISTENT) EXPECT_GT(c.num_donated, 0u);
      else EXPECT_EQ(c.num_donated, 0u);
      const uint64_t rounds = s.schedule_counters.list_rounds;
      EXPECT_EQ(rounds > 0, choice.traversal == GPURT_TRAVERSAL_LEAF_LISTS);
      EXPECT_EQ(launches_of(device, "REYES stage 'dice'") - dice_before, rounds);
      EXPECT_EQ(launches_of(device, "REYES stage 'shade'") - shade_before, rounds);
      EXPECT_EQ(launches_of(device, "REYES stage 'sample'") - sample_before, rounds);
      EXPECT_EQ(launches_of(device, fused + ", by what waits") - uber_before,
                choice.traversal == GPURT_TRAVERSAL_UBER ? 1u : 0u);
      EXPECT_EQ(s.schedule_counters.mode_switches > 0, choice.traversal == GPURT_TRAVERSAL_UBER);
      EXPECT_EQ(launches_of(device, fused) - fused_before,
                is_fused && shading != GPURT_REYES_SHADING_SAMPLES ? 1u : 0u);
    }
  }
}

// Lists that are full end what runs, and it goes on where it was.
TEST(CudaReyesSchedules, GiveThatImageInLittleMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  std::vector<float> expected;
  for (const uint64_t mebibytes : {0, 48, 24}) {
    if (mebibytes == 48 && is_short_form()) continue;
    const Device device = make_device(GPURT_DEVICE_CUDA, 0, mebibytes << 20);
    const Scene scene = scene_on(device);
    for (const Choice &choice : choices) {
      SCOPED_TRACE(testing::Message() << mebibytes << " MiB, launch " << choice.launch << ", traversal "
                                      << choice.traversal << ", compaction " << choice.compaction);
      gpurt_statistics s;
      const std::vector<float> color = picture(scene, choice, GPURT_REYES_SHADING_MICROPOLYGONS, 150, s);
      if (expected.empty()) expected = color;
      EXPECT_TRUE(has_same_bits(color, expected));
    }
  }
}

// In as little memory as the default takes, blocks' queues have no room for what blocks may leave, of many
// more pieces than lists hold: what waits goes on in rounds.
TEST(CudaReyesSchedules, GoOnInRoundsWhereQueuesHaveNoRoom)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Choice queues = {GPURT_LAUNCH_PERSISTENT, GPURT_TRAVERSAL_STACK};
  constexpr int num_behind = 24;
  constexpr uint32_t size = 200;
  gpurt_statistics s;
  const Device roomy = make_device(GPURT_DEVICE_CUDA);
  const char *const in_rounds = "REYES stage 'split'", *const in_queues =
                                                           "REYES stage 'split', queues of blocks";
  const uint64_t rounds_before = launches_of(roomy, in_rounds);
  const std::vector<float> expected =
      picture(scene_on(roomy, num_behind), queues, GPURT_REYES_SHADING_MICROPOLYGONS, size, s);
  EXPECT_EQ(launches_of(roomy, in_rounds), rounds_before);
  const uint64_t queues_before = launches_of(roomy, in_queues);
  const Device committed = make_device(GPURT_DEVICE_CUDA);
  const Scene held = scene_on(committed, num_behind);
  RenderOptions o;
  o.width = o.height = size;
  const Frame film = make_frame(held, o);
  gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
  GPURT_ASSERT_OK(gpurt_device_get_properties(committed, &p));
  uint64_t least = UINT64_MAX;
  for (const uint64_t kibibytes : {8192, 4096, 2048, 1536, 1024, 768, 640, 512}) {
    SCOPED_TRACE(kibibytes);
    const Device tight = make_device(GPURT_DEVICE_CUDA, 0, p.memory_peak_bytes + (kibibytes << 10));
    const Scene scene = scene_on(tight, num_behind);
    const Frame frame = make_frame(scene, o);
    const gpurt_render_desc desc = description(queues, GPURT_REYES_SHADING_MICROPOLYGONS);
    Job job;
    GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
    const gpurt_result result = gpurt_job_wait(job, GPURT_WAIT_FOREVER);
    if (result == GPURT_ERROR_OUT_OF_MEMORY) {
      // No buffers, not no places in them.
      EXPECT_EQ(std::string(gpurt_last_error()).find("pieces"), std::string::npos) << gpurt_last_error();
      break;
    }
    GPURT_ASSERT_OK(result);
    EXPECT_TRUE(has_same_bits(read_color(frame, o), expected));
    least = kibibytes;
  }
  EXPECT_LE(least, 2048u);
  EXPECT_GT(launches_of(roomy, in_queues), queues_before);
  EXPECT_GT(launches_of(roomy, in_rounds), rounds_before);
}

TEST(CudaReyesSchedules, RefuseStagesOfSamples)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  const Scene scene = scene_on(device);
  const Frame frame = make_frame(scene, {});
  for (const gpurt_traversal traversal : {GPURT_TRAVERSAL_LEAF_LISTS, GPURT_TRAVERSAL_UBER}) {
    const gpurt_render_desc desc = description({GPURT_LAUNCH_AUTO, traversal}, GPURT_REYES_SHADING_SAMPLES);
    Job job;
    EXPECT_EQ(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()), GPURT_ERROR_UNSUPPORTED);
    EXPECT_NE(std::string(gpurt_last_error()).find("GPURT_REYES_SHADING_MICROPOLYGONS"), std::string::npos);
  }
}

TEST(ReyesSchedules, AreCudaDevices)
{
  const Device device = make_device(GPURT_DEVICE_CPU);
  const Scene scene = scene_on(device);
  const Frame frame = make_frame(scene, {});
  for (const Choice &choice : choices) {
    const bool is_there = choice.launch <= GPURT_LAUNCH_REGULAR &&
                          choice.traversal <= GPURT_TRAVERSAL_STACK &&
                          choice.compaction <= GPURT_COMPACTION_BLOCK_SCAN;
    gpurt_render_desc desc = description(choice, GPURT_REYES_SHADING_MICROPOLYGONS);
    desc.samples_per_pixel = 1;
    Job job;
    EXPECT_EQ(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()),
              is_there ? GPURT_OK : GPURT_ERROR_UNSUPPORTED);
  }
  // Rays have no rounds of cutting.
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.schedule.launch = GPURT_LAUNCH_ROUNDS;
  Job job;
  EXPECT_EQ(gpurt_frame_submit(make_frame(scene, {}), &desc, nullptr, 0, job.out()), GPURT_ERROR_UNSUPPORTED);
}

}  // namespace
}  // namespace gpurt_test
