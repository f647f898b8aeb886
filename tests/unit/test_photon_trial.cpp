// How many photons and which radius a job chooses from its trial passes, where the best ones are known.
#include "frame/photon_trial.h"

#include <gtest/gtest.h>

#include <cmath>

namespace {

using namespace gpurt;

// Trial passes with a radius and half of it, whose squared bias grows with a power of the radius and is known well.
PhotonTrial trial_of(double path_seconds, double photon_seconds, double of_paths, double of_photons,
                     double bias, double power = 4)
{
  return {64,
          path_seconds,
          photon_seconds,
          {of_paths + of_photons, bias, 0.01 * bias},
          {of_paths + 4 * of_photons, bias * std::pow(0.5, power), 0.01 * bias * std::pow(0.5, power)}};
}

constexpr double no_limit = 1e9;

// Noise of photons and bias alone: their sum p / s^2 + b s^q is least where s^(2 + q) = 2 p / (q b). As many passes as the trial
// had: their number does not come into it.
TEST(PhotonTrial, BalancesNoiseAndBias)
{
  for (const double power : {4.0, 2.0}) {
    for (const double best : {0.2, 0.5, 1.0, 1.3}) {
      const double of_photons = 1e-3, bias = 2 * of_photons / (power * std::pow(best, 2 + power));
      const PhotonTrial trial = trial_of(1e-3, 1e-3, 0, of_photons, bias, power);
      const PhotonChoice choice = choose_photons(trial, 0.128, {no_limit, 1, 2});
      EXPECT_EQ(choice.photons, 1);
      // Steps of 2^(1/8), and more bias than the estimate says by less than a factor of 2.
      EXPECT_LT(choice.radius / best, 1.06) << best << ' ' << power;
      EXPECT_GT(choice.radius / best, std::pow(0.5, 1 / (2 + power)) / 1.06) << best << ' ' << power;
    }
  }
}

// Noise that half the radius does not raise is that of paths, and no reason for a wider one.
TEST(PhotonTrial, TellsNoiseOfPathsFromThatOfPhotons)
{
  const double of_photons = 1e-4, bias = of_photons / (2 * std::pow(0.5, 6));
  const double without =
      choose_photons(trial_of(1e-3, 1e-3, 0, of_photons, bias), 0.128, {no_limit, 1, 2}).radius;
  EXPECT_LT(without, 0.6);
  EXPECT_EQ(choose_photons(trial_of(1e-3, 1e-3, 1e-2, of_photons, bias), 0.128, {no_limit, 1, 2}).radius,
            without);
}

// Where few photons come the bias is as good as unknown, whatever it seems to be.
TEST(PhotonTrial, KeepsTheRadiusWhereTheBiasIsUnknown)
{
  for (const double bias : {1e-6, 1e-1}) {
    PhotonTrial trial = trial_of(1e-3, 1e-3, 0, 1e-3, bias);
    EXPECT_NE(choose_photons(trial, 0.128, {no_limit, 1, 2}).radius, 1);
    trial.wide.bias_deviation = trial.wide.bias;
    EXPECT_EQ(choose_photons(trial, 0.128, {no_limit, 1, 2}).radius, 1);
    trial.wide.bias = -trial.wide.bias;
    EXPECT_EQ(choose_photons(trial, 0.128, {no_limit, 1, 2}).radius, 1);
  }
}

// In a given time, a / n + p n^(-2/3) / m with n (e + m t) = T: with paths that are dear more photons pay, with photons that
// are dear, or where paths make the noise, they do not.
TEST(PhotonTrial, AddsPhotonsWhereTheyAreCheap)
{
  const auto photons = [](double path_seconds, double photon_seconds, double of_paths, double of_photons) {
    return choose_photons(trial_of(path_seconds, photon_seconds, of_paths, of_photons, of_photons / 2), 1,
                          {no_limit, 32, 1, true})
        .photons;
  };
  EXPECT_EQ(photons(1e-3, 1e-3, 1e-2, 1e-4), 1);
  EXPECT_EQ(photons(1e-4, 1e-3, 1e-4, 1e-4), 1);
  EXPECT_GE(photons(1e-3, 1e-5, 1e-6, 1e-3), 4);
  EXPECT_GT(photons(1e-3, 1e-5, 1e-6, 1e-3), photons(1e-3, 1e-3, 1e-6, 1e-3));
}

TEST(PhotonTrial, KeepsToItsLimits)
{
  const PhotonTrial trial = trial_of(1e-3, 1e-3, 0, 1e-3, 1e-9);
  const PhotonChoice free = choose_photons(trial, 1, {no_limit, 8, 1.2});
  EXPECT_LE(free.photons, 8);
  EXPECT_LE(free.radius, 1.2);
  EXPECT_GT(free.radius, 1.1);
  EXPECT_LE(choose_photons(trial, 1, {no_limit, 8, 100}).radius, 1.5);
  const PhotonChoice kept = choose_photons(trial, 1, {no_limit, 1, 0, true});
  EXPECT_EQ(kept.photons, 1);
  EXPECT_EQ(kept.radius, 1);
  // No photon came at all: nothing is known that would speak against the usual settings.
  const PhotonChoice none = choose_photons(trial_of(1e-3, 1e-3, 1e-3, 0, 0), 1, {no_limit, 8, 2});
  EXPECT_EQ(none.photons, 1);
  EXPECT_EQ(none.radius, 1);
  // Where only a few passes are wanted there is no time to save.
  EXPECT_EQ(choose_photons(trial, 1, {4, 8, 1, true}).photons, 8);
}

}  // namespace
