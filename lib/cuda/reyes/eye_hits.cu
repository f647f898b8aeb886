// Stage 'map': what samples see, as the hits of path tracing's eye rays.
#include "core/reyes/map.h"
#include "cuda/launch.h"
#include "cuda/reyes/stages.h"

namespace gpurt::cuda {
namespace {

constexpr uint32_t samples_per_warp = 256;

__global__ void __launch_bounds__(block_size)
    mark_visible(const unsigned long long *keys, uint32_t n, uint32_t *visible)
{
  // A warp takes a run of samples: neighbours mostly see the same root, and a word that all look at takes turns.
  const uint32_t lane = threadIdx.x % 32;
  const uint64_t begin = thread_item() / 32 * samples_per_warp + lane;
  uint32_t last = invalid_id;
  for (uint32_t k = 0; k < samples_per_warp; k += 32) {
    const uint64_t i = begin + k;
    const unsigned long long key = i < n ? keys[i] : 0;
    const uint32_t root = key != 0 ? ~uint32_t(key) : last;
    const uint32_t before = __shfl_up_sync(0xffffffffu, root, 1);
    if (root != last && (lane == 0 || root != before)) {
      const uint32_t bit = 1u << root % 32;
      uint32_t *word = visible + root / 32;
      if ((*const_cast<volatile uint32_t *>(word) & bit) == 0) atomicOr(word, bit);
    }
    last = root;
  }
}

__global__ void __launch_bounds__(block_size)
    map_samples(const __grid_constant__ EyeHits eye, const __grid_constant__ PathWave wave, uint32_t n)
{
  const uint32_t i = uint32_t(thread_item());
  bool is_shaded = false;
  if (i < n) {
    const PathSample s = path_sample(eye.unit, i);
    const uint64_t slot = slot_of(eye, eye.unit.first_path + i, s.local, s.sample - eye.unit.first_sample);
    const unsigned long long key = eye.keys[slot];
    const uint32_t root = key != 0 ? ~uint32_t(key) : invalid_id;
    Ray ray = wave.rays.rays[i];
    if (eye.places.filter != ReyesFilter::Box) {
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
  const uint64_t num_warps = (uint64_t(grid.num_samples) + samples_per_warp - 1) / samples_per_warp;
  launch("REYES' roots that are seen", mark_visible, num_warps * 32, stream, grid.keys, grid.num_samples,
         visible);
}

void launch_eye_hits(const EyeHits &eye, const PathWave &wave, uint32_t n, cudaStream_t stream)
{
  launch("REYES stage 'map'", map_samples, n, stream, eye, wave, n);
}

}  // namespace gpurt::cuda
