// Light that glass absorbs on its way: Beer and Lambert's law along every segment of a path within a closed solid.
//
// Solids stand in air. A medium is named by 1 + the index of its glass's material; 0 is air, where paths start. Which one a
// segment lies in follows from the surface that it left, and where it ends on glass from within, from that glass.
#pragma once

#include "core/math/functions.h"
#include "core/scene/surface.h"

namespace gpurt {

constexpr uint32_t medium_air = 0;

GPURT_FUNCTIONS_BEGIN

// The share of light that is left. Where nothing is absorbed any distance leaves all, and where nothing is left any distance
// above 0 leaves nothing.
GPURT_INLINE Vec3f transmittance(const SceneView &scene, uint32_t medium, float distance)
{
  if (medium == medium_air) return vec3(1.0f);
  const Vec3f depth = scene.materials[medium - 1].absorption * distance;
  // Not above 0 is 0 times infinity, too.
  const auto left = [](float x) { return x > 0.0f ? exp_of_negative(-x) : 1.0f; };
  return {left(depth.x), left(depth.y), left(depth.z)};
}

GPURT_INLINE bool is_behind(const SurfaceHit &surface, Vec3f wo_world)
{
  return dot(surface.geometric_normal, wo_world) < 0.0f;
}

// The medium of a segment that was thought to lie in `medium` and ended at the surface.
GPURT_INLINE uint32_t medium_before(uint32_t medium, const SurfaceHit &surface, const Material &material,
                                    Vec3f wo_world)
{
  if (material.type != MaterialType::Glass) return medium;
  // A solid's inside is known by its surface; what is in front of it is not its own.
  return is_behind(surface, wo_world) ? surface.material + 1 : medium;
}

// The medium of a segment that leaves the surface along wi, where one came in `medium`.
GPURT_INLINE uint32_t medium_after(uint32_t medium, const SurfaceHit &surface, const Material &material,
                                   Vec3f wi)
{
  if (material.type != MaterialType::Glass) return medium;
  if (is_behind(surface, wi)) return surface.material + 1;
  return medium == surface.material + 1 ? medium_air : medium;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
