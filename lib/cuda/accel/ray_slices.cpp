#include "cuda/accel/ray_slices.h"

namespace gpurt::cuda {

void SliceSize::learn(uint64_t num_rays, double seconds)
{
  // Aim for 20 to 60 ms: launching costs nothing there, and four times as much would still be in time.
  const uint64_t current = get();
  if (seconds > 0.060) {
    const double fitting = double(num_rays) * 0.040 / seconds;
    // Whole numbers of the least, so that parts of arrays lie as well as the arrays.
    num_rays_ = std::min(current, std::max(uint64_t(fitting) / min_slice_rays, uint64_t(1)) * min_slice_rays);
  } else if (seconds < 0.020 && num_rays == current) {
    num_rays_ = std::min(current * 2, max_slice_rays);
  }
}

bool RaySlices::begin(SliceSize &size, uint64_t slice_rays, uint64_t num_slices, cudaStream_t stream)
{
  if (!events_) events_ = std::make_unique<Events>();
  if (num_slices_ != 0) {
    const cudaError_t status = cudaEventQuery(events_->end.get());
    if (status == cudaErrorNotReady) {
      (void)cudaGetLastError();
      return false;
    }
    check(status, "cudaEventQuery");
    size.learn(slice_rays_, seconds_between(events_->begin, events_->end) / double(num_slices_));
  }
  slice_rays_ = slice_rays;
  num_slices_ = num_slices;
  events_->begin.record(stream);
  return true;
}

}  // namespace gpurt::cuda
