// A film in memory and how a sample is added to it. All sums are exact, so their order does not matter.
#pragma once

#include "core/fixed_sum.h"
#include "core/math/vec.h"

namespace gpurt {

// Even and odd samples go to two halves with independent random sequences: their difference estimates the error.
struct PixelSums {
  FixedSum color[2][3];
  uint32_t num_samples[2];
  uint32_t num_covered;    // samples whose eye ray hit something
  uint32_t num_nonfinite;  // samples left out because a value was not finite or beyond fixed_sum_limit
};

// Sums of quantities in [-1, 1] in units of 2^-32. The normal is that of the shading frame, towards the viewer.
struct PixelFeatures {
  int64_t normal[3];
  int64_t albedo[3];
};

// What the eye ray of sample 0 hit. `is_set` is 1 once sample 0 was taken.
struct PixelFirstHit {
  float depth;  // distance from the camera's plane
  Vec3f position;
  uint32_t primitive, geometry, instance;  // public ids
  uint32_t is_set;
};

struct FilmView {
  PixelSums *pixels;          // [height][width]
  PixelFeatures *features;    // or null
  PixelFirstHit *first_hits;  // or null
  uint32_t width, height;
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE void add(PixelSums &sums, const PixelSums &other)
{
  for (int h = 0; h < 2; ++h) {
    for (int c = 0; c < 3; ++c) add(sums.color[h][c], other.color[h][c]);
    sums.num_samples[h] += other.num_samples[h];
  }
  sums.num_covered += other.num_covered;
  sums.num_nonfinite += other.num_nonfinite;
}

// Adds one sample. A value that is not finite, or beyond the film's range, is counted and left out.
GPURT_INLINE void add_sample(PixelSums &sums, uint64_t sample, Vec3f radiance, bool covered)
{
  const bool usable = max_component(abs(radiance)) <= fixed_sum_limit && is_finite(radiance);
  if (!usable) {
    sums.num_nonfinite++;
    return;
  }
  const int half = int(sample & 1);
  add(sums.color[half][0], fixed_sum_from(radiance.x));
  add(sums.color[half][1], fixed_sum_from(radiance.y));
  add(sums.color[half][2], fixed_sum_from(radiance.z));
  sums.num_samples[half]++;
  sums.num_covered += covered ? 1 : 0;
}

GPURT_INLINE int64_t feature_from(float x) { return int64_t(clamp(x, -1.0f, 1.0f) * 0x1p32f); }

GPURT_FUNCTIONS_END
}  // namespace gpurt
