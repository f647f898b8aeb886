// Settings of photon mapping: what zero means, and the initial radius.
#pragma once

#include "backend.h"
#include "gpurt.h"

namespace gpurt {

/// Puts values for zeros: those of the frame's samples where `made_with` has some, else defaults for a frame of that many
/// pixels. An initial radius of 0 is left. Throws INVALID_ARGUMENT for values out of range or other than the frame's, and
/// UNSUPPORTED for estimators that do not exist yet.
PhotonSettings resolve_photon_settings(const gpurt_photon_settings &asked, const PhotonSettings &made_with,
                                       uint64_t num_pixels);

/// The largest number that a job chooses by itself.
constexpr uint32_t most_default_photons = 1u << 22;

/// The radius that follows from a pilot: where photons are dense, about ten of a pass lie within it, as long as its discs
/// are small in the picture: that of discs which are just so small is `widest`.
struct InitialRadius {
  float radius, widest;
};
InitialRadius choose_initial_radius(const CommittedScene &scene, const PathSettings &path,
                                    const EmissionView &emission, uint32_t photons_per_pass);

}  // namespace gpurt
