// Rays of a queue on the device, and what else is compacted like them: whether one is there, and how it is moved. Only .cu files
// include this.
#pragma once

#include "core/path/path_wave.h"

namespace gpurt::cuda {

__device__ __forceinline__ bool is_there(const Ray *rays, uint32_t i, uint32_t n)
{
  return i < n && !(rays[i].tmax < 0.0f);
}

__device__ __forceinline__ void copy_ray(const Ray *from, Ray *to)
{
  const float4 *p = reinterpret_cast<const float4 *>(from);
  float4 *q = reinterpret_cast<float4 *>(to);
  q[0] = p[0];
  q[1] = p[1];
}

__device__ __forceinline__ void move_item(const RayQueue &from, uint32_t i, const RayQueue &to, uint32_t k)
{
  copy_ray(from.rays + i, to.rays + k);
  to.paths[k] = from.paths[i];
}

__device__ __forceinline__ void move_item(const ShadowQueue &from, uint32_t i, const ShadowQueue &to,
                                          uint32_t k)
{
  copy_ray(from.rays + i, to.rays + k);
  to.paths[k] = from.paths[i];
  to.contributions[k] = from.contributions[i];
}

// Flags whose places are wanted, as a queue whose items are moved by writing down where to.
struct FlagQueue {
  const uint32_t *flags;
  uint32_t *places;
};

__device__ __forceinline__ bool is_there(const uint32_t *flags, uint32_t i, uint32_t n)
{
  return i < n && flags[i] != 0;
}

__device__ __forceinline__ void move_item(const FlagQueue &from, uint32_t i, const FlagQueue &, uint32_t k)
{
  from.places[i] = k;
}

}  // namespace gpurt::cuda
