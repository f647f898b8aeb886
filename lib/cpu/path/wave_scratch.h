// One thread's memory for a wave of paths.
#pragma once

#include <vector>

#include "core/path/path_wave.h"
#include "frame/film.h"

namespace gpurt {

// Paths that run through the stages together: enough to fill the stages' loops, few enough to stay in a core's cache.
constexpr uint32_t wave_capacity = 2048;

// One thread's memory for a wave and for the film of its unit.
class WaveScratch {
 public:
  explicit WaveScratch(uint32_t capacity = wave_capacity)
      : paths_(capacity),
        hits_(capacity),
        rays_(capacity),
        next_rays_(capacity),
        shadow_slots_(capacity),
        shadow_rays_(capacity),
        ids_(4 * size_t(capacity)),
        contributions_(2 * size_t(capacity)),
        occluded_(capacity)
  {}

  PathWave wave()
  {
    const size_t capacity = paths_.size();
    uint32_t *ids = ids_.data();
    Vec3f *contributions = contributions_.data();
    return {paths_.data(),
            {rays_.data(), ids},
            hits_.data(),
            {next_rays_.data(), ids + capacity},
            {shadow_slots_.data(), ids + 2 * capacity, contributions},
            {shadow_rays_.data(), ids + 3 * capacity, contributions + capacity},
            occluded_.data()};
  }

  static constexpr uint64_t bytes(uint32_t capacity = wave_capacity)
  {
    return uint64_t(capacity) *
           (sizeof(PathState) + sizeof(Hit) + 4 * (sizeof(Ray) + sizeof(uint32_t)) + 2 * sizeof(Vec3f) + 1);
  }

  TileFilm film;

 private:
  std::vector<PathState> paths_;
  std::vector<Hit> hits_;
  std::vector<Ray> rays_, next_rays_, shadow_slots_, shadow_rays_;
  std::vector<uint32_t> ids_;
  std::vector<Vec3f> contributions_;
  std::vector<uint8_t> occluded_;
};

}  // namespace gpurt
