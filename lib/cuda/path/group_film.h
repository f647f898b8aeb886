// The film of a group of units: in device memory, then in pinned host memory in the same layout, then unit by unit.
#pragma once

#include "cuda/path/unit_groups.h"

namespace gpurt::cuda {

class GroupFilm {
 public:
  GroupFilm(uint64_t num_pixels, uint32_t outputs);
  uint64_t bytes() const;
  /// The arrays lie one behind the other from `base` on.
  FilmView view(std::byte *base, uint32_t width, uint32_t height) const;

 private:
  uint64_t num_pixels_;
  bool has_features_, has_first_hits_, has_errors_, has_statistics_;
};

/// Hands the units of a finished group over, on the host's threads. `counters` are what the group did together, but for its
/// samples. `has_eye_rays`: each of these had one.
void deliver(const RenderPass &pass, const UnitGroup &group, const FilmView &film,
             const RenderCounters &counters, bool has_eye_rays = true);

}  // namespace gpurt::cuda
