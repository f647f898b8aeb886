// The error estimate against the error that is really there, for noise of known mean.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>

#include "frame/error_estimate.h"
#include "test_frame_fake.h"

namespace {

using namespace gpurt_test;

// relMSE of the frame against the mean that its samples have.
template <class MeanFn>
double true_error(const Frame &frame, MeanFn &&mean)
{
  const auto color = read<float>(frame, GPURT_OUTPUT_COLOR);
  double sum = 0;
  for (size_t i = 0; i < color.size(); ++i) {
    const uint32_t x = uint32_t(i / 3 % frame.settings().width);
    const double r = mean(x), d = double(color[i]) - r;
    sum += d * d / (r * r + 0.01);
  }
  return sum / double(color.size());
}

TEST(ErrorEstimate, IsRightForEvenNoise)
{
  // Exponential samples of means 0.05 to 2 across the image: relMSE is about 1 / n where the mean is large.
  const auto mean = [](uint32_t x) { return 0.05 + 2 * x / 96.0; };
  FakeFrame fake([&](uint64_t seed, uint32_t x, uint32_t y, uint64_t s) {
    return vec3(float(-mean(x) * std::log(1 - uniform(seed, x, y, s))));
  });
  for (uint32_t n : {32u, 128u}) {
    const auto frame = fake.make(96, 64);
    render(frame, n);
    const double ratio = statistics(*frame).estimated_error / true_error(*frame, mean);
    RecordProperty("ratio_" + std::to_string(n), std::to_string(ratio));
    // The sum over 18432 values of chi-square kind is known to 2 %; the standard deviations added and the noise in the
    // denominators make it larger by design.
    EXPECT_GT(ratio, 0.95) << n;
    EXPECT_LT(ratio, 1.4) << n;
  }
}

TEST(ErrorEstimate, EdgesDoNotMakeItWildlyPessimistic)
{
  // Stripes two pixels wide: noisy bright beside clean dark, the worst case of dilation.
  const auto mean = [](uint32_t x) { return x / 2 % 2 ? 1.0 : 0.02; };
  FakeFrame fake([&](uint64_t seed, uint32_t x, uint32_t y, uint64_t s) {
    return vec3(float(2 * mean(x) * uniform(seed, x, y, s)));
  });
  const auto frame = fake.make(96, 64);
  render(frame, 64);
  const double ratio = statistics(*frame).estimated_error / true_error(*frame, mean);
  RecordProperty("ratio", std::to_string(ratio));
  EXPECT_GT(ratio, 0.9);
  EXPECT_LT(ratio, 2.0);
}

// A room lit by a rare path: most samples return nothing, one in 1 / p returns a lot. A plain variance / mean^2 sees a
// quotient of 1 at the few bright pixels and none elsewhere, and stops at once.
class RarePath : public testing::TestWithParam<std::tuple<double, double>> {};

TEST_P(RarePath, ReachedErrorIsAtMostTwiceTheRequestedOne)
{
  const auto [probability, radiance_mean] = GetParam();
  const double value = radiance_mean / probability;
  const float target = 0.2f;
  FakeFrame fake([=](uint64_t seed, uint32_t x, uint32_t y, uint64_t s) {
    return vec3(uniform(seed, x, y, s) < probability ? float(value) : 0.0f);
  });
  // The lamp that the rare path leads to is known to the scene, wherever it is.
  fake.compiled->bounds = {{0, 0, 0}, {8, 0, 0}};  // an eighth of the diagonal is 1
  Light lamp{};
  lamp.type = LightType::Point;
  lamp.color = vec3(float(value) * pi);
  fake.compiled->lights.push_back(lamp);
  int num_failures = 0;
  double smallest = 1e30, largest = 0;
  for (uint64_t seed = 0; seed < 4; ++seed) {
    const auto frame = fake.make(32, 24, 0, seed, 0);
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.target_error = target;
    Job::submit(frame, desc, {})->wait(GPURT_WAIT_FOREVER);
    const double error = true_error(*frame, [=](uint32_t) { return radiance_mean; });
    num_failures += error > 2 * double(target) ? 1 : 0;
    smallest = std::min(smallest, error);
    largest = std::max(largest, error);
  }
  RecordProperty("smallest", std::to_string(smallest));
  RecordProperty("largest", std::to_string(largest));
  EXPECT_EQ(num_failures, 0) << "errors up to " << largest;
}

INSTANTIATE_TEST_SUITE_P(Rooms, RarePath,
                         testing::Values(std::tuple(0.02, 0.3), std::tuple(0.002, 0.3),
                                         std::tuple(2e-4, 0.05), std::tuple(1e-5, 0.01)));

// Light of 0.1 on which blotches of 16 x 16 pixels come, as many in all: few leave most pixels without any.
class Blotches : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(OfPhotons, Blotches, testing::Values(12.0, 300.0));

TEST_P(Blotches, AreNoWitnessesOfEachOther)
{
  const double expected = GetParam(), blotch = 36 / expected;
  constexpr uint32_t width = 128, height = 128, size = 16;
  constexpr double base = 0.1;
  constexpr uint32_t num_trials = 2048;  // enough for Poisson's distribution
  const double share = expected * size * size / (double(width + size) * (height + size));
  const double truth = base + share * blotch;
  double least = 1e30, least_apart = 1e30, mean_ratio = 0;
  constexpr uint64_t num_seeds = 40;
  for (uint64_t seed = 0; seed < num_seeds; ++seed) {
    std::vector<PixelMoments> pixels(size_t(width) * height);
    std::vector<double> halves[2];
    for (auto &half : halves) half.assign(pixels.size(), base);
    for (uint32_t k = 0; k < num_trials; ++k) {
      if (uniform(seed, k, 0, 0) >= expected / num_trials) continue;
      const int x0 = int(uniform(seed, k, 1, 0) * (width + size)) - int(size);
      const int y0 = int(uniform(seed, k, 2, 0) * (height + size)) - int(size);
      for (int y = std::max(y0, 0); y < std::min(y0 + int(size), int(height)); ++y) {
        for (int x = std::max(x0, 0); x < std::min(x0 + int(size), int(width)); ++x)
          halves[k & 1][size_t(y) * width + size_t(x)] += 2 * blotch;
      }
    }
    double made = 0;
    for (size_t i = 0; i < pixels.size(); ++i) {
      const double a = halves[0][i], b = halves[1][i], mean = (a + b) / 2;
      PixelMoments &p = pixels[i];
      p = {};
      p.is_covered = true;
      for (int c = 0; c < 3; ++c) {
        p.mean[c] = float(mean);
        p.variance[c] = float((a - b) * (a - b) / 4);
        p.is_first_larger[c] = a > b;
      }
      made += (mean - truth) * (mean - truth) / (truth * truth + 0.01);
    }
    made /= double(pixels.size());
    const MomentSource source = [&](uint32_t y0, uint32_t y1, PixelMoments *rows) {
      std::copy_n(pixels.begin() + std::ptrdiff_t(y0) * width, size_t(y1 - y0) * width, rows);
    };
    const PhotonDoubt photons{2 * blotch, 1};
    const double stated = estimate_relmse(width, height, 2, 0, source, &photons).noise;
    least = std::min(least, stated / made);
    mean_ratio += stated / made / double(num_seeds);
    least_apart = std::min(least_apart, estimate_relmse(width, height, 2, 0, source).noise / made);
  }
  RecordProperty("least", std::to_string(least));
  RecordProperty("mean", std::to_string(mean_ratio));
  std::printf("stated over true: at least %.2f, on average %.2f; as if pixels were independent, %.2f\n",
              least, mean_ratio, least_apart);
  // Overrated on purpose: how much of the light they are is known from them alone.
  EXPECT_GT(least, 1);
  EXPECT_LT(mean_ratio, expected < 100 ? 40 : 16);
  if (expected < 100) {
    EXPECT_LT(least_apart, 0.5);
  }
}

TEST(ErrorEstimate, UnseenRadianceOfLamps)
{
  CompiledScene scene;
  scene.bounds = {{0, 0, 0}, {8, 0, 0}};
  scene.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  scene.indices = {{0, 1, 2}};
  Light lamp{};
  lamp.triangle = 0;
  lamp.placement = invalid_id;
  lamp.color = {3, 2, 1};
  scene.lights.push_back(lamp);
  EXPECT_NEAR(unseen_radiance(scene), 3 * 0.5 / 3.14159265, 1e-6);  // area 1/2 at distance 1
  lamp.type = LightType::Distant;
  scene.lights = {lamp};
  EXPECT_NEAR(unseen_radiance(scene), 3 / 3.14159265, 1e-6);
  scene.bounds = empty_box();
  EXPECT_EQ(unseen_radiance(scene), 0);
}

TEST(ErrorEstimate, IsUnknownWithoutTwoHalves)
{
  FakeFrame fake;
  const auto frame = fake.make(8, 8);
  EXPECT_LT(frame->estimated_error().total(), 0);
  render(frame, 1);
  EXPECT_LT(frame->estimated_error().total(), 0);
  render(frame, 2);
  EXPECT_GT(frame->estimated_error().total(), 0);
}

}  // namespace
