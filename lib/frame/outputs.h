// From sums to the values that readers and files see: what each gpurt_output means.
#pragma once

#include "backend.h"
#include "frame/film.h"
#include "render_counters.h"

namespace gpurt {

/// The name of an output as messages and the command line say it, such as "colour".
const char *output_name(gpurt_output output);

/// Number of 32-bit values of a pixel.
uint32_t num_components(gpurt_output output);

struct SumRow {
  const PixelSums *pixels;
  const PixelFeatures *features;      // or null
  const PixelFirstHit *first_hits;    // or null
  const PixelErrors *errors;          // or null
  const PixelStatistics *statistics;  // or null
  PhotonEstimator estimator;          // of the samples, where they are of photon mapping
};

/// Writes one row of `width` pixels, float or uint32_t as gpurt_output says. Pixels without samples become 0, ids of
/// them GPURT_INVALID_ID.
void resolve_row(gpurt_output output, const SumRow &row, uint32_t width, void *out);

struct PixelMoments;
/// Mean and variance of the mean of pixel x, from the two halves, and its squared bias; false, with infinite variance, while
/// a half is empty.
bool moments_of(const SumRow &row, uint32_t x, PixelMoments &out);

/// Sums beyond the range in which further samples are safe.
uint32_t num_saturated_sums(const PixelSums &sums);

}  // namespace gpurt
