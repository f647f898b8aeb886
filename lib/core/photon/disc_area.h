// How much of a gather's disc lies on a surface: rays from above the visible point to points of the disc.
//
// Where a surface ends, or another one stands on it, photons come from a part of the disc alone; dividing by the whole
// area makes rims and corners dark. Outer points are looked at first: where they all are on a surface, so is the disc.
// Source: Jensen 2001, Section 7.2.2 names the bias and the division by the area that is there.
// Differs: the area is measured by rays, not guessed from the photons.
#pragma once

#include "core/photon/gather_photons.h"

namespace gpurt {

constexpr uint32_t disc_probes = 16;
constexpr uint32_t first_disc_probes = 4;  // the outermost

GPURT_FUNCTIONS_BEGIN

// Point k of a disc of radius 1, outermost first: a spiral of equal areas, turned by a number of the path's own.
// Source: Vogel 1979.
GPURT_INLINE Vec2f disc_point(SampleKey key, uint32_t k)
{
  const float radius = sqrt((float(disc_probes - k) - 0.5f) * (1.0f / float(disc_probes)));
  const float turn =
      float(k) * 0.38196601f + unit_float(uint32_t(mix_bits(key.seed ^ key.reversed_index) >> 32));
  float s, c;
  sincos_turns(turn, s, c);
  return {radius * c, radius * s};
}

// The kernel's weight there.
GPURT_INLINE float disc_weight(PhotonKernel kernel, uint32_t k)
{
  return kernel_weight(kernel, (float(disc_probes - k) - 0.5f) * (1.0f / float(disc_probes)), 1.0f);
}

GPURT_INLINE float sum_disc_weights(PhotonKernel kernel, uint32_t num)
{
  float sum = 0.0f;
  for (uint32_t k = 0; k < num; ++k) sum += disc_weight(kernel, k);
  return sum;
}

// Aims probe k of every visible point whose disc may end within the radius; into the slots of next rays.
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
    if (point.depth == 0 || point.clearance > pass.radius) return;
    if (k == 0) point.area = 0.0f;
    if (k == first_disc_probes && point.area == sum_disc_weights(pass.kernel, first_disc_probes)) {
      point.clearance = infinity;  // the disc is whole
      return;
    }
    Vec3f s, t;
    make_frame(point.geometric_normal, s, t);
    const Vec2f q = disc_point(wave.paths[i].key, k);
    const Vec3f offset = (s * q.x + t * q.y) * pass.radius;
    // From half a radius above the point to a little below the disc.
    const Vec3f above = point.geometric_normal * (0.5f * pass.radius);
    const Vec3f down = offset - above;
    wave.next_rays.rays[i] = {point.position + above, 0.0f, down, 1.5f};
  }
};

// Counts the probes that met the disc's own surface.
struct CountDiscProbe {
  SceneView scene;
  PathWave wave;
  VisiblePoint *points;
  PhotonPass pass;
  uint32_t k;

  GPURT_HD void operator()(uint32_t i) const
  {
    const Hit hit = wave.hits[i];
    if (hit.triangle == invalid_id) return;
    VisiblePoint &point = points[wave.rays.paths[i]];
    const SurfaceHit surface = surface_at(scene, hit);
    const Vec3f to_hit = surface.position - point.position;
    if (abs(dot(to_hit, point.geometric_normal)) > gather_max_plane_distance * pass.radius) return;
    const float cosine = dot(surface.geometric_normal, point.geometric_normal);
    if (abs(cosine) < gather_min_cosine) return;
    point.area += disc_weight(pass.kernel, k);
  }
};

// Puts the share for the sum of weights. The point itself lies on a surface and counts for half a probe, so that no share
// is 0.
struct FinishDiscArea {
  VisiblePoint *points;
  PhotonPass pass;

  GPURT_HD void operator()(uint32_t i) const
  {
    VisiblePoint &point = points[i];
    if (point.depth == 0) return;
    const float all = sum_disc_weights(pass.kernel, disc_probes);
    point.area = point.clearance > pass.radius ? 1.0f : (point.area + 0.5f) / (all + 0.5f);
  }
};

GPURT_FUNCTIONS_END
}  // namespace gpurt
