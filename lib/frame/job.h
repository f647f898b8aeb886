// A job: rendering of tiles of a frame on a thread of its own.
#pragma once

#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "frame/frame.h"
#include "frame/passes.h"
#include "scene/emission_table.h"

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
  double progress() const { return share_.load(); }

 private:
  Job(std::shared_ptr<Frame> frame, const gpurt_render_desc &desc, std::vector<gpurt_tile> tiles);
  void run();
  bool wait_for_turn();
  void render();
  bool render_to(uint64_t num_samples);
  void render_pass(std::span<const WorkUnit> units);
  std::vector<Region> plan() const;
  void prepare_photons();
  bool try_photons(const std::shared_ptr<Frame> &frame, const PhotonSettings &settings,
                   uint64_t num_passes) const;
  PhotonSettings tune_photons(const PhotonSettings &settings, float widest_radius);
  bool has_photons() const { return desc_.pipeline == GPURT_PIPELINE_PHOTON; }
  uint64_t pass_samples(uint64_t num_samples, uint64_t from) const;
  double elapsed_seconds() const;
  void report_progress(uint64_t new_samples);
  void finish(gpurt_result result, std::string error);

  const std::shared_ptr<Frame> frame_;
  gpurt_render_desc desc_;  // resolved: zero means "no such limit", and nothing else has a default any more
  const std::vector<gpurt_tile> tiles_;
  ReyesSettings reyes_{};  // resolved; zero for other pipelines
  ReyesSchedule reyes_schedule_{};
  Schedule schedule_;          // of rays
  bool is_on_device_ = false;  // the frame's sums are where it renders
  std::atomic<bool> cancelled_{false};

  // Of the job's thread.
  std::vector<Region> regions_;
  EmissionTable emission_;  // of photon mapping
  PhotonRequest photon_request_{};
  std::string photon_reason_;  // why its settings are not the usual ones; empty: they are
  double start_seconds_ = 0;
  double seconds_per_path_ = 0;  // wall time, of the last pass, or of all for photons; 0: not measured yet
  double last_seconds_per_path_ = 0;  // of the last pass
  double pass_seconds_ = 0;           // of all passes

  std::mutex progress_mutex_;  // serialises the caller's callback
  double last_report_seconds_ = 0;
  std::atomic<uint64_t> done_{0};    // samples of this job
  std::atomic<double> expected_{0};  // samples in all, where they can be told
  std::atomic<double> share_{0};

  std::mutex mutex_;
  std::condition_variable finished_changed_;
  bool finished_ = false;
  gpurt_result result_ = GPURT_OK;
  std::string error_;

  std::thread thread_;  // last: it uses all of the above
};

}  // namespace gpurt
