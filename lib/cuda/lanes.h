// Streams that host threads work on side by side: each with pinned memory through which host arrays travel.
//
// A lane serves one thread at a time. While one lane's thread copies host memory, the device computes for another.
#pragma once

#include <cuda_runtime_api.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "cuda/device_memory.h"

namespace gpurt::cuda {

/// Page-locked host memory, which the device reads and writes at full speed. Not part of the device's memory limit.
class PinnedBuffer {
 public:
  PinnedBuffer() = default;
  PinnedBuffer(const PinnedBuffer &) = delete;
  PinnedBuffer &operator=(const PinnedBuffer &) = delete;
  ~PinnedBuffer();
  /// At least `bytes`; earlier contents are lost where it grows.
  void *reserve(uint64_t bytes);

 private:
  void *data_ = nullptr;
  uint64_t bytes_ = 0;
};

class Event {
 public:
  explicit Event(unsigned flags = cudaEventDefault)
  {
    check(cudaEventCreateWithFlags(&event_, flags), "cudaEventCreateWithFlags");
  }
  ~Event() { ignore(cudaEventDestroy(event_)); }
  Event(const Event &) = delete;
  Event &operator=(const Event &) = delete;
  void record(cudaStream_t stream) { check(cudaEventRecord(event_, stream), "cudaEventRecord"); }
  void wait() const { check(cudaEventSynchronize(event_), "cudaEventSynchronize"); }
  cudaEvent_t get() const { return event_; }

 private:
  cudaEvent_t event_ = nullptr;
};

/// Time on the device between two events that have passed.
double seconds_between(const Event &begin, const Event &end);

class Stream {
 public:
  Stream() { check(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "cudaStreamCreateWithFlags"); }
  ~Stream() { ignore(cudaStreamDestroy(stream_)); }
  Stream(const Stream &) = delete;
  Stream &operator=(const Stream &) = delete;
  cudaStream_t get() const { return stream_; }

 private:
  cudaStream_t stream_ = nullptr;
};

class Lane {
 public:
  cudaStream_t stream() const { return stream_.get(); }
  /// For work beside the stream's, in whose order nothing comes by itself: the user joins the two, and waits for both.
  cudaStream_t stream_beside()
  {
    if (!beside_) beside_.emplace();
    return beside_->get();
  }
  /// Waits for all work of the lane.
  void synchronize() { check(cudaStreamSynchronize(stream()), "cudaStreamSynchronize"); }
  /// Makes later work of the lane wait for what the caller started on the legacy default stream.
  void wait_for_default_stream();

  PinnedBuffer to_device, to_host;
  struct {
    Event begin, end;
  } timing[2];

 private:
  Stream stream_;
  std::optional<Stream> beside_;
  Event order_{cudaEventDisableTiming};
};

/// Waits for a stream where a scope is left, whatever happened: declared after the buffers that the stream's work uses.
class WaitAtEnd {
 public:
  explicit WaitAtEnd(cudaStream_t stream) : stream_(stream) {}
  ~WaitAtEnd() { ignore(cudaStreamSynchronize(stream_)); }
  WaitAtEnd(const WaitAtEnd &) = delete;
  WaitAtEnd &operator=(const WaitAtEnd &) = delete;

 private:
  cudaStream_t stream_;
};

class LanePool;

/// A lane in use. At the end its work is waited for, whatever happened, and the lane goes back.
class LaneLease {
 public:
  LaneLease(LanePool &pool, std::unique_ptr<Lane> lane) : pool_(pool), lane_(std::move(lane)) {}
  LaneLease(const LaneLease &) = delete;
  LaneLease &operator=(const LaneLease &) = delete;
  ~LaneLease();
  Lane &operator*() const { return *lane_; }
  Lane *operator->() const { return lane_.get(); }

 private:
  LanePool &pool_;
  std::unique_ptr<Lane> lane_;
};

/// The lanes of a backend: made as they are needed, kept until its end. Used from any thread, with its device current.
class LanePool {
 public:
  LaneLease acquire();

 private:
  friend class LaneLease;
  std::mutex mutex_;
  std::vector<std::unique_ptr<Lane>> idle_;
};

/// Calls work(lane) on up to `num_lanes` threads, the caller's among them, each with a lane of its own and with the
/// device current. The first exception is thrown again once all have ended; `stop` is then true, which work looks at.
void run_on_lanes(LanePool &pool, int ordinal, unsigned num_lanes,
                  const std::function<void(Lane &lane, const std::atomic<bool> &stop)> &work);

}  // namespace gpurt::cuda
