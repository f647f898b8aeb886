#include "cuda/path/count_rays.h"

#include "cuda/launch.h"

namespace gpurt::cuda {
namespace {

// Notes what a vertex makes.
struct CountingSink {
  uint32_t *num_shadows, *num_next;
  __device__ void shadow(const Ray &, Vec3f, uint32_t) const { *num_shadows = 1; }
  __device__ void next(const Ray &) const { *num_next = 1; }
};

// Puts it where there is room for exactly that.
struct PlacingSink {
  const PathWave &wave;
  uint32_t path_index;
  const uint32_t *shadow_place, *next_place;

  __device__ void shadow(const Ray &ray, Vec3f contribution, uint32_t) const
  {
    const uint32_t k = *shadow_place;
    wave.shadow_queue.rays[k] = ray;
    wave.shadow_queue.paths[k] = path_index;
    wave.shadow_queue.contributions[k] = contribution;
  }
  __device__ void next(const Ray &ray) const
  {
    const uint32_t k = *next_place;
    wave.next_rays.rays[k] = ray;
    wave.next_rays.paths[k] = path_index;
  }
};

__global__ void __launch_bounds__(block_size)
    count_rays_kernel(const __grid_constant__ ShadePathVertex stage, uint32_t begin, uint32_t end,
                      uint32_t *shadow_flags, uint32_t *next_flags)
{
  const uint64_t k = thread_item();
  if (k >= end - begin) return;
  const uint32_t i = begin + uint32_t(k);
  uint32_t num_shadows = 0, num_next = 0;
  stage.shade(i, stage.wave.rays.paths[i], CountingSink{&num_shadows, &num_next});
  shadow_flags[k] = num_shadows;
  next_flags[k] = num_next;
}

__global__ void __launch_bounds__(block_size)
    make_rays_kernel(const __grid_constant__ ShadePathVertex stage, uint32_t begin, uint32_t end,
                     const uint32_t *shadow_places, const uint32_t *next_places)
{
  const uint64_t k = thread_item();
  if (k >= end - begin) return;
  const uint32_t i = begin + uint32_t(k), path_index = stage.wave.rays.paths[i];
  stage.wave.paths[path_index] =
      stage.shade(i, path_index, PlacingSink{stage.wave, path_index, shadow_places + k, next_places + k});
}

}  // namespace

void launch_count_rays(const ShadePathVertex &stage, uint32_t begin, uint32_t end, uint32_t *shadow_flags,
                       uint32_t *next_flags, cudaStream_t stream)
{
  launch("kernel that counts the rays of materials and lights", count_rays_kernel, end - begin, stream, stage,
         begin, end, shadow_flags, next_flags);
}

void launch_make_rays(const ShadePathVertex &stage, uint32_t begin, uint32_t end,
                      const uint32_t *shadow_places, const uint32_t *next_places, cudaStream_t stream)
{
  launch("kernel that makes the counted rays", make_rays_kernel, end - begin, stream, stage, begin, end,
         shadow_places, next_places);
}

}  // namespace gpurt::cuda
