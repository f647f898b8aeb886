#include "frame/error_estimate.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "error.h"
#include "scene/emission_table.h"

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

// How many pixels of a frame go together: see estimate_relmse.
class BlotchArea {
 public:
  BlotchArea(uint32_t width, uint32_t height)
  {
    // Of fewer than 16 squares the variance says little.
    for (uint32_t size = 2; 4 * size <= std::min(width, height); size *= 2)
      levels_.push_back({size, std::vector<Vec3d>(width / size + 1, Vec3d{}), 0});
  }
  /// Pixels come row by row; `deviation` is half of the difference of the halves, over the root of the denominator.
  void add(uint32_t x, int channel, double deviation)
  {
    if (!std::isfinite(deviation)) return;
    sum2_ += deviation * deviation;
    for (Level &level : levels_) level.row[x / level.size][channel] += deviation;
  }
  void end_row(uint32_t y)
  {
    for (Level &level : levels_) {
      if ((y + 1) % level.size == 0) level.end_squares();
    }
  }
  double finish()
  {
    double area = 1;
    for (Level &level : levels_) {
      level.end_squares();
      if (sum2_ > 0) area = std::max(area, level.sum2 / sum2_);
    }
    return area;
  }

 private:
  using Vec3d = std::array<double, 3>;
  struct Level {
    uint32_t size;
    std::vector<Vec3d> row;  // of squares
    double sum2;

    void end_squares()
    {
      for (Vec3d &square : row) {
        for (const double sum : square) sum2 += sum * sum;
        square = {};
      }
    }
  };
  std::vector<Level> levels_;
  double sum2_ = 0;
};

}  // namespace

ErrorEstimate estimate_relmse(uint32_t width, uint32_t height, double num_samples, double unseen_radiance,
                              const MomentSource &moments, const PhotonDoubt *photons)
{
  BlotchArea blotches(photons ? width : 0, photons ? height : 0);
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
        double mean = std::clamp(double(median9(means)), pixel.mean[c] - move, pixel.mean[c] + move);
        const double deviation = std::sqrt(double(pixel.variance[c]));
        if (photons) mean = std::clamp(double(pixel.mean[c]) - deviation, 0.0, std::max(mean, 0.0));
        const double inverse = 1 / (mean * mean + relmse_floor);
        if (photons)
          blotches.add(x, c, (pixel.is_first_larger[c] ? deviation : -deviation) * std::sqrt(inverse));
        error += double(pixel.variance[c]) * inverse;
        bias += double(pixel.bias2[c]) * inverse;
        if (pixel.is_covered) inverse_sum += inverse;
      }
      sum += error;
      sum2 += error * error;
      bias_sum += bias;
      bias_sum2 += bias * bias;
    }
    if (photons) blotches.end_row(y);
  }
  const double num_pixels = double(width) * height;
  if (!(sum < infinity)) return {infinity, 0};

  const double area = photons ? blotches.finish() : 1;
  const double seen = sum > 0 ? (sum + num_sigmas * std::sqrt(area * sum2)) / (3 * num_pixels) : 0;
  // Variance of a mean of num_samples: p X^2 / num_samples, p = 3 / (num_pixels num_samples).
  double unseen2 = unseen_radiance * unseen_radiance;
  if (photons) {
    const double lit = photons->num_gathered > 0 ? area : num_pixels;
    unseen2 += lit * photons->photon_radiance * photons->photon_radiance;
  }
  const double unseen =
      rule_of_three * unseen2 / (num_pixels * num_samples * num_samples) * inverse_sum / (3 * num_pixels);
  const double bias = (bias_sum + num_sigmas * std::sqrt(bias_sum2)) / (3 * num_pixels);
  return {seen + (num_samples > 0 ? unseen : 0), bias < infinity ? std::max(bias, 0.0) : infinity};
}

double photon_radiance(const CompiledScene &scene, const PhotonSettings &settings, double radius)
{
  if (settings.photons_per_pass == 0 || !(radius > 0)) return 0;
  const double power = double(make_emission_table(scene).view().total_weight);
  const double norm = settings.kernel == PhotonKernel::Cone ? 3 : 1;  // as of make_photon_pass
  const double radiance =
      norm * power / (double(settings.photons_per_pass) * double(pi) * double(pi) * radius * radius);
  return std::isfinite(radiance) ? radiance : 0;
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
