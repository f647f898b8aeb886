// A step of a traversal, at a node or a triangle. Nothing, but where GPURT_COUNTS_LANES is set: there a backend, whose kernels
// count by it how many lanes of a warp take part, has a count_step of its own before this header.
#pragma once

#include "core/platform.h"

#if !defined(GPURT_COUNTS_LANES)
namespace gpurt {

GPURT_FUNCTIONS_BEGIN

// `takes_part`: false for lanes that come along with a warp and have no use for the step.
GPURT_INLINE void count_step(bool takes_part = true) { (void)takes_part; }

GPURT_FUNCTIONS_END
}  // namespace gpurt
#endif
