#include "scene/environment_table.h"

#include <algorithm>

#include "core/scene/texture.h"
#include "scene/parallel.h"
#include "scene/trigonometry.h"

namespace gpurt {
namespace {

// Images up to this size get a table of twice their width and height.
constexpr uint64_t max_fine_texels = uint64_t(1) << 22;

// Nonzero weights are raised to this share of their sum, so that no step of a table rounds to nothing: where there is
// radiance there is density. Floats below 1 are 2^-24 apart or less.
constexpr double smallest_share = 0x1p-22;

// Weights of the texels before, at and after a cell in the mean of the bilinear interpolation over the cell. A cell is
// a texel, or one half of it.
struct CellFilter {
  double weight[3];
};

CellFilter cell_filter(uint32_t cell, uint32_t cells_per_texel)
{
  if (cells_per_texel == 1) return {{0.125, 0.75, 0.125}};
  if (cell % 2 == 0) return {{0.25, 0.75, 0}};
  return {{0, 0.75, 0.25}};
}

double texel_luminance(const Texture &texture, Vec3f factor, int64_t x, int64_t y)
{
  const Texel t = fetch_texel(texture, wrap_texel(x, texture.width, texture.wrap_u),
                              wrap_texel(y, texture.height, texture.wrap_v));
  // Every channel counts: radiance of any colour must get a weight that does not round to nothing.
  return 0.2126 * factor.x * double(t.r) + 0.7152 * factor.y * double(t.g) + 0.0722 * factor.z * double(t.b);
}

// Writes the cumulative distribution of n weights, cdf[0] = 0 to cdf[n] = 1; uniform if all are 0. Returns their sum.
double fill_cdf(double *weights, uint32_t n, float *cdf)
{
  double total = 0;
  for (uint32_t i = 0; i < n; ++i) total += weights[i];
  const double least = total * smallest_share;
  double raised_total = 0;
  for (uint32_t i = 0; i < n; ++i) {
    if (total <= 0) weights[i] = 1;
    else if (weights[i] > 0) weights[i] = std::max(weights[i], least);
    raised_total += weights[i];
  }
  double sum = 0;
  cdf[0] = 0;
  for (uint32_t i = 0; i < n; ++i) {
    sum += weights[i];
    cdf[i + 1] = float(sum / raised_total);
  }
  // Rounding of the sum must leave no share to trailing cells of weight 0, nor take it from the last that has some.
  for (uint32_t i = n; i > 0; --i) {
    cdf[i] = 1;
    if (weights[i - 1] > 0) break;
  }
  return total;
}

}  // namespace

void compile_environment(const EnvironmentData &environment, CompiledScene &scene)
{
  Environment &e = scene.environment;
  e = {};
  e.radiance = environment.radiance;
  e.texture = invalid_id;
  if (max_component(environment.radiance) <= 0) return;  // black, with or without a texture
  e.is_present = 1;
  if (environment.texture == invalid_id) return;

  // The image wraps around in u and ends in v, whatever the texture says for its use on surfaces.
  Texture texture = scene.textures[environment.texture];
  texture.wrap_u = Wrap::Repeat;
  texture.wrap_v = Wrap::Clamp;
  texture.nearest = 0;
  e.texture = uint32_t(scene.textures.size());
  scene.textures.push_back(texture);
  const uint64_t num_texels = uint64_t(texture.width) * texture.height;
  const uint32_t fineness = num_texels > max_fine_texels ? 1 : 2;
  e.width = texture.width * fineness;
  e.height = texture.height * fineness;
  scene.environment_rows.resize(uint64_t(e.height) + 1);
  scene.environment_columns.resize(uint64_t(e.height) * (uint64_t(e.width) + 1));

  std::vector<double> row_weights(e.height), row_sines(e.height);
  tbb::parallel_for(
      tbb::blocked_range<uint32_t>(0, e.height, 4), [&](const tbb::blocked_range<uint32_t> &rows) {
        std::vector<double> texel_row(texture.width), weights(e.width);
        for (uint32_t y = rows.begin(); y != rows.end(); ++y) {
          const CellFilter fy = cell_filter(y, fineness);
          const int64_t ty = y / fineness;
          std::fill(texel_row.begin(), texel_row.end(), 0);
          for (int k = 0; k < 3; ++k) {
            if (fy.weight[k] == 0) continue;
            for (uint32_t x = 0; x < texture.width; ++x) {
              texel_row[x] += fy.weight[k] * texel_luminance(texture, e.radiance, x, ty + k - 1);
            }
          }
          for (uint32_t x = 0; x < e.width; ++x) {
            const CellFilter fx = cell_filter(x, fineness);
            const int64_t tx = x / fineness;
            double w = 0;
            for (int k = 0; k < 3; ++k) {
              if (fx.weight[k] != 0)
                w += fx.weight[k] * texel_row[wrap_texel(tx + k - 1, texture.width, texture.wrap_u)];
            }
            weights[x] = w;
          }
          const double theta = pi_double * (y + 0.5) / e.height;
          row_sines[y] = sine(std::min(theta, pi_double - theta));
          row_weights[y] =
              row_sines[y] * fill_cdf(weights.data(), e.width,
                                      &scene.environment_columns[uint64_t(y) * (uint64_t(e.width) + 1)]);
        }
      });
  double sines = 0;
  for (double s : row_sines) sines += s;
  const double total = fill_cdf(row_weights.data(), e.height, scene.environment_rows.data());
  e.mean_luminance = float(total / (sines * e.width));
  if (total <= 0) {  // a black image
    scene.environment_rows = {};
    scene.environment_columns = {};
    scene.textures.pop_back();
    e = {};
    e.texture = invalid_id;
  }
}

}  // namespace gpurt
