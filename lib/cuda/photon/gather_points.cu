// What visible points gather, and how it is added to the film. Sums are of integers: lanes and maps may share them out.
#include "cuda/launch.h"
#include "cuda/path/pool_places.h"
#include "cuda/photon/eye_paths.h"
#include "cuda/warp_reduce.h"

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

template <bool HasBlur>
__global__ void __launch_bounds__(block_size)
    gather_kernel(const __grid_constant__ EyeWave wave, const __grid_constant__ PhotonGrid grid,
                  PhotonSums sums, uint32_t first, uint32_t n)
{
  const uint64_t i = first + thread_item() / lanes_per_point;
  PhotonSum sum;
  PhotonBlur blur;
  clear(sum);
  clear(blur);
  const bool gathers = i < uint64_t(first) + n && wave.points[i].depth != 0;
  if (gathers) {
    const uint32_t slot = slot_of(wave, uint32_t(i));
    PhotonGrid own = grid;
    own.starts += uint64_t(slot) * grid.shape.table_size;
    gather_photons<lanes_per_point, HasBlur>(own, wave.passes[slot], wave.settings.max_depth, wave.points[i],
                                             sum, blur, threadIdx.x % lanes_per_point);
  }
  for (int64_t &flux : sum.flux) flux = join_lanes(flux);
  if (HasBlur) {
    for (int64_t &flux : blur.flux) flux = join_lanes(flux);
  }
  sum.num_photons = join_lanes(sum.num_photons);
  sum.num_overflows = join_lanes(sum.num_overflows);
  if (!gathers || threadIdx.x % lanes_per_point != 0) return;
  PhotonSum &to = sums.sums[i];
  for (int k = 0; k < 3; ++k) to.flux[k] += sum.flux[k];
  to.num_photons += sum.num_photons;
  to.num_overflows += sum.num_overflows;
  if (!HasBlur) return;
  for (int k = 0; k < 3; ++k) sums.blurs[i].flux[k] += blur.flux[k];
}

__global__ void __launch_bounds__(block_size)
    set_radii_kernel(const __grid_constant__ EyeWave wave, uint32_t n)
{
  const uint64_t i = thread_item();
  if (i >= n || wave.points[i].depth == 0) return;
  const PathSample sample = path_sample(wave.pixels.unit, uint32_t(i));
  wave.points[i].radius =
      next_radius(wave.passes[slot_of(wave, uint32_t(i))], wave.film.statistics[sample.local]);
}

// A thread takes all of a pixel's paths, so that no two touch the same sums.
__global__ void __launch_bounds__(block_size)
    add_samples_kernel(const __grid_constant__ EyeWave wave, PhotonSums sums, uint32_t n, uint32_t num_pixels)
{
  const uint64_t i = thread_item();
  float largest = 0.0f;
  uint32_t num_visible = 0;
  unsigned long long num_gathered = 0;
  for (uint64_t k = i; i < num_pixels && k < n; k += num_pixels) {
    const PathSample sample = path_sample(wave.pixels.unit, uint32_t(k));
    const PhotonSum sum = sums.sums[k];
    const Vec3f radiance =
        add_photon_sample(wave.film, sample.local, sample.sample, wave.passes[slot_of(wave, uint32_t(k))],
                          wave.states[k], wave.points[k], sum, sums.blurs ? &sums.blurs[k] : nullptr);
    // What is not a number is not above it.
    if (max_component(radiance) > largest) largest = max_component(radiance);
    num_visible += wave.points[k].depth != 0;
    num_gathered += sum.num_photons;
  }
  // The bits of positive floats are ordered as the floats.
  const unsigned largest_of_warp = warp_max(float_bits(largest));
  num_visible = warp_sum(num_visible);
  for (int step = warp_size / 2; step != 0; step /= 2)
    num_gathered += __shfl_xor_sync(~0u, num_gathered, step);
  if (threadIdx.x % warp_size != 0) return;
  EyeNumbers &numbers = *wave.numbers;
  if (largest_of_warp > numbers.largest_bits) atomicMax(&numbers.largest_bits, largest_of_warp);
  if (num_visible != 0) atomicAdd(&numbers.num_visible, static_cast<unsigned long long>(num_visible));
  if (num_gathered != 0) atomicAdd(&numbers.num_gathered, num_gathered);
}

}  // namespace

void launch_set_photon_radii(const EyeWave &wave, uint32_t n, cudaStream_t stream)
{
  launch("kernel that sets the radii of gathers", set_radii_kernel, n, stream, wave, n);
}

void launch_gather_points(const EyeWave &wave, const PhotonGrid &grid, const PhotonSums &sums, uint32_t first,
                          uint32_t n, cudaStream_t stream)
{
  const uint64_t num_threads = uint64_t(n) * lanes_per_point;
  if (sums.blurs != nullptr) {
    launch("kernel that gathers photons and their blur at visible points", gather_kernel<true>, num_threads,
           stream, wave, grid, sums, first, n);
  } else {
    launch("kernel that gathers photons at visible points", gather_kernel<false>, num_threads, stream, wave,
           grid, sums, first, n);
  }
}

void launch_add_photon_samples(const EyeWave &wave, const PhotonSums &sums, uint32_t n, cudaStream_t stream)
{
  const uint32_t num_pixels = min(wave.film.width * wave.film.height, n);
  launch("kernel that adds photon samples to the film", add_samples_kernel, num_pixels, stream, wave, sums, n,
         num_pixels);
}

}  // namespace gpurt::cuda
