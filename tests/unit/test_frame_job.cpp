// Jobs: planning of work units, order, cancelling, stopping by error and by time, failures.
#include <gtest/gtest.h>

#include <algorithm>

#include "test_frame_fake.h"

namespace {

using namespace gpurt_test;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start)
{
  return std::chrono::duration<double>(Clock::now() - start).count();
}

std::shared_ptr<Job> submit(const std::shared_ptr<Frame> &frame, const gpurt_render_desc &desc,
                            std::vector<gpurt_tile> tiles = {})
{
  return Job::submit(frame, desc, tiles);
}

gpurt_render_desc with_samples(uint32_t n)
{
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.samples_per_pixel = n;
  return desc;
}

TEST(Passes, CutTilesAreAlignedAndCoverWhatTheyCut)
{
  const std::vector<gpurt_tile> tiles = {{5, 3, 70, 33}};
  const auto cut = cut_tiles(tiles, 32);
  ASSERT_EQ(cut.size(), 6u);
  uint64_t area = 0;
  for (const gpurt_tile &t : cut) {
    EXPECT_EQ(t.x0 / 32, (t.x1 - 1) / 32);
    EXPECT_EQ(t.y0 / 32, (t.y1 - 1) / 32);
    area += uint64_t(t.x1 - t.x0) * (t.y1 - t.y0);
  }
  EXPECT_EQ(area, 65u * 30u);
  EXPECT_NO_THROW(check_tiles(cut, 70, 33));
}

TEST(Passes, RefusesBadTiles)
{
  const auto refused = [](std::vector<gpurt_tile> tiles) {
    return error_of([&] { check_tiles(tiles, 100, 50); }).second;
  };
  EXPECT_EQ(refused({{0, 0, 50, 50}, {50, 0, 100, 50}}), "");
  EXPECT_TRUE(contains(refused({{0, 0, 50, 50}, {49, 49, 60, 50}}),
                       "tile 1 overlaps an earlier one at pixel (49, 49)"));
  EXPECT_TRUE(
      contains(refused({{0, 0, 101, 50}}), "tile 0, [0, 101) x [0, 50), leaves the frame of 100 x 50"));
  EXPECT_TRUE(contains(refused({{0, 0, 10, 10}, {20, 20, 20, 30}}), "tile 1 is empty"));
}

TEST(Passes, SplitsUntilCountsAreUniform)
{
  const auto key = [](uint32_t x, uint32_t y) { return uint64_t(x == 5 && y == 9 ? 1 : 0); };
  std::vector<gpurt_tile> parts;
  split_uniform({0, 0, 16, 16}, key, parts);
  EXPECT_NO_THROW(check_tiles(parts, 16, 16));
  uint64_t area = 0;
  for (const gpurt_tile &t : parts) {
    area += uint64_t(t.x1 - t.x0) * (t.y1 - t.y0);
    for (uint32_t y = t.y0; y < t.y1; ++y) {
      for (uint32_t x = t.x0; x < t.x1; ++x) EXPECT_EQ(key(x, y), key(t.x0, t.y0));
    }
  }
  EXPECT_EQ(area, 256u);
  EXPECT_LE(parts.size(), 9u);  // log2(256) halvings
}

TEST(Passes, UnitsBringRegionsToOneLevel)
{
  std::vector<Region> regions = {{{0, 0, 4, 4}, 100, 3}, {{4, 0, 8, 4}, 0, 10}, {{0, 4, 8, 8}, 0, 0}};
  const auto units = take_units(regions, 8);
  ASSERT_EQ(units.size(), 2u);
  EXPECT_EQ(units[0].first_sample, 103u);
  EXPECT_EQ(units[0].num_samples, 5u);
  EXPECT_EQ(units[1].num_samples, 8u);
  EXPECT_EQ(regions[1].num_samples, 10u);
  EXPECT_TRUE(take_units(regions, 8).empty());
}

