#include "sky.h"

#include <algorithm>
#include <array>
#include <string>

namespace cli::scenes {

namespace {

Vec3 sky_radiance(Vec3 d, Vec3 to_sun)
{
  const double toward_sun = std::max(dot(d, to_sun), 0.0);
  const Vec3 haze = mix({0.95, 1.10, 1.30}, {1.75, 1.55, 1.25}, std::pow(toward_sun, 4.0));
  if (d.y <= 0) return mix(haze, {0.10, 0.095, 0.07}, smooth_step(0, 0.06, -d.y));
  Vec3 sky = mix(haze, {0.20, 0.42, 1.0}, std::pow(smooth_step(0, 0.75, d.y), 0.6));
  sky = sky + Vec3{2.4, 2.1, 1.6} * std::pow(toward_sun, 180.0) +
        Vec3{0.5, 0.42, 0.3} * std::pow(toward_sun, 14.0);
  // Clouds on a plane above; they thin out into the haze.
  const double reach = 1 / (d.y + 0.06);
  const Vec3 p{d.x * reach * 0.9, 0.4, d.z * reach * 0.9};
  const double density = fractal_noise(p, 6, 5) + 0.35 * noise(p * 0.35, 17);
  const double cover = smooth_step(0.02, 0.42, density) * smooth_step(0.03, 0.20, d.y);
  const double shade = smooth_step(0.25, 0.75, density);  // thick ones are darker below
  const Vec3 cloud =
      mix({2.1, 2.05, 1.95}, {0.95, 1.0, 1.1}, 0.7 * shade) * (1 + 0.8 * std::pow(toward_sun, 6.0));
  return mix(sky, cloud, cover);
}

// Shared exponent, as Radiance files have it.
std::array<uint8_t, 4> to_rgbe(Vec3 c)
{
  const double largest = std::max({c.x, c.y, c.z});
  if (largest < 1e-32) return {0, 0, 0, 0};
  int exponent;
  const double scale = std::frexp(largest, &exponent) * 256 / largest;
  return {uint8_t(c.x * scale), uint8_t(c.y * scale), uint8_t(c.z * scale), uint8_t(exponent + 128)};
}

}  // namespace

std::vector<uint8_t> make_sky(int width, int height, Vec3 to_sun)
{
  const std::string header = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y " + std::to_string(height) + " +X " +
                             std::to_string(width) + "\n";
  std::vector<uint8_t> file(header.begin(), header.end());
  std::vector<std::array<uint8_t, 4>> row(static_cast<size_t>(width));
  for (int j = 0; j < height; ++j) {
    const double theta = pi * (j + 0.5) / height;
    for (int i = 0; i < width; ++i) {
      // The left edge looks along -Z, a quarter across along +X.
      const double phi = 2 * pi * (i + 0.5) / width;
      const Vec3 d{std::sin(theta) * std::sin(phi), std::cos(theta), -std::sin(theta) * std::cos(phi)};
      row[size_t(i)] = to_rgbe(sky_radiance(d, to_sun));
    }
    // A row holds its four components one after the other, here in pieces without repetition.
    file.insert(file.end(), {2, 2, uint8_t(width >> 8), uint8_t(width & 0xff)});
    for (size_t c = 0; c < 4; ++c) {
      for (int first = 0; first < width; first += 128) {
        const int n = std::min(128, width - first);
        file.push_back(uint8_t(n));
        for (int i = first; i < first + n; ++i) file.push_back(row[size_t(i)][c]);
      }
    }
  }
  return file;
}

}  // namespace cli::scenes
