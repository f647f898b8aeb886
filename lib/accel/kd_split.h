// The search for the best split of a cell.
#pragma once

#include <memory>
#include <vector>

#include "accel/kd_build_kernels.h"

namespace gpurt {

/// Lower and upper ends of references along an axis; those of flat ones, which are both, apart.
struct KdEnds {
  std::vector<float> lo, hi, flat;
};

/// Memory that one thread reuses from search to search.
struct KdSplitScratch {
  KdBins bins;
  KdEnds ends;
};

/// The split with the least expected cost over all planes through an end of a reference, exactly: as a sweep over sorted
/// ends finds it. At most `budget` references in both children together; large searches are spread over threads.
/// Of equal splits the first axis, then the lowest plane. The cost is infinite if there is no split.
KdSplit find_split(const KdBuildKernels &kernels, const KdReference *references, uint64_t count,
                   const Box &cell, const KdCost &cost, uint64_t budget, KdSplitScratch &scratch);

}  // namespace gpurt