TEST(Passes, Checkpoints)
{
  std::vector<uint64_t> n = {checkpoint_from(0)};
  for (int i = 0; i < 5; ++i) n.push_back(checkpoint_after(n.back()));
  EXPECT_EQ(n, (std::vector<uint64_t>{32, 48, 64, 96, 128, 192}));
  EXPECT_EQ(checkpoint_from(48), 48u);
  EXPECT_EQ(checkpoint_from(49), 64u);
}

TEST(Job, UnitsStaySmall)
{
  FakeFrame fake;
  const auto frame = fake.make(300, 200);
  render(frame, 100);
  EXPECT_LE(fake.scene->largest_unit_paths, 65536u);
  EXPECT_EQ(statistics(*frame).tile_size, 32u);
  render(frame, 101, {}, 128);
  EXPECT_EQ(statistics(*frame).tile_size, 128u);
}

TEST(Job, CancelIsQuickAndKeepsWholeSamples)
{
  FakeFrame fake;
  fake.scene->path_time = std::chrono::microseconds(20);  // a slow scene: 16 s in all
  const auto frame = fake.make(128, 128);
  const auto job = submit(frame, with_samples(100));
  EXPECT_EQ(error_of([&] { job->wait(300'000'000); }).first, GPURT_ERROR_TIMEOUT);
  const auto start = Clock::now();
  job->cancel();
  EXPECT_EQ(error_of([&] { job->wait(GPURT_WAIT_FOREVER); }).first, GPURT_ERROR_CANCELLED);
  EXPECT_LT(seconds_since(start), 0.5);  // the promise of gpurt_job_cancel
  const auto counts = read<uint32_t>(*frame, GPURT_OUTPUT_SAMPLE_COUNT);
  EXPECT_GT(*std::max_element(counts.begin(), counts.end()), 0u);
  EXPECT_LT(*std::min_element(counts.begin(), counts.end()), 100u);

  // It goes on to the same bits.
  fake.scene->path_time = {};
  render(frame, 100);
  const auto once = fake.make(128, 128);
  render(once, 100);
  EXPECT_EQ(read_all(*frame), read_all(*once));
}

