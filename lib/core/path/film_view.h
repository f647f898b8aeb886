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

// What samples of photon mapping say about their own error, where that is wanted.
struct PixelErrors {
  FixedSum bias[2][3];     // what the blur adds to a sample, estimated: of even and odd samples
  FixedSum corrected2[3];  // squares of samples less that, times error_square_scale
  uint32_t num_unbounded;  // samples too large for these sums: then the error is not known
  uint32_t padding;
};

// What photon mapping with a memory keeps of a pixel from pass to pass; see core/photon/estimator.h.
struct PixelStatistics {
  double radius2;
  double count;
  double sums[6];
};

struct FilmView {
  PixelSums *pixels;          // [height][width]
  PixelFeatures *features;    // or null
  PixelFirstHit *first_hits;  // or null
  uint32_t width, height;
  PixelErrors *errors = nullptr;          // or null
  PixelStatistics *statistics = nullptr;  // or null
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

// Squares are kept of radiances from 2^-24 up to 2^23.
constexpr float error_square_scale = 0x1p-16f, error_limit = 0x1p23f;

GPURT_INLINE void add(PixelErrors &sums, const PixelErrors &other)
{
  for (int c = 0; c < 3; ++c) {
    for (int h = 0; h < 2; ++h) add(sums.bias[h][c], other.bias[h][c]);
    add(sums.corrected2[c], other.corrected2[c]);
  }
  sums.num_unbounded += other.num_unbounded;
}

// Adds what a sample that add_sample takes says about its error.
GPURT_INLINE void add_sample_error(PixelErrors &sums, uint64_t sample, Vec3f radiance, Vec3f bias)
{
  const Vec3f corrected = radiance - bias;
  if (!(max_component(abs(radiance)) <= fixed_sum_limit) || !is_finite(radiance)) return;
  if (!(max_component(abs(bias)) <= error_limit && max_component(abs(corrected)) <= error_limit) ||
      !is_finite(bias)) {
    sums.num_unbounded++;
    return;
  }
  const int half = int(sample & 1);
  const float b[3] = {bias.x, bias.y, bias.z}, x[3] = {corrected.x, corrected.y, corrected.z};
  for (int c = 0; c < 3; ++c) {
    add(sums.bias[half][c], fixed_sum_from(b[c]));
    add(sums.corrected2[c], fixed_sum_from(x[c] * error_square_scale * x[c]));
  }
}

GPURT_INLINE int64_t feature_from(float x) { return int64_t(clamp(x, -1.0f, 1.0f) * 0x1p32f); }

GPURT_FUNCTIONS_END
}  // namespace gpurt
