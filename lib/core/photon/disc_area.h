// How much of a gather's disc lies on a surface: rays from above the visible point to random points of the disc.
//
// Where a surface ends, or another one stands on it, photons come from a part A of the disc alone, and dividing by the
// whole area makes rims and corners dark. What is needed is 1 / A, and the number of random points that are tried until
// one lies on the surface has just that expectation: an estimate without bias, for one ray where the disc is whole.
// Source: Jensen 2001 for the bias; Booth 2007 for reciprocals of probabilities by counting trials.
#pragma once

#include "core/photon/gather_photons.h"

namespace gpurt {

// Trials at most. The point itself lies on a surface, so that A is 1/8 in the corner of a box's edge or more: this many
// trials then miss once in 5000.
constexpr uint32_t max_disc_trials = 64;
// Pairs of sample dimensions beyond those of any path: two for each trial.
constexpr uint32_t dim_disc = 0x40000000u;

GPURT_FUNCTIONS_BEGIN

// Point k of a disc of radius 1, distributed as the kernel weighs it.
GPURT_INLINE Vec2f disc_point(SampleKey key, PhotonKernel kernel, uint32_t k)
{
  const Vec2f u = sample_2d(key, dim_disc + 2 * k);
  float radius;
  if (kernel == PhotonKernel::Cone) {
    // The density of distances is that of the median of three uniform numbers, 6 x (1 - x).
    const Vec2f v = sample_2d(key, dim_disc + 2 * k + 1);
    radius = max(min(u.x, v.x), min(max(u.x, v.x), v.y));
  } else {
    radius = sqrt(u.x);
  }
  float s, c;
  sincos_turns(u.y, s, c);
  return {radius * c, radius * s};
}

// Whether the point's disc is not known to lie on a surface.
GPURT_INLINE bool wants_disc_trials(const PhotonPass &pass, const VisiblePoint &point)
{
  return point.depth != 0 && !(point.clearance > gather_radius(pass, point));
}

// The ray of trial k, from half a radius above the point to a little below the disc: what stands between hides it.
GPURT_INLINE Ray disc_probe(const PhotonPass &pass, SampleKey key, const VisiblePoint &point, uint32_t k)
{
  Vec3f s, t;
  make_frame(point.geometric_normal, s, t);
  const Vec2f q = disc_point(key, pass.kernel, k);
  const float radius = gather_radius(pass, point);
  const Vec3f offset = (s * q.x + t * q.y) * radius;
  const Vec3f above = point.geometric_normal * (0.5f * radius);
  return {point.position + above, 0.0f, offset - above, 1.5f};
}

// What trial k adds to VisiblePoint::missed if it meets none.
GPURT_INLINE int32_t missed_blur(SampleKey key, PhotonKernel kernel, uint32_t k)
{
  const Vec2f q = disc_point(key, kernel, k);
  return int32_t(blur_weight(kernel, q.x * q.x + q.y * q.y, 1.0f) * 0x1p20f);
}

// Whether a probe met a surface that the gather takes photons from.
GPURT_INLINE bool lies_on_surface(const SceneView &scene, const PhotonPass &pass, const VisiblePoint &point,
                                  const Hit &hit)
{
  if (hit.triangle == invalid_id) return false;
  const SurfaceHit surface = surface_at(scene, hit);
  const float distance = abs(dot(surface.position - point.position, point.geometric_normal));
  if (distance > gather_max_plane_distance * gather_radius(pass, point)) return false;
  const float cosine = abs(dot(surface.geometric_normal, point.geometric_normal));
  return !(pass.remedies & remedy_normal && cosine < gather_min_cosine);
}

// Aims trial k of every visible point whose disc is not known to lie on a surface; into the slots of next rays.
struct AimDiscProbe {
  PathWave wave;
  VisiblePoint *points;
  PhotonPass pass;
  uint32_t k;

  GPURT_HD void operator()(uint32_t i) const
  {
    wave.next_rays.rays[i].tmax = -1.0f;
    wave.next_rays.paths[i] = i;
    VisiblePoint &point = points[i];
    if (!wants_disc_trials(pass, point)) return;
    wave.next_rays.rays[i] = disc_probe(pass, wave.paths[i].key, point, k);
    point.inverse_area = float(k + 1);
  }
};

// Ends the trials of points whose probe met such a surface.
struct EndDiscTrials {
  SceneView scene;
  PathWave wave;
  VisiblePoint *points;
  PhotonPass pass;
  uint32_t k;

  GPURT_HD void operator()(uint32_t i) const
  {
    const uint32_t path = wave.rays.paths[i];
    VisiblePoint &point = points[path];
    if (lies_on_surface(scene, pass, point, wave.hits[i])) point.clearance = infinity;
    else point.missed += missed_blur(wave.paths[path].key, pass.kernel, k);
  }
};

GPURT_FUNCTIONS_END
}  // namespace gpurt
