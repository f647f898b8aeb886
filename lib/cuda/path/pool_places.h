// How a kernel puts what its threads make into queues without gaps, and what it knows of rays that leave a triangle. Only .cu
// files include this.
#pragma once

#include "core/accel/meets_triangle.h"
#include "cuda/launch.h"

namespace gpurt::cuda {

constexpr unsigned warp_size = 32;
constexpr unsigned num_warps = block_size / warp_size;

// A ray that leaves a triangle and cannot meet it again need not test it, which single precision could not decide.
static __device__ __noinline__ uint32_t leave_out(const SceneView &scene, const Ray &ray, uint32_t triangle)
{
  return meets_triangle(scene, ray, triangle) ? invalid_id : triangle;
}

__device__ __forceinline__ void store_ray(Ray *to, const Ray &ray)
{
  float4 *p = reinterpret_cast<float4 *>(to);
  p[0] = make_float4(ray.origin.x, ray.origin.y, ray.origin.z, ray.tmin);
  p[1] = make_float4(ray.direction.x, ray.direction.y, ray.direction.z, ray.tmax);
}

// The rays that a hit makes, till it is known where they go.
struct MadeRays {
  Ray next, shadow;
  Vec3f contribution;
  uint32_t target;
  bool has_next, has_shadow;
};

struct MadeRaysSink {
  MadeRays &made;
  __device__ void next(const Ray &ray) const
  {
    made.next = ray;
    made.has_next = true;
  }
  __device__ void shadow(const Ray &ray, Vec3f contribution, uint32_t target) const
  {
    made.shadow = ray;
    made.contribution = contribution;
    made.target = target;
    made.has_shadow = true;
  }
};

// Where this thread's item goes in a queue of `number` items so far: one atomic addition a block. In which order blocks
// come changes no result.
__device__ __forceinline__ uint32_t take_place(bool has_item, uint32_t *number,
                                               uint32_t (&shared)[num_warps + 1])
{
  const unsigned lane = threadIdx.x % warp_size, warp = threadIdx.x / warp_size;
  const unsigned votes = __ballot_sync(~0u, has_item);
  if (lane == 0) shared[warp] = __popc(votes);
  __syncthreads();
  if (threadIdx.x == 0) {
    uint32_t sum = 0;
    for (unsigned w = 0; w < num_warps; ++w) {
      const uint32_t count = shared[w];
      shared[w] = sum;
      sum += count;
    }
    shared[num_warps] = sum != 0 ? atomicAdd(number, sum) : 0;
  }
  __syncthreads();
  return shared[num_warps] + shared[warp] + __popc(votes & ((1u << lane) - 1u));
}

}  // namespace gpurt::cuda