TEST(Job, JobsOfAFrameRunInOrderAndReleaseCancels)
{
  FakeFrame fake;
  fake.scene->path_time = std::chrono::microseconds(2);
  const auto frame = fake.make(64, 64);
  const auto first = submit(frame, with_samples(4)), second = submit(frame, with_samples(8));
  auto third = submit(frame, with_samples(100000));
  EXPECT_EQ(error_of([&] { frame->save("/tmp/never.jpg"); }).first, GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_TRUE(contains(error_of([&] { frame->merge(*fake.make(64, 64)); }).second, "still runs"));
  second->wait(GPURT_WAIT_FOREVER);
  EXPECT_NO_THROW(first->wait(0));
  EXPECT_EQ(first->progress(), 1);
  const auto start = Clock::now();
  const auto fourth = submit(frame, with_samples(100000));
  fourth->cancel();  // while it is queued
  EXPECT_EQ(error_of([&] { fourth->wait(GPURT_WAIT_FOREVER); }).first, GPURT_ERROR_CANCELLED);
  third.reset();
  EXPECT_LT(seconds_since(start), 1.0);
  render(frame, 8);  // the queue is empty again
}

TEST(Job, ChecksItsDescription)
{
  FakeFrame fake;
  const auto frame = fake.make(32, 32);
  const auto refused = [&](auto &&change, std::vector<gpurt_tile> tiles = {}) {
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    change(desc);
    return error_of([&] { Job::submit(frame, desc, tiles); });
  };
  EXPECT_EQ(refused([](auto &d) { d.pipeline = GPURT_PIPELINE_REYES; }).first, GPURT_ERROR_UNSUPPORTED);
  EXPECT_EQ(refused([](auto &d) { d.pipeline = gpurt_pipeline(9); }).first, GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(refused([](auto &d) { d.target_error = -1; }).first, GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(refused([](auto &d) { d.time_limit_s = std::nan(""); }).first, GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_TRUE(contains(refused([](auto &d) { d.target_error = 0.1f; }, {{0, 0, 16, 32}}).second,
                       "cover only 512 of its 1024 pixels"));
  render(frame, 1);
  EXPECT_TRUE(contains(refused([](auto &d) { d.max_depth = 5; }).second, "holds samples of depth 17"));
}

TEST(Job, AFailingDeviceFailsTheJobAndKeepsTheFrameUsable)
{
  FakeFrame fake;
  fake.scene->fail_after = 2;
  const auto frame = fake.make(32, 32);
  const auto job = submit(frame, with_samples(64));
  const auto [result, text] = error_of([&] { job->wait(GPURT_WAIT_FOREVER); });
  EXPECT_EQ(result, GPURT_ERROR_DEVICE);
  EXPECT_EQ(text, "the fake device fell over");
  fake.scene->fail_after = 0;
  render(frame, 64);
  EXPECT_EQ(statistics(*frame).samples_per_pixel, 64u);
}

TEST(Job, ReportsProgressFromOneThreadAtATime)
{
  struct Reports {
    std::atomic<int> inside{0};
    int calls = 0;
    double last_share = 0;
    bool is_sound = true;
  } reports;
  FakeFrame fake;
  fake.scene->path_time = std::chrono::microseconds(4);
  const auto frame = fake.make(64, 64);
  gpurt_render_desc desc = with_samples(40);
  desc.progress_user = &reports;
  desc.progress = [](void *user, double done, double total) {
    auto &r = *static_cast<Reports *>(user);
    r.is_sound &= ++r.inside == 1 && done <= total && done / total >= r.last_share - 1e-9;
    r.last_share = done / total;
    r.calls++;
    r.inside--;
  };
  submit(frame, desc)->wait(GPURT_WAIT_FOREVER);
  EXPECT_TRUE(reports.is_sound);
  EXPECT_GT(reports.calls, 2);
  EXPECT_EQ(reports.last_share, 1);
}

TEST(Job, TimeModeEndsAfterTheLastWholePassThatFits)
{
  FakeFrame fake;
  fake.scene->path_time = std::chrono::microseconds(5);  // 10 ms a sample of the frame on two threads
  const auto frame = fake.make(64, 64);
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.time_limit_s = 0.6;
  const auto start = Clock::now();
  submit(frame, desc)->wait(GPURT_WAIT_FOREVER);
  const double seconds = seconds_since(start);
  EXPECT_LT(seconds, 0.75);  // machines under test are busy; alone it ends in time
  EXPECT_GT(seconds, 0.3);
  const auto counts = read<uint32_t>(*frame, GPURT_OUTPUT_SAMPLE_COUNT);
  EXPECT_EQ(*std::min_element(counts.begin(), counts.end()), *std::max_element(counts.begin(), counts.end()));
  // Running again with what it chose gives the same image.
  const auto again = fake.make(64, 64);
  fake.scene->path_time = {};
  render(again, counts[0]);
  EXPECT_EQ(read_all(*again), read_all(*frame));
}

TEST(Job, ErrorModeStopsAtACheckpointAndReproduces)
{
  FakeFrame fake([](uint64_t seed, uint32_t x, uint32_t y, uint64_t s) {
    return vec3(float(2 * uniform(seed, x, y, s)));  // mean 1, variance 1/3: relMSE 1 / (3.03 n)
  });
  const auto frame = fake.make(64, 64);
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.target_error = 0.005f;  // n = 66
  submit(frame, desc)->wait(GPURT_WAIT_FOREVER);
  const gpurt_statistics s = statistics(*frame);
  EXPECT_EQ(s.samples_per_pixel, 96u);
  EXPECT_LT(s.estimated_error, 0.005);
  EXPECT_TRUE(contains(s.reason, "below 0.005"));
  const auto again = fake.make(64, 64);
  render(again, 20);
  submit(again, desc)->wait(GPURT_WAIT_FOREVER);
  EXPECT_EQ(read_all(*again), read_all(*frame));
}

}  // namespace
