// The light of a grid's micropolygons: what samples keep in place of the primitive.
#pragma once

#include "core/reyes/dice.h"
#include "cpu/reyes/lanes.h"

namespace gpurt {

// Packed light of a grid's micropolygons, or of its blocks of them.
struct GridLight {
  uint32_t shift_u, shift_v;                                 // log2 of the micropolygons along a block
  uint32_t bits_u;                                           // log2 of the blocks along u
  uint32_t packed[max_segments * max_segments + num_lanes];  // rows are written in whole lanes
};

GPURT_FUNCTIONS_BEGIN

// Of micropolygon (i, j).
GPURT_INLINE uint32_t light_of(const GridLight &light, uint32_t i, uint32_t j)
{
  return light.packed[(j >> light.shift_v) << light.bits_u | i >> light.shift_u];
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
