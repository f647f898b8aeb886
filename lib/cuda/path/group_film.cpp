#include "cuda/path/group_film.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <cstring>

namespace gpurt::cuda {
namespace {

template <class T>
void copy_rows(ZeroedArray<T> &to, const T *from, const WorkUnit &unit, const WorkUnit &group)
{
  if (to.empty()) return;
  const uint64_t width = unit.x1 - unit.x0, group_width = group.x1 - group.x0;
  for (uint32_t y = unit.y0; y < unit.y1; ++y) {
    std::memcpy(to.data() + (y - unit.y0) * width, from + (y - group.y0) * group_width + (unit.x0 - group.x0),
                width * sizeof(T));
  }
}

}  // namespace

GroupFilm::GroupFilm(uint64_t num_pixels, uint32_t outputs) : num_pixels_(num_pixels)
{
  TileFilm one;
  one.reset(1, 1, outputs);
  has_features_ = !one.features.empty();
  has_first_hits_ = !one.first_hits.empty();
  has_errors_ = !one.errors.empty();
  has_statistics_ = !one.statistics.empty();
}

uint64_t GroupFilm::bytes() const
{
  return num_pixels_ *
         (sizeof(PixelSums) + (has_features_ ? sizeof(PixelFeatures) : 0) +
          (has_first_hits_ ? sizeof(PixelFirstHit) : 0) + (has_errors_ ? sizeof(PixelErrors) : 0) +
          (has_statistics_ ? sizeof(PixelStatistics) : 0));
}

// Sizes of the arrays' elements are multiples of 8, as their alignment wants.
FilmView GroupFilm::view(std::byte *base, uint32_t width, uint32_t height) const
{
  FilmView film{};
  film.width = width;
  film.height = height;
  film.pixels = reinterpret_cast<PixelSums *>(base);
  base += num_pixels_ * sizeof(PixelSums);
  if (has_features_) {
    film.features = reinterpret_cast<PixelFeatures *>(base);
    base += num_pixels_ * sizeof(PixelFeatures);
  }
  if (has_first_hits_) {
    film.first_hits = reinterpret_cast<PixelFirstHit *>(base);
    base += num_pixels_ * sizeof(PixelFirstHit);
  }
  if (has_errors_) {
    film.errors = reinterpret_cast<PixelErrors *>(base);
    base += num_pixels_ * sizeof(PixelErrors);
  }
  if (has_statistics_) film.statistics = reinterpret_cast<PixelStatistics *>(base);
  return film;
}
static_assert(sizeof(PixelSums) % 8 == 0 && sizeof(PixelFeatures) % 8 == 0 &&
              sizeof(PixelFirstHit) % 8 == 0 && sizeof(PixelErrors) % 8 == 0 &&
              sizeof(PixelStatistics) % 8 == 0);

void deliver(const RenderPass &pass, const UnitGroup &group, const FilmView &film,
             const RenderCounters &counters, bool has_eye_rays)
{
  tbb::enumerable_thread_specific<TileFilm> tiles;
  tbb::parallel_for(size_t(0), group.units.size(), [&](size_t i) {
    const WorkUnit &unit = group.units[i];
    TileFilm &tile = tiles.local();
    tile.reserve(unit.x1 - unit.x0, unit.y1 - unit.y0, pass.outputs);
    copy_rows(tile.pixels, film.pixels, unit, group.bounds);
    copy_rows(tile.features, film.features, unit, group.bounds);
    copy_rows(tile.first_hits, film.first_hits, unit, group.bounds);
    copy_rows(tile.errors, film.errors, unit, group.bounds);
    copy_rows(tile.statistics, film.statistics, unit, group.bounds);
    // What the group did together is counted with its first unit: only sums matter.
    RenderCounters c = i == 0 ? counters : RenderCounters{};
    c.num_samples = uint64_t(unit.x1 - unit.x0) * (unit.y1 - unit.y0) * unit.num_samples;
    if (has_eye_rays) c.num_camera_rays = c.num_samples;
    pass.deliver(unit, tile, c);
  });
}

}  // namespace gpurt::cuda
