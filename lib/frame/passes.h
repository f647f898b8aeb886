// How a job cuts its tiles into work units: rectangles of pixels that are at the same sample, a few samples at a time.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "backend.h"

namespace gpurt {

/// A rectangle whose pixels have the same samples: `num_samples` of them from `first_sample` on.
struct Region {
  gpurt_tile tile;
  uint64_t first_sample;
  uint64_t num_samples;
};

/// Throws INVALID_ARGUMENT naming the first tile that is empty, leaves the frame or overlaps an earlier one.
void check_tiles(std::span<const gpurt_tile> tiles, uint32_t width, uint32_t height);

/// Cuts tiles into squares of tile_size aligned to multiples of it (smaller at borders), row by row.
std::vector<gpurt_tile> cut_tiles(std::span<const gpurt_tile> tiles, uint32_t tile_size);

/// Splits a tile, halving its longer side, until the key is the same throughout each part.
void split_uniform(const gpurt_tile &tile, const std::function<uint64_t(uint32_t x, uint32_t y)> &key,
                   std::vector<gpurt_tile> &out);

/// Units that bring every region to `num_samples`; the regions are advanced accordingly.
///
/// There is never more than one unit for a pixel: whatever a cancelled pass leaves out, no pixel has a gap.
std::vector<WorkUnit> take_units(std::vector<Region> &regions, uint64_t num_samples);

/// Largest square work unit. What a cancelled unit has done is lost: of 256 pixels, some tens of milliseconds of a CPU
/// thread for a sample.
constexpr uint32_t max_tile_size = 256;

/// Edge of the work units where the caller did not choose one: so small that every worker gets several, not smaller
/// than what keeps a unit's fixed cost low.
uint32_t choose_tile_size(std::span<const gpurt_tile> tiles, uint32_t num_threads, uint32_t largest = 32);

/// Numbers of samples at which a frame that aims for an error looks at it: 32, 48, 64, 96, 128, ...: about 1.4 times
/// more each time, with halves that are multiples of large powers of two, for which low-discrepancy points are best.
/// The smallest of them that is >= num_samples, or the next one above it.
uint64_t checkpoint_from(uint64_t num_samples);
uint64_t checkpoint_after(uint64_t num_samples);

}  // namespace gpurt
