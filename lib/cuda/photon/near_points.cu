// Paths that go on past points with other surfaces near them: see core/photon/near_vertex.h.
#include "cuda/launch.h"
#include "cuda/path/pool_places.h"
#include "cuda/photon/eye_paths.h"

namespace gpurt::cuda {
namespace {

__global__ void __launch_bounds__(block_size)
    aim_kernel(const __grid_constant__ EyeWave wave, int from, uint32_t depth, uint32_t k, uint32_t n)
{
  const uint64_t i = thread_item();
  bool is_aimed = false;
  if (i < n) {
    const uint32_t path = wave.queues[from].paths[i];
    is_aimed = gathers_at(wave.points[path], depth);
    Ray ray{vec3(0.0f), 0.0f, vec3(0.0f), -1.0f};
    if (is_aimed)
      ray = near_ray(wave.passes[slot_of(wave, path)], wave.states[path].key, wave.points[path], k);
    store_ray(wave.shadows.queue.rays + i, ray);
  }
  const int num_aimed = __syncthreads_count(is_aimed);
  if (threadIdx.x == 0 && num_aimed != 0)
    atomicAdd(&wave.numbers->num_near_rays, static_cast<unsigned long long>(num_aimed));
}

__global__ void __launch_bounds__(block_size)
    pass_kernel(const __grid_constant__ EyeWave wave, int from, uint32_t depth, uint32_t n)
{
  const uint64_t i = thread_item();
  if (i >= n || !wave.shadows.occluded[i]) return;
  const uint32_t path = wave.queues[from].paths[i];
  if (gathers_at(wave.points[path], depth)) pass_by(wave.states[path], wave.points[path]);
}

}  // namespace

void launch_aim_near_rays(const EyeWave &wave, int from, uint32_t depth, uint32_t k, uint32_t n,
                          cudaStream_t stream)
{
  launch("kernel that aims rays at what is near points", aim_kernel, n, stream, wave, from, depth, k, n);
}

void launch_pass_near_points(const EyeWave &wave, int from, uint32_t depth, uint32_t n, cudaStream_t stream)
{
  launch("kernel that passes points that surfaces are near", pass_kernel, n, stream, wave, from, depth, n);
}

}  // namespace gpurt::cuda
