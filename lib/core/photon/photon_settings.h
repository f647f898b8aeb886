// What a pass of photon mapping is made with: everything that decides its bits beside the scene and PathSettings.
#pragma once

#include "core/math/vec.h"

namespace gpurt {

enum class PhotonKernel : uint32_t { Constant = 1, Cone = 2 };  // values of gpurt_photon_kernel

enum class PhotonEstimator : uint32_t {
  Memoryless = 1,
  PerPixel = 2,
  Adaptive = 3
};  // values of gpurt_photon_estimator

// Adaptive radii are at most this times the memoryless radius of the pass.
constexpr float largest_adaptive_factor = 4.0f;

// Bits of gpurt_photon_remedy.
constexpr uint32_t remedy_normal = 1, remedy_plane = 2, remedy_side = 4, remedy_boundary = 8,
                   remedy_continue = 32;

struct PhotonSettings {
  uint32_t photons_per_pass;
  float initial_radius;
  PhotonKernel kernel;
  uint32_t remedies;
  PhotonEstimator estimator = PhotonEstimator::Memoryless;
};

// A pass: all that depends on its index.
struct PhotonPass {
  uint64_t index;
  uint32_t num_emitted;  // photon paths
  float radius;          // where pixels have their own: the largest
  PhotonKernel kernel;
  uint32_t remedies;
  // Radiance of a Lambertian surface of reflectance pi for one photon of flux 1: the flux of a photon over the area of
  // the disc, with the kernel's norm.
  float scale;
  PhotonEstimator estimator = PhotonEstimator::Memoryless;
};

// Photon paths keep their length in a byte, and share it with the eye path.
constexpr uint32_t max_photon_depth = 255;

}  // namespace gpurt
