// Eye paths on the device, part by part of a unit: where they gather, how much of the discs there lies on surfaces, the
// gather and the film.
#pragma once

#include "cuda/photon/eye_paths.h"
#include "cuda/photon/pass_queue.h"

namespace gpurt::cuda {

class EyeTracer {
 public:
  /// For up to `capacity` paths at a time. Throws OUT_OF_MEMORY.
  EyeTracer(PassQueue &queue, uint32_t capacity);

  uint32_t capacity() const { return capacity_; }
  const VisiblePoint *points() const { return wave_.points; }

  /// Clears n points. A path writes what its vertex needs, and that there is none: all of it is there to copy after this alone.
  void clear_points(uint32_t n);

  /// Turns to passes, in device memory; `first_slot` is that of the unit's first sample.
  void set_passes(const PhotonPass *passes, uint32_t first_slot);
  /// Follows n paths to their visible points. `film` takes what the eye rays met; its arrays may be null. False: cancelled.
  bool trace_points(const PathSettings &settings, uint32_t remedies, const EyePixels &pixels,
                    const FilmView &film, uint32_t n);
  /// Sets the radii of the points' gathers by the statistics of the film's pixels.
  void set_radii(const FilmView &film, uint32_t n);
  /// Measures the discs of the points, where the passes' remedies ask for it. False: cancelled.
  bool measure_discs(uint32_t remedies, uint32_t n);
  /// Adds what the points gather to sums[n]. False: cancelled.
  bool gather(const PhotonGrid &grid, const PhotonSums &sums, uint32_t n);
  /// Adds the paths to the film.
  void add_samples(const PhotonSums &sums, const FilmView &film, uint32_t n);

  struct Counters {
    uint64_t num_camera_rays = 0, num_bounce_rays = 0, num_shadow_rays = 0, num_gathered = 0, num_visible = 0;
    float largest_sample = 0;
  };
  /// Of all that was done since the last call. Waits for it.
  Counters take_counters();

 private:
  const EyeNumbers &read_numbers();
  void clear_step();
  void pass_near_points(int from, uint32_t depth, uint32_t num_rays);

  PassQueue &queue_;
  const uint32_t capacity_;
  DeviceBuffer<std::byte> buffer_;
  EyeWave wave_{};
  Hit *hits_ = nullptr;
  uint32_t *trace_scratch_ = nullptr;
  Counters counters_;
  uint32_t gather_slice_ = 0;  // points of a launch; 0: not known yet
};

}  // namespace gpurt::cuda
