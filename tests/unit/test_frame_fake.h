// A scene whose samples are a known function of pixel and index, behind the interface of a backend.
#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <functional>
#include <thread>

#include "frame/frame.h"
#include "frame/job.h"

namespace gpurt_test {

using namespace gpurt;

inline uint64_t mix(uint64_t x)
{
  x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9u;
  x = (x ^ x >> 27) * 0x94d049bb133111ebu;
  return x ^ x >> 31;
}

/// Uniform in [0, 1), a function of its arguments alone.
inline double uniform(uint64_t seed, uint64_t x, uint64_t y, uint64_t sample, uint64_t dimension = 0)
{
  return double(mix(mix(mix(mix(mix(seed + 1) + x) + y) + sample) + dimension) >> 11) * 0x1p-53;
}

/// Radiance of sample `sample` of pixel (x, y).
using SampleFn = std::function<Vec3f(uint64_t seed, uint32_t x, uint32_t y, uint64_t sample)>;

inline Vec3f noise(uint64_t seed, uint32_t x, uint32_t y, uint64_t sample)
{
  // Values of very different size, so that float sums would depend on their order.
  const double a = uniform(seed, x, y, sample), b = uniform(seed, x, y, sample, 1);
  return {float(a), float(b * std::exp2(20 * a - 10)), float(a * 1e-6)};
}

class FakeScene : public CommittedScene {
 public:
  explicit FakeScene(SampleFn sample = noise) : sample_(std::move(sample)) {}

  const AccelFacts &accel_facts() const override { return facts; }
  void trace(const TraceRequest &) const override {}
  HostKdTree export_tree(uint32_t) const override { return {}; }
  void render(const RenderPass &pass) const override
  {
    num_passes++;
    std::atomic<size_t> next{0};
    std::vector<std::thread> threads;
    std::exception_ptr error;
    for (uint32_t t = 0; t < num_threads; ++t) {
      threads.emplace_back([&] {
        for (;;) {
          // Back to front, so that deliveries do not come in the order of planning.
          const size_t k = next++;
          if (k >= pass.units.size() || pass.cancelled->load()) return;
          render_unit(pass, pass.units[pass.units.size() - 1 - k]);
        }
      });
    }
    for (std::thread &thread : threads) thread.join();
    if (fail_after != 0 && num_passes >= fail_after) fail(GPURT_ERROR_DEVICE, "the fake device fell over");
  }

  AccelFacts facts;
  uint32_t num_threads = 2;
  uint32_t fail_after = 0;                 // passes; 0: never
  std::chrono::microseconds path_time{0};  // slept for
  mutable std::atomic<uint32_t> num_passes{0};
  mutable std::atomic<uint64_t> largest_unit_paths{0};

 private:
  void render_unit(const RenderPass &pass, const WorkUnit &unit) const
  {
    const uint32_t width = unit.x1 - unit.x0, height = unit.y1 - unit.y0;
    const uint64_t num_paths = uint64_t(width) * height * unit.num_samples;
    uint64_t largest = largest_unit_paths;
    while (largest < num_paths && !largest_unit_paths.compare_exchange_weak(largest, num_paths)) {
    }
    if (path_time.count() > 0) std::this_thread::sleep_for(path_time * num_paths);
    TileFilm film;
    film.reset(width, height, pass.outputs);
    RenderCounters counters;
    for (uint32_t y = unit.y0; y < unit.y1; ++y) {
      for (uint32_t x = unit.x0; x < unit.x1; ++x) {
        const size_t i = size_t(y - unit.y0) * width + (x - unit.x0);
        for (uint64_t s = unit.first_sample; s < unit.first_sample + unit.num_samples; ++s) {
          const Vec3f radiance = sample_(pass.settings.seed, x, y, s);
          add_sample(film.pixels[i], s, radiance, x % 2 == 0);
          counters.num_samples++;
          counters.num_camera_rays++;
          if (is_finite(radiance))
            counters.largest_sample = std::max(counters.largest_sample, max_component(radiance));
          if (!film.features.empty()) film.features[i].normal[2] += feature_from(0.5f);
          if (!film.first_hits.empty() && s == 0) {
            film.first_hits[i] = {float(x + y), {float(x), float(y), 3.0f}, x, 1, y, 1};
            if (x % 2 == 1) film.first_hits[i] = {infinity, {0, 0, 0}, invalid_id, invalid_id, invalid_id, 1};
          }
        }
      }
    }
    pass.deliver(unit, film, counters);
  }

