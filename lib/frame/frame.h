// A frame: the film that jobs add samples to, read, saved, continued and merged exactly.
#pragma once

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <string>

#include "backend.h"
#include "frame/film.h"
#include "frame/outputs.h"
#include "frame/pixel_sets.h"
#include "frame/sample_sets.h"

namespace gpurt {

/// What a frame renders and where: one commit of a scene, and the device that made it.
struct FrameScene {
  std::shared_ptr<const CommittedScene> committed;
  std::shared_ptr<const CompiledScene> compiled;
  std::shared_ptr<MemoryTracker> memory;  // may be null: nothing is accounted
  uint32_t num_threads = 1;
  double build_seconds = 0;
};

/// gpurt_frame_desc after validation. Two frames whose settings and scenes are equal hold samples of the same image.
struct FrameSettings {
  uint32_t width = 0, height = 0;
  uint32_t camera = 0;
  uint32_t outputs = 0;  // bits of gpurt_output; colour, alpha and sample count are always set
  uint32_t frame_index = 0;
  uint64_t seed = 0;
  uint64_t first_sample =
      0;  // where pixels without samples start; frames may differ in it and still be merged
};

/// Totals over all jobs of a frame, and what its samples were made with; part of a saved state.
struct FrameTotals {
  gpurt_pipeline pipeline = GPURT_PIPELINE_AUTO;  // AUTO: no job has run yet
  uint32_t max_depth = 0;                         // 0: no job has run yet
  PhotonSettings
      photon{};           // of photon mapping: photons_per_pass is not 0; a radius of 0 is still to be found
  ReyesSettings reyes{};  // zero for other pipelines
  RenderCounters counters;
  uint64_t num_saturated = 0;
  double render_seconds = 0;
};

/// The sums of a frame with all that identifies them: a film that can be merged, on its way from or to a file.
struct FrameState {
  FrameSettings settings;
  uint64_t scene_hash = 0;
  Camera camera{};
  Accel accel = Accel::Auto;
  TriangleTest triangle_test = TriangleTest::Watertight;
  FrameTotals totals;
  TileFilm film;
  SampleSets sets;
  std::vector<uint32_t> sample_sets;  // per pixel: which samples it has, as an entry of `sets`
};

/// Largest width and height of a frame.
constexpr uint32_t max_frame_size = 65535;

class Job;

/// Used from any thread. Jobs keep it alive.
class Frame {
 public:
  /// Checks `desc` against the scene and reserves the film. Throws INVALID_ARGUMENT, OUT_OF_MEMORY, UNSUPPORTED.
  Frame(FrameScene scene, const gpurt_frame_desc &desc);
  ~Frame();
  Frame(const Frame &) = delete;
  Frame &operator=(const Frame &) = delete;

  const FrameSettings &settings() const { return state_.settings; }
  const FrameScene &scene() const { return scene_; }

  /// Copies an output as gpurt_frame_read does; may run while a job renders.
  void read(gpurt_output output, void *data, uint64_t size_bytes) const;
  /// The same without the host, where the sums are on the device; `data` may be memory of that. False: they are not.
  bool read_on_device(gpurt_output output, void *data, uint64_t size_bytes) const;
  /// Number of bytes that read() wants for an output. Throws INVALID_ARGUMENT for one that the frame has not.
  uint64_t output_bytes(gpurt_output output) const;
  /// Writes .exr, .png or .gpurt, by the extension.
  void save(const std::string &path) const;

  /// Adds the samples of another frame. Throws INVALID_ARGUMENT and changes nothing where they do not fit together.
  void merge(Frame &other);
  void load_state(const std::string &path);

  /// Fills everything but struct_size.
  void statistics(gpurt_statistics &out) const;
  /// See error_estimate.h; negative where it is not known.
  struct Error {
    double noise = -1, bias = -1;
    double total() const { return noise < 0 ? noise : noise + std::max(bias, 0.0); }
  };
  Error estimated_error() const;

 private:
  friend class Job;

  // Bands of rows have a mutex each, so that finished units are added side by side and readers see whole samples.
  static constexpr uint32_t rows_per_band = 16;
  static constexpr uint64_t no_gap = ~uint64_t(0);
  std::mutex &band_mutex(uint32_t y) const { return bands_[y / rows_per_band]; }
  uint64_t pixel(uint32_t x, uint32_t y) const { return uint64_t(y) * state_.settings.width + x; }

