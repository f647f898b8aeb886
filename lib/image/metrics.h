// How far an image is from a reference.
#pragma once

#include <cstdint>
#include <vector>

namespace gpurt {

/// Planes are linear RGB, float [height][width][3], finite.
struct ImageErrors {
  double relmse = 0;         // mean over pixels and channels of (x - r)^2 / (r^2 + 0.01)
  double trimmed = 0;        // the same without the worst 0.1 % of pixels, which fireflies cannot move
  double bias = 0;           // mean of x - r
  double bias_rgb[3] = {};   // per channel
  double bias_relative = 0;  // as a share of the reference's mean; NaN for a black reference
};
ImageErrors compare_images(const float *image, const float *reference, uint64_t num_pixels,
                           double trim = 0.001);

/// Means of one 8 x 8 tile (smaller at the right and bottom edges), over pixels, per channel.
struct TileErrors {
  uint32_t x0, y0, x1, y1;
  double mean[3];  // of the image
  double reference_mean[3];
  double relmse;
};
std::vector<TileErrors> compare_tiles(const float *image, const float *reference, uint32_t width,
                                      uint32_t height, uint32_t tile_size = 8);

}  // namespace gpurt
