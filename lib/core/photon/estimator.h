// How what visible points gather becomes pixels, and which radius they gather within next.
//
// Memoryless: the radius depends on the pass alone, and a pixel is the mean of its samples.
// Per pixel: a pixel keeps the number of its photons and their flux; each gather takes in a share of the new photons and
// shrinks the radius to the area that keeps their density. The pixel is the flux over the last area.
// Adaptive: a pixel is the mean of its samples; their radius is that of the least sum of squared blur and variance, by what
// the pixel's gathers so far say about both.
// Sources: Knaus and Zwicker 2011; Hachisuka and Jensen 2009; Kaplanyan and Dachsbacher 2013.
// Differs: for adaptive radii the last takes the Laplacian of radiance from photons around each point by finite differences
// of its own kernel, and the variance from the photons' density; here both come from the sums that state the error.
#pragma once

#include "core/photon/disc_area.h"

namespace gpurt {

// Share of new photons that a pixel takes in: alpha of all three sources.
constexpr double photon_alpha = 2.0 / 3;

// Squares of adaptive radii are at least this part of the pass's largest.
constexpr double smallest_adaptive_share = 0x1p-10;

// Where the sums of PixelStatistics have what: per pixel, the flux of even and of odd samples; adaptive, sums over gathers
// of radius r that found radiance x by m photons, with blur b: of r^2, x r^2, m, b r^4 and r^6.
enum AdaptiveSum : uint32_t { sum_r2 = 0, sum_x_r2 = 1, sum_m = 2, sum_b_r4 = 3, sum_r6 = 4 };

// What the gathers of a unit of paths are summed up in; blurs are null where they are not wanted.
struct PhotonSums {
  PhotonSum *sums;
  PhotonBlur *blurs;
};

GPURT_FUNCTIONS_BEGIN

// Whether gathers sum up blurs for a film.
GPURT_INLINE bool wants_blur(const PhotonPass &pass, bool film_has_errors)
{
  return film_has_errors || pass.estimator == PhotonEstimator::Adaptive;
}

// The squared radius of the least error of a mean of `count` gathers, over that of the largest one allowed.
//
// One gather has the variance x^2 / m, as all photons carry about the same flux, and m grows with r^2: so the mean of n has
// x^2 / (n d r^2), with d the photons over r^2. Its blur is c r^2. The sum of c^2 r^4 and the variance is least where
// r^6 = x^2 / (2 n d c^2).
GPURT_INLINE double adaptive_share(const PixelStatistics &s, double largest_radius)
{
  const double count = s.count, r2 = s.sums[sum_r2], m = s.sums[sum_m];
  const double curvature = s.sums[sum_r6] > 0 ? s.sums[sum_b_r4] / s.sums[sum_r6] : 0;
  if (!(r2 > 0) || !(m > 0)) return 1;
  const double mean = s.sums[sum_x_r2] / r2, density = m / r2;
  const double largest2 = largest_radius * largest_radius;
  const double divisor = 2 * count * density * curvature * curvature * largest2 * largest2 * largest2;
  const double cube = mean * mean;
  if (!(cube < divisor)) return 1;
  const double share = double(cube_root(float(cube / divisor)));
  return share > smallest_adaptive_share ? share : smallest_adaptive_share;
}

// The radius of a pixel's next gather. What has no statistics yet has the pass's own.
GPURT_INLINE float next_radius(const PhotonPass &pass, const PixelStatistics &s)
{
  if (pass.estimator == PhotonEstimator::Adaptive)
    return pass.radius * float(sqrt(adaptive_share(s, double(pass.radius))));
  return s.radius2 > 0 ? min(float(sqrt(s.radius2)), pass.radius) : pass.radius;
}

// Sets the radii of points; one call a path. `statistics` has the rows of the frame.
struct SetPhotonRadii {
  PathUnit unit;
  PhotonPass pass;
  const PixelStatistics *statistics;
  uint32_t width;  // of the rows
  VisiblePoint *points;

