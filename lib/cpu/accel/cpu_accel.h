// Ray queries of one committed scene, for the loops that are compiled once per instruction set. No library types.
#pragma once

#include "core/accel/ray.h"

namespace gpurt {

/// `impl` is what the functions trace: they are set up together, for the kd-tree or for Embree.
struct CpuAccel {
  const void *impl;
  /// The nearest hit of each ray; a miss has triangle invalid_id and the ray's tmax.
  void (*closest)(const CpuAccel &accel, const Ray *rays, Hit *hits, uint32_t n);
  /// 1 where a ray meets something in [tmin, tmax].
  void (*occluded)(const CpuAccel &accel, const Ray *rays, uint8_t *occluded, uint32_t n);
};

}  // namespace gpurt
