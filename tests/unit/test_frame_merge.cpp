// Frames are sums: parts merge, continue, and travel through files to the same bits.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "test_frame_fake.h"

namespace {

using namespace gpurt_test;
namespace fs = std::filesystem;

// 37 x 29 leaves partial tiles and rows of odd length.
constexpr uint32_t width = 37, height = 29;

class FrameMerge : public testing::Test {
 protected:
  void SetUp() override
  {
    const auto *test = testing::UnitTest::GetInstance()->current_test_info();
    folder = fs::path(testing::TempDir()) / (std::string("gpurt_") + test->name());
    fs::remove_all(folder);
    fs::create_directories(folder);
  }
  void TearDown() override { fs::remove_all(folder); }
  std::string file(const char *name) const { return (folder / name).string(); }

  fs::path folder;
  FakeFrame fake;
};

TEST_F(FrameMerge, ContinuingTilesAndTileSizesChangeNoBits)
{
  const auto once = fake.make(width, height);
  render(once, 40);
  const auto parts = fake.make(width, height);
  render(parts, 3, {{0, 0, 20, 29}});
  render(parts, 17, {{20, 0, 37, 11}, {20, 11, 37, 29}}, 8);
  render(parts, 40, {}, 128);
  EXPECT_EQ(read_all(*once), read_all(*parts));
  EXPECT_EQ(statistics(*parts).num_samples, uint64_t(width) * height * 40);
  EXPECT_EQ(statistics(*parts).samples_per_pixel, 40u);
}

TEST_F(FrameMerge, AnyOrderOfPartsGivesTheBitsOfOneRun)
{
  const auto once = fake.make(width, height);
  render(once, 30);
  const auto expected = read_all(*once);

  std::vector<int> order = {0, 1, 2, 3};
  do {
    const auto sum = fake.make(width, height);
    for (int part : order) {
      const uint32_t first[] = {0, 5, 6, 20}, count[] = {5, 1, 14, 10};
      const auto frame = fake.make(width, height, first[part]);
      render(frame, count[part]);
      sum->merge(*frame);
    }
    ASSERT_EQ(read_all(*sum), expected);
  } while (std::next_permutation(order.begin(), order.end()));
}

TEST_F(FrameMerge, RefusesToCountSamplesTwice)
{
  const auto a = fake.make(width, height), b = fake.make(width, height, 3);
  render(a, 4);  // 0..3
  render(b, 2);  // 3..4
  const auto before = read_all(*a);
  const auto [result, text] = error_of([&] { a->merge(*b); });
  EXPECT_EQ(result, GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_TRUE(contains(text, "twice"));
  EXPECT_TRUE(contains(text, "pixel (0, 0) it has samples 3..4 and the frame samples 0..3"));
  EXPECT_EQ(read_all(*a), before);
  EXPECT_EQ(error_of([&] { a->merge(*a); }).first, GPURT_ERROR_INVALID_ARGUMENT);
}

TEST_F(FrameMerge, SeesASampleTwiceBehindAGapAndInOnePixelAlone)
{
  const auto low = fake.make(width, height), high = fake.make(width, height, 64),
             pixel = fake.make(width, height, 70);
  render(low, 32);
  render(high, 32);
  render(pixel, 1, {{5, 6, 6, 7}});
  low->merge(*high);  // 0..31 and 64..95
  EXPECT_TRUE(contains(error_of([&] { low->merge(*high); }).second, "0..31 64..95"));
  EXPECT_TRUE(contains(error_of([&] { low->merge(*pixel); }).second, "pixel (5, 6)"));
}

TEST_F(FrameMerge, AFrameWithGapsIsReadAndMergedButNotContinued)
{
  const auto sum = fake.make(width, height), high = fake.make(width, height, 8),
             middle = fake.make(width, height, 4);
  render(sum, 4);
  render(high, 4);
  render(middle, 4);
  sum->merge(*high);
  EXPECT_EQ(statistics(*sum).samples_per_pixel, 8u);
  EXPECT_TRUE(contains(error_of([&] { render(sum, 16); }).second, "have gaps"));
  sum->merge(*middle);
  render(sum, 16);
  const auto once = fake.make(width, height);
  render(once, 16);
  EXPECT_EQ(read_all(*sum), read_all(*once));
}

TEST_F(FrameMerge, RefusesOtherImages)
{
  const auto frame = fake.make(width, height);
  render(frame, 2);
  const auto refused = [&](const std::shared_ptr<Frame> &other) {
    return error_of([&] { frame->merge(*other); }).second;
  };
  EXPECT_TRUE(contains(refused(fake.make(width, height + 1)), "size is 37 x 30"));
  EXPECT_TRUE(contains(refused(fake.make(width, height, 0, 8)), "seed is 8"));
  EXPECT_TRUE(contains(refused(fake.make(width, height, 0, 7, 1)), "outputs"));
  FakeFrame other;
  other.compiled->hash = 0x77;
  EXPECT_TRUE(contains(refused(other.make(width, height)), "scene hash is 0000000000000077"));
  FakeFrame embree;
  embree.scene->facts.accel = Accel::Embree;
  EXPECT_TRUE(contains(refused(embree.make(width, height)), "embree"));
  const auto deep = fake.make(width, height, 2);
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.samples_per_pixel = 1;
  desc.max_depth = 3;
  Job::submit(deep, desc, {})->wait(GPURT_WAIT_FOREVER);
  EXPECT_TRUE(contains(refused(deep), "max_depth is 3, that of the frame is 17"));
}

TEST_F(FrameMerge, StateFilesKeepEveryBit)
{
  const auto frame = fake.make(width, height);
  render(frame, 5);
  render(frame, 9, {{3, 4, 30, 20}});  // uneven counts
  frame->save(file("a.gpurt"));
  const auto loaded = fake.make(width, height);
  loaded->load_state(file("a.gpurt"));
  EXPECT_EQ(read_all(*loaded), read_all(*frame));
  EXPECT_EQ(statistics(*loaded).num_samples, statistics(*frame).num_samples);
  EXPECT_EQ(statistics(*loaded).largest_sample, statistics(*frame).largest_sample);
  EXPECT_EQ(statistics(*loaded).max_depth, 17u);
  render(frame, 12);
  render(loaded, 12);
  EXPECT_EQ(read_all(*loaded), read_all(*frame));
  EXPECT_TRUE(contains(error_of([&] { loaded->load_state(file("a.gpurt")); }).second, "twice"));
  // Nothing but the file: no temporary name is left.
  EXPECT_EQ(std::distance(fs::directory_iterator(folder), {}), 1);
}

TEST_F(FrameMerge, DamagedAndForeignFilesAreRefusedWithOneLine)
{
  const auto frame = fake.make(5, 3);
  render(frame, 4);
  frame->save(file("good.gpurt"));
  std::ifstream in(file("good.gpurt"), std::ios::binary);
  const std::string good((std::istreambuf_iterator<char>(in)), {});
  const auto target = fake.make(5, 3);
  const auto untouched = read_all(*target);
  const auto load = [&](const std::string &bytes) {
    std::ofstream(file("bad.gpurt"), std::ios::binary) << bytes;
    return error_of([&] { target->load_state(file("bad.gpurt")); });
  };
  // Every byte counts: all of the header, then every seventh.
  for (size_t i = 0; i < good.size(); i += i < 300 ? 1 : 7) {
    std::string bad = good;
    bad[i] = char(bad[i] ^ 0x20);
    const auto [result, text] = load(bad);
    ASSERT_EQ(result, GPURT_ERROR_IO) << "byte " << i << ": " << text;
    ASSERT_TRUE(contains(text, "bad.gpurt"));
    ASSERT_EQ(text.find('\n'), std::string::npos);
  }
  for (size_t length : {size_t(0), size_t(7), size_t(200), good.size() / 2, good.size() - 1}) {
    ASSERT_EQ(load(good.substr(0, length)).first, GPURT_ERROR_IO) << length;
  }
  EXPECT_TRUE(contains(load("this is some text, long enough for a header" + std::string(300, ' ')).second,
                       "not a gpurt state file"));
  EXPECT_TRUE(contains(error_of([&] { target->load_state(file("absent.gpurt")); }).second, "No such file"));
  EXPECT_EQ(read_all(*target), untouched);
  target->load_state(file("good.gpurt"));
  EXPECT_EQ(read_all(*target), read_all(*frame));
}

TEST_F(FrameMerge, OutputsMeanWhatTheHeaderSays)
{
  FakeFrame steps([](uint64_t, uint32_t x, uint32_t, uint64_t s) {
    return Vec3f{float(x), s < 3 ? 1.0f : 5.0f, s % 2 ? 4.0f : 2.0f};
  });
  const auto frame = steps.make(4, 2);
  render(frame, 4, {{0, 0, 4, 1}});
  const auto color = read<float>(*frame, GPURT_OUTPUT_COLOR);
  EXPECT_EQ(color[3], 1);
  EXPECT_EQ(color[4], 2);  // (1 + 1 + 1 + 5) / 4
  EXPECT_EQ(color[5], 3);
  const auto variance = read<float>(*frame, GPURT_OUTPUT_VARIANCE);
  EXPECT_EQ(variance[0], 0);
  EXPECT_EQ(variance[1], 1);  // halves 1 and 3: (1 - 3)^2 / 4
  EXPECT_EQ(variance[2], 1);
  EXPECT_EQ(read<float>(*frame, GPURT_OUTPUT_ALPHA), (std::vector<float>{1, 0, 1, 0, 0, 0, 0, 0}));
  EXPECT_EQ(read<uint32_t>(*frame, GPURT_OUTPUT_SAMPLE_COUNT),
            (std::vector<uint32_t>{4, 4, 4, 4, 0, 0, 0, 0}));
  EXPECT_EQ(read<float>(*frame, GPURT_OUTPUT_DEPTH),
            (std::vector<float>{0, infinity, 2, infinity, 0, 0, 0, 0}));
  EXPECT_EQ(read<uint32_t>(*frame, GPURT_OUTPUT_PRIMITIVE)[2], 2u);
  EXPECT_EQ(read<uint32_t>(*frame, GPURT_OUTPUT_PRIMITIVE)[1], GPURT_INVALID_ID);
  EXPECT_EQ(read<uint32_t>(*frame, GPURT_OUTPUT_PRIMITIVE)[5], GPURT_INVALID_ID);
  EXPECT_EQ(read<float>(*frame, GPURT_OUTPUT_NORMAL)[2], 0.5f);
  EXPECT_LT(statistics(*frame).estimated_error, 0);  // not known: half of the frame has no samples

  // Unequal halves: the samples of one are 0, the others 3 apart from it, na = 1, nb = 2.
  FakeFrame odd([](uint64_t, uint32_t, uint32_t, uint64_t s) { return vec3(s % 2 ? 0.0f : 3.0f); });
  const auto uneven = odd.make(1, 1);
  render(uneven, 1);
  EXPECT_EQ(read<float>(*uneven, GPURT_OUTPUT_VARIANCE)[0], infinity);
  render(uneven, 3);
  EXPECT_FLOAT_EQ(read<float>(*uneven, GPURT_OUTPUT_VARIANCE)[0], 9 * 1.0f * 2 / 9);
}

TEST_F(FrameMerge, NonFiniteSamplesAreCountedAndLeftOut)
{
  FakeFrame bad([](uint64_t, uint32_t x, uint32_t, uint64_t s) {
    return vec3(x == 1 && s == 2 ? infinity : x == 2 && s == 0 ? std::nanf("") : 1.0f);
  });
  const auto frame = bad.make(3, 1);
  render(frame, 4);
  EXPECT_EQ(statistics(*frame).num_nonfinite, 2u);
  EXPECT_EQ(read<uint32_t>(*frame, GPURT_OUTPUT_SAMPLE_COUNT), (std::vector<uint32_t>{4, 3, 3}));
  EXPECT_EQ(read<float>(*frame, GPURT_OUTPUT_COLOR), std::vector<float>(9, 1.0f));
  render(frame, 6);  // goes on at sample 4 everywhere
  EXPECT_EQ(read<uint32_t>(*frame, GPURT_OUTPUT_SAMPLE_COUNT), (std::vector<uint32_t>{6, 5, 5}));
  frame->save(file("bad.gpurt"));
  const auto loaded = bad.make(3, 1);
  loaded->load_state(file("bad.gpurt"));
  EXPECT_EQ(read_all(*loaded), read_all(*frame));
}

TEST_F(FrameMerge, ChecksItsDescription)
{
  const auto refused = [&](auto &&change) {
    gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
    change(desc);
    return error_of([&] { Frame({fake.scene, fake.compiled, fake.memory, 1, 0}, desc); });
  };
  EXPECT_TRUE(contains(refused([](auto &d) { d.camera = 1; }).second, "has 1 cameras"));
  EXPECT_TRUE(contains(refused([](auto &d) { d.width = 65536; }).second, "width is 65536"));
  EXPECT_TRUE(contains(refused([](auto &d) { d.outputs = 1u << GPURT_OUTPUT_COUNT; }).second, "outputs"));
  EXPECT_EQ(refused([](auto &d) { d.outputs = 1u << GPURT_OUTPUT_TIME; }).first, GPURT_ERROR_UNSUPPORTED);
  fake.memory = std::make_shared<MemoryTracker>(1 << 20);
  const auto [result, text] = refused([](auto &d) { d.width = 512; });
  EXPECT_EQ(result, GPURT_ERROR_OUT_OF_MEMORY);
  EXPECT_TRUE(contains(text, "film"));
  EXPECT_EQ(fake.memory->used(), 0u);
  fake.compiled->cameras[0].width = 20;
  const auto frame = fake.make(0, 10);
  EXPECT_EQ(frame->settings().width, 20u);
  EXPECT_TRUE(contains(error_of([&] {
                         float x;
                         frame->read(GPURT_OUTPUT_ALPHA, &x, 4);
                       }).second,
                       "800 bytes"));
  EXPECT_TRUE(contains(error_of([&] { fake.make(2, 2, 0, 0, 0)->output_bytes(GPURT_OUTPUT_DEPTH); }).second,
                       "without depth"));
  EXPECT_TRUE(contains(error_of([&] { frame->save(file("a.jpg")); }).second, ".jpg"));
  EXPECT_EQ(error_of([&] { frame->save("/nowhere/at/all/a.png"); }).first, GPURT_ERROR_IO);
}

}  // namespace