  GPURT_HD void operator()(uint32_t i) const
  {
    if (pass.estimator == PhotonEstimator::Memoryless || points[i].depth == 0) return;
    const PathSample s = path_sample(unit, i);
    points[i].radius = next_radius(pass, statistics[uint64_t(s.y) * width + s.x]);
  }
};

// Takes in what a pixel's next gather found. Per pixel alone the flux is the estimate.
GPURT_INLINE void take_in(PixelStatistics &s, const PhotonPass &pass, const VisiblePoint &point,
                          const PhotonSum &sum, Vec3f gathered, Vec3f blur, uint32_t half)
{
  if (point.depth == 0) return;
  const double r2 = double(point.radius) * double(point.radius);
  if (pass.estimator == PhotonEstimator::Adaptive) {
    s.count += 1;
    s.sums[sum_r2] += r2;
    s.sums[sum_x_r2] += (double(gathered.x) + double(gathered.y) + double(gathered.z)) * r2;
    s.sums[sum_m] += double(sum.num_photons);
    s.sums[sum_b_r4] += (double(blur.x) + double(blur.y) + double(blur.z)) * r2 * r2;
    s.sums[sum_r6] += r2 * r2 * r2;
    return;
  }
  if (!(s.radius2 > 0)) s.radius2 = r2;
  if (sum.num_photons == 0) return;
  const double m = double(sum.num_photons);
  const double kept = s.count + photon_alpha * m;
  const double ratio = kept / (s.count + m);
  const double flux[3] = {double(gathered.x) * r2, double(gathered.y) * r2, double(gathered.z) * r2};
  for (uint32_t c = 0; c < 3; ++c) {
    s.sums[3 * half + c] = (s.sums[3 * half + c] + flux[c]) * ratio;
    s.sums[3 * (1 - half) + c] *= ratio;
  }
  s.count = kept;
  s.radius2 *= ratio;
}

// Adds a sample to a pixel of a film, and returns its radiance. `blur` may be null.
GPURT_INLINE Vec3f add_photon_sample(const FilmView &film, uint32_t pixel, uint64_t sample,
                                     const PhotonPass &pass, const PathState &path, const VisiblePoint &point,
                                     const PhotonSum &sum, const PhotonBlur *blur)
{
  const Vec3f radiance = sample_radiance(pass, path, point, sum);
  const bool is_per_pixel = pass.estimator == PhotonEstimator::PerPixel;
  Vec3f added = radiance;
  // Its gathers are kept apart; one that is not finite is left out with its direct light.
  if (is_per_pixel && is_finite(radiance)) added = path.radiance;
  add_sample(film.pixels[pixel], sample, added, path.covered != 0);
  const Vec3f bias =
      blur != nullptr && point.depth != 0 ? gathered_blur(pass, point, sum, *blur) : vec3(0.0f);
  if (film.errors != nullptr) add_sample_error(film.errors[pixel], sample, radiance, bias);
  if (pass.estimator != PhotonEstimator::Memoryless && is_finite(radiance)) {
    const Vec3f gathered = point.depth != 0 ? gathered_radiance(pass, point, sum) : vec3(0.0f);
    take_in(film.statistics[pixel], pass, point, sum, gathered, bias, uint32_t(sample & 1));
  }
  return radiance;
}

// Adds the wave's paths to the film: one call a pixel, as AddSamples.
struct AddPhotonSamples {
  PathUnit unit;
  PathWave wave;
  FilmView film;
  PhotonPass pass;
  const VisiblePoint *points;
  PhotonSums gathered;
  uint32_t num_paths;

  GPURT_HD void operator()(uint32_t i) const
  {
    const uint32_t num_pixels = film.width * film.height;
    for (uint32_t k = i; k < num_paths; k += num_pixels) {
      const PathSample sample = path_sample(unit, k);
      add_photon_sample(film, sample.local, sample.sample, pass, wave.paths[k], points[k], gathered.sums[k],
                        gathered.blurs ? &gathered.blurs[k] : nullptr);
    }
  }
};

GPURT_FUNCTIONS_END
}  // namespace gpurt
