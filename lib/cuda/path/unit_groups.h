// Joins work units into rectangles that are large enough to fill a CUDA device.
#pragma once

#include <vector>

#include "backend.h"

namespace gpurt::cuda {

/// Units that together cover a rectangle with the same samples.
struct UnitGroup {
  WorkUnit bounds;
  std::vector<WorkUnit> units;

  uint64_t num_pixels() const { return uint64_t(bounds.x1 - bounds.x0) * (bounds.y1 - bounds.y0); }
  uint64_t num_paths() const { return num_pixels() * bounds.num_samples; }
};

/// Joins neighbours as long as a group has at most max_paths paths and max_pixels pixels; a unit with more is a group
/// of its own. The result depends on the units alone, not on their order.
std::vector<UnitGroup> group_units(std::span<const WorkUnit> units, uint64_t max_paths, uint64_t max_pixels);

}  // namespace gpurt::cuda
