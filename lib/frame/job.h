// A job: rendering of tiles of a frame on a thread of its own.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "frame/frame.h"

namespace gpurt {

/// Used from any thread. Destruction cancels the job and waits for its thread.
class Job {
 public:
  /// Checks the request and queues it behind the other jobs of the frame; no tiles: the whole frame.
  /// Throws INVALID_ARGUMENT, UNSUPPORTED.
  static std::shared_ptr<Job> submit(std::shared_ptr<Frame> frame, const gpurt_render_desc &desc,
                                     std::span<const gpurt_tile> tiles);
  ~Job();
  Job(const Job &) = delete;
  Job &operator=(const Job &) = delete;

  /// Returns once the job has ended well; throws its error, CANCELLED, or TIMEOUT while it still runs.
  void wait(uint64_t timeout_ns);
  /// Returns at once; the job stops within half a second and keeps whole samples.
  void cancel();
  /// Share that is done, in [0, 1]; never falls.
  double progress() const { return progress_.load(); }

 private:
  Job(std::shared_ptr<Frame> frame, const gpurt_render_desc &desc, std::vector<gpurt_tile> tiles);
  void run();
  void finish(gpurt_result result, std::string error);

  std::shared_ptr<Frame> frame_;
  const gpurt_render_desc desc_;  // resolved: no field has a "default" value any more
  const std::vector<gpurt_tile> tiles_;
  std::atomic<bool> cancelled_{false};
  std::atomic<double> progress_{0};

  mutable std::mutex mutex_;
  std::condition_variable finished_changed_;
  bool finished_ = false;
  gpurt_result result_ = GPURT_OK;
  std::string error_;

  std::thread thread_;  // last: it uses all of the above
};

}  // namespace gpurt
