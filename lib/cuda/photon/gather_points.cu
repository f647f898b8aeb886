// What visible points gather, and how it is added to the film. Sums are of integers: lanes and maps may share them out.
#include "cuda/launch.h"
#include "cuda/path/pool_places.h"
#include "cuda/photon/eye_paths.h"

namespace gpurt::cuda {
namespace {

// Lanes of a point have the loads of a row's photons in flight at once.
constexpr unsigned lanes_per_point = 4;

__device__ __forceinline__ int64_t join_lanes(int64_t x)
{
  x += __shfl_xor_sync(~0u, x, 1);
  return x + __shfl_xor_sync(~0u, x, 2);
}
__device__ __forceinline__ uint32_t join_lanes(uint32_t x)
{
  x += __shfl_xor_sync(~0u, x, 1);
  return x + __shfl_xor_sync(~0u, x, 2);
}

__global__ void __launch_bounds__(block_size)
    gather_kernel(const __grid_constant__ PhotonGrid grid, const __grid_constant__ PhotonPass pass,
                  uint32_t max_depth, const VisiblePoint *points, PhotonSum *sums, uint32_t n)
{
  const uint64_t i = thread_item() / lanes_per_point;
  PhotonSum sum;
  clear(sum);
  const bool gathers = i < n && points[i].depth != 0;
  if (gathers) {
    gather_photons<lanes_per_point>(grid, pass, max_depth, points[i], sum, threadIdx.x % lanes_per_point);
  }
  for (int64_t &flux : sum.flux) flux = join_lanes(flux);
  sum.num_photons = join_lanes(sum.num_photons);
  sum.num_overflows = join_lanes(sum.num_overflows);
  if (!gathers || threadIdx.x % lanes_per_point != 0) return;
  PhotonSum &to = sums[i];
  for (int k = 0; k < 3; ++k) to.flux[k] += sum.flux[k];
  to.num_photons += sum.num_photons;
  to.num_overflows += sum.num_overflows;
}

__global__ void __launch_bounds__(block_size)
    add_samples_kernel(const __grid_constant__ EyeWave wave, const __grid_constant__ PhotonPass pass,
                       const PhotonSum *sums, uint32_t n)
{
  const uint64_t i = thread_item();
  float largest = 0.0f;
  uint32_t is_visible = 0, num_photons = 0;
  if (i < n) {
    const PathSample sample = path_sample(wave.pixels.unit, uint32_t(i));
    const PathState &path = wave.states[i];
    const PhotonSum sum = sums[i];
    const Vec3f radiance = sample_radiance(pass, path, wave.points[i], sum);
    add_sample(wave.film.pixels[sample.local], sample.sample, radiance, path.covered != 0);
    // What is not a number is not above it.
    if (max_component(radiance) > largest) largest = max_component(radiance);
    is_visible = wave.points[i].depth != 0;
    num_photons = sum.num_photons;
  }
  // The bits of positive floats are ordered as the floats.
  const unsigned largest_of_warp = __reduce_max_sync(~0u, float_bits(largest));
  const unsigned num_visible = __reduce_add_sync(~0u, is_visible);
  // In two halves, since the sum of 32 numbers may not fit into 32 bits.
  const unsigned low = __reduce_add_sync(~0u, num_photons & 0xffffu);
  const unsigned high = __reduce_add_sync(~0u, num_photons >> 16);
  if (threadIdx.x % warp_size != 0) return;
  EyeNumbers &numbers = *wave.numbers;
  if (largest_of_warp > numbers.largest_bits) atomicMax(&numbers.largest_bits, largest_of_warp);
  if (num_visible != 0) atomicAdd(&numbers.num_visible, static_cast<unsigned long long>(num_visible));
  const unsigned long long num_gathered = (static_cast<unsigned long long>(high) << 16) + low;
  if (num_gathered != 0) atomicAdd(&numbers.num_gathered, num_gathered);
}

}  // namespace

void launch_gather_points(const PhotonGrid &grid, const PhotonPass &pass, uint32_t max_depth,
                          const VisiblePoint *points, PhotonSum *sums, uint32_t n, cudaStream_t stream)
{
  launch("kernel that gathers photons at visible points", gather_kernel, uint64_t(n) * lanes_per_point,
         stream, grid, pass, max_depth, points, sums, n);
}

void launch_add_photon_samples(const EyeWave &wave, const PhotonPass &pass, const PhotonSum *sums, uint32_t n,
                               cudaStream_t stream)
{
  launch("kernel that adds photon samples to the film", add_samples_kernel, n, stream, wave, pass, sums, n);
}

}  // namespace gpurt::cuda
