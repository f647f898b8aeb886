// The kernels that count lanes as host code calls them: closest hits by the watertight test, every schedule, with the hits and
// counters of the kernels that they are compiled from.
#pragma once

#include "cuda/accel/counting/lane_totals.h"
#include "cuda/accel/near.h"
#include "cuda/accel/schedule/kernels.h"

namespace gpurt::cuda::counting {

decltype(plain::launch_closest) launch_closest;
decltype(plain::launch_near_persistent) launch_near_persistent;
decltype(plain::launch_persistent_stack) launch_persistent_stack;
decltype(plain::launch_persistent_rays) launch_persistent_rays;
decltype(plain::launch_packets) launch_packets;
decltype(plain::launch_uber) launch_uber;
decltype(plain::launch_select_leaves) launch_select_leaves;
decltype(plain::launch_intersect_leaves) launch_intersect_leaves;
decltype(plain::launch_finish_lists) launch_finish_lists;

/// num_lane_totals of them, in the memory of the current device.
LaneTotals *totals_of_fused_kernels();
LaneTotals *totals_of_scheduled_kernels();

}  // namespace gpurt::cuda::counting
