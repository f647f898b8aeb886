// Batches of rays in launches that end in time, whatever a scene's rays cost.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <memory>

#include "cuda/lanes.h"

namespace gpurt::cuda {

constexpr uint64_t min_slice_rays = uint64_t(1) << 10, max_slice_rays = uint64_t(1) << 22;

/// How many rays a launch takes so that it ends well within the quarter of a second after which a display's watchdog
/// or a waiting cancellation would notice it. Learns from launches; shared by the threads that trace one scene.
class SliceSize {
 public:
  explicit SliceSize(uint64_t first_rays = uint64_t(1) << 18) : num_rays_(first_rays) {}
  uint64_t get() const { return num_rays_.load(std::memory_order_relaxed); }
  void learn(uint64_t num_rays, double seconds);

 private:
  std::atomic<uint64_t> num_rays_;
};

/// Cuts the batches that one stream traces, and lets the scene's slices learn from them without waiting: a batch is looked at
/// when the next one comes, if it is done by then.
class RaySlices {
 public:
  /// Calls start(first, count), which launches kernels on the stream, for slices of num_rays rays.
  template <class Start>
  void run(SliceSize &size, uint64_t num_rays, cudaStream_t stream, Start &&start)
  {
    if (num_rays == 0) return;
    const uint64_t slice = size.get();
    const bool is_timed = begin(size, std::min(slice, num_rays), (num_rays + slice - 1) / slice, stream);
    for (uint64_t first = 0; first < num_rays; first += slice)
      start(first, std::min(slice, num_rays - first));
    if (is_timed) events_->end.record(stream);
  }

 private:
  struct Events {
    Event begin, end;
  };

  // False: what was timed last still runs.
  bool begin(SliceSize &size, uint64_t slice_rays, uint64_t num_slices, cudaStream_t stream);

  std::unique_ptr<Events> events_;
  // Of the batch that is timed.
  uint64_t slice_rays_ = 0, num_slices_ = 0;
};

}  // namespace gpurt::cuda