  SampleFn sample_;
};

constexpr uint32_t all_outputs = (1u << GPURT_OUTPUT_TIME) - 1;

struct FakeFrame {
  std::shared_ptr<FakeScene> scene = std::make_shared<FakeScene>();
  std::shared_ptr<CompiledScene> compiled = std::make_shared<CompiledScene>();
  std::shared_ptr<MemoryTracker> memory = std::make_shared<MemoryTracker>(0);

  explicit FakeFrame(SampleFn sample = noise) : scene(std::make_shared<FakeScene>(std::move(sample)))
  {
    compiled->bounds = empty_box();
    compiled->hash = 0x1234;
    compiled->cameras.push_back({{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 5}}}, 0.8f, 0, 0});
  }

  std::shared_ptr<Frame> make(uint32_t width, uint32_t height, uint64_t first_sample = 0, uint64_t seed = 7,
                              uint32_t outputs = all_outputs) const
  {
    gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
    desc.width = width;
    desc.height = height;
    desc.outputs = outputs;
    desc.seed = seed;
    desc.first_sample = first_sample;
    return std::make_shared<Frame>(FrameScene{scene, compiled, memory, scene->num_threads, 0.0}, desc);
  }
};

inline std::shared_ptr<Job> submit(const std::shared_ptr<Frame> &frame, uint32_t samples_per_pixel,
                                   std::vector<gpurt_tile> tiles = {}, uint32_t tile_size = 0)
{
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.samples_per_pixel = samples_per_pixel;
  desc.tile_size = tile_size;
  return Job::submit(frame, desc, tiles);
}
inline void render(const std::shared_ptr<Frame> &frame, uint32_t samples_per_pixel,
                   std::vector<gpurt_tile> tiles = {}, uint32_t tile_size = 0)
{
  submit(frame, samples_per_pixel, tiles, tile_size)->wait(GPURT_WAIT_FOREVER);
}

template <class T>
std::vector<T> read(const Frame &frame, gpurt_output output)
{
  std::vector<T> values(frame.output_bytes(output) / sizeof(T));
  frame.read(output, values.data(), values.size() * sizeof(T));
  return values;
}

/// The bytes of every output.
inline std::vector<std::vector<uint32_t>> read_all(const Frame &frame)
{
  std::vector<std::vector<uint32_t>> all;
  for (int output = 0; output < GPURT_OUTPUT_TIME; ++output) {
    if (frame.settings().outputs & 1u << output) all.push_back(read<uint32_t>(frame, gpurt_output(output)));
  }
  return all;
}

inline gpurt_statistics statistics(const Frame &frame)
{
  gpurt_statistics s = GPURT_STATISTICS_INIT;
  frame.statistics(s);
  return s;
}

inline testing::AssertionResult contains(const std::string &text, const std::string &part)
{
  if (text.find(part) != std::string::npos) return testing::AssertionSuccess();
  return testing::AssertionFailure() << '"' << text << "\" does not contain \"" << part << '"';
}

/// The result and text of the gpurt::Error that `call` throws; GPURT_OK if it does not.
template <class Call>
std::pair<gpurt_result, std::string> error_of(Call &&call)
{
  try {
    call();
  } catch (const Error &error) {
    return {error.result(), error.what()};
  }
  return {GPURT_OK, ""};
}

}  // namespace gpurt_test
