// Stage 'map': what samples see, as the hits of path tracing's eye rays.
#include "core/reyes/map.h"
#include "cuda/launch.h"
#include "cuda/reyes/stages.h"

namespace gpurt::cuda {
namespace {

__global__ void __launch_bounds__(block_size)
    mark_visible(const unsigned long long *keys, uint32_t n, uint32_t *visible)
{
  const uint64_t i = thread_item();
  if (i >= n || keys[i] == 0) return;
  const uint32_t root = ~uint32_t(keys[i]), bit = 1u << root % 32;
  // Most samples find it done.
  if ((*const_cast<volatile uint32_t *>(visible + root / 32) & bit) == 0) atomicOr(visible + root / 32, bit);
}

__global__ void __launch_bounds__(block_size)
    map_samples(const __grid_constant__ EyeHits eye, const __grid_constant__ PathWave wave, uint32_t n)
{
  const uint32_t i = uint32_t(thread_item());
  bool is_shaded = false;
  if (i < n) {
    const uint32_t slot = eye.slots[eye.unit.first_path + i];
    const unsigned long long key = eye.keys[slot];
    const uint32_t root = key != 0 ? ~uint32_t(key) : invalid_id;
    Ray ray = wave.rays.rays[i];
    if (eye.places.filter != ReyesFilter::Box) {
      const PathSample s = path_sample(eye.unit, i);
      const SampleKey sample = sample_key(eye.settings.seed, eye.settings.frame_index, s.x, s.y, s.sample);
      const FilteredPlace place =
          place_sample(eye.places.filter, eye.places.table, sample_2d(sample, dim_pixel));
      float depth_per_t;
      ray = camera_ray(eye.settings.camera, float(s.x) + place.offset.x, float(s.y) + place.offset.y,
                       depth_per_t);
      wave.rays.rays[i] = ray;
      wave.paths[i].throughput = vec3(place.weight);
    }
    is_shaded = root != invalid_id;
    wave.hits[i] =
        hit_of_sample(eye.scene, eye.settings.camera, ray, root, float_from_bits(uint32_t(key >> 32)),
                      place_from_key(is_shaded ? eye.spots[slot] : 0));
  }
  const uint32_t shaded = __ballot_sync(0xffffffffu, is_shaded);
  if (threadIdx.x % 32 == 0 && shaded != 0)
    atomicAdd(&eye.numbers->num_shaded, static_cast<unsigned long long>(__popc(shaded)));
}

}  // namespace

void launch_mark_visible(const SampleGrid &grid, uint32_t *visible, cudaStream_t stream)
{
  launch("REYES' roots that are seen", mark_visible, grid.num_samples, stream, grid.keys, grid.num_samples,
         visible);
}

void launch_eye_hits(const EyeHits &eye, const PathWave &wave, uint32_t n, cudaStream_t stream)
{
  launch("REYES stage 'map'", map_samples, n, stream, eye, wave, n);
}

}  // namespace gpurt::cuda
