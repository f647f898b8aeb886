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

constexpr double max_move = 3;  // of a mean towards its neighbours' median, in standard deviations

// Three rows of moments around the one that is looked at; at the border the outermost row stands for the missing one.
class RowWindow {
 public:
  RowWindow(uint32_t width, uint32_t height, const MomentSource &source) : height_(height), source_(source)
  {
    for (auto &row : rows_) row.resize(width);
    load(0);
  }
  /// Rows y - 1, y and y + 1; y rises by one a call from 0 on.
  std::array<const PixelMoments *, 3> around(uint32_t y)
  {
    if (y + 1 < height_) load(y + 1);
    return {row(y > 0 ? y - 1 : 0), row(y), row(std::min(y + 1, height_ - 1))};
  }

 private:
  const PixelMoments *row(uint32_t y) const { return rows_[y % 3].data(); }
  void load(uint32_t y) { source_(y, y + 1, rows_[y % 3].data()); }

  uint32_t height_;
  const MomentSource &source_;
  std::array<std::vector<PixelMoments>, 3> rows_;
};

// The median of nine values by 19 exchanges, some of which matter on one side alone.
float median9(std::array<float, 9> v)
{
  const auto sort = [&](int a, int b) {
    const float lo = std::min(v[a], v[b]), hi = std::max(v[a], v[b]);
    v[a] = lo;
    v[b] = hi;
  };
  for (int k = 0; k < 9; k += 3) {
    sort(k + 1, k + 2);
    sort(k, k + 1);
    sort(k + 1, k + 2);
  }
  // Largest of the smallest, median of the medians, smallest of the largest.
  v[6] = std::max(v[3], std::max(v[0], v[6]));
  sort(4, 7);
  v[4] = std::max(v[1], std::min(v[4], v[7]));
  v[2] = std::min(v[2], std::min(v[5], v[8]));
  return std::max(std::min(v[6], v[4]), std::min(std::max(v[6], v[4]), v[2]));
}

}  // namespace

ErrorEstimate estimate_relmse(uint32_t width, uint32_t height, double num_samples, double unseen_radiance,
                              const MomentSource &moments)
{
  RowWindow window(width, height, moments);
  double sum = 0, sum2 = 0, inverse_sum = 0, bias_sum = 0, bias_sum2 = 0;
  for (uint32_t y = 0; y < height; ++y) {
    const auto rows = window.around(y);
    for (uint32_t x = 0; x < width; ++x) {
      const uint32_t left = x > 0 ? x - 1 : 0, right = std::min(x + 1, width - 1);
      const PixelMoments &pixel = rows[1][x];
      double error = 0, bias = 0;
      for (int c = 0; c < 3; ++c) {
        std::array<float, 9> means;
        for (size_t row = 0; row < 3; ++row) {
          means[3 * row] = rows[row][left].mean[c];
          means[3 * row + 1] = rows[row][x].mean[c];
          means[3 * row + 2] = rows[row][right].mean[c];
        }
        const double move = max_move * std::sqrt(double(pixel.variance[c]));
        const double mean = std::clamp(double(median9(means)), pixel.mean[c] - move, pixel.mean[c] + move);
        const double inverse = 1 / (mean * mean + relmse_floor);
        error += double(pixel.variance[c]) * inverse;
        bias += double(pixel.bias2[c]) * inverse;
        if (pixel.is_covered) inverse_sum += inverse;
      }
      sum += error;
      sum2 += error * error;
      bias_sum += bias;
      bias_sum2 += bias * bias;
    }
  }
  const double num_pixels = double(width) * height;
  if (!(sum < infinity)) return {infinity, 0};

  const double seen = sum > 0 ? (sum + num_sigmas * std::sqrt(sum2)) / (3 * num_pixels) : 0;
  // Variance of a mean of num_samples: p X^2 / num_samples, p = 3 / (num_pixels num_samples).
  const double unseen = rule_of_three * unseen_radiance * unseen_radiance /
                        (num_pixels * num_samples * num_samples) * inverse_sum / (3 * num_pixels);
  const double bias = (bias_sum + num_sigmas * std::sqrt(bias_sum2)) / (3 * num_pixels);
  return {seen + (num_samples > 0 ? unseen : 0), bias < infinity ? std::max(bias, 0.0) : infinity};
}

double unseen_radiance(const CompiledScene &scene)
{
  const Box &b = scene.bounds;
  if (is_empty(b)) return 0;
  const double diagonal =
      std::sqrt(std::pow(double(b.hi.x) - b.lo.x, 2) + std::pow(double(b.hi.y) - b.lo.y, 2) +
                std::pow(double(b.hi.z) - b.lo.z, 2));
  const double distance2 = diagonal * diagonal / 64;
  const auto position = [&](const Light &light, uint32_t corner) {
    const UInt3 ids = scene.indices[light.triangle];
    const Vec3f p = scene.positions[corner == 0 ? ids.x : corner == 1 ? ids.y : ids.z];
    return light.placement == invalid_id
               ? p
               : transform_point(scene.placements[light.placement].object_to_world, p);
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
