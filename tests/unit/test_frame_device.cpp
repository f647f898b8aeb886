// Frames whose sums are on a device: a fake one, whose film can be lost, or have no room.
#include <gtest/gtest.h>

#include <filesystem>

#include "core/path/film_values.h"
#include "test_frame_fake.h"

namespace {

using namespace gpurt_test;

constexpr uint32_t width = 37, height = 29;

// What happens to the films of a device, and what it does to them.
struct FakeDevice {
  std::atomic<uint32_t> num_films{0}, num_uploads{0}, num_downloads{0}, num_resolved{0};
  bool is_lost = false, is_lost_midway = false;
  bool is_lost_after_add = false, is_lost_midway_after_add = false;
  bool has_room = true;
};

class FakeFilm final : public DeviceFilm {
 public:
  FakeFilm(FakeDevice &device, uint32_t w, uint32_t h, uint32_t outputs) : device_(device)
  {
    sums_.reset(w, h, outputs);
    device_.num_films++;
  }
  ~FakeFilm() override { device_.num_films--; }
  void upload(const TileFilm &from) override
  {
    check();
    device_.num_uploads++;
    sums_ = from;
  }
  void download(TileFilm &to, bool &has_begun) const override
  {
    if (device_.is_lost_midway) {
      has_begun = true;
      to.pixels[0].num_samples[0] = 77;
      fail(GPURT_ERROR_DEVICE, "the fake device is lost");
    }
    check();
    device_.num_downloads++;
    has_begun = true;
    to = sums_;
  }
  bool resolve(gpurt_output output, void *data, uint64_t) const override
  {
    check();
    if (output > GPURT_OUTPUT_VARIANCE) return false;
    device_.num_resolved++;
    const uint64_t num_pixels = sums_.pixels.size();
    resolve_row(output,
                {sums_.pixels.data(), sums_.features.data(), sums_.first_hits.data(), nullptr, nullptr,
                 PhotonEstimator::Memoryless},
                uint32_t(num_pixels), data);
    return true;
  }
  FilmFinds add(const WorkUnit &unit, const TileFilm &tile)
  {
    add_film(sums_, tile, unit.x0, unit.y0);
    FilmFinds found;
    for (const PixelSums &p : tile.pixels) found.num_nonfinite += p.num_nonfinite;
    for (const PixelSums &p : sums_.pixels) found.num_saturated += num_saturated_sums(p);
    device_.is_lost = device_.is_lost_after_add;
    device_.is_lost_midway = device_.is_lost_midway_after_add;
    return found;
  }

 private:
  void check() const
  {
    if (device_.is_lost) fail(GPURT_ERROR_DEVICE, "the fake device is lost");
  }
  FakeDevice &device_;
  TileFilm sums_;
};

class DeviceScene final : public FakeScene {
 public:
  using FakeScene::FakeScene;
  std::unique_ptr<DeviceFilm> make_film(uint32_t w, uint32_t h, uint32_t outputs) const override
  {
    return std::make_unique<FakeFilm>(device, w, h, outputs);
  }
  void render(const RenderPass &pass) const override
  {
    last_outputs = pass.outputs;
    RenderPass part = pass;
    if (pass.on_device != nullptr) {
      auto &film = static_cast<FakeFilm &>(*pass.on_device->film);
      part.deliver = [&](const WorkUnit &unit, const TileFilm &tile, const RenderCounters &counters) {
        pass.on_device->deliver({&unit, 1}, counters, [&] { return film.add(unit, tile); });
      };
    }
    if (device.is_lost) fail(GPURT_ERROR_DEVICE, "the fake device is lost");
    if (!device.has_room && pass.on_device != nullptr) fail(GPURT_ERROR_OUT_OF_MEMORY, "no room for a film");
    FakeScene::render(part);
  }

