// OpenEXR files: multi-layer frames out, plain images in.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace gpurt {

/// Linear RGBA, row major, top row first.
struct ImageRgba {
  uint32_t width = 0, height = 0;
  std::vector<float> pixels;  // [height][width][4]
};

/// Reads R, G, B and A (1 if absent; a lone Y is repeated) of an EXR file, of any compression, scanlines or tiles.
/// Throws IO with one line that names the file and its defect, OUT_OF_MEMORY.
ImageRgba read_exr_rgba(const std::string &path);

enum class ExrType { Float, Uint };

/// A channel of 32-bit values, by its name in the file: "R", "normal.X", "depth.Z".
struct ExrChannel {
  std::string name;
  ExrType type = ExrType::Float;
};

using ExrValue = std::variant<std::string, int, float>;
using ExrAttributes = std::vector<std::pair<std::string, ExrValue>>;  // name in the header, value

/// Fills rows [y0, y1) of every channel: planes[c] is [y1 - y0][width] of float or uint32_t.
using ExrFill = std::function<void(uint32_t y0, uint32_t y1, const std::vector<void *> &planes)>;

/// Writes a single-part scanline file with ZIP compression, a block of rows at a time: the rows of a large frame are
/// never in memory at once. Throws IO; what was at `path` stays until the new file is whole.
void write_exr(const std::string &path, uint32_t width, uint32_t height,
               const std::vector<ExrChannel> &channels, const ExrAttributes &attributes, const ExrFill &fill);

}  // namespace gpurt
