// Films that stay on a CUDA device: what is read of them, into whatever memory, saved and merged has the bits of the CPU's.
#include <cuda_runtime_api.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <thread>

#include "pictures.h"

namespace gpurt_test {
namespace {

constexpr gpurt_output all[] = {GPURT_OUTPUT_COLOR,     GPURT_OUTPUT_ALPHA,    GPURT_OUTPUT_DEPTH,
                                GPURT_OUTPUT_NORMAL,    GPURT_OUTPUT_ALBEDO,   GPURT_OUTPUT_POSITION,
                                GPURT_OUTPUT_PRIMITIVE, GPURT_OUTPUT_INSTANCE, GPURT_OUTPUT_SAMPLE_COUNT,
                                GPURT_OUTPUT_VARIANCE};

struct Places {
  Device cpu = make_device(GPURT_DEVICE_CPU), cuda = make_device(GPURT_DEVICE_CUDA);
  Scene on_cpu = make_scene(cpu, fill_cornell_box), on_cuda = make_scene(cuda, fill_cornell_box);
};

Frame rendered(gpurt_scene scene, const RenderOptions &o, uint64_t first_sample = 0)
{
  gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
  desc.width = o.width;
  desc.height = o.height;
  desc.seed = o.seed;
  desc.outputs = all_outputs;
  desc.first_sample = first_sample;
  Frame frame;
  GPURT_EXPECT_OK(gpurt_frame_create(scene, &desc, frame.out()));
  render(frame, o);
  return frame;
}

// Sizes of which the last block, the last pixels that are resolved together, and rows are odd: three parts of 2^17 pixels.
constexpr uint32_t odd_width = 601, odd_height = 437;

TEST(CudaFilms, AreReadIntoAnyMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Places p;
  const RenderOptions o{.width = odd_width, .height = odd_height, .spp = 3, .max_depth = 2};
  const auto expected = read_all(rendered(p.on_cpu, o), o);
  const Frame frame = rendered(p.on_cuda, o);
  expect_same(expected, read_all(frame, o));  // host memory that is not page-locked
  void *pinned = nullptr, *device = nullptr;
  const size_t room = size_t(o.width) * o.height * 12 + 4;
  ASSERT_EQ(cudaMallocHost(&pinned, room), cudaSuccess);
  ASSERT_EQ(cudaMalloc(&device, room), cudaSuccess);
  std::vector<OutputBits> from_pinned, from_device;
  for (size_t i = 0; i < std::size(all); ++i) {
    std::vector<uint32_t> words(expected[i].words.size());
    const size_t bytes = words.size() * 4;
    // Aligned as the values are, no more.
    char *const to = static_cast<char *>(pinned) + 4, *const there = static_cast<char *>(device) + 4;
    GPURT_EXPECT_OK(gpurt_frame_read(frame, all[i], to, bytes));
    std::memcpy(words.data(), to, bytes);
    from_pinned.push_back({expected[i].name, words});
    // After what is on the default stream.
    EXPECT_EQ(cudaMemsetAsync(there, 0xab, bytes, nullptr), cudaSuccess);
    GPURT_EXPECT_OK(gpurt_frame_read(frame, all[i], there, bytes));
    EXPECT_EQ(cudaMemcpy(words.data(), there, bytes, cudaMemcpyDeviceToHost), cudaSuccess);
    from_device.push_back({expected[i].name, words});
  }
  expect_same(expected, from_pinned);
  expect_same(expected, from_device);
  // Of a frame without samples, whose sums are the host's.
  const Frame empty = make_frame(p.on_cuda, o);
  const size_t alpha_bytes = size_t(o.width) * o.height * 4;
  std::vector<uint32_t> words(alpha_bytes / 4, 1);
  GPURT_EXPECT_OK(gpurt_frame_read(empty, GPURT_OUTPUT_ALPHA, device, alpha_bytes));
  EXPECT_EQ(cudaMemcpy(words.data(), device, alpha_bytes, cudaMemcpyDeviceToHost), cudaSuccess);
  EXPECT_EQ(words, std::vector<uint32_t>(alpha_bytes / 4, 0));
  cudaFree(device);
  cudaFreeHost(pinned);
}

TEST(CudaFilms, OfReyesAreReadWithoutTheirDevice)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  RenderOptions o{.width = 80, .height = 60, .spp = 4};
  o.pipeline = GPURT_PIPELINE_REYES;
  std::vector<OutputBits> expected;
  Frame frame;
  {
    const Places p;
    expected = read_all(rendered(p.on_cpu, o), o);
    frame = rendered(p.on_cuda, o);
  }
  // The scene and the device are released, and live as long as the frame.
  expect_same(expected, read_all(frame, o));
  EXPECT_EQ(statistics(frame).samples_per_pixel, 4u);
}

TEST(CudaFilms, GrowByTilesJobsMergesAndFiles)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Places p;
  RenderOptions o{.width = 90, .height = 70, .spp = 12, .max_depth = 3};
  const auto expected = read_all(rendered(p.on_cpu, o), o);
  // By tiles, then all; then parts of either device, alternately; then on.
  o.spp = 2;
  o.tiles = {{0, 0, 40, 70}, {50, 10, 90, 30}};
  const Frame frame = rendered(p.on_cuda, o);
  o.tiles = {};
  o.spp = 4;
  render(frame, o);
  o.spp = 2;
  const Frame cpu_part = rendered(p.on_cpu, o, 4), cuda_part = rendered(p.on_cuda, o, 6);
  GPURT_EXPECT_OK(gpurt_frame_merge(frame, cuda_part));
  GPURT_EXPECT_OK(gpurt_frame_merge(frame, cpu_part));
  o.spp = 10;
  render(frame, o);
  const std::string file = testing::TempDir() + "/gpurt_cuda_films.gpurt";
  GPURT_EXPECT_OK(gpurt_frame_save(frame, file.c_str()));
  o.spp = 12;
  for (gpurt_scene scene : {gpurt_scene(p.on_cpu), gpurt_scene(p.on_cuda)}) {
    const Frame loaded = make_frame(scene, o, all_outputs);
    GPURT_EXPECT_OK(gpurt_frame_load_state(loaded, file.c_str()));
    render(loaded, o);
    expect_same(expected, read_all(loaded, o));
  }
  std::remove(file.c_str());
  render(frame, o);
  expect_same(expected, read_all(frame, o));
}

