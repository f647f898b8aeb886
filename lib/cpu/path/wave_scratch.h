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
  WaveScratch()
      : paths_(wave_capacity),
        hits_(wave_capacity),
        rays_(wave_capacity),
        next_rays_(wave_capacity),
        shadow_slots_(wave_capacity),
        shadow_rays_(wave_capacity),
        ids_(4 * size_t(wave_capacity)),
        contributions_(2 * size_t(wave_capacity)),
        occluded_(wave_capacity)
  {}

  PathWave wave()
  {
    uint32_t *ids = ids_.data();
    Vec3f *contributions = contributions_.data();
    return {paths_.data(),
            {rays_.data(), ids},
            hits_.data(),
            {next_rays_.data(), ids + wave_capacity},
            {shadow_slots_.data(), ids + 2 * wave_capacity, contributions},
            {shadow_rays_.data(), ids + 3 * wave_capacity, contributions + wave_capacity},
            occluded_.data()};
  }

  static constexpr uint64_t bytes()
  {
    return uint64_t(wave_capacity) *
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