  mutable FakeDevice device;
  mutable uint32_t last_outputs = 0;
};

class FrameOnDevice : public testing::Test {
 protected:
  FrameOnDevice()
  {
    scene->facts = fake.scene->facts;
    on_device.scene = scene;
    on_device.compiled = fake.compiled;
  }
  std::shared_ptr<DeviceScene> scene = std::make_shared<DeviceScene>();
  FakeDevice &device = scene->device;
  FakeFrame fake, on_device;
};

TEST_F(FrameOnDevice, HasTheBitsOfTheHostAndIsReadWithoutIt)
{
  const auto expected = fake.make(width, height), frame = on_device.make(width, height);
  EXPECT_EQ(read_all(*frame), read_all(*expected));  // no samples
  render(expected, 7);
  render(frame, 7);
  device.num_downloads = 0;
  EXPECT_EQ(read_all(*frame), read_all(*expected));
  EXPECT_EQ(device.num_downloads, 0u);
  EXPECT_EQ(device.num_resolved, 10u);
  // In any tiles, continued.
  const auto parts = on_device.make(width, height);
  render(parts, 3, {{0, 0, 20, 29}});
  render(parts, 5, {{20, 0, 37, 11}, {20, 11, 37, 29}}, 8);
  render(parts, 7, {}, 128);
  EXPECT_EQ(read_all(*parts), read_all(*expected));
  EXPECT_EQ(device.num_films, 2u);
}

TEST_F(FrameOnDevice, CountsWhatTheHostCounts)
{
  const auto sample = [](uint64_t seed, uint32_t x, uint32_t y, uint64_t s) {
    return x == 3 && s % 2 == 0 ? Vec3f{infinity, 0, 0} : noise(seed, x, y, s);
  };
  FakeFrame host(sample);
  on_device.scene = std::make_shared<DeviceScene>(sample);
  const auto expected = host.make(width, height), frame = on_device.make(width, height);
  render(expected, 6);
  render(frame, 6);
  const gpurt_statistics a = statistics(*expected), b = statistics(*frame);
  EXPECT_EQ(a.num_nonfinite, uint64_t(height) * 3);
  EXPECT_EQ(b.num_nonfinite, a.num_nonfinite);
  EXPECT_EQ(b.num_samples, a.num_samples);
  EXPECT_EQ(b.samples_per_pixel, a.samples_per_pixel);
  EXPECT_EQ(b.estimated_error, a.estimated_error);
  EXPECT_EQ(read_all(*frame), read_all(*expected));
}

TEST_F(FrameOnDevice, MergesIsMergedAndGoesOn)
{
  const auto once = fake.make(width, height);
  render(once, 12);
  const auto host_part = fake.make(width, height, 4), device_part = on_device.make(width, height, 6);
  render(host_part, 2);
  render(device_part, 3);
  const auto frame = on_device.make(width, height);
  render(frame, 4);
  frame->merge(*host_part);
  frame->merge(*device_part);
  render(frame, 12);  // 9..11
  EXPECT_EQ(read_all(*frame), read_all(*once));
  EXPECT_GT(device.num_uploads, 0u);
  const auto host = fake.make(width, height);
  host->merge(*frame);
  EXPECT_EQ(read_all(*host), read_all(*once));
}

TEST_F(FrameOnDevice, TravelsThroughFiles)
{
  const std::string file = (std::filesystem::path(testing::TempDir()) / "gpurt_FrameOnDevice.gpurt").string();
  const auto once = fake.make(width, height), frame = on_device.make(width, height);
  render(once, 9);
  render(frame, 2, {{0, 0, 30, 10}});
  render(frame, 5);
  frame->save(file);
  const auto loaded = on_device.make(width, height);
  loaded->load_state(file);
  std::filesystem::remove(file);
  EXPECT_EQ(read_all(*loaded), read_all(*frame));
  render(loaded, 9);
  EXPECT_EQ(read_all(*loaded), read_all(*once));
}

TEST_F(FrameOnDevice, IsTheHostsWhereThereIsNoRoom)
{
  const auto once = fake.make(width, height), frame = on_device.make(width, height);
  render(once, 9);
  render(frame, 4);
  device.has_room = false;
  render(frame, 6);
  EXPECT_EQ(device.num_films, 0u);
  device.has_room = true;
  render(frame, 9);
  EXPECT_EQ(device.num_films, 1u);
  EXPECT_EQ(read_all(*frame), read_all(*once));
}

// What the host lacks then is lost, which somebody is told once: the job, or the first reader after it.
TEST_F(FrameOnDevice, GoesBackToTheHostWhereTheDeviceIsLost)
{
  const auto first = fake.make(width, height), frame = on_device.make(width, height);
  render(first, 3);
  render(frame, 3);
  const std::string file = (std::filesystem::path(testing::TempDir()) / "gpurt_lost.gpurt").string();
  frame->save(file);  // takes all to the host
  device.is_lost_after_add = true;
  const auto [result, text] = error_of([&] { render(frame, 500, {}, 128); });
  EXPECT_EQ(result, GPURT_ERROR_DEVICE);
  EXPECT_TRUE(contains(text, "the fake device is lost"));
  const std::string texts = text + error_of([&] { read_all(*frame); }).second;
  EXPECT_TRUE(contains(texts, "goes back to the " + std::to_string(3 * width * height)));
  EXPECT_EQ(read_all(*frame), read_all(*first));
  EXPECT_EQ(statistics(*frame).num_samples, 3u * width * height);
  const auto other = fake.make(width, height);
  other->merge(*frame);
  EXPECT_EQ(read_all(*other), read_all(*first));
  std::filesystem::remove(file);
}

TEST_F(FrameOnDevice, HasNoSamplesWhereTheyWereLostOnTheWay)
{
  const auto frame = on_device.make(width, height), none = fake.make(width, height);
  device.is_lost_midway_after_add = true;
  const auto [result, text] = error_of([&] {
    render(frame, 3);
    frame->save(testing::TempDir() + "/gpurt_lost.exr");
  });
  EXPECT_EQ(result, GPURT_ERROR_DEVICE);
  EXPECT_TRUE(contains(text, "goes back to the 0"));
  EXPECT_EQ(read_all(*frame), read_all(*none));
  EXPECT_EQ(statistics(*frame).num_samples, 0u);
}

TEST_F(FrameOnDevice, IsSecuredOnTheHostWhereThatCostsLittle)
{
  const auto small = on_device.make(width, height), small_on_host = fake.make(width, height);
  render(small, 2);
  render(small_on_host, 2);
  // 1.8 MB, which are copied in 0.2 ms, and take a hundred times as long to render.
  constexpr uint32_t size = 128, color = 1u << GPURT_OUTPUT_COLOR;
  const auto large = on_device.make(size, size, 0, 7, color),
             large_on_host = fake.make(size, size, 0, 7, color);
  scene->path_time = std::chrono::microseconds(2);
  render(large, 2);
  render(large_on_host, 2);
  EXPECT_GE(device.num_downloads, 2u);
  device.is_lost = true;
  EXPECT_EQ(read_all(*small), read_all(*small_on_host));
  EXPECT_EQ(read_all(*large), read_all(*large_on_host));
}

// The film on the device has what the frame was created with, whatever the host's film has by then.
TEST_F(FrameOnDevice, HasNothingOfPhotonsThatWereNotTraced)
{
  const auto frame = on_device.make(width, height), expected = fake.make(width, height);
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.pipeline = GPURT_PIPELINE_PHOTON;
  desc.target_error = 0.1f;
  desc.photon.initial_radius = 0.1f;
  device.is_lost = true;
  EXPECT_EQ(error_of([&] { Job::submit(frame, desc, {})->wait(GPURT_WAIT_FOREVER); }).first,
            GPURT_ERROR_DEVICE);
  EXPECT_NE(scene->last_outputs & film_errors, 0u);
  device.is_lost = false;
  render(frame, 3);
  EXPECT_EQ(scene->last_outputs, frame->settings().outputs);
  render(expected, 3);
  EXPECT_EQ(read_all(*frame), read_all(*expected));
}

TEST_F(FrameOnDevice, KeepsWholePassesOfJobsThatFail)
{
  const auto frame = on_device.make(width, height), expected = fake.make(width, height);
  scene->fail_after = 2;
  EXPECT_EQ(error_of([&] { render(frame, 1000, {}, 8); }).first, GPURT_ERROR_DEVICE);
  scene->fail_after = 0;
  const uint32_t num_samples = statistics(*frame).samples_per_pixel;
  EXPECT_GT(num_samples, 0u);
  render(expected, num_samples);
  EXPECT_EQ(read_all(*frame), read_all(*expected));
  render(frame, 1000);
  render(expected, 1000);
  EXPECT_EQ(read_all(*frame), read_all(*expected));
}

TEST_F(FrameOnDevice, IsReadAndSavedWhileItIsRendered)
{
  scene->path_time = std::chrono::microseconds(1);
  const auto frame = on_device.make(width, height), expected = fake.make(width, height);
  const auto job = submit(frame, 200);
  const std::string file = testing::TempDir() + "/gpurt_while.gpurt";
  for (int i = 0; i < 20; ++i) {
    read_all(*frame);
    frame->save(file);
    // A state whose pixels disagree with the samples that it says they have is refused.
    const auto loaded = fake.make(width, height);
    loaded->load_state(file);
  }
  std::filesystem::remove(file);
  job->wait(GPURT_WAIT_FOREVER);
  render(expected, 200);
  EXPECT_EQ(read_all(*frame), read_all(*expected));
}

TEST_F(FrameOnDevice, WasCancelledAndGoesOn)
{
  scene->path_time = std::chrono::microseconds(5);
  const auto frame = on_device.make(width, height), expected = fake.make(width, height);
  const auto job = submit(frame, 60);
  while (statistics(*frame).num_samples == 0) std::this_thread::yield();
  job->cancel();
  error_of([&] { job->wait(GPURT_WAIT_FOREVER); });
  scene->path_time = {};
  render(frame, 60);
  render(expected, 60);
  EXPECT_EQ(read_all(*frame), read_all(*expected));
  EXPECT_EQ(statistics(*frame).num_samples, 60u * width * height);
}

}  // namespace
