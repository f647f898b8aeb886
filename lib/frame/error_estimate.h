// The error of a frame, estimated from nothing but the frame: when may rendering stop?
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "backend.h"  // CompiledScene

namespace gpurt {

/// What the estimate needs of a pixel.
struct PixelMoments {
  float mean[3];
  float variance[3];        // of the mean, from the two halves
  bool is_first_larger[3];  // the mean of even samples is above that of odd ones
  float bias2[3];           // squared, estimated without bias: it may be negative
  bool is_covered;          // some eye ray hit something: light not yet seen may still arrive
};

/// Fills rows [y0, y1) of the frame.
using MomentSource = std::function<void(uint32_t y0, uint32_t y1, PixelMoments *rows)>;

/// What photons add to the doubt: one of them lights all pixels whose gathers reach it.
struct PhotonDoubt {
  double photon_radiance;  // what one adds to a pixel that finds it in one of its samples, at most
  double num_gathered;     // by all gathers
};

/// What a frame is off by: both are relMSE, and add up.
struct ErrorEstimate {
  double noise, bias;
};

/// relMSE of a frame, mean over pixels and channels of (x - r)^2 / (r^2 + 0.01), without knowing r.
///
/// `num_samples` is the number that the pixels have on average, `unseen_radiance` what a single sample may return that
/// reaches a lamp on a path which no sample has found yet.
///
/// Three things would make the plain mean of variance / (mean^2 + 0.01) stop too early, and are met:
///  - A pixel that one rare sample made bright has a large mean, so the plain quotient is at most 1 however wrong the
///    pixel is. In the denominator the mean is therefore moved towards the median of its 3 x 3 neighbourhood, which a
///    rare sample does not touch, but by no more than three standard deviations of the pixel: converged detail stays.
///  - Where few pixels carry most of the error, their number is itself uncertain. The sum is raised by two of its
///    standard deviations, which follow from the effective number of contributions (sum e)^2 / sum e^2.
///  - Paths of which none has been found contribute nothing to the halves. Of an event that did not occur in M samples
///    the probability is below 3 / M with 95 % confidence; with `unseen_radiance` as its value this gives a variance,
///    added to every covered pixel.
/// Source: two halves: Dammertz et al. 2010; the rule of three: Hanley and Lippman-Hand 1983; the effective number of
/// contributions: Kish 1965; median of nine: Paeth 1990.
/// Differs: the usual dilation (neighbours take part in the numerator) is 30 times too high where noisy bright pixels
/// lie beside dark ones; the neighbourhood in the denominator meets the same failure without that.
/// The mean of the bias has the same denominators and the same two standard deviations; it is not below 0.
///
/// Photons, where `photons` is given, make blotches: pixels of a neighbourhood are right or wrong together.
///  - Such a neighbourhood is its own witness: the median does not tell a blotch wider than 3 x 3 pixels. But one of the
///    halves has not seen its photon, so in the denominator the mean is moved down to that of the darker half at least.
///  - A photon that counts in A pixels is one contribution, not A: the squared standard deviation of the sum is A times
///    that of independent pixels. A is the largest, over squares of 2, 4, 8 ... pixels, of the variance of their sums
///    over the sum of their pixels' variances: 1 for independent pixels, and the area of blotches narrower than the
///    squares, however many lie on each other.
///  - Of photons that no gather has found yet, three more may come with 95 % confidence, each of which lights A pixels;
///    every pixel, where none was found, since then nothing is known of A.
ErrorEstimate estimate_relmse(uint32_t width, uint32_t height, double num_samples, double unseen_radiance,
                              const MomentSource &moments, const PhotonDoubt *photons = nullptr);

/// PhotonDoubt::photon_radiance: of a photon of the last pass, found by a white surface.
double photon_radiance(const CompiledScene &scene, const PhotonSettings &settings, double radius);

/// `unseen_radiance` of a scene: all its lamps at once, as a diffuse surface shows them at an eighth of the diagonal of
/// the scene; a lamp's own radiance where that is less.
double unseen_radiance(const CompiledScene &scene);

}  // namespace gpurt
