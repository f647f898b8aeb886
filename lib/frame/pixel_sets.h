// Which samples every pixel of a frame has, as entries of a table of sets: mostly one for all of them.
#pragma once

#include <vector>

#include "backend.h"
#include "frame/sample_sets.h"

namespace gpurt {

/// Not synchronised.
class PixelSets {
 public:
  PixelSets() = default;
  PixelSets(uint32_t width, uint32_t height) : width_(width), height_(height) {}

  /// Takes over what [height][width] pixels have.
  void assign(std::span<const uint32_t> sets);
  /// Adds the samples of units, which no pixel has twice; seen once they are settled.
  void add(std::span<const WorkUnit> units);
  /// Whether the units that were added cover all pixels, or more.
  bool is_full() const { return added_pixels_ >= uint64_t(width_) * height_; }
  /// Makes the units count. `unite` returns the entry for a set together with a range, invalid_id where they overlap; then
  /// INTERNAL is thrown.
  template <class Unite>
  void settle(Unite &&unite)
  {
    if (added_.empty()) return;
    const std::vector<WorkUnit> units = take_added();
    if (has_one_set() && cover_all_alike(units)) {
      common_ = united(common_, units[0], unite);
      return;
    }
    spread();
    for (const WorkUnit &u : units) {
      uint32_t old_set = invalid_id,
               new_set = invalid_id;  // of the last pixel: mostly those of the next one too
      for (uint32_t y = u.y0; y < u.y1; ++y) {
        for (uint64_t i = uint64_t(y) * width_ + u.x0; i < uint64_t(y) * width_ + u.x1; ++i) {
          if (sets_[i] != old_set) new_set = united(old_set = sets_[i], u, unite);
          sets_[i] = new_set;
        }
      }
    }
    gather();
  }

  /// Of settled units.
  bool has_one_set() const { return sets_.empty(); }
  uint32_t of(uint64_t pixel) const { return has_one_set() ? common_ : sets_[pixel]; }
  void copy_to(std::vector<uint32_t> &sets) const;

 private:
  std::vector<WorkUnit> take_added();
  bool cover_all_alike(std::span<const WorkUnit> units) const;
  void spread();
  void gather();
  template <class Unite>
  static uint32_t united(uint32_t set, const WorkUnit &u, Unite &&unite)
  {
    const uint32_t both = unite(set, SampleRange{u.first_sample, u.first_sample + u.num_samples});
    if (both == invalid_id) refuse_twice(u);
    return both;
  }
  [[noreturn]] static void refuse_twice(const WorkUnit &u);

  uint32_t width_ = 0, height_ = 0;
  uint32_t common_ = SampleSets::empty;  // of all pixels, where sets_ is empty
  std::vector<uint32_t> sets_;
  std::vector<WorkUnit> added_;
  uint64_t added_pixels_ = 0;
};

}  // namespace gpurt
