// Photons a pass and their radius for a given time, from what a few passes say of noise, blur and cost.
#pragma once

#include <cstdint>

namespace gpurt {

/// What trial passes found. Errors are relMSE of the mean of the passes.
struct PhotonTrial {
  struct Error {
    double noise;           // of everything
    double bias;            // squared; it may be negative
    double bias_deviation;  // how far this is off, about
  };
  double num_passes;
  double path_seconds,
      photon_seconds;  // of a pass: paths from the eye, and photons with their maps and gathers
  Error wide, narrow;  // with the radius, and with half of it: the same paths and photons
};

/// Factors of the trial's photons a pass and initial radius.
struct PhotonChoice {
  double photons = 1, radius = 1;
};

/// What a choice is bound to.
struct PhotonChoiceLimits {
  double max_passes;
  double most_photons = 1, widest_radius = 1;  // factors
  bool keeps_radius = false;
};

/// The choice of the least error in `seconds`. The noise of paths falls with the number of passes; that of photons with passes to
/// the power of -2/3, their number and the square of the radius. Squared bias grows with a power of the radius, which falls
/// with passes to the power of -1/6: the fourth where light is smooth, a smaller one at edges of caustics, as the two radii tell.
/// The radius stays where the bias is not known, being no larger than what it may be off by.
PhotonChoice choose_photons(const PhotonTrial &trial, double seconds, const PhotonChoiceLimits &limits);

}  // namespace gpurt
