// Rays of an image in tiles of 8 x 4, one a warp: neighbours in both directions, rather than in a row alone, go the same
// way through a tree.
#pragma once

#include <cstdint>

#include "core/platform.h"

namespace gpurt::cuda {

class TiledRows {
 public:
  /// Rays [y * width + x]; width 0: the rays have no such order, and are taken one by one.
  TiledRows(uint32_t width, uint32_t num_rays)
      : width_(width), tiles_per_row_((width + tile_width - 1) / tile_width), num_rays_(num_rays)
  {
    if (width == 0) return;
    // tile / tiles_per_row = tile * reciprocal >> 32 as long as tile * tiles_per_row < 2^32. Longer rows are taken as they are.
    const uint64_t num_tiles = num_items() / (tile_width * tile_height);
    if (num_tiles * tiles_per_row_ < uint64_t(1) << 32 && tiles_per_row_ > 1)
      reciprocal_ = uint32_t((uint64_t(1) << 32) / tiles_per_row_ + 1);
    else width_ = 0;
  }
  /// Threads that it takes.
  uint64_t num_items() const
  {
    if (width_ == 0) return num_rays_;
    const uint64_t rows = (uint64_t(num_rays_) + width_ - 1) / width_;
    return (rows + tile_height - 1) / tile_height * tiles_per_row_ * (tile_width * tile_height);
  }
  /// The ray of an item; num_rays or more: none.
  GPURT_INLINE uint32_t ray_of(uint32_t item) const
  {
    if (width_ == 0) return item;
    const uint32_t tile = item / (tile_width * tile_height), lane = item % (tile_width * tile_height);
    const uint32_t tile_y = uint32_t(uint64_t(tile) * reciprocal_ >> 32),
                   tile_x = tile - tile_y * tiles_per_row_;
    const uint32_t x = tile_x * tile_width + lane % tile_width, y = tile_y * tile_height + lane / tile_width;
    return x < width_ ? y * width_ + x : num_rays_;
  }

 private:
  static constexpr uint32_t tile_width = 8, tile_height = 4;
  uint32_t width_, tiles_per_row_, num_rays_;
  uint32_t reciprocal_ = 0;  // of tiles_per_row_
};

}  // namespace gpurt::cuda
