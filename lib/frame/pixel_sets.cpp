#include "frame/pixel_sets.h"

#include <algorithm>

namespace gpurt {

void PixelSets::assign(std::span<const uint32_t> sets)
{
  added_.clear();
  added_pixels_ = 0;
  sets_.assign(sets.begin(), sets.end());
  gather();
}

void PixelSets::add(std::span<const WorkUnit> units)
{
  added_.insert(added_.end(), units.begin(), units.end());
  for (const WorkUnit &u : units) added_pixels_ += uint64_t(u.x1 - u.x0) * (u.y1 - u.y0);
}

void PixelSets::copy_to(std::vector<uint32_t> &sets) const
{
  if (has_one_set()) sets.assign(uint64_t(width_) * height_, common_);
  else sets = sets_;
}

std::vector<WorkUnit> PixelSets::take_added()
{
  added_pixels_ = 0;
  return std::exchange(added_, {});
}

// As long as no pixel has a sample twice, units with the same samples do not overlap.
bool PixelSets::cover_all_alike(std::span<const WorkUnit> units) const
{
  uint64_t num_pixels = 0;
  for (const WorkUnit &u : units) {
    if (u.first_sample != units[0].first_sample || u.num_samples != units[0].num_samples) return false;
    num_pixels += uint64_t(u.x1 - u.x0) * (u.y1 - u.y0);
  }
  return num_pixels == uint64_t(width_) * height_;
}

void PixelSets::spread()
{
  if (has_one_set()) sets_.assign(uint64_t(width_) * height_, common_);
}

void PixelSets::gather()
{
  if (sets_.empty()) return;
  const uint32_t first = sets_[0];
  if (!std::all_of(sets_.begin(), sets_.end(), [first](uint32_t set) { return set == first; })) return;
  common_ = first;
  sets_ = {};
}

void PixelSets::refuse_twice(const WorkUnit &u)
{
  fail(GPURT_ERROR_INTERNAL, "a work unit of [{}, {}) x [{}, {}) brought samples {} .. {} twice", u.x0, u.x1,
       u.y0, u.y1, u.first_sample, u.first_sample + u.num_samples);
}

}  // namespace gpurt
