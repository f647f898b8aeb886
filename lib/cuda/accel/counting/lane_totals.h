// What kernels that count lanes leave in device memory.
#pragma once

namespace gpurt::cuda {

struct LaneTotals {
  unsigned long long warp_steps, lane_steps;
};

/// Blocks share these out, so that they seldom wait for one another.
constexpr unsigned num_lane_totals = 64;

}  // namespace gpurt::cuda
