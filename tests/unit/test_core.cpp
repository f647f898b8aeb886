// lib/core on the host: scalars, exact sums, sample sequences, warps, BSDFs.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "core/path/bsdf.h"
#include "core/path/film_view.h"
#include "core/path/light_tree.h"
#include "core/random/sobol.h"

namespace gpurt {
namespace {

TEST(Scalar, NextUpAndDownAreNeighbours)
{
  for (float x : {0.0f, 1.0f, -1.0f, 1e-40f, 3.5e37f, -7.25f}) {
    EXPECT_EQ(next_up(x), std::nextafterf(x, INFINITY)) << x;
    EXPECT_EQ(next_down(x), std::nextafterf(x, -INFINITY)) << x;
  }
}

TEST(Functions, SinesAndArcTangentsAgreeWithLibm)
{
  // Cephes states 2 ulp on the reduced range; 4e-7 is that and the rounding of 2 pi r.
  for (int i = -4000; i <= 4000; ++i) {
    const float x = float(i) * 0.00037f;
    float s, c;
    sincos_turns(x, s, c);
    EXPECT_NEAR(s, std::sin(2 * M_PI * double(x)), 4e-7);
    EXPECT_NEAR(c, std::cos(2 * M_PI * double(x)), 4e-7);
  }
  for (int i = 0; i < 4000; ++i) {
    const double a = (i + 0.5) / 4000 * 2 * M_PI - M_PI;
    EXPECT_NEAR(atan2(float(std::sin(a)), float(std::cos(a))), a, 6e-7);
  }
  EXPECT_EQ(atan2(0.0f, 0.0f), 0.0f);
}

TEST(Functions, ExponentialsAgreeWithLibm)
{
  EXPECT_EQ(exp_of_negative(0.0f), 1.0f);
  EXPECT_EQ(exp_of_negative(-infinity), 0.0f);
  EXPECT_EQ(exp_of_negative(-104.0f), 0.0f);
  for (int i = 1; i < 20000; ++i) {
    const float x = float(i) * -0.0052f;
    const double expected = std::exp(double(x));
    // 2 ulp, and half of the smallest float.
    EXPECT_NEAR(exp_of_negative(x), expected, expected * 0x1p-22 + 0x1p-149) << x;
  }
}

TEST(Functions, SrgbTableMatchesTheCurve)
{
  for (int i = 0; i < 256; ++i) {
    const double c = i / 255.0;
    const double expected = c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
    EXPECT_NEAR(linear_from_srgb8(uint32_t(i)), expected, expected * 1e-7 + 1e-12);
  }
}

TEST(FixedSum, IsExactAndIndependentOfOrder)
{
  std::mt19937 rng(7);
  std::vector<float> values;
  std::uniform_real_distribution<float> mantissa(-1, 1);
  std::uniform_int_distribution<int> exponent(-40, 29);
  for (int i = 0; i < 5000; ++i) values.push_back(std::ldexp(mantissa(rng), exponent(rng)));
  // Every value is a multiple of 2^-64 (24 bits of mantissa from 2^-40 down), so __int128 holds the exact sum.
  __int128 exact = 0;
  for (float v : values) exact += (__int128)std::ldexp((long double)v, 64);
  FixedSum forward{0, 0}, backward{0, 0};
  for (size_t i = 0; i < values.size(); ++i) {
    add(forward, fixed_sum_from(values[i]));
    add(backward, fixed_sum_from(values[values.size() - 1 - i]));
  }
  EXPECT_EQ(forward.low, backward.low);
  EXPECT_EQ(forward.high, backward.high);
  EXPECT_EQ(forward.low, uint64_t(exact));
  EXPECT_EQ(forward.high, int64_t(exact >> 64));
}

TEST(FixedSum, RoundTripsSingleValues)
{
  for (float v : {0.0f, 1.0f, -1.0f, 0.1f, -3.75e8f, 0x1p-41f, 1e9f, 1.5f, -0x1.fffffep-30f}) {
    EXPECT_EQ(float(to_double(fixed_sum_from(v))), v);
  }
}

TEST(PixelSums, LeavesOutWhatIsNotFiniteAndCountsIt)
{
  PixelSums sums{};
  add_sample(sums, 0, {1, 2, 3}, true);
  add_sample(sums, 1, {NAN, 2, 3}, true);
  add_sample(sums, 2, {1, INFINITY, 3}, true);
  add_sample(sums, 3, {4, 5, 6}, false);
  EXPECT_EQ(sums.num_nonfinite, 2u);
  EXPECT_EQ(sums.num_samples[0], 1u);
  EXPECT_EQ(sums.num_samples[1], 1u);
  EXPECT_EQ(sums.num_covered, 1u);
  EXPECT_EQ(to_double(sums.color[1][2]), 6.0);
}

// Every elementary interval of a (0, 2)-sequence's first 2^k points holds one point; scrambling keeps that.
TEST(Sobol, IsAZeroTwoSequenceForEveryKeyAndPair)
{
  for (uint32_t seed : {1u, 77u, 0xdeadbeefu}) {
    for (uint32_t pair : {0u, 5u, 64u}) {
      for (int log_n : {4, 8}) {
        const uint32_t n = 1u << log_n;
        for (int log_x = 0; log_x <= log_n; ++log_x) {
          const uint32_t nx = 1u << log_x, ny = n / nx;
          std::vector<int> count(n, 0);
          for (uint32_t i = 0; i < n; ++i) {
            const Vec2f p = sample_2d({seed, reverse_bits(i)}, pair);
            ASSERT_TRUE(p.x >= 0 && p.x < 1 && p.y >= 0 && p.y < 1);
            count[uint32_t(p.x * nx) * ny + uint32_t(p.y * ny)]++;
          }
          for (int c : count)
            ASSERT_EQ(c, 1) << "seed " << seed << " pair " << pair << " boxes " << nx << "x" << ny;
        }
      }
    }
  }
}

// Catalogue row 25: sequences of different pixels, seeds, frames and halves are uncorrelated.
TEST(Sobol, DifferentSeedsFramesAndPixelsAreUncorrelated)
{
  const int n = 4096;
  auto series = [&](uint64_t seed, uint32_t frame, uint32_t x, uint64_t offset) {
    std::vector<double> v;
    for (int i = 0; i < n; ++i)
      v.push_back(sample_2d(sample_key(seed, frame, x, uint32_t(i), offset), 1).x - 0.5);
    return v;
  };
  const std::vector<std::vector<double>> all = {series(1, 0, 0, 0), series(2, 0, 0, 0), series(1, 1, 0, 0),
                                                series(1, 0, 1, 0), series(1, 0, 0, 1), series(1, 0, 0, 2)};
  for (size_t a = 0; a < all.size(); ++a) {
    for (size_t b = a + 1; b < all.size(); ++b) {
      double sum = 0;
      for (int i = 0; i < n; ++i) sum += all[a][i] * all[b][i];
      // Products of uniforms in [-1/2, 1/2] have standard deviation 1/12. Neighbouring samples of one pixel are
      // stratified against each other: only pairs of different sequences are held to 3.5 sigma (15 pairs).
      if (a == 0 && b == 5) continue;
      EXPECT_LT(std::abs(sum / n) / (1.0 / 12 / std::sqrt(double(n))), 3.5) << a << " against " << b;
    }
  }
}

// Pearson's chi-square of a sampled direction's histogram against the pdf that eval_bsdf states.
double chi_square(const Bsdf &bsdf, Vec3f wo, int &cells)
{
  const int nt = 10, np = 20, n = 400000;
  std::vector<double> expected(nt * np, 0), observed(nt * np, 0);
  const int sub = 24;
  for (int i = 0; i < nt * sub; ++i) {
    for (int j = 0; j < np * sub; ++j) {
      const double z = (i + 0.5) / (nt * sub), phi = (j + 0.5) / (np * sub) * 2 * M_PI,
                   r = std::sqrt(1 - z * z);
      float pdf;
      eval_bsdf(bsdf, wo, {float(r * std::cos(phi)), float(r * std::sin(phi)), float(z)}, pdf);
      expected[(i / sub) * np + j / sub] += double(pdf) * n * (2 * M_PI / (np * sub)) / (nt * sub);
    }
  }
  for (int i = 0; i < n; ++i) {
    const SampleKey key{mix_bits(uint64_t(i)), 0};
    BsdfSample s;
    if (!sample_bsdf(bsdf, wo, 0.5f, sample_2d(key, 0), s)) continue;
    double phi = std::atan2(s.wi.y, s.wi.x);
    if (phi < 0) phi += 2 * M_PI;
    observed[std::min(int(s.wi.z * nt), nt - 1) * np + std::min(int(phi / (2 * M_PI) * np), np - 1)]++;
    float pdf;
    const Vec3f f = eval_bsdf(bsdf, wo, s.wi, pdf);
    EXPECT_NEAR(pdf, s.pdf, 2e-3 * s.pdf);
    EXPECT_NEAR(f.x, s.weight.x * s.pdf, 2e-3 * f.x + 1e-6);
  }
  double sum = 0;
  cells = 0;
  for (size_t k = 0; k < expected.size(); ++k) {
    if (expected[k] < 20) continue;
    sum += (observed[k] - expected[k]) * (observed[k] - expected[k]) / expected[k];
    cells++;
  }
  return sum;
}

TEST(Bsdf, SamplesFollowTheStatedDensity)
{
  const Bsdf lambert{MaterialType::Lambert, vec3(0.8f), 0, 1};
  const Bsdf metal{MaterialType::Metal, vec3(0.9f), 0.4f, 1};
  for (const Bsdf &b : {lambert, metal}) {
    for (float z : {0.95f, 0.5f, 0.2f}) {
      int cells;
      const double x = chi_square(b, {std::sqrt(1 - z * z), 0, z}, cells);
      // The chi-square distribution with k degrees has mean k and variance 2k; 5 sigma, plus the quadrature's error.
      EXPECT_LT(x, cells + 5 * std::sqrt(2.0 * cells) + 0.1 * cells)
          << "wo.z " << z << " type " << int(b.type);
    }
  }
}

TEST(Bsdf, GlassKeepsEnergyAndSnellsLaw)
{
  for (float eta : {1.5f, 1 / 1.5f}) {
    const Bsdf glass{MaterialType::Glass, vec3(1.0f), 0, eta};
    for (float z : {1.0f, 0.7f, 0.3f}) {
      const Vec3f wo{std::sqrt(1 - z * z), 0, z};
      float cos_t;
      const float f = fresnel_dielectric(z, eta, cos_t);
      BsdfSample s;
      ASSERT_TRUE(sample_bsdf(glass, wo, f * 0.5f, {0, 0}, s));
      EXPECT_FLOAT_EQ(s.wi.z, z);
      if (f >= 1) continue;
      ASSERT_TRUE(sample_bsdf(glass, wo, f + (1 - f) * 0.5f, {0, 0}, s));
      EXPECT_LT(s.wi.z, 0);
      EXPECT_NEAR(length(s.wi), 1, 1e-6);
      EXPECT_NEAR(std::abs(s.wi.x) * eta, wo.x, 1e-6);
      EXPECT_NEAR(s.weight.x * eta * eta, 1, 1e-6);
    }
  }
  float cos_t;
  EXPECT_NEAR(fresnel_dielectric(1.0f, 1.5f, cos_t), 0.04f, 1e-7);
}

}  // namespace
}  // namespace gpurt
