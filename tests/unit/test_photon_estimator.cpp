// What a gather sums up, what it says about its blur, and what pixels make of it.
//
// Mistakes that other photon mappers have made were put in by hand, once each, to see that a test fails:
//   the cosine of arrival multiplied in again                   TakesTheFluxOfPhotonsAsItIs
//   far-side photons counted, so that they shrink the radius    CountsPhotonsOfItsOwnSurfaceAlone
//   two-sided surfaces black on one side                        TakesTheFluxOfPhotonsAsItIs
//   cells counted by int(extent / r) without a bound            PhotonGrid.ClampsItsCellsWhereTheRadiusIsTiny
//   k of k nearest photons counted in the disc of the k-th      RadiiComeFromPhotonsThatAreNotGathered
//   radii of pass k shrunk by k + 1 or k - 1 factors            RadiiFallByAFactorForEveryPassBefore
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <cmath>
#include <random>

#include "core/photon/estimator.h"
#include "cpu/photon/photon_grid.h"
#include "photon_pass.h"

namespace gpurt {
namespace {

PhotonPass pass_of(float radius, PhotonKernel kernel = PhotonKernel::Constant,
                   PhotonEstimator estimator = PhotonEstimator::Memoryless)
{
  const EmissionView emission{nullptr, 0, 1.0f, {0, 0, 0}, 1.0f};
  return make_photon_pass({1000, radius, kernel, remedy_normal | remedy_side | remedy_plane, estimator},
                          emission, 0);
}

// At the origin of the plane z = 0, seen from above.
VisiblePoint white_point(float radius)
{
  VisiblePoint p{};
  p.geometric_normal = {0, 0, 1};
  p.normal_code = encode_normal(p.geometric_normal);
  p.depth = 1;
  p.weight = {1, 1, 1};
  p.inverse_area = 1;
  p.radius = radius;
  return p;
}

Photon photon_at(float x, float y, float z, Vec3f normal, uint32_t id)
{
  return {
      {x, y, z}, encode_flux({1, 1, 1}, id), encode_direction(-normal), encode_normal(normal) | 2u << 24, id,
      1};
}

template <bool HasBlur>
PhotonSum gather(const std::vector<Photon> &photons, const PhotonPass &pass, const VisiblePoint &point,
                 PhotonBlur &blur)
{
  tbb::task_arena arena(1);
  PhotonSum sum;
  clear(sum);
  clear(blur);
  arena.execute([&] {
    const PhotonSource source{photons.data(), nullptr, nullptr, nullptr, photons.size()};
    uint64_t first_bad;
    PhotonGridOptions options;
    options.radius = pass.radius;
    const CpuPhotonGrid grid(source, photon_bounds(source, first_bad), options, nullptr);
    gather_photons<1, HasBlur>(grid.view(), pass, 17, point, sum, blur);
  });
  return sum;
}

// Photons of the far side of a sheet, of another wall and of a step must not count: neither their flux nor their number,
// by which radii of pixels shrink.
TEST(PhotonEstimator, CountsPhotonsOfItsOwnSurfaceAlone)
{
  std::vector<Photon> photons;
  for (uint32_t i = 0; i < 120; ++i) {
    const float x = 0.008f * float(i % 11), y = 0.007f * float(i % 7);
    if (i % 12 == 0) photons.push_back(photon_at(x, y, 0, {0, 0, 1}, i));
    else if (i % 12 < 6) photons.push_back(photon_at(x, y, 0, {0, 0, -1}, i));
    else if (i % 12 < 9) photons.push_back(photon_at(x, y, 0, {0.8f, 0, 0.6f}, i));
    else photons.push_back(photon_at(x, y, 0.02f, {0, 0, 1}, i));
  }
  const PhotonPass pass = pass_of(0.15f, PhotonKernel::Constant, PhotonEstimator::PerPixel);
  const VisiblePoint point = white_point(0.15f);
  PhotonBlur none;
  const PhotonSum sum = gather<false>(photons, pass, point, none);
  EXPECT_EQ(sum.num_photons, 10u);
  EXPECT_EQ(sum.flux[0], int64_t(10) << 32);

  PixelStatistics s{};
  const Vec3f found = gathered_radiance(pass, point, sum);
  take_in(s, pass, point, sum, found, vec3(0.0f), 0);
  // Of m new photons and none before, 2/3 are taken in, and the area shrinks as much.
  EXPECT_DOUBLE_EQ(s.count, 20.0 / 3);
  const double r2 = double(point.radius) * double(point.radius);
  EXPECT_DOUBLE_EQ(s.radius2, r2 * (2.0 / 3));
  EXPECT_DOUBLE_EQ(s.sums[0] / s.radius2, double(found.x));
  // A second gather of as many photons for the area leaves the density what it was.
  VisiblePoint next = point;
  next.radius = next_radius(pass, s);
  PhotonSum fewer = sum;
  fewer.num_photons = 7;
  for (int64_t &f : fewer.flux) f = int64_t(7) << 32;
  const Vec3f again = gathered_radiance(pass, next, fewer);
  take_in(s, pass, next, fewer, again, vec3(0.0f), 1);
  EXPECT_NEAR((s.sums[0] + s.sums[3]) / s.radius2 / 2, double(found.x), 0.05 * double(found.x));
}

// A disc that reaches to the k-th nearest photon holds k - 1 by chance, and one by choice: its density is too large by k to
// k - 1. The pilot that radii come from has photons of its own, so that all of those in the disc are there by chance.
TEST(PhotonEstimator, RadiiComeFromPhotonsThatAreNotGathered)
{
  for (uint32_t photon = 0; photon < 100; ++photon) {
    const SampleKey pilot = photon_key(5, 3, pilot_pass, 1000, photon);
    for (uint64_t pass = 0; pass < 8; ++pass)
      EXPECT_NE(photon_key(5, 3, pass, 1000, photon).seed, pilot.seed) << pass;
  }
}

// Knaus and Zwicker's rule has i = 1 for the pass after the first: pass k, counted from 0, has k factors.
TEST(PhotonEstimator, RadiiFallByAFactorForEveryPassBefore)
{
  EXPECT_EQ(photon_radius2_share(0), 1);
  EXPECT_DOUBLE_EQ(photon_radius2_share(1), (1 + 2.0 / 3) / 2);
  EXPECT_DOUBLE_EQ(photon_radius2_share(2), (1 + 2.0 / 3) / 2 * ((2 + 2.0 / 3) / 3));
  // In closed form, on both sides of where the product ends.
  for (const uint64_t k : {uint64_t(3), uint64_t(1000), uint64_t(65536), uint64_t(65537)}) {
    const double n = double(k);
    const double share = std::exp(std::lgamma(n + 5.0 / 3) - std::lgamma(n + 2) - std::lgamma(5.0 / 3));
    EXPECT_NEAR(photon_radius2_share(k) / share, 1, 1e-9) << k;
  }
  // There differences of lgamma have too few digits; the next term is of the order of k^-2.
  const double far = std::cbrt(1 / (0x1p30 + 4.0 / 3)) / std::tgamma(5.0 / 3);
  EXPECT_NEAR(photon_radius2_share(uint64_t(1) << 30) / far, 1, 1e-9);
  const EmissionView emission{nullptr, 0, 1.0f, {0, 0, 0}, 1.0f};
  for (const uint64_t pass : {0, 1, 7}) {
    const PhotonPass made = make_photon_pass({1000, 0.25f, PhotonKernel::Constant, 0}, emission, pass);
    EXPECT_FLOAT_EQ(made.radius, float(0.25 * std::sqrt(photon_radius2_share(pass)))) << pass;
    // The estimate is divided by the area of the pass's own disc.
    EXPECT_FLOAT_EQ(made.scale,
                    float(1 / (1000 * 3.14159265358979 * double(made.radius) * double(made.radius))));
  }
}

// Photons arrive with the cosine already: a slanting one is not rarer by its weight. And a sheet has two sides.
TEST(PhotonEstimator, TakesTheFluxOfPhotonsAsItIs)
{
  std::vector<Photon> photons;
  for (uint32_t i = 0; i < 40; ++i) {
    const Vec3f normal{0, 0, i < 30 ? 1.0f : -1.0f};
    Photon p = photon_at(0.004f * float(i % 10), 0.002f * float(i % 20), 0, normal, i);
    p.direction = encode_direction(normalize(Vec3f{float(i % 5) - 2, 1, -0.3f * normal.z}));
    photons.push_back(p);
  }
  const PhotonPass pass = pass_of(0.15f);
  PhotonBlur none;
  EXPECT_EQ(gather<false>(photons, pass, white_point(0.15f), none).flux[1], int64_t(30) << 32);
  VisiblePoint below = white_point(0.15f);
  below.geometric_normal = -below.geometric_normal;
  below.normal_code = encode_normal(below.geometric_normal);
  EXPECT_EQ(gather<false>(photons, pass, below, none).flux[1], int64_t(10) << 32);
}

// Of the weight's integrals over the disc, that of what is constant is 0, and that of what grows with the square of the
// distance is the kernel's own: its expectation is the bias of the sum.
TEST(PhotonEstimator, WeighsBlurByTheSquareOfTheDistance)
{
  for (const PhotonKernel kernel : {PhotonKernel::Constant, PhotonKernel::Cone}) {
    double sum = 0, constant = 0, square = 0, own = 0;
    const int n = 100000;
    for (int i = 0; i < n; ++i) {
      const double u = (i + 0.5) / n;  // squares of distances are uniform in a disc
      const float d2 = float(u * 0.25);
      const double k = double(kernel_weight(kernel, d2, 2.0f));
      const double w = k * double(blur_weight(kernel, d2, 2.0f));
      sum += k;
      constant += w;
      square += w * u;
      own += k * u;
    }
    EXPECT_NEAR(constant / sum, 0, 1e-4);
    EXPECT_NEAR(square / own, 1, 1e-4);
  }
}

// Even light on a disc that ends at a straight edge: there is nothing to blur. The estimate has to be 0 in the mean, with
// what the trials of the disc tell about the part that is missing, and so has radiance to be what it is.
TEST(PhotonEstimator, TakesTheMissingPartOfADiscIntoAccount)
{
  for (const PhotonKernel kernel : {PhotonKernel::Constant, PhotonKernel::Cone}) {
    const PhotonPass pass = pass_of(1.0f, kernel);
    const float edge = 0.4f;
    std::mt19937 random(1);
    std::uniform_real_distribution<float> unit(-1, 1);
    const int num_gathers = 40000, num_photons = 50;  // in the square around the disc
    double radiance = 0, blur = 0, uncorrected = 0, square = 0;
    for (int i = 0; i < num_gathers; ++i) {
      VisiblePoint point = white_point(1.0f);
      const SampleKey key{mix_bits(uint64_t(i) + 7), 0};
      for (uint32_t k = 0; k < max_disc_trials; ++k) {
        point.inverse_area = float(k + 1);
        if (disc_point(key, kernel, k).x < edge) break;
        point.missed += missed_blur(key, kernel, k);
      }
      PhotonSum sum;
      PhotonBlur blurs;
      clear(sum);
      clear(blurs);
      for (int p = 0; p < num_photons; ++p) {
        const float x = unit(random), y = unit(random), d2 = x * x + y * y;
        if (x >= edge || d2 >= 1) continue;
        const float w = kernel_weight(kernel, d2, 1.0f);
        sum.flux[0] += int64_t(w * 0x1p32f);
        blurs.flux[0] += int64_t(w * blur_weight(kernel, d2, 1.0f) * 0x1p32f);
      }
      const double scale = double(pass.scale);
      radiance += double(gathered_radiance(pass, point, sum).x) / scale;
      const double b = double(gathered_blur(pass, point, sum, blurs).x) / scale;
      blur += b;
      square += b * b;
      uncorrected += double(blurs.flux[0]) * 0x1p-32;
    }
    // Photons of the square times the kernel's integral over the disc, of that of the square, 4.
    const double expected = num_photons * 3.14159265358979 / 4 * (kernel == PhotonKernel::Cone ? 1.0 / 3 : 1);
    radiance /= num_gathers * expected;
    blur /= num_gathers * expected;
    const double sigma = std::sqrt(square / num_gathers) / expected / std::sqrt(double(num_gathers));
    EXPECT_NEAR(radiance, 1, 0.02);
    EXPECT_LT(std::abs(blur), 4 * sigma) << sigma;
    EXPECT_LT(sigma, 0.01);
    EXPECT_LT(uncorrected / (num_gathers * expected), -0.05) << "this edge should need the correction";
  }
}

TEST(PhotonEstimator, ChoosesTheRadiusOfTheLeastError)
{
  const PhotonPass pass = pass_of(2.0f, PhotonKernel::Constant, PhotonEstimator::Adaptive);
  PixelStatistics s{};
  EXPECT_EQ(next_radius(pass, s), 2.0f);
  // 10 gathers within radius 1 of 5 photons each, radiance 3, and blur -0.03 of it.
  VisiblePoint point = white_point(1.0f);
  PhotonSum sum;
  clear(sum);
  sum.num_photons = 5;
  for (int i = 0; i < 10; ++i) take_in(s, pass, point, sum, vec3(3.0f), vec3(-0.09f), 0);
  // 2 n d c^2 r^6 = x^2
  const double c = 0.09, expected = std::pow(9 / (2 * 10 * 5 * c * c), 1.0 / 6);
  EXPECT_NEAR(double(next_radius(pass, s)), expected, 1e-5);
  const auto error = [&](double r) { return c * c * r * r * r * r + 9 / (10 * 5 * r * r); };
  EXPECT_LT(error(expected), error(expected * 1.05));
  EXPECT_LT(error(expected), error(expected / 1.05));
  // Without blur as large as the pass allows, with much blur as small as it may be, without photons as large as allowed.
  s.sums[sum_b_r4] = 0;
  EXPECT_EQ(next_radius(pass, s), 2.0f);
  s.sums[sum_b_r4] = 1e30;
  EXPECT_EQ(next_radius(pass, s), 2.0f / 32);
  s.sums[sum_m] = 0;
  EXPECT_EQ(next_radius(pass, s), 2.0f);
}

}  // namespace
}  // namespace gpurt
