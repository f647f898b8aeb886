// How photons are shared out among the lights, on the device.
#pragma once

#include "core/photon/emission.h"
#include "cuda/device_memory.h"

namespace gpurt::cuda {

/// The lights' shares in device memory.
class DeviceEmission {
 public:
  DeviceEmission(const EmissionView &emission, const std::shared_ptr<DeviceMemory> &memory,
                 cudaStream_t stream)
      : view_(emission)
  {
    if (emission.cdf == nullptr) return;
    cdf_ = upload(memory, std::span<const float>(emission.cdf, uint64_t(emission.num_sources) + 1),
                  "the lights' shares of photons", stream);
    view_.cdf = cdf_.data();
  }
  const EmissionView &view() const { return view_; }

 private:
  EmissionView view_;
  DeviceBuffer<float> cdf_;
};

}  // namespace gpurt::cuda
