// What the kd-tree builder works on: bounds of the part of a primitive that lies in a cell.
#pragma once

#include "core/math/vec.h"

namespace gpurt {

struct alignas(16) KdReference {
  Vec3f lo;
  uint32_t id;
  Vec3f hi;
  uint32_t reserved;
};

/// Where a cell is split. Primitives below the plane go to the first child, those above to the second, those across it to
/// both; those that lie in the plane go to the side that is cheaper.
struct KdSplit {
  float cost;      // expected, in triangle tests; infinity: no split is allowed
  float position;  // strictly inside the cell
  int axis;
  bool planar_first;
};

/// The surface area heuristic: a step costs `traversal_cost` triangle tests; a split that leaves one side empty is
/// cheaper by the factor 1 - empty_bonus.
struct KdCost {
  float traversal_cost;
  float empty_factor;
};

// Numbers of references whose ends fall into slices of the cell, per axis. A slice's number grows with the coordinate
// for any rounding, so that counts of whole slices are exact.
constexpr uint32_t kd_max_bins = 1024;

struct KdBins {
  float origin[3];
  float scale[3];
  uint32_t num_bins;
  uint32_t lo[3][kd_max_bins];  // [bin]
  uint32_t hi[3][kd_max_bins];
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE uint32_t bin_of(float x, float origin, float scale, uint32_t num_bins)
{
  const int bin = int((x - origin) * scale);
  return uint32_t(min(max(bin, 0), int(num_bins) - 1));
}

// Factor that brings the longest edge of a cell to 1, so that areas stay in range at any scale.
GPURT_INLINE float unit_of(const Box &cell) { return 1.0f / max_component(cell.hi - cell.lo); }

// Half the surface area of a box with these edges.
GPURT_INLINE float half_area(Vec3f extent)
{
  return extent.x * extent.y + extent.y * extent.z + extent.z * extent.x;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
