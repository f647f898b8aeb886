// Times every launch, for tests of the promise that none takes longer than a quarter of a second.
#pragma once

#include <cuda_runtime_api.h>

#include <map>
#include <string>

namespace gpurt::cuda {

/// While one lives, what launch.h starts is timed by events around it. On a device that has other streams' work too, a launch's
/// time holds its waiting for that. One at a time, for launches on the device that is current where it is made.
class LaunchTimer {
 public:
  LaunchTimer();
  ~LaunchTimer();
  LaunchTimer(const LaunchTimer &) = delete;
  LaunchTimer &operator=(const LaunchTimer &) = delete;

  /// Seconds of the longest launch of each name so far; waits for those that still run.
  std::map<std::string, double> longest();
};

/// Around a launch; nothing where no timer lives.
class TimedLaunch {
 public:
  struct Times;

  explicit TimedLaunch(cudaStream_t stream);
  ~TimedLaunch();
  TimedLaunch(const TimedLaunch &) = delete;
  TimedLaunch &operator=(const TimedLaunch &) = delete;
  void end(const char *name);

 private:
  cudaStream_t stream_;
  Times *times_;
};

}  // namespace gpurt::cuda
