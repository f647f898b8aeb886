// The steps of eye paths to their visible points.
#include "cuda/launch.h"
#include "cuda/path/pool_places.h"
#include "cuda/photon/eye_paths.h"

namespace gpurt::cuda {
namespace {

__device__ PathSample eye_sample(const EyeWave &wave, uint32_t i)
{
  const uint32_t n = wave.pixels.points_per_axis;
  if (n == 0) return path_sample(wave.pixels.unit, i);
  const Camera &camera = wave.settings.camera;
  const uint64_t x = 2 * uint64_t(i % n) + 1, y = 2 * uint64_t(i / n) + 1;
  return {uint32_t(x * camera.width / (2 * n)), uint32_t(y * camera.height / (2 * n)), 0, 0};
}

__global__ void __launch_bounds__(block_size) start_kernel(const __grid_constant__ EyeWave wave, uint32_t n)
{
  const uint64_t i = thread_item();
  if (i >= n) return;
  const PathSample s = eye_sample(wave, uint32_t(i));
  const SampleKey key = sample_key(wave.settings.seed, wave.settings.frame_index, s.x, s.y, s.sample);
  const Vec2f u = sample_2d(key, dim_pixel);
  float depth_per_t;
  store_ray(wave.queues[0].rays + i,
            camera_ray(wave.settings.camera, float(s.x) + u.x, float(s.y) + u.y, depth_per_t));
  wave.queues[0].paths[i] = uint32_t(i);
  wave.states[i] = {vec3(1.0f), 0.0f, vec3(0.0f), vec3(0.0f), vec3(0.0f), key, 0, medium_air};
}

template <bool MayAbsorb>
__global__ void __launch_bounds__(block_size)
    shade_kernel(const __grid_constant__ EyeWave wave, int from, uint32_t depth, uint32_t n)
{
  __shared__ uint32_t next_places[num_warps + 1], shadow_places[num_warps + 1];
  const uint64_t i = thread_item();
  MadeRays made;
  made.has_next = made.has_shadow = false;
  uint32_t path = 0, triangle = invalid_id;
  if (i < n) {
    const Ray ray = wave.queues[from].rays[i];
    const Hit hit = wave.hits[i];
    path = wave.queues[from].paths[i];
    triangle = hit.triangle;
    if (depth == 1 && (wave.film.features != nullptr || wave.film.first_hits != nullptr)) {
      const PathSample sample = eye_sample(wave, path);
      EyeFeatures{wave.scene, wave.settings, wave.film}(
          sample.sample, sample.local, ray, hit, [](int64_t &sum, int64_t term) {
            // Sums of integers: any order gives the same bits.
            atomicAdd(reinterpret_cast<unsigned long long *>(&sum), static_cast<unsigned long long>(term));
          });
    }
    PathState state = wave.states[path];
    BasicEyeVertex<MayAbsorb>{wave.scene, wave.settings, depth}.shade(ray, hit, state, wave.points[path],
                                                                      MadeRaysSink{made});
    wave.states[path] = state;
  }
  const uint32_t next_place = take_place(made.has_next, &wave.numbers->next, next_places);
  if (made.has_next) {
    const EyeQueue &to = wave.queues[1 - from];
    store_ray(to.rays + next_place, made.next);
    to.paths[next_place] = path;
    to.left_out[next_place] = wave.leaves_out ? leave_out(wave.scene, made.next, triangle) : invalid_id;
  }
  const uint32_t shadow_place = take_place(made.has_shadow, &wave.numbers->shadows, shadow_places);
  if (made.has_shadow) {
    const EyeShadows &to = wave.shadows;
    store_ray(to.queue.rays + shadow_place, made.shadow);
    to.queue.paths[shadow_place] = path;
    to.queue.contributions[shadow_place] = made.contribution;
    if (wave.leaves_out) {
      to.left_out[shadow_place] = leave_out(wave.scene, made.shadow, triangle);
      to.ended_at[shadow_place] =
          made.target != invalid_id ? leave_out(wave.scene, made.shadow, made.target) : invalid_id;
    }
  }
}

// A path has no more than one shadow ray a step.
__global__ void __launch_bounds__(block_size)
    add_direct_light_kernel(const __grid_constant__ EyeShadows shadows, PathState *states, uint32_t n)
{
  const uint64_t i = thread_item();
  if (i < n && !shadows.occluded[i])
    states[shadows.queue.paths[i]].radiance += shadows.queue.contributions[i];
}

}  // namespace

void launch_start_eye_paths(const EyeWave &wave, uint32_t n, cudaStream_t stream)
{
  launch("kernel that starts eye paths", start_kernel, n, stream, wave, n);
}

void launch_shade_eye_paths(const EyeWave &wave, int from, uint32_t depth, uint32_t n, cudaStream_t stream)
{
  launch("kernel that shades eye paths", wave.scene.has_absorption ? shade_kernel<true> : shade_kernel<false>,
         n, stream, wave, from, depth, n);
}

void launch_add_direct_light(const EyeWave &wave, uint32_t n, cudaStream_t stream)
{
  launch("kernel that adds direct light to eye paths", add_direct_light_kernel, n, stream, wave.shadows,
         wave.states, n);
}

}  // namespace gpurt::cuda
