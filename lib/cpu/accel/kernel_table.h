// Ray queries over either tree of the CPU, for one combination of triangle test, alpha masks and shared geometries.
#pragma once

#include "core/accel/ray.h"

namespace gpurt {

struct CpuAccel;

struct TraceKernels {
  void (*closest)(const CpuAccel &accel, const Ray *rays, Hit *hits, uint32_t n);
  void (*occluded)(const CpuAccel &accel, const Ray *rays, uint8_t *occluded, uint32_t n);
  /// Calls sink(user, hit) for every crossing, unsorted; a triangle may come several times.
  void (*all)(const CpuAccel &accel, const Ray &ray, void *user, void (*sink)(void *user, const Hit &hit));
};

}  // namespace gpurt
