#include "frame/outputs.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/path/film_values.h"
#include "frame/error_estimate.h"

namespace gpurt {

namespace {

constexpr bool is_same(FilmOutput a, gpurt_output b) { return uint32_t(a) == uint32_t(b); }
static_assert(is_same(FilmOutput::Color, GPURT_OUTPUT_COLOR) &&
              is_same(FilmOutput::Alpha, GPURT_OUTPUT_ALPHA) &&
              is_same(FilmOutput::Depth, GPURT_OUTPUT_DEPTH) &&
              is_same(FilmOutput::Normal, GPURT_OUTPUT_NORMAL) &&
              is_same(FilmOutput::Albedo, GPURT_OUTPUT_ALBEDO) &&
              is_same(FilmOutput::Position, GPURT_OUTPUT_POSITION) &&
              is_same(FilmOutput::Primitive, GPURT_OUTPUT_PRIMITIVE) &&
              is_same(FilmOutput::Instance, GPURT_OUTPUT_INSTANCE) &&
              is_same(FilmOutput::SampleCount, GPURT_OUTPUT_SAMPLE_COUNT) &&
              is_same(FilmOutput::Variance, GPURT_OUTPUT_VARIANCE));

// What pixels with statistics of their own gathered: their flux over the area of the last gather, a sample.
double gathered_color(const SumRow &row, uint32_t x, int half, int channel)
{
  if (row.statistics == nullptr || row.estimator != PhotonEstimator::PerPixel) return 0;
  const PixelStatistics &s = row.statistics[x];
  return s.radius2 > 0 ? s.sums[3 * half + channel] / s.radius2 : 0;
}

GatheredColor gathered_colors(const SumRow &row, uint32_t x)
{
  GatheredColor gathered{};
  if (row.statistics == nullptr) return gathered;
  for (int h = 0; h < 2; ++h) {
    for (int c = 0; c < 3; ++c) gathered.halves[h][c] = gathered_color(row, x, h, c);
  }
  return gathered;
}

double color_of(const SumRow &row, uint32_t x, int channel)
{
  return color_of(row.pixels[x], channel,
                  gathered_color(row, x, 0, channel) + gathered_color(row, x, 1, channel));
}

double bias_of(const SumRow &row, uint32_t x, int channel)
{
  FixedSum sum = row.errors[x].bias[0][channel];
  add(sum, row.errors[x].bias[1][channel]);
  return to_double(sum) / double(num_finite(row.pixels[x]));
}

// Of Student's distribution with n degrees of freedom: two tails of 2.5 %. Source: Cornish and Fisher's expansion, Abramowitz
// and Stegun 1964, 26.7.5.
double student_quantile(double n)
{
  constexpr double z = 1.959964, z3 = z * z * z, z5 = z3 * z * z;
  return z + (z3 + z) / (4 * n) + (5 * z5 + 16 * z3 + 3 * z) / (96 * n * n);
}

// The bias, and the confidence interval of what remains of the colour without it, as Hachisuka, Jarosz and Jensen 2010 have it.
float error_of(const SumRow &row, uint32_t x, int channel)
{
  const PixelErrors &e = row.errors[x];
  const double n = double(num_finite(row.pixels[x]));
  if (n < 2 || e.num_unbounded != 0) return std::numeric_limits<float>::infinity();
  const double bias = bias_of(row, x, channel), corrected = color_of(row, x, channel) - bias;
  const double mean2 = to_double(e.corrected2[channel]) / double(error_square_scale) / n;
  const double variance = std::max(mean2 - corrected * corrected, 0.0) / (n - 1);
  return float(std::abs(bias) + student_quantile(n - 1) * std::sqrt(variance));
}

}  // namespace

const char *output_name(gpurt_output output)
{
  switch (output) {
    case GPURT_OUTPUT_COLOR:
      return "colour";
    case GPURT_OUTPUT_ALPHA:
      return "alpha";
    case GPURT_OUTPUT_DEPTH:
      return "depth";
    case GPURT_OUTPUT_NORMAL:
      return "normal";
    case GPURT_OUTPUT_ALBEDO:
      return "albedo";
    case GPURT_OUTPUT_POSITION:
      return "position";
    case GPURT_OUTPUT_PRIMITIVE:
      return "primitive";
    case GPURT_OUTPUT_INSTANCE:
      return "instance";
    case GPURT_OUTPUT_SAMPLE_COUNT:
      return "sample count";
    case GPURT_OUTPUT_VARIANCE:
      return "variance";
    case GPURT_OUTPUT_TIME:
      return "time";
    case GPURT_OUTPUT_BIAS:
      return "bias";
    case GPURT_OUTPUT_ERROR:
      return "error";
    default:
      return "unknown output";
  }
}

uint32_t num_components(gpurt_output output)
{
  if (output == GPURT_OUTPUT_BIAS || output == GPURT_OUTPUT_ERROR) return 3;
  return num_values(FilmOutput(output));
}

bool moments_of(const SumRow &row, uint32_t x, PixelMoments &out)
{
  const PixelSums &sums = row.pixels[x];
  const double a_count = sums.num_samples[0], b_count = sums.num_samples[1], count = a_count + b_count;
  const bool is_known = a_count > 0 && b_count > 0;
  out.is_covered = sums.num_covered > 0;
  for (int c = 0; c < 3; ++c) {
    out.mean[c] = count > 0 ? float(color_of(row, x, c)) : 0.0f;
    out.variance[c] = std::numeric_limits<float>::infinity();
    out.bias2[c] = 0;
    out.is_first_larger[c] = false;
    if (!is_known) continue;
    const double difference = color_of_half(sums, 0, c, gathered_color(row, x, 0, c)) -
                              color_of_half(sums, 1, c, gathered_color(row, x, 1, c));
    out.is_first_larger[c] = difference > 0;
    out.variance[c] = variance_of_mean(sums, difference);
    if (row.errors == nullptr) continue;
    // The halves' noise is independent: that of one does not raise the expectation of the product.
    const PixelErrors &e = row.errors[x];
    out.bias2[c] = e.num_unbounded != 0
                       ? std::numeric_limits<float>::infinity()
                       : float(to_double(e.bias[0][c]) / a_count * (to_double(e.bias[1][c]) / b_count));
  }
  return is_known;
}

void resolve_row(gpurt_output output, const SumRow &row, uint32_t width, void *out)
{
  auto *values = static_cast<uint32_t *>(out);
  if (output == GPURT_OUTPUT_BIAS || output == GPURT_OUTPUT_ERROR) {
    for (uint32_t x = 0; x < width; ++x) {
      const bool has_samples = num_finite(row.pixels[x]) != 0;
      for (int c = 0; c < 3; ++c) {
        const float value = !has_samples                  ? 0.0f
                            : output == GPURT_OUTPUT_BIAS ? float(bias_of(row, x, c))
                                                          : error_of(row, x, c);
        *values++ = float_bits(value);
      }
    }
    return;
  }
  const uint32_t n = num_components(output);
  for (uint32_t x = 0; x < width; ++x, values += n) {
    film_values(FilmOutput(output), row.pixels[x], row.features != nullptr ? row.features + x : nullptr,
                row.first_hits != nullptr ? row.first_hits + x : nullptr, gathered_colors(row, x), values);
  }
}

uint32_t num_saturated_sums(const PixelSums &sums)
{
  uint32_t n = 0;
  for (const auto &half : sums.color) {
    for (const FixedSum &sum : half) n += is_saturated(sum) ? 1 : 0;
  }
  return n;
}

void ReyesCounters::add(const ReyesCounters &other)
{
  num_patches += other.num_patches;
  num_triangles += other.num_triangles;
  num_splits += other.num_splits;
  num_culled += other.num_culled;
  num_grids += other.num_grids;
  num_micropolygons += other.num_micropolygons;
  num_fragments += other.num_fragments;
  num_shaded += other.num_shaded;
  largest_queue = std::max(largest_queue, other.largest_queue);
  largest_bucket = std::max(largest_bucket, other.largest_bucket);
  working_bytes = std::max(working_bytes, other.working_bytes);
  bound_seconds += other.bound_seconds;
  split_seconds += other.split_seconds;
  dice_seconds += other.dice_seconds;
  sample_seconds += other.sample_seconds;
  split_rounds += other.split_rounds;
  num_donated += other.num_donated;
  largest_fragments = std::max(largest_fragments, other.largest_fragments);
  num_lost_fragments += other.num_lost_fragments;
}

void add_counters(RenderCounters &sum, const RenderCounters &other)
{
  sum.num_samples += other.num_samples;
  sum.num_camera_rays += other.num_camera_rays;
  sum.num_bounce_rays += other.num_bounce_rays;
  sum.num_shadow_rays += other.num_shadow_rays;
  sum.num_nonfinite += other.num_nonfinite;
  sum.generate_seconds += other.generate_seconds;
  sum.trace_seconds += other.trace_seconds;
  sum.shade_seconds += other.shade_seconds;
  sum.shadow_seconds += other.shadow_seconds;
  sum.film_seconds += other.film_seconds;
  sum.largest_sample = std::max(sum.largest_sample, other.largest_sample);
  sum.schedule.add(other.schedule);
  sum.photon.add(other.photon);
  sum.reyes.add(other.reyes);
}

}  // namespace gpurt
