// The search for the best split of a node's references: by object or in space.
#pragma once

#include "accel/kd_build.h"
#include "accel/kd_reference.h"

namespace gpurt {

/// What is known of a node's references before it is split.
struct BvhExtent {
  Box bounds;           // of the references
  double lo[3], hi[3];  // of the sums of their lower and upper ends: twice the centres

  static BvhExtent empty();
  void add(const KdReference &r);
  void add(const BvhExtent &other);
};

/// Half the surface area of a box; 0 where it is empty.
double half_area(const Box &box);

enum class BvhSplitKind {
  None,    // nothing tells the references apart
  Object,  // by the slice that holds the centre
  Spatial  // at a plane, with references cut in two
};

struct BvhSplit {
  BvhSplitKind kind = BvhSplitKind::None;
  double cost = 0;  // area times number, of both sides together
  int axis = 0;
  double origin = 0, scale = 0;  // slice of x: (x - origin) * scale
  int num_bins = 0;
  int bin = 0;         // the last slice of the first side
  float position = 0;  // Spatial: where that slice ends
};

/// The slice of a coordinate, or of a sum of both ends. It grows with x for any rounding.
inline int bin_of(const BvhSplit &split, double x)
{
  const int bin = int((x - split.origin) * split.scale);
  return bin < 0 ? 0 : (bin < split.num_bins ? bin : split.num_bins - 1);
}

/// Bounds of the parts of a reference on either side of a plane; an empty box where nothing of it is.
void cut_reference(const KdSource &source, const KdReference &r, int axis, float position, Box part[2]);

/// The best split by object; None where all centres agree.
BvhSplit find_object_split(const KdReference *references, uint64_t count, const BvhExtent &extent,
                           Box side[2]);

/// The best split in space that cuts at least one reference and makes at most `spare` more: where all of `spare` is used
/// up, or depth, there is an end.
BvhSplit find_spatial_split(const KdSource &source, const KdReference *references, uint64_t count,
                            const BvhExtent &extent, uint64_t spare);

}  // namespace gpurt
