// Times between marks on a stream, added up by what ran between them.
#pragma once

#include <memory>
#include <vector>

#include "cuda/lanes.h"

namespace gpurt::cuda {

/// What a stretch of photon mapping's work is for.
enum class PhotonLap : uint32_t {
  Emit = 0,
  Photons,  // tracing
  Scatter,
  Build,
  Generate,
  Trace,
  Shade,
  Shadow,
  Gather,
  Film,
  Count
};

class LapClock {
 public:
  void start(cudaStream_t stream)
  {
    laps_.clear();
    record(stream, PhotonLap::Count);
  }
  /// What ran since the last mark belongs to `lap`.
  void mark(cudaStream_t stream, PhotonLap lap)
  {
    // Marks of one lap one after the other are one.
    if (laps_.size() > 1 && laps_.back() == lap) events_[laps_.size() - 1]->record(stream);
    else record(stream, lap);
  }
  /// Adds the times to seconds[lap] and starts anew; the stream must have passed all marks.
  void collect(double (&seconds)[uint32_t(PhotonLap::Count)])
  {
    for (size_t i = 1; i < laps_.size(); ++i)
      seconds[uint32_t(laps_[i])] += seconds_between(*events_[i - 1], *events_[i]);
    laps_.clear();
  }

 private:
  void record(cudaStream_t stream, PhotonLap lap)
  {
    if (events_.size() == laps_.size()) events_.push_back(std::make_unique<Event>());
    events_[laps_.size()]->record(stream);
    laps_.push_back(lap);
  }
  std::vector<std::unique_ptr<Event>> events_;
  std::vector<PhotonLap> laps_;
};

}  // namespace gpurt::cuda
