#include "image/metrics.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "error.h"

namespace gpurt {

namespace {

double relative_square(double x, double r) { return (x - r) * (x - r) / (r * r + 0.01); }

}  // namespace

ImageErrors compare_images(const float *image, const float *reference, uint64_t num_pixels, double trim)
{
  if (num_pixels == 0) fail_invalid("images without pixels cannot be compared");
  if (!(trim >= 0 && trim < 1)) fail_invalid("trim is {}; it must lie in [0, 1)", trim);
  ImageErrors errors;
  std::vector<double> per_pixel(num_pixels);
  double reference_sum = 0;
  for (uint64_t p = 0; p < num_pixels; ++p) {
    double sum = 0;
    for (int c = 0; c < 3; ++c) {
      const double x = image[3 * p + c], r = reference[3 * p + c];
      sum += relative_square(x, r);
      errors.bias_rgb[c] += x - r;
      reference_sum += r;
    }
    per_pixel[p] = sum / 3;
  }
  for (double &bias : errors.bias_rgb) bias /= double(num_pixels);
  errors.bias = (errors.bias_rgb[0] + errors.bias_rgb[1] + errors.bias_rgb[2]) / 3;
  const double reference_mean = reference_sum / (3 * double(num_pixels));
  errors.bias_relative = reference_mean != 0 ? errors.bias / reference_mean : std::nan("");
  errors.relmse = std::accumulate(per_pixel.begin(), per_pixel.end(), 0.0) / double(num_pixels);

  const auto dropped = uint64_t(std::ceil(double(num_pixels) * trim));
  const uint64_t keep = std::max<uint64_t>(num_pixels - dropped, 1);
  std::nth_element(per_pixel.begin(), per_pixel.begin() + ptrdiff_t(keep - 1), per_pixel.end());
  errors.trimmed =
      std::accumulate(per_pixel.begin(), per_pixel.begin() + ptrdiff_t(keep), 0.0) / double(keep);
  return errors;
}

std::vector<TileErrors> compare_tiles(const float *image, const float *reference, uint32_t width,
                                      uint32_t height, uint32_t tile_size)
{
  if (tile_size == 0) fail_invalid("tile_size is 0; it must be at least 1");
  std::vector<TileErrors> tiles;
  for (uint64_t y0 = 0; y0 < height; y0 += tile_size) {
    for (uint64_t x0 = 0; x0 < width; x0 += tile_size) {
      const uint64_t x1 = std::min<uint64_t>(x0 + tile_size, width),
                     y1 = std::min<uint64_t>(y0 + tile_size, height);
      TileErrors tile{uint32_t(x0), uint32_t(y0), uint32_t(x1), uint32_t(y1), {}, {}, 0};
      for (uint64_t y = y0; y < y1; ++y) {
        for (uint64_t x = x0; x < x1; ++x) {
          for (int c = 0; c < 3; ++c) {
            const uint64_t i = 3 * (y * width + x) + c;
            tile.mean[c] += image[i];
            tile.reference_mean[c] += reference[i];
            tile.relmse += relative_square(image[i], reference[i]);
          }
        }
      }
      const double num_pixels = double((x1 - x0) * (y1 - y0));
      for (int c = 0; c < 3; ++c) {
        tile.mean[c] /= num_pixels;
        tile.reference_mean[c] /= num_pixels;
      }
      tile.relmse /= 3 * num_pixels;
      tiles.push_back(tile);
    }
  }
  return tiles;
}

}  // namespace gpurt
