// Checks a kd-tree that comes from outside: from the tree exchange or from a cache file.
#pragma once

#include <functional>

#include "backend.h"

namespace gpurt {

/// Throws INVALID_ARGUMENT naming the first node at fault, unless
///  - inner nodes split along an axis 0 to 2, at a plane inside their cell, and have both children in the array behind them;
///  - every node is reached once, and no leaf is deeper than kd_max_depth;
///  - leaves and references stay within their arrays, and references within the primitives;
///  - the bounds contain those of every primitive referred to, where these are known already (not null).
/// Returns the depth. A tree without nodes is legal: every ray misses it.
uint32_t check_kd_tree(const HostKdTree &tree, uint64_t num_primitives,
                       const std::function<Box(uint32_t)> &primitive_bounds);

}  // namespace gpurt
