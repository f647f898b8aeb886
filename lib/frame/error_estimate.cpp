#include "frame/error_estimate.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "error.h"

namespace gpurt {

namespace {

constexpr double relmse_floor = 0.01;  // of the measure itself
constexpr double num_sigmas = 2;       // of the uncertainty that the sum is raised by
constexpr double rule_of_three = 3;    // -ln 0.05

// Three rows of moments around the one that is looked at; missing neighbours at the border are left out.
class RowWindow {
 public:
  RowWindow(uint32_t width, uint32_t height, const MomentSource &source) : height_(height), source_(source)
  {
    for (auto &row : rows_) row.resize(width);
    load(0);
  }
  /// Rows from y - 1 to y + 1, null outside the frame; y rises by one a call from 0 on.
  std::array<const PixelMoments *, 3> around(uint32_t y)
  {
    if (y + 1 < height_) load(y + 1);
    return {y > 0 ? row(y - 1) : nullptr, row(y), y + 1 < height_ ? row(y + 1) : nullptr};
  }

 private:
  const PixelMoments *row(uint32_t y) const { return rows_[y % 3].data(); }
  void load(uint32_t y) { source_(y, y + 1, rows_[y % 3].data()); }

  uint32_t height_;
  const MomentSource &source_;
  std::array<std::vector<PixelMoments>, 3> rows_;
};

}  // namespace

double estimate_relmse(uint32_t width, uint32_t height, double num_samples, double unseen_radiance,
                       const MomentSource &moments)
{
  RowWindow window(width, height, moments);
  double sum = 0, sum2 = 0, inverse_sum = 0;
  for (uint32_t y = 0; y < height; ++y) {
    const auto rows = window.around(y);
    for (uint32_t x = 0; x < width; ++x) {
      const uint32_t x0 = x > 0 ? x - 1 : 0, x1 = std::min(x + 1, width - 1);
      double pixel = 0;
      for (int c = 0; c < 3; ++c) {
        double variance = 0;
        int n = 0;
        for (const PixelMoments *row : rows) {
          if (!row) continue;
          for (uint32_t k = x0; k <= x1; ++k, ++n) variance += double(row[k].variance[c]);
        }
        const double mean = double(rows[1][x].mean[c]);
        const double denominator = mean * mean + relmse_floor;
        pixel += variance / (n * denominator);
        if (rows[1][x].is_covered) inverse_sum += 1 / denominator;
      }
      sum += pixel;
      sum2 += pixel * pixel;
    }
  }
  const double num_pixels = double(width) * height;
  if (!(sum < infinity)) return infinity;

  // Dilation spreads a contribution over nine pixels, so nine times fewer of them are independent.
  const double independent = sum2 > 0 ? sum * sum / sum2 / 9 : 0;
  const double seen = sum / (3 * num_pixels) * (independent > 0 ? 1 + num_sigmas / std::sqrt(independent) : 1);
  // Variance of a mean of num_samples: p X^2 / num_samples, p = 3 / (num_pixels num_samples).
  const double unseen = rule_of_three * unseen_radiance * unseen_radiance / (num_pixels * num_samples * num_samples) *
                        inverse_sum / (3 * num_pixels);
  return seen + (num_samples > 0 ? unseen : 0);
}

double unseen_radiance(const CompiledScene &scene)
{
  const Box &b = scene.bounds;
  if (is_empty(b)) return 0;
  const double diagonal = std::sqrt(std::pow(double(b.hi.x) - b.lo.x, 2) + std::pow(double(b.hi.y) - b.lo.y, 2) +
                                    std::pow(double(b.hi.z) - b.lo.z, 2));
  const double distance2 = diagonal * diagonal / 64;
  const auto position = [&](const Light &light, uint32_t corner) {
    const UInt3 ids = scene.indices[light.triangle];
    const Vec3f p = scene.positions[corner == 0 ? ids.x : corner == 1 ? ids.y : ids.z];
    return light.placement == invalid_id ? p : transform_point(scene.placements[light.placement].object_to_world, p);
  };
  double sum = 0;
  for (const Light &light : scene.lights) {
    const double color = double(max_component(light.color));
    switch (light.type) {
      case LightType::Triangle: {
        const Vec3f p0 = position(light, 0);
        const double area = 0.5 * double(length(cross(position(light, 1) - p0, position(light, 2) - p0)));
        // At most the radiance that a lamp filling the hemisphere would show.
        sum += std::min(color, color * area / (distance2 * double(pi)));
        break;
      }
      case LightType::Point:
      case LightType::Spot:
        if (distance2 > 0) sum += color / (distance2 * double(pi));
        break;
      case LightType::Distant:
        sum += color / double(pi);
        break;
      case LightType::Environment:
        break;  // it is counted below
    }
  }
  const Environment &e = scene.environment;
  if (e.is_present) sum += double(e.texture == invalid_id ? max_component(e.radiance) : e.mean_luminance);
  return std::isfinite(sum) ? sum : 0;
}

}  // namespace gpurt
