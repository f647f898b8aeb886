// What a bucket's samples see at the farthest, tile by tile: surfaces behind that need not be looked at.
// Source: Greene, Kass and Miller 1993, hierarchical Z-buffer visibility; here of one level.
#pragma once

#include "core/reyes/sample.h"
#include "cpu/reyes/lanes.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

// Samples only ever see nearer surfaces: what was found of a tile stays a bound, and is found anew where a surface came since.
class DepthTiles {
 public:
  explicit DepthTiles(const SampleBlock &block)
      : block_(block),
        bits_(block.cell_bits + tile_bits),
        width_((block.cells_x + tile_cells - 1) >> tile_bits),
        height_((block.cells_y + tile_cells - 1) >> tile_bits)
  {
    if (width_ * height_ > most_tiles) width_ = height_ = 0;
    for (int32_t t = 0; t < width_ * height_; ++t) tiles_[t] = {0.0f, invalid_id, true};
  }

  // Whether all samples of a box, in raster units from the block's origin, see something nearer than 1 / w = z.
  bool hides(float x0, float y0, float x1, float y1, float z)
  {
    const Range r = range(x0, y0, x1, y1);
    for (int32_t y = r.y0; y <= r.y1; ++y) {
      for (int32_t x = r.x0; x <= r.x1; ++x) {
        Tile &t = tiles_[y * width_ + x];
        if (z < t.least) continue;
        // One sample that sees nothing nearer is enough.
        if (!t.is_old || (t.witness != invalid_id && block_.z[t.witness] <= z)) return false;
        look_at(x, y, t);
        if (!(z < t.least)) return false;
      }
    }
    // Without tiles nothing is known.
    return r.x0 <= r.x1 && r.y0 <= r.y1;
  }

  // A surface has come into the box.
  void touch(float x0, float y0, float x1, float y1)
  {
    const Range r = range(x0, y0, x1, y1);
    for (int32_t y = r.y0; y <= r.y1; ++y) {
      for (int32_t x = r.x0; x <= r.x1; ++x) tiles_[y * width_ + x].is_old = true;
    }
  }

 private:
  static constexpr int32_t tile_bits = 4, tile_cells = 1 << tile_bits, most_tiles = 100;
  struct Range {
    int32_t x0, y0, x1, y1;
  };
  struct Tile {
    float least;       // 1 / w
    uint32_t witness;  // a sample that had no more when the tile was looked at
    bool is_old;
  };

  Range range(float x0, float y0, float x1, float y1) const
  {
    const auto tile = [&](float x, int32_t n) {
      const float end = float(n << bits_);
      return int32_t(clamp(x, 0.0f, end - 1.0f)) >> bits_;
    };
    if (width_ == 0) return {0, 0, -1, -1};
    return {tile(x0, width_), tile(y0, height_), tile(x1, width_), tile(y1, height_)};
  }

  void look_at(int32_t x, int32_t y, Tile &t) const
  {
    const int32_t x0 = x << tile_bits, x1 = min(x0 + tile_cells, block_.cells_x), y0 = y << tile_bits,
                  y1 = min(y0 + tile_cells, block_.cells_y);
    t = {infinity, invalid_id, false};
    for (int32_t row = y0; row < y1; ++row) {
      const uint32_t *first = block_.first + row * block_.cells_x;
      const uint32_t end = first[x1];
      FloatLanes least = lanes(infinity);
      uint32_t k = first[x0];
      for (; k + num_lanes <= end; k += num_lanes) least = min(least, load_lanes(block_.z + k));
      float of_row = infinity;
      for (uint32_t i = 0; i < num_lanes; ++i) of_row = min(of_row, least[i]);
      for (; k < end; ++k) of_row = min(of_row, block_.z[k]);
      if (!(of_row < t.least)) continue;
      t.least = of_row;
      for (k = first[x0]; block_.z[k] != of_row;) ++k;
      t.witness = k;
      if (of_row == 0.0f) return;
    }
  }

  const SampleBlock block_;
  const int32_t bits_;  // log2 of a tile's edge in raster units
  int32_t width_, height_;
  Tile tiles_[most_tiles];
};

GPURT_FUNCTIONS_END
}  // namespace gpurt
