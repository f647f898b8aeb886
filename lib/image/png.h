// PNG files of tonemapped colours.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

namespace gpurt {

/// x / (1 + x), then the sRGB curve, in [0, 1]. Negative and NaN give 0, infinity gives 1.
float tonemap(float radiance);

/// Fills row y with linear RGB, float [width][3].
using PngFill = std::function<void(uint32_t y, float *rgb)>;

/// Writes an 8-bit sRGB file. Throws IO; what was at `path` stays until the new file is whole.
void write_png(const std::string &path, uint32_t width, uint32_t height, const PngFill &fill);

}  // namespace gpurt
