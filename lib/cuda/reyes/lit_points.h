// Light of micropolygons' own that is found after visibility, for the samples of a group of units, on a CUDA stream.
//
// Samples that see the same micropolygon, or block of them, find each other in a table by hashes of what they keep: one of them
// stands for the point, and the others learn which. Which one that is may change from run to run, and its light does not: it is a
// function of the point.
#pragma once

#include "cuda/path/wave.h"
#include "cuda/reyes/shade_points.h"
#include "cuda/reyes/visible.h"

namespace gpurt::cuda {

/// Memory of a lane for that.
class LitPoints {
 public:
  /// For groups of up to `num_samples`. Throws OUT_OF_MEMORY.
  LitPoints(const std::shared_ptr<DeviceMemory> &memory, uint64_t num_samples);

  /// Lights what the group's samples see and adds it to a film of zeros. False if `cancelled` became true on the way.
  bool run(const TraceScene &scene, const PathSettings &settings, bool has_found_light,
           const ReyesSettings &reyes, VisibleSamples &visible, WaveMemory &wave, const FilmView &film,
           const std::atomic<bool> *cancelled, cudaStream_t stream, ReyesCounters &counters,
           WaveCounters &wave_counters);

  uint64_t bytes() const { return buffer_.bytes(); }

 private:
  struct Arrays;
  static Arrays lay_out(std::byte *base, uint64_t num_samples);

  DeviceBuffer<std::byte> buffer_;
  PointView view_{};
};

}  // namespace gpurt::cuda
