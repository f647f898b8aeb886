// Visible points that other surfaces are near: whether anything stands on the disc of the gather.
//
// Where a wall stands on a floor, photons of the floor behind it lie within the radius, in the same plane, with the same
// normal: nothing that a photon keeps tells them from those in front. Such a point does not gather: its path goes on as path
// tracing's does, by the ray that every gathering vertex sends out to meet lamps, and gathers at a later vertex. Whether it
// does depends on the surfaces alone, and either way all light is counted once: direct light by next-event estimation here,
// the rest by photons here or by what the next vertices find.
// Source: Jensen 2001, who goes on where a final gather's ray is short. Differs: it is the disc that decides, not the ray.
#pragma once

#include "core/photon/gather_photons.h"

namespace gpurt {

// Rays from a point to the rim of a polygon around the disc, evenly turned: a long wall that comes nearer than the radius
// meets one of them.
constexpr uint32_t num_near_rays = 8;
constexpr float near_ray_length = 1.0824f;  // 1 / cos(pi / 8)
// Height of these rays over the tangent plane, in radii: what is lower, and the surface's own curve, does not count.
constexpr float near_ray_height = 0.05f;
// Pairs of sample dimensions beyond those of paths and discs: one for each vertex.
constexpr uint32_t dim_near = 0x50000000u;

GPURT_FUNCTIONS_BEGIN

// Whether the point is where the path gathers at `depth`.
GPURT_INLINE bool gathers_at(const VisiblePoint &point, uint32_t depth) { return point.depth == depth; }

GPURT_INLINE Ray near_ray(const PhotonPass &pass, SampleKey key, const VisiblePoint &point, uint32_t k)
{
  Vec3f s, t;
  make_frame(point.geometric_normal, s, t);
  float sine, cosine;
  const float turn = (float(k) + sample_2d(key, dim_near + point.depth).x) * (1.0f / num_near_rays);
  sincos_turns(turn, sine, cosine);
  // Where pixels have radii of their own, they are not larger.
  const Vec3f along = (s * cosine + t * sine) * (near_ray_length * pass.radius);
  return {point.position + point.geometric_normal * (near_ray_height * pass.radius), 0.0f, along, 1.0f};
}

// The path of a point that something is near goes on.
GPURT_INLINE void pass_by(PathState &path, VisiblePoint &point)
{
  path.covered &= ~path_gathers;
  point.depth = 0;
}

// Aims ray k of every path that gathers at `depth`, into the slots of shadow rays.
struct AimNearRay {
  PathWave wave;
  const VisiblePoint *points;
  PhotonPass pass;
  uint32_t depth, k;

  GPURT_HD void operator()(uint32_t i) const
  {
    const uint32_t path = wave.rays.paths[i];
    wave.shadows.rays[i].tmax = -1.0f;
    wave.shadows.paths[i] = path;
    if (gathers_at(points[path], depth))
      wave.shadows.rays[i] = near_ray(pass, wave.paths[path].key, points[path], k);
  }
};

struct PassNearPoint {
  PathWave wave;
  VisiblePoint *points;

  GPURT_HD void operator()(uint32_t i) const
  {
    const uint32_t path = wave.shadow_queue.paths[i];
    if (wave.occluded[i]) pass_by(wave.paths[path], points[path]);
  }
};

GPURT_FUNCTIONS_END
}  // namespace gpurt