  // Sums that are on the device that renders; see frame_device.cpp.
  struct OnDevice {
    std::unique_ptr<DeviceFilm> film;  // null: the host's arrays are all there is
    bool has_samples = false;          // else the film is yet to get any, as the host's arrays
    bool is_newer = false;             // than the host's arrays; else the two are equal
    PixelSets sets;                    // which samples the film has
    FrameTotals host_totals;           // where it is newer: those of the host's arrays
    double newer_seconds = 0;          // that rendering took what the host's arrays lack
  };
  /// Makes the host's arrays have all samples; they stay so while the lock lives, but for what add_unit() does.
  std::unique_lock<std::mutex> host_sums() const;
  std::unique_ptr<DeviceFilm> make_device_film() const;
  void make_host_arrays() const;  // under host_mutex_, but in the constructor
  void bring_to_host() const;     // under host_mutex_ and device_mutex_
  [[noreturn]] void go_back_to_host(const gpurt::Error &loss, bool has_begun) const;  // under both
  void settle_sets() const;                                                           // under device_mutex_
  FrameTotals host_totals() const;                                                    // of the host's arrays

  void check_output(gpurt_output output) const;
  void check_read(gpurt_output output, const void *data, uint64_t size_bytes) const;
  SumRow row_of(uint32_t y) const;
  void read_row(gpurt_output output, uint32_t y, void *row) const;
  void save_exr(const std::string &path) const;
  void save_state(const std::string &path) const;
  void check_same_image(const FrameState &other, const std::string &other_name) const;
  void merge_state(const FrameState &other, const std::string &other_name);
  bool is_rendering() const { return !jobs_.empty(); }  // under jobs_mutex_
  FrameTotals totals() const;
  uint64_t smallest_sample_count() const;

  // What jobs do.
  /// Fixes pipeline, depth and settings with the first samples; throws INVALID_ARGUMENT where a
  /// later job differs, UNSUPPORTED where the frame's outputs are not the pipeline's.
  void begin_samples(const gpurt_render_desc &desc, const ReyesSettings &reyes);
  void check_error_outputs(const gpurt_render_desc &desc, const PhotonSettings &photon) const;
  /// Has film arrays for more. No job may run.
  void add_film_outputs(uint32_t more);
  /// Settings of photon mapping with a radius, which is found from the scene where it is not known yet: then with the
  /// widest one that would do.
  PhotonSettings photon_settings(const EmissionView &emission, float &widest_radius);
  /// Of a frame without samples.
  void set_photon_settings(const PhotonSettings &settings);
  /// What zeros of `asked` mean for this frame: what its samples were made with, or the defaults.
  ReyesSettings resolve_reyes(const gpurt_reyes_settings &asked) const;
  PathSettings path_settings(uint32_t max_depth) const;
  void add_unit(const WorkUnit &unit, const TileFilm &film, const RenderCounters &counters);
  /// Has the sums on the device from here on, where that keeps films and has memory for one. False: they are the host's.
  bool take_to_device();
  /// Has them on the host, and no film on the device.
  void leave_device();
  void add_on_device(std::span<const WorkUnit> units, const RenderCounters &counters,
                     const std::function<FilmFinds()> &add);
  /// Copies the sums to the host where it costs little beside what rendering them again would.
  void secure_on_host(double seconds);
  /// Which samples pixels have: between passes.
  PixelSets pixel_sets() const;
  void set_outcome(uint32_t tile_size, const gpurt_schedule &schedule, std::string reason);
  void add_render_seconds(double seconds);

  FrameScene scene_;
  bool keeps_on_device_ = false;  // sums may be on the device; else what follows of that is not used
  // Pixels and their sample sets under their band's mutex, totals under totals_mutex_, the table under sets_mutex_;
  // the rest does not change.
  mutable FrameState state_;
  Reservation memory_;
  // In this order, and before those of the bands.
  mutable std::mutex host_mutex_;    // of whoever looks at the host's arrays where sums may be on the device
  mutable std::mutex device_mutex_;  // of what follows
  mutable OnDevice on_device_;
  // Else their memory is as it came: no pixel has a sample there; under host_mutex_.
  mutable bool has_host_arrays_ = false;
  mutable std::vector<std::mutex> bands_;
  mutable std::mutex sets_mutex_;
  mutable std::mutex totals_mutex_;
  mutable uint64_t generation_ = 0;                     // counts changes of the film; under totals_mutex_
  uint32_t last_tile_size_ = 0;                         // under totals_mutex_
  gpurt_schedule last_schedule_ = GPURT_SCHEDULE_INIT;  // under totals_mutex_
  std::string reason_;                                  // under totals_mutex_

  // Jobs in the order of their submission: the first one renders. The film changes by it and by merging alone,
  // and merging refuses to run while there are jobs.
  mutable std::mutex jobs_mutex_;
  mutable std::condition_variable jobs_changed_;
  std::deque<const Job *> jobs_;
  uint64_t first_gap_ =
      no_gap;  // the first pixel whose samples have gaps, as merging can leave them; under jobs_mutex_

  mutable std::mutex estimate_mutex_;
  mutable uint64_t estimate_generation_ = ~uint64_t(0);
  mutable Error estimate_;
};

}  // namespace gpurt
