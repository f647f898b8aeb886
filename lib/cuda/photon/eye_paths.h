// Eye paths of photon mapping on the device: their steps to the visible points, the trials of discs, gather and film.
#pragma once

#include <cuda_runtime_api.h>

#include "core/photon/estimator.h"
#include "core/photon/near_vertex.h"
#include "cuda/accel/kernels.h"

namespace gpurt::cuda {

/// Where paths start: the pixels of a unit, or for the pilot those in points_per_axis^2 places of the image, sample 0.
struct EyePixels {
  PathUnit unit;
  uint32_t points_per_axis;  // 0: those of the unit
};

struct EyeQueue {
  Ray *rays;
  uint32_t *paths;
  uint32_t *left_out;  // the triangle that a ray leaves and cannot meet; invalid_id: none
};

/// Shadow rays of a step: the triangles that they leave out are those that they leave and end at.
struct EyeShadows {
  ShadowQueue queue;
  uint32_t *left_out, *ended_at;
  uint8_t *occluded;
};

// What kernels count, in device memory.
struct EyeNumbers {
  uint32_t next, shadows;  // rays of one step
  uint32_t largest_bits;   // of the largest radiance of a path
  uint32_t padding;
  unsigned long long num_visible;
  unsigned long long num_gathered;
  unsigned long long num_probes;  // of trials up to the one that ended them
  unsigned long long num_near_rays;
};

/// Paths of a part of a unit, of one pass after another.
struct EyeWave {
  SceneView scene;
  PathSettings settings;
  EyePixels pixels;
  const PhotonPass *passes;  // by slot, in device memory
  uint32_t first_slot;       // of the unit's first sample
  FilmView film;             // its optional arrays, which the eye rays' features are added to
  PathState *states;
  VisiblePoint *points;
  EyeQueue queues[2];
  const Hit *hits;
  EyeShadows shadows;
  EyeNumbers *numbers;
  bool leaves_out;  // whether left_out and ended_at are wanted
};

/// Starts n paths: their rays in queue 0.
void launch_start_eye_paths(const EyeWave &wave, uint32_t n, cudaStream_t stream);
/// What n rays of queue `from` met, at `depth`; next rays go to the other queue.
void launch_shade_eye_paths(const EyeWave &wave, int from, uint32_t depth, uint32_t n, cudaStream_t stream);
void launch_add_direct_light(const EyeWave &wave, uint32_t n, cudaStream_t stream);

/// Aims ray k of the paths of queue `from` that gather at `depth`, where their passes ask for it, into the places of shadow
/// rays; the others' meet nothing.
void launch_aim_near_rays(const EyeWave &wave, int from, uint32_t depth, uint32_t k, uint32_t n,
                          cudaStream_t stream);
/// Lets those go on whose ray met something.
void launch_pass_near_points(const EyeWave &wave, int from, uint32_t depth, uint32_t n, cudaStream_t stream);

/// Trials first .. first + per_point - 1 of every point, side by side in a queue.
struct DiscTrials {
  uint32_t first, per_point;
};
/// Aims the trial 0 of all of n points that want some, into queue 0: numbers->next of them.
void launch_begin_disc_trials(const EyeWave &wave, uint32_t n, cudaStream_t stream);
/// Looks at the trials of num_points points of queue `from`. Points without an end go to the front of the other queue's
/// paths, numbers->next of them.
void launch_end_disc_trials(const EyeWave &wave, int from, DiscTrials trials, uint32_t num_points,
                            cudaStream_t stream);
/// Aims the trials of the points that are at the front of the queue's paths: num_points * trials.per_point rays.
void launch_aim_disc_trials(const EyeWave &wave, int from, DiscTrials trials, uint32_t num_points,
                            cudaStream_t stream);

/// Sets the radii of n points by the statistics of the film's pixels.
void launch_set_photon_radii(const EyeWave &wave, uint32_t n, cudaStream_t stream);
/// Adds what points first .. first + n - 1 gather to their sums; `grid` as PhotonStore::build returns it.
void launch_gather_points(const EyeWave &wave, const PhotonGrid &grid, const PhotonSums &sums, uint32_t first,
                          uint32_t n, cudaStream_t stream);
/// Adds a film of the same size and arrays.
void launch_add_film(const FilmView &to, const FilmView &from, cudaStream_t stream);
/// Adds n paths to the film.
void launch_add_photon_samples(const EyeWave &wave, const PhotonSums &sums, uint32_t n, cudaStream_t stream);

#if defined(__CUDACC__)
/// The slot of the pass that path i belongs to.
__device__ __forceinline__ uint32_t slot_of(const EyeWave &wave, uint32_t i)
{
  const PathUnit &unit = wave.pixels.unit;
  const uint64_t num_pixels = uint64_t(unit.x1 - unit.x0) * (unit.y1 - unit.y0);
  // Mostly the path is one of the first sample, and nothing need be divided.
  const uint64_t k = unit.first_path + i;
  return wave.first_slot + (k < num_pixels ? 0u : uint32_t(k / num_pixels));
}
#endif

}  // namespace gpurt::cuda
