// Passes of photon mapping: what a pass's index makes of the settings.
#pragma once

#include <algorithm>
#include <cmath>

#include "core/photon/emission.h"
#include "core/photon/photon_settings.h"

namespace gpurt {

/// What photon mapping did, for gpurt_photon_counters.
struct PhotonCounters {
  uint64_t num_emitted = 0, num_rays = 0, num_stored = 0, num_gathered = 0, num_visible = 0,
           num_sub_passes = 0;
  double trace_seconds = 0, build_seconds = 0, gather_seconds = 0;
  double smallest_radius = 0;                    // 0: none yet
  double emit_seconds = 0, scatter_seconds = 0;  // of trace_seconds

  void add(const PhotonCounters &other)
  {
    num_emitted += other.num_emitted;
    num_rays += other.num_rays;
    num_stored += other.num_stored;
    num_gathered += other.num_gathered;
    num_visible += other.num_visible;
    num_sub_passes += other.num_sub_passes;
    trace_seconds += other.trace_seconds;
    build_seconds += other.build_seconds;
    gather_seconds += other.gather_seconds;
    emit_seconds += other.emit_seconds;
    scatter_seconds += other.scatter_seconds;
    if (other.smallest_radius > 0 && (smallest_radius == 0 || other.smallest_radius < smallest_radius))
      smallest_radius = other.smallest_radius;
  }
};

/// Cube root of a positive number by Newton's method: the same bits everywhere.
inline double cube_root_of(double x)
{
  int exponent;
  const double mantissa = std::frexp(x, &exponent);
  const int third = exponent >= 0 ? exponent / 3 : -((2 - exponent) / 3);
  const double scaled = std::ldexp(mantissa, exponent - 3 * third);  // in [1/2, 4)
  double y = 1;
  for (int i = 0; i < 40; ++i) y = (2 * y + scaled / (y * y)) / 3;
  return std::ldexp(y, third);
}

/// Square of the radius of pass `index` over that of pass 0.
///
/// r(i+1)^2 = r(i)^2 (i + a) / (i + 1) for i = 1, 2, ..., a = 2/3.
/// Source: Knaus and Zwicker 2011. Beyond 2^16 passes the product is that of Gamma functions, whose ratio is
/// (i + 1/3)^(-1/3) to within i^-2.
inline double photon_radius2_share(uint64_t index)
{
  constexpr uint64_t last_of_product = uint64_t(1) << 16;
  double share = 1;
  for (uint64_t i = 1; i <= std::min(index, last_of_product); ++i)
    share *= (double(i) + 2.0 / 3) / (double(i) + 1);
  if (index > last_of_product) {
    // Of i + 1 factors' Gamma(i + 1 + 2/3) / Gamma(i + 2).
    share *= cube_root_of((double(last_of_product) + 4.0 / 3) / (double(index) + 4.0 / 3));
  }
  return share;
}

/// Pass `index`, whose radius never falls below what coordinates of the scene resolve.
inline PhotonPass make_photon_pass(const PhotonSettings &settings, const EmissionView &emission,
                                   uint64_t index)
{
  PhotonPass pass;
  pass.index = index;
  pass.num_emitted = emission.cdf ? settings.photons_per_pass : 0;
  pass.kernel = settings.kernel;
  pass.remedies = settings.remedies;
  pass.estimator = settings.estimator;
  double radius = double(settings.initial_radius);
  if (settings.estimator != PhotonEstimator::PerPixel) radius *= std::sqrt(photon_radius2_share(index));
  if (settings.estimator == PhotonEstimator::Adaptive && index != 0)
    radius *= double(largest_adaptive_factor);
  const float extent = max_component(abs(emission.center)) + emission.radius;
  pass.radius = std::max(float(radius), extent * 0x1p-20f);
  // The kernel's integral over the disc: pi r^2, of a cone a third of it.
  const double norm = settings.kernel == PhotonKernel::Cone ? 3 : 1;
  const double area = 3.14159265358979323846 * double(pass.radius) * pass.radius;
  pass.scale = float(norm * double(emission.total_weight) / (double(settings.photons_per_pass) * area));
  return pass;
}

}  // namespace gpurt
