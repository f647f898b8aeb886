#include "frame/photon_trial.h"

#include <algorithm>
#include <cmath>

namespace gpurt {

namespace {

// How far the radius may go from the trial's, beyond which the trial says little.
constexpr double narrowest_radius = 0.125, widest_radius = 1.5;
constexpr double radius_step = 1.0905077326652577;  // 2^(1/8)

// Of the squared bias over its estimate, which is that of light whose second derivatives do not change within the radius: on
// cornell_spheres and caustic_glass 1.4 to 1.9 was measured.
constexpr double bias_over_estimate = 1.6;

bool is_known(const PhotonTrial::Error &e) { return e.bias > 2 * e.bias_deviation; }

}  // namespace

PhotonChoice choose_photons(const PhotonTrial &trial, double seconds, const PhotonChoiceLimits &limits)
{
  const PhotonTrial::Error &wide = trial.wide, &narrow = trial.narrow;
  // A quarter of the area has a quarter of the photons, and four times their noise; the paths' noise is the same.
  const double of_photons = std::max(narrow.noise - wide.noise, 0.0) / 3;
  const double of_paths = std::max(wide.noise - of_photons, 0.0);
  const double bias = bias_over_estimate * std::max(wide.bias, 0.0);
  const double power =
      is_known(wide) && is_known(narrow) ? std::clamp(std::log2(wide.bias / narrow.bias), 1.0, 4.0) : 4.0;
  const auto error_of = [&](double photons, double radius) {
    const double passes = std::clamp(seconds / (trial.path_seconds + photons * trial.photon_seconds), 1.0,
                                     std::max(limits.max_passes, 1.0));
    const double ratio = trial.num_passes / passes;
    return of_paths * ratio + std::cbrt(ratio * ratio) * of_photons / (photons * radius * radius) +
           bias * std::pow(std::pow(ratio, 1.0 / 6) * radius, power);
  };
  // Where little light is found, discs bring it to where it does not belong, and the bias is not known: wider ones would hide it,
  // and for narrower ones there is no reason.
  const bool keeps_radius = limits.keeps_radius || !is_known(wide);
  const double widest = std::min(limits.widest_radius, widest_radius);
  PhotonChoice best;
  double least = error_of(1, 1);
  for (double photons = 1; photons <= limits.most_photons; photons *= 2) {
    double radius = keeps_radius ? 1 : narrowest_radius;
    do {
      const double error = error_of(photons, radius);
      if (error < least) {
        least = error;
        best = {photons, radius};
      }
      radius *= radius_step;
    } while (!keeps_radius && radius <= widest);
  }
  return best;
}

}  // namespace gpurt
