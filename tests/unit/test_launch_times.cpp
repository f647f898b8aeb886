// No launch of a render takes longer than a quarter of a second, which displays and a cancelled job's 0.5 s rely on, where a
// ray crosses some thousand triangles: whatever the pipeline and its schedule.
#include <chrono>

#include "../cuda/pictures.h"
#include "cuda/launch_timer.h"

namespace gpurt_test {
namespace {

constexpr double longest_launch = 0.25;  // seconds

// The Cornell box with sheets across it that are nearly all holes: every ray passes through most of them, and each one is looked
// at, with its texture.
void fill_sheets(gpurt_scene scene)
{
  fill_cornell_box(scene);
  std::vector<uint8_t> texels(64 * 64 * 4, 128);
  for (size_t i = 3; i < texels.size(); i += 4) texels[i] = i % 8191 == 4095 ? 255 : 0;
  gpurt_material_desc material = GPURT_MATERIAL_DESC_INIT;
  material.alpha_cutoff = 0.5f;
  material.base_color_texture = add_texture(scene, GPURT_TEXTURE_RGBA8_LINEAR, 64, 64, texels.data(),
                                            GPURT_WRAP_REPEAT, GPURT_FILTER_NEAREST);
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &material, &id));
  Mesh sheets;
  for (int i = 0; i < 2000; ++i) {
    const float z = -0.95f + 1.9f * float(i) / 2000;
    sheets.append(quad({-1, -1, z}, {1, -1, z}, {1, 1, z}, {-1, 1, z}));
  }
  const uint32_t geometry = add_textured_mesh(scene, sheets, id, {2.7f, 2.7f});
  place(scene, geometry, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0});
}

struct Way {
  const char *name;
  gpurt_accel accel;
  gpurt_pipeline pipeline;
  gpurt_schedule schedule = GPURT_SCHEDULE_INIT;
};

gpurt_schedule schedule_of(gpurt_traversal traversal, gpurt_launch launch = GPURT_LAUNCH_AUTO,
                           gpurt_fetch fetch = GPURT_FETCH_AUTO,
                           gpurt_generation generation = GPURT_GENERATION_AUTO)
{
  gpurt_schedule s = GPURT_SCHEDULE_INIT;
  s.traversal = traversal;
  s.launch = launch;
  s.fetch = fetch;
  s.generation = generation;
  return s;
}

const std::vector<Way> &ways()
{
  static const std::vector<Way> all = {
      {"paths, bvh", GPURT_ACCEL_BVH, GPURT_PIPELINE_PATH},
      {"paths, kdtree", GPURT_ACCEL_KDTREE, GPURT_PIPELINE_PATH},
      {"paths in slots", GPURT_ACCEL_BVH, GPURT_PIPELINE_PATH,
       schedule_of(GPURT_TRAVERSAL_STACK, GPURT_LAUNCH_REGULAR, GPURT_FETCH_AUTO, GPURT_GENERATION_SLOTS)},
      {"counted paths", GPURT_ACCEL_BVH, GPURT_PIPELINE_PATH,
       schedule_of(GPURT_TRAVERSAL_AUTO, GPURT_LAUNCH_AUTO, GPURT_FETCH_AUTO, GPURT_GENERATION_COUNTED)},
      {"persistent threads", GPURT_ACCEL_KDTREE, GPURT_PIPELINE_PATH,
       schedule_of(GPURT_TRAVERSAL_STACK, GPURT_LAUNCH_PERSISTENT)},
      {"lists of leaves", GPURT_ACCEL_KDTREE, GPURT_PIPELINE_PATH, schedule_of(GPURT_TRAVERSAL_LEAF_LISTS)},
      {"packets", GPURT_ACCEL_KDTREE, GPURT_PIPELINE_PATH,
       schedule_of(GPURT_TRAVERSAL_STACK, GPURT_LAUNCH_REGULAR, GPURT_FETCH_PACKETS)},
      {"uber-kernel", GPURT_ACCEL_BVH, GPURT_PIPELINE_PATH, schedule_of(GPURT_TRAVERSAL_UBER)},
      {"photons", GPURT_ACCEL_BVH, GPURT_PIPELINE_PHOTON},
      {"REYES", GPURT_ACCEL_BVH, GPURT_PIPELINE_REYES},
  };
  return all;
}

// A render is cancelled while it does the work that takes long, and ends in time.
TEST(CudaLaunches, EndInAQuarterOfASecondAndJobsInHalfASecondWhenCancelled)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Device device = make_device(GPURT_DEVICE_CUDA);
  Scene scene;
  gpurt_accel accel = GPURT_ACCEL_AUTO;
  for (const Way &way : ways()) {
    SCOPED_TRACE(way.name);
    if (way.accel != accel) scene = make_scene(device, fill_sheets, way.accel);
    accel = way.accel;
    RenderOptions size;
    size.width = size.height = 1024;
    const Frame frame = make_frame(scene, size);
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.pipeline = way.pipeline;
    desc.schedule = way.schedule;
    desc.samples_per_pixel = 1 << 16;
    gpurt::cuda::LaunchTimer timer;
    Job job;
    GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
    EXPECT_EQ(gpurt_job_wait(job, 600'000'000), GPURT_ERROR_TIMEOUT) << gpurt_last_error();
    const auto start = std::chrono::steady_clock::now();
    GPURT_ASSERT_OK(gpurt_job_cancel(job));
    EXPECT_EQ(gpurt_job_wait(job, 60'000'000'000), GPURT_ERROR_CANCELLED) << gpurt_last_error();
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    EXPECT_LT(seconds, 0.5);  // what gpurt_job_cancel promises
    const std::map<std::string, double> longest = timer.longest();
    EXPECT_FALSE(longest.empty());
    std::pair<std::string, double> worst{"", 0};
    for (const auto &one : longest) {
      EXPECT_LT(one.second, longest_launch) << one.first;
      if (one.second > worst.second) worst = one;
    }
    std::printf("%s: %.0f ms in %s; ended %.0f ms after the cancel\n", way.name, 1e3 * worst.second,
                worst.first.c_str(), 1e3 * seconds);
  }
}

}  // namespace
}  // namespace gpurt_test
