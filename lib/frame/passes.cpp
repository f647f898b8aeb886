#include "frame/passes.h"

#include <algorithm>

#include "error.h"

namespace gpurt {

void check_tiles(std::span<const gpurt_tile> tiles, uint32_t width, uint32_t height)
{
  // A bit a pixel finds overlaps in time proportional to the area, for any number of tiles.
  std::vector<bool> taken(uint64_t(width) * height);
  for (size_t i = 0; i < tiles.size(); ++i) {
    const gpurt_tile &t = tiles[i];
    if (t.x0 >= t.x1 || t.y0 >= t.y1) {
      fail_invalid("tile {} is empty: [{}, {}) x [{}, {}); x1 and y1 are one past the last pixel", i, t.x0,
                   t.x1, t.y0, t.y1);
    }
    if (t.x1 > width || t.y1 > height) {
      fail_invalid("tile {}, [{}, {}) x [{}, {}), leaves the frame of {} x {} pixels", i, t.x0, t.x1, t.y0,
                   t.y1, width, height);
    }
    for (uint32_t y = t.y0; y < t.y1; ++y) {
      for (uint32_t x = t.x0; x < t.x1; ++x) {
        auto bit = taken[uint64_t(y) * width + x];
        if (bit)
          fail_invalid(
              "tile {} overlaps an earlier one at pixel ({}, {}); the tiles of one job must be disjoint", i,
              x, y);
        bit = true;
      }
    }
  }
}

std::vector<gpurt_tile> cut_tiles(std::span<const gpurt_tile> tiles, uint32_t tile_size)
{
  std::vector<gpurt_tile> cut;
  for (const gpurt_tile &t : tiles) {
    for (uint64_t y = t.y0; y < t.y1; y = (y / tile_size + 1) * tile_size) {
      const uint64_t y1 = std::min<uint64_t>((y / tile_size + 1) * tile_size, t.y1);
      for (uint64_t x = t.x0; x < t.x1; x = (x / tile_size + 1) * tile_size) {
        const uint64_t x1 = std::min<uint64_t>((x / tile_size + 1) * tile_size, t.x1);
        cut.push_back({uint32_t(x), uint32_t(y), uint32_t(x1), uint32_t(y1)});
      }
    }
  }
  return cut;
}

void split_uniform(const gpurt_tile &tile, const std::function<uint64_t(uint32_t x, uint32_t y)> &key,
                   std::vector<gpurt_tile> &out)
{
  const uint64_t first = key(tile.x0, tile.y0);
  bool is_uniform = true;
  for (uint32_t y = tile.y0; y < tile.y1 && is_uniform; ++y) {
    for (uint32_t x = tile.x0; x < tile.x1 && is_uniform; ++x) is_uniform = key(x, y) == first;
  }
  if (is_uniform) {
    out.push_back(tile);
    return;
  }
  gpurt_tile a = tile, b = tile;
  if (tile.x1 - tile.x0 >= tile.y1 - tile.y0) a.x1 = b.x0 = tile.x0 + (tile.x1 - tile.x0) / 2;
  else a.y1 = b.y0 = tile.y0 + (tile.y1 - tile.y0) / 2;
  split_uniform(a, key, out);
  split_uniform(b, key, out);
}

std::vector<WorkUnit> take_units(std::vector<Region> &regions, uint64_t num_samples)
{
  std::vector<WorkUnit> units;
  for (Region &region : regions) {
    if (region.num_samples >= num_samples) continue;
    const gpurt_tile &t = region.tile;
    units.push_back(
        {t.x0, t.y0, t.x1, t.y1, region.first_sample + region.num_samples, num_samples - region.num_samples});
    region.num_samples = num_samples;
  }
  return units;
}

uint32_t choose_tile_size(std::span<const gpurt_tile> tiles, uint32_t num_threads, uint32_t largest)
{
  uint64_t num_pixels = 0;
  for (const gpurt_tile &t : tiles) num_pixels += uint64_t(t.x1 - t.x0) * (t.y1 - t.y0);
  // Eight units a worker leave at most an eighth of a pass with idle workers at its end.
  uint32_t size = largest;
  while (size > 8 && num_pixels / (uint64_t(size) * size) < uint64_t(num_threads) * 8) size /= 2;
  return size;
}

uint64_t checkpoint_from(uint64_t num_samples)
{
  uint64_t n = 32;
  while (n < num_samples) n = checkpoint_after(n);
  return n;
}

uint64_t checkpoint_after(uint64_t num_samples)
{
  for (uint64_t power = 32;; power *= 2) {
    if (power > num_samples) return power;
    if (power + power / 2 > num_samples) return power + power / 2;
  }
}

}  // namespace gpurt
