// Reading the reference images and their noise, and the statistical comparison with them.
#pragma once

#include <ImfArray.h>
#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputFile.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace gpurt_test {

struct RgbImage {
  uint32_t width = 0, height = 0;
  std::vector<float> rgb;
};

inline RgbImage read_rgb_exr(const std::string &path)
{
  Imf::InputFile file(path.c_str());
  const Imath::Box2i window = file.header().dataWindow();
  RgbImage image;
  image.width = uint32_t(window.max.x - window.min.x + 1);
  image.height = uint32_t(window.max.y - window.min.y + 1);
  image.rgb.resize(size_t(image.width) * image.height * 3);
  const size_t x_stride = 3 * sizeof(float), y_stride = x_stride * image.width;
  char *base = reinterpret_cast<char *>(image.rgb.data()) - window.min.x * ptrdiff_t(x_stride) -
               window.min.y * ptrdiff_t(y_stride);
  Imf::FrameBuffer buffer;
  const char *names[3] = {"R", "G", "B"};
  for (int c = 0; c < 3; ++c) {
    buffer.insert(names[c], Imf::Slice(Imf::FLOAT, base + c * sizeof(float), x_stride, y_stride));
  }
  file.setFrameBuffer(buffer);
  file.readPixels(window.min.y, window.max.y);
  return image;
}

struct ImageComparison {
  double relmse = 0, trimmed = 0;   // trimmed: without the worst 0.1 % of pixels
  double expected = 0;              // of relmse: the noise of both images
  double mean_ratio = 0;            // of the image's mean to the reference's
  double tiles_within_4_sigma = 0;  // share of 8x8 tiles and channels
  double worst_sigma = 0;
};

/// `variance` is that of each pixel and channel of `image`; `reference_relmse` the reference's own noise.
inline ImageComparison compare_images(const std::vector<float> &image, const std::vector<float> &variance,
                                      const RgbImage &reference, double reference_relmse)
{
  ImageComparison result;
  const size_t num_pixels = size_t(reference.width) * reference.height;
  std::vector<double> errors(num_pixels, 0);
  double sum_image = 0, sum_reference = 0;
  for (size_t p = 0; p < num_pixels; ++p) {
    for (int c = 0; c < 3; ++c) {
      const double x = image[3 * p + c], r = reference.rgb[3 * p + c];
      errors[p] += (x - r) * (x - r) / (r * r + 0.01) / 3;
      result.expected += variance[3 * p + c] / (r * r + 0.01) / 3 / num_pixels;
      sum_image += x;
      sum_reference += r;
    }
  }
  std::sort(errors.begin(), errors.end());
  const size_t kept = num_pixels - size_t(std::ceil(num_pixels * 0.001));
  for (size_t p = 0; p < num_pixels; ++p) {
    result.relmse += errors[p] / num_pixels;
    if (p < kept) result.trimmed += errors[p] / kept;
  }
  result.expected += reference_relmse;
  result.mean_ratio = sum_image / sum_reference;

  size_t within = 0, total = 0;
  for (uint32_t y0 = 0; y0 < reference.height; y0 += 8) {
    for (uint32_t x0 = 0; x0 < reference.width; x0 += 8) {
      for (int c = 0; c < 3; ++c) {
        double x = 0, r = 0, var = 0;
        int n = 0;
        for (uint32_t y = y0; y < std::min(y0 + 8, reference.height); ++y) {
          for (uint32_t k = x0; k < std::min(x0 + 8, reference.width); ++k, ++n) {
            const size_t i = (size_t(y) * reference.width + k) * 3 + size_t(c);
            const double value = reference.rgb[i];
            x += image[i];
            r += value;
            var += variance[i] + reference_relmse * (value * value + 0.01);
          }
        }
        // The references are stored with 10 bits of mantissa: half a step is 2^-11 of the value.
        const double sigma = std::sqrt(var) / n + std::abs(r / n) * std::ldexp(1.0, -11);
        const double deviation = sigma > 0 ? std::abs(x - r) / n / sigma : (x == r ? 0 : HUGE_VAL);
        result.worst_sigma = std::max(result.worst_sigma, deviation);
        within += deviation <= 4 ? 1 : 0;
        total++;
      }
    }
  }
  result.tiles_within_4_sigma = double(within) / double(total);
  return result;
}

}  // namespace gpurt_test
