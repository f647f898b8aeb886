// Accounting of a device's memory: every large allocation of scenes, frames and jobs is reserved here first, so that
// the memory limit holds before the system runs out.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <utility>

#include "error.h"

namespace gpurt {

class MemoryTracker {
 public:
  explicit MemoryTracker(uint64_t limit_bytes) : limit_(limit_bytes) {}

  /// Throws OUT_OF_MEMORY naming `what` if the limit would be exceeded.
  void reserve(uint64_t bytes, const char *what)
  {
    const uint64_t before = used_.fetch_add(bytes);
    if (limit_ != 0 && before + bytes > limit_) {
      used_.fetch_sub(bytes);
      fail(GPURT_ERROR_OUT_OF_MEMORY,
           "{} needs {} bytes, but {} of the memory limit of {} bytes are in use; raise memory_limit_bytes "
           "or make the scene or frame smaller",
           what, bytes, before, limit_);
    }
    uint64_t peak = peak_.load();
    while (peak < before + bytes && !peak_.compare_exchange_weak(peak, before + bytes)) {
    }
    if (whole_) {
      try {
        whole_->reserve(bytes, what);
      } catch (...) {
        used_.fetch_sub(bytes);
        throw;
      }
    }
  }
  void release(uint64_t bytes)
  {
    used_.fetch_sub(bytes);
    if (whole_) whole_->release(bytes);
  }

  /// Counts everything for `whole` too, of which this is a part. Called before anything is reserved here.
  void count_in(std::shared_ptr<MemoryTracker> whole) { whole_ = std::move(whole); }

  /// Counts what was released for another to reserve, and is held again: beyond the limit too.
  void retake(uint64_t bytes)
  {
    used_.fetch_add(bytes);
    if (whole_) whole_->retake(bytes);
  }

  uint64_t limit() const { return limit_; }
  uint64_t used() const { return used_.load(); }
  uint64_t peak() const { return peak_.load(); }

 private:
  const uint64_t limit_;
  std::shared_ptr<MemoryTracker> whole_;  // null: this is no part of anything
  std::atomic<uint64_t> used_{0};
  std::atomic<uint64_t> peak_{0};
};

/// Bytes held from a tracker for as long as this lives.
class Reservation {
 public:
  Reservation() = default;
  Reservation(std::shared_ptr<MemoryTracker> tracker, uint64_t bytes, const char *what)
      : tracker_(std::move(tracker)), bytes_(bytes)
  {
    if (tracker_) tracker_->reserve(bytes_, what);
  }
  Reservation(Reservation &&other) noexcept
      : tracker_(std::move(other.tracker_)), bytes_(std::exchange(other.bytes_, 0))
  {}
  Reservation &operator=(Reservation &&other) noexcept
  {
    std::swap(tracker_, other.tracker_);
    std::swap(bytes_, other.bytes_);
    return *this;
  }
  ~Reservation()
  {
    if (tracker_) tracker_->release(bytes_);
  }
  /// Changes the size; on failure the old one is kept.
  void resize(uint64_t bytes, const char *what)
  {
    if (tracker_ && bytes > bytes_) tracker_->reserve(bytes - bytes_, what);
    else if (tracker_) tracker_->release(bytes_ - bytes);
    bytes_ = bytes;
  }
  uint64_t bytes() const { return bytes_; }
  /// Leaves the bytes reserved for someone else to release.
  void disown()
  {
    tracker_.reset();
    bytes_ = 0;
  }

 private:
  std::shared_ptr<MemoryTracker> tracker_;
  uint64_t bytes_ = 0;
};

}  // namespace gpurt
