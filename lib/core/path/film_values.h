// From the sums of a pixel to the values that readers see.
#pragma once

#include "core/path/film_view.h"

namespace gpurt {

// Outputs that any device resolves: values of gpurt_output, of which those after these need more than one pixel's sums say.
enum class FilmOutput : uint32_t {
  Color = 0,
  Alpha = 1,
  Depth = 2,
  Normal = 3,
  Albedo = 4,
  Position = 5,
  Primitive = 6,
  Instance = 7,
  SampleCount = 8,
  Variance = 9
};

// What a pixel gathered beside its sums, by halves: of photon mapping with statistics of pixels, else 0.
struct GatheredColor {
  double halves[2][3];
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE uint64_t num_finite(const PixelSums &p) { return uint64_t(p.num_samples[0]) + p.num_samples[1]; }

GPURT_INLINE double color_of_half(const PixelSums &p, int half, int channel, double gathered)
{
  return (to_double(p.color[half][channel]) + gathered) / double(p.num_samples[half]);
}

GPURT_INLINE double color_of(const PixelSums &p, int channel, double gathered)
{
  FixedSum sum = p.color[0][channel];
  add(sum, p.color[1][channel]);
  return (to_double(sum) + gathered) / double(num_finite(p));
}

// Variance of the mean of all samples; `difference` is that of the halves' means. With s^2 the variance of one sample,
// E (a - b)^2 = s^2 (1/na + 1/nb), and that of the mean of all is s^2 / n.
GPURT_INLINE float variance_of_mean(const PixelSums &p, double difference)
{
  const double a = double(p.num_samples[0]), b = double(p.num_samples[1]), count = a + b;
  return float(difference * difference * (a / count) * (b / count));
}

// Features are taken of every sample, also of those whose radiance was not finite.
GPURT_INLINE float mean_feature(const PixelSums &p, int64_t sum)
{
  const uint64_t taken = num_finite(p) + p.num_nonfinite;
  return taken != 0 ? float(double(sum) * 0x1p-32 / double(taken)) : 0.0f;
}

// Whether a sum is beyond the range in which more samples are safe: half of it, so that one more unit cannot wrap around.
GPURT_INLINE bool is_saturated(const FixedSum &sum)
{
  constexpr int64_t limit = int64_t(1) << 61;
  return sum.high >= limit || sum.high < -limit;
}

// 32-bit values of a pixel.
GPURT_INLINE uint32_t num_values(FilmOutput output)
{
  switch (output) {
    case FilmOutput::Color:
    case FilmOutput::Normal:
    case FilmOutput::Albedo:
    case FilmOutput::Position:
    case FilmOutput::Variance:
      return 3;
    default:
      return 1;
  }
}

// Writes the bits of an output's values. `features` and `first_hit` are what the output needs of the pixel, else null.
GPURT_INLINE void film_values(FilmOutput output, const PixelSums &p, const PixelFeatures *features,
                              const PixelFirstHit *first_hit, const GatheredColor &gathered, uint32_t *values)
{
  const uint64_t count = num_finite(p);
  switch (output) {
    case FilmOutput::Color:
      for (int c = 0; c < 3; ++c) {
        const double sum = gathered.halves[0][c] + gathered.halves[1][c];
        values[c] = float_bits(count != 0 ? float(color_of(p, c, sum)) : 0.0f);
      }
      break;
    case FilmOutput::Alpha:
      values[0] = float_bits(count != 0 ? float(double(p.num_covered) / double(count)) : 0.0f);
      break;
    case FilmOutput::Depth:
      values[0] = float_bits(first_hit->is_set ? first_hit->depth : 0.0f);
      break;
    case FilmOutput::Normal:
      for (int c = 0; c < 3; ++c) values[c] = float_bits(mean_feature(p, features->normal[c]));
      break;
    case FilmOutput::Albedo:
      for (int c = 0; c < 3; ++c) values[c] = float_bits(mean_feature(p, features->albedo[c]));
      break;
    case FilmOutput::Position:  // 0 until it is set
      values[0] = float_bits(first_hit->position.x);
      values[1] = float_bits(first_hit->position.y);
      values[2] = float_bits(first_hit->position.z);
      break;
    case FilmOutput::Primitive:
      values[0] = first_hit->is_set ? first_hit->primitive : invalid_id;
      break;
    case FilmOutput::Instance:
      values[0] = first_hit->is_set ? first_hit->instance : invalid_id;
      break;
    case FilmOutput::SampleCount:
      values[0] = uint32_t(count);
      break;
    case FilmOutput::Variance: {
      const bool is_known = p.num_samples[0] != 0 && p.num_samples[1] != 0;
      for (int c = 0; c < 3; ++c) {
        float variance = count != 0 ? infinity : 0.0f;
        if (is_known) {
          variance = variance_of_mean(p, color_of_half(p, 0, c, gathered.halves[0][c]) -
                                             color_of_half(p, 1, c, gathered.halves[1][c]));
        }
        values[c] = float_bits(variance);
      }
      break;
    }
  }
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