// A frame that the device has hardly room for beside what renders it, and one that it has none for.
TEST(CudaFilms, AreTheSameInLittleMemory)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Places p;
  const RenderOptions o{.width = 320, .height = 240, .spp = 3, .max_depth = 2};
  const auto expected = read_all(rendered(p.on_cpu, o), o);
  bool has_failed = false, has_worked = false;
  for (const uint64_t megabytes : {16, 18, 20, 24, 32, 48, 64, 96, 128}) {
    gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
    desc.type = GPURT_DEVICE_CUDA;
    desc.memory_limit_bytes = megabytes << 20;
    Device device;
    GPURT_EXPECT_OK(gpurt_device_create(&desc, device.out()));
    const Scene scene = make_scene(device, fill_cornell_box);
    const Frame frame = make_frame(scene, o, all_outputs);
    gpurt_render_desc render_desc = GPURT_RENDER_DESC_INIT;
    render_desc.samples_per_pixel = o.spp;
    render_desc.max_depth = o.max_depth;
    Job job;
    GPURT_EXPECT_OK(gpurt_frame_submit(frame, &render_desc, nullptr, 0, job.out()));
    const gpurt_result result = gpurt_job_wait(job, GPURT_WAIT_FOREVER);
    gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
    GPURT_EXPECT_OK(gpurt_device_get_properties(device, &properties));
    EXPECT_LE(properties.memory_peak_bytes, megabytes << 20);
    if (result == GPURT_ERROR_OUT_OF_MEMORY) {
      EXPECT_FALSE(has_worked) << megabytes;  // less was enough
      has_failed = true;
      continue;
    }
    EXPECT_EQ(result, GPURT_OK) << gpurt_last_error();
    has_worked = true;
    expect_same(expected, read_all(frame, o));
  }
  EXPECT_TRUE(has_worked);
  std::printf("the smallest limits %s\n", has_failed ? "were too small" : "were enough");
}

// Reading goes on while a job adds, and cancelling leaves whole samples, with which the next job goes on.
TEST(CudaFilms, AreReadWhileTheyGrowAndGoOnAfterCancelling)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Places p;
  RenderOptions o{.width = 256, .height = 200, .spp = 1, .max_depth = 3};
  const Frame frame = rendered(p.on_cuda, o);
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.samples_per_pixel = 1 << 20;
  desc.max_depth = o.max_depth;
  Job job;
  GPURT_EXPECT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
  std::vector<uint32_t> counts(size_t(o.width) * o.height), before(counts.size(), 0);
  for (int i = 0; i < 50; ++i) {
    GPURT_EXPECT_OK(
        gpurt_frame_read(frame, GPURT_OUTPUT_SAMPLE_COUNT, counts.data(), counts.size() * sizeof(uint32_t)));
    bool is_less = false;
    for (size_t k = 0; k < counts.size(); ++k) is_less |= counts[k] < before[k];
    EXPECT_FALSE(is_less);
    before = counts;
  }
  EXPECT_GT(statistics(frame).samples_per_pixel, 0u);
  GPURT_EXPECT_OK(gpurt_job_cancel(job));
  EXPECT_EQ(gpurt_job_wait(job, GPURT_WAIT_FOREVER), GPURT_ERROR_CANCELLED);
  GPURT_EXPECT_OK(
      gpurt_frame_read(frame, GPURT_OUTPUT_SAMPLE_COUNT, counts.data(), counts.size() * sizeof(uint32_t)));
  o.spp = *std::max_element(counts.begin(), counts.end());
  render(frame, o);
  const auto whole = rendered(p.on_cuda, o);
  expect_same(read_all(whole, o), read_all(frame, o));
}

TEST(CudaFilms, OfSeveralThreadsAreTheSame)
{
  if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
  const Places p;
  const RenderOptions o{.width = 100, .height = 80, .spp = 2, .max_depth = 2};
  const auto expected = read_all(rendered(p.on_cpu, o), o);
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&] {
      for (int turn = 0; turn < 3; ++turn) {
        const Frame frame = rendered(p.on_cuda, o);
        expect_same(expected, read_all(frame, o));
        EXPECT_EQ(statistics(frame).num_samples, uint64_t(2) * o.width * o.height);
      }
    });
  }
  for (std::thread &thread : threads) thread.join();
}

}  // namespace
}  // namespace gpurt_test
