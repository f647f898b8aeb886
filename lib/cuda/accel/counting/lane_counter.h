// Counts the lanes of warps that work, for the time of a query.
#pragma once

#include <cuda_runtime_api.h>

#include <mutex>

#include "schedule.h"

namespace gpurt::cuda {

/// The kernels that count leave their totals in one place of each device, so there is one of these at a time; others wait.
class LaneCounter {
 public:
  LaneCounter();

  /// Puts the totals of the current device to 0; waits for the stream.
  void clear(cudaStream_t stream) const;
  /// Adds them; waits for the stream.
  void collect(ScheduleCounters &sum, cudaStream_t stream) const;

 private:
  std::unique_lock<std::mutex> lock_;
};

}  // namespace gpurt::cuda
