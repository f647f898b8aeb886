// EXR and PNG files hold what was written; metrics agree with numbers worked out by hand.
#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputFile.h>
#include <ImfStringAttribute.h>
#include <gtest/gtest.h>
#include <png.h>
#include <sys/resource.h>

#include <csignal>
#include <filesystem>
#include <fstream>

#include "image/exr.h"
#include "image/metrics.h"
#include "image/png.h"
#include "test_frame_fake.h"

namespace {

using namespace gpurt_test;
namespace fs = std::filesystem;

class ImageFiles : public testing::Test {
 protected:
  void SetUp() override
  {
    folder = fs::path(testing::TempDir()) /
             (std::string("gpurt_") + testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder);
    fs::create_directories(folder);
  }
  void TearDown() override { fs::remove_all(folder); }
  std::string file(const char *name) const { return (folder / name).string(); }
  size_t num_files() const { return size_t(std::distance(fs::directory_iterator(folder), {})); }

  fs::path folder;
};

// One channel of an EXR file, read with OpenEXR alone.
template <class T>
std::vector<T> read_channel(const std::string &path, const char *name)
{
  Imf::InputFile in(path.c_str());
  const Imath::Box2i window = in.header().dataWindow();
  const size_t width = size_t(window.max.x + 1), height = size_t(window.max.y + 1);
  const Imf::Channel *channel = in.header().channels().findChannel(name);
  const auto type = std::is_same_v<T, float> ? Imf::FLOAT : Imf::UINT;
  if (!channel || channel->type != type) return {};
  std::vector<T> values(width * height);
  Imf::FrameBuffer buffer;
  buffer.insert(name, Imf::Slice(type, reinterpret_cast<char *>(values.data()), 4, 4 * width));
  in.setFrameBuffer(buffer);
  in.readPixels(0, int(height) - 1);
  return values;
}

TEST_F(ImageFiles, ExrHoldsEveryOutputByNameAndValue)
{
  FakeFrame fake;
  const auto frame = fake.make(33, 150);  // three blocks of rows
  render(frame, 5);
  frame->save(file("a.exr"));
  const auto expect_plane = [&](gpurt_output output, std::vector<const char *> names) {
    const auto all = read<float>(*frame, output);
    for (size_t c = 0; c < names.size(); ++c) {
      std::vector<float> plane;
      for (size_t i = c; i < all.size(); i += names.size()) plane.push_back(all[i]);
      EXPECT_EQ(read_channel<float>(file("a.exr"), names[c]), plane) << names[c];
    }
  };
  expect_plane(GPURT_OUTPUT_COLOR, {"R", "G", "B"});
  expect_plane(GPURT_OUTPUT_ALPHA, {"A"});
  expect_plane(GPURT_OUTPUT_DEPTH, {"Z"});
  expect_plane(GPURT_OUTPUT_NORMAL, {"normal.X", "normal.Y", "normal.Z"});
  expect_plane(GPURT_OUTPUT_ALBEDO, {"albedo.R", "albedo.G", "albedo.B"});
  expect_plane(GPURT_OUTPUT_POSITION, {"position.X", "position.Y", "position.Z"});
  expect_plane(GPURT_OUTPUT_VARIANCE, {"variance.R", "variance.G", "variance.B"});
  EXPECT_EQ(read_channel<uint32_t>(file("a.exr"), "primitive"),
            read<uint32_t>(*frame, GPURT_OUTPUT_PRIMITIVE));
  EXPECT_EQ(read_channel<uint32_t>(file("a.exr"), "instance"), read<uint32_t>(*frame, GPURT_OUTPUT_INSTANCE));
  EXPECT_EQ(read_channel<uint32_t>(file("a.exr"), "sampleCount"),
            read<uint32_t>(*frame, GPURT_OUTPUT_SAMPLE_COUNT));

  Imf::InputFile in(file("a.exr").c_str());
  const auto text = [&](const char *name) {
    return in.header().typedAttribute<Imf::StringAttribute>(name).value();
  };
  EXPECT_EQ(text("gpurt:version"), "0.1.0");
  EXPECT_EQ(text("gpurt:seed"), "7");
  EXPECT_EQ(text("gpurt:samples"), "5");
  EXPECT_EQ(text("gpurt:sceneHash"), "0000000000001234");
  EXPECT_TRUE(contains(text("gpurt:settings"), "max_depth=17"));
  EXPECT_EQ(num_files(), 1u);

  const ImageRgba image = read_exr_rgba(file("a.exr"));
  ASSERT_EQ(image.width, 33u);
  ASSERT_EQ(image.height, 150u);
  const auto color = read<float>(*frame, GPURT_OUTPUT_COLOR), alpha = read<float>(*frame, GPURT_OUTPUT_ALPHA);
  for (size_t i = 0; i < alpha.size(); ++i) {
    for (size_t c = 0; c < 3; ++c) ASSERT_EQ(image.pixels[4 * i + c], color[3 * i + c]);
    ASSERT_EQ(image.pixels[4 * i + 3], alpha[i]);
  }
}

TEST_F(ImageFiles, ReadsGreyAndMissingAlpha)
{
  const std::vector<ExrChannel> channels = {{"Y"}};
  write_exr(file("grey.exr"), 2, 1, channels, {}, [](uint32_t, uint32_t, const std::vector<void *> &planes) {
    static_cast<float *>(planes[0])[0] = 0.25f;
    static_cast<float *>(planes[0])[1] = 8;
  });
  EXPECT_EQ(read_exr_rgba(file("grey.exr")).pixels, (std::vector<float>{0.25f, 0.25f, 0.25f, 1, 8, 8, 8, 1}));
}

TEST_F(ImageFiles, RefusesWhatIsNoImage)
{
  EXPECT_TRUE(contains(error_of([&] { read_exr_rgba(file("absent.exr")); }).second, "No such file"));
  EXPECT_TRUE(contains(error_of([&] { read_exr_rgba(folder.string()); }).second, "is a folder"));
  std::ofstream(file("text.exr")) << "certainly not an image";
  const auto [result, text] = error_of([&] { read_exr_rgba(file("text.exr")); });
  EXPECT_EQ(result, GPURT_ERROR_IO);
  EXPECT_TRUE(contains(text, "text.exr: not a readable EXR file"));
  EXPECT_EQ(text.find('\n'), std::string::npos);
  write_exr(file("depth.exr"), 1, 1, {{"Z"}, {"id", ExrType::Uint}}, {},
            [](uint32_t, uint32_t, const auto &) {});
  EXPECT_TRUE(contains(error_of([&] { read_exr_rgba(file("depth.exr")); }).second, "it has Z, id"));
  // A truncated file ends in an error, whatever is left of it.
  write_exr(file("good.exr"), 40, 40, {{"R"}, {"G"}, {"B"}}, {},
            [](uint32_t, uint32_t, const std::vector<void *> &planes) {
              for (void *plane : planes) {
                for (int i = 0; i < 1600; ++i) static_cast<float *>(plane)[i] = float(uniform(1, 2, 3, i));
              }
            });
  const auto size = fs::file_size(file("good.exr"));
  for (uintmax_t length = 0; length < size; length += 97) {
    fs::copy_file(file("good.exr"), file("cut.exr"), fs::copy_options::overwrite_existing);
    fs::resize_file(file("cut.exr"), length);
    ASSERT_EQ(error_of([&] { read_exr_rgba(file("cut.exr")); }).first, GPURT_ERROR_IO) << length;
  }
}

TEST_F(ImageFiles, AFailedWriteLeavesTheOldFileAndNoOther)
{
  std::ofstream(file("a.exr")) << "old";
  const auto broken = [](uint32_t, uint32_t, const std::vector<void *> &) {
    fail(GPURT_ERROR_INTERNAL, "no rows");
  };
  EXPECT_EQ(error_of([&] { write_exr(file("a.exr"), 1, 1, {{"R"}}, {}, broken); }).first,
            GPURT_ERROR_INTERNAL);
  EXPECT_EQ(error_of([&] {
              write_png(file("a.png"), 1, 1, [](uint32_t, float *) { fail(GPURT_ERROR_INTERNAL, "no row"); });
            }).first,
            GPURT_ERROR_INTERNAL);
  EXPECT_EQ(num_files(), 1u);
  std::string text;
  std::ifstream(file("a.exr")) >> text;
  EXPECT_EQ(text, "old");
  const auto [result, message] =
      error_of([&] { write_png(file("no/folder.png"), 1, 1, [](uint32_t, float *) {}); });
  EXPECT_EQ(result, GPURT_ERROR_IO);
  EXPECT_TRUE(contains(message, "no/folder.png: cannot be created: No such file"));
}

TEST_F(ImageFiles, AFullDiskIsAnErrorAndLeavesNothing)
{
  // A limit on the size of files stands for the end of the disk.
  FakeFrame fake;
  const auto frame = fake.make(64, 64);
  render(frame, 1);
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before;
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  rlimit small = before;
  small.rlim_cur = 5000;
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  for (const char *name : {"a.exr", "a.gpurt"}) {
    const auto [result, text] = error_of([&] { frame->save(file(name)); });
    EXPECT_EQ(result, GPURT_ERROR_IO) << name;
    EXPECT_TRUE(contains(text, std::string(name) + ": cannot be written"));
  }
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  EXPECT_EQ(num_files(), 0u);
}

TEST(Tonemap, KnownValues)
{
  EXPECT_EQ(tonemap(0), 0);
  EXPECT_EQ(tonemap(-1), 0);
  EXPECT_EQ(tonemap(std::nanf("")), 0);
  EXPECT_FLOAT_EQ(tonemap(infinity), 1);
  EXPECT_FLOAT_EQ(tonemap(1), 0.735356983f);                   // sRGB of 1/2
  EXPECT_FLOAT_EQ(tonemap(0.001f), 12.92f * 0.001f / 1.001f);  // the linear part
}

TEST_F(ImageFiles, PngHoldsTonemappedBytes)
{
  const float rows[2][6] = {{0, 1, 3, 0.25f, 1e30f, -2}, {0.001f, 0.01f, 0.1f, 10, 100, 0.5f}};
  write_png(file("a.png"), 2, 2, [&](uint32_t y, float *rgb) { std::copy(rows[y], rows[y] + 6, rgb); });
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  ASSERT_TRUE(png_image_begin_read_from_file(&image, file("a.png").c_str()));
  ASSERT_EQ(image.width, 2u);
  ASSERT_EQ(image.height, 2u);
  image.format = PNG_FORMAT_RGB;
  std::vector<uint8_t> bytes(PNG_IMAGE_SIZE(image));
  ASSERT_TRUE(png_image_finish_read(&image, nullptr, bytes.data(), 0, nullptr));
  // 255 * srgb(x / (1 + x)), rounded, worked out in double precision elsewhere.
  EXPECT_EQ(bytes, (std::vector<uint8_t>{0, 188, 225, 124, 255, 0, 3, 25, 85, 245, 254, 156}));
  EXPECT_EQ(num_files(), 1u);
}

TEST(Metrics, AgreeWithNumbersWorkedOutByHand)
{
  const std::vector<float> image = {1, 0, 0, /**/ 2, 2, 2}, reference = {0, 0, 0, /**/ 2, 1, 2};
  const ImageErrors e = compare_images(image.data(), reference.data(), 2);
  // (1 / 0.01 + 1 / 1.01) / 6
  EXPECT_NEAR(e.relmse, (100 + 1 / 1.01) / 6, 1e-12);
  EXPECT_NEAR(e.trimmed, 1 / 1.01 / 3, 1e-12);  // 0.1 % of two pixels is rounded up to one
  EXPECT_NEAR(e.bias, 2.0 / 6, 1e-15);
  EXPECT_NEAR(e.bias_rgb[0], 0.5, 1e-15);
  EXPECT_NEAR(e.bias_relative, (2.0 / 6) / (5.0 / 6), 1e-15);
  EXPECT_NEAR(compare_images(image.data(), reference.data(), 2, 0).trimmed, e.relmse, 1e-12);
  EXPECT_EQ(error_of([&] { compare_images(image.data(), reference.data(), 0); }).first,
            GPURT_ERROR_INVALID_ARGUMENT);
}

TEST(Metrics, TilesCoverTheImage)
{
  const std::vector<float> image(10 * 9 * 3, 3), reference(10 * 9 * 3, 1);
  const auto tiles = compare_tiles(image.data(), reference.data(), 10, 9);
  ASSERT_EQ(tiles.size(), 4u);
  EXPECT_EQ(tiles[3].x0, 8u);
  EXPECT_EQ(tiles[3].x1, 10u);
  EXPECT_EQ(tiles[3].y1, 9u);
  for (const TileErrors &tile : tiles) {
    EXPECT_EQ(tile.mean[1], 3);
    EXPECT_EQ(tile.reference_mean[2], 1);
    EXPECT_NEAR(tile.relmse, 4 / 1.01, 1e-12);
  }
}

}  // namespace
