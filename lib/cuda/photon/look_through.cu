// Looks through points: their bounds, and the first ones that are not allowed; packs them by the way. And through a table: how full it is.
#include "cuda/launch.h"
#include "cuda/photon/kernels.h"
#include "cuda/warp_reduce.h"

namespace gpurt::cuda {
namespace {

constexpr unsigned num_blocks = 1024;
// Points are read from memory, not from a cache: more threads wait for it.
constexpr unsigned num_point_blocks = 4096;

__device__ bool is_flux(Vec3f f)
{
  return f.x >= 0.0f && f.y >= 0.0f && f.z >= 0.0f && max_component(f) <= max_photon_flux;
}

__global__ void __launch_bounds__(block_size)
    look_through_kernel(const __grid_constant__ PhotonSource source, DevicePointsFound *found, Photon *packed)
{
  Box bounds = empty_box();
  uint32_t bad_position = invalid_id, bad_flux = invalid_id, bad_normal = invalid_id;
  for (uint64_t i = thread_item(); i < source.num_photons; i += uint64_t(gridDim.x) * block_size) {
    const Vec3f p = source_position(source, i);
    if (is_finite(p)) bounds = extend(bounds, p);
    else bad_position = min(bad_position, uint32_t(i));
    if (source.fluxes != nullptr && !is_flux(source.fluxes[i])) bad_flux = min(bad_flux, uint32_t(i));
    if (source.normals != nullptr && !is_finite(source.normals[i])) bad_normal = min(bad_normal, uint32_t(i));
    if (packed != nullptr) {
      const Photon p = source_record(source, i);
      float4 *to = reinterpret_cast<float4 *>(packed + i);
      to[0] = {p.position.x, p.position.y, p.position.z, __uint_as_float(p.flux)};
      to[1] = {__uint_as_float(p.direction), __uint_as_float(p.normal), __uint_as_float(p.id), 0.0f};
    }
  }
  extend_bounds(&found->bounds, bounds);
  if (bad_position != invalid_id) atomicMin(&found->bad_position, bad_position);
  if (bad_flux != invalid_id) atomicMin(&found->bad_flux, bad_flux);
  if (bad_normal != invalid_id) atomicMin(&found->bad_normal, bad_normal);
}

__global__ void __launch_bounds__(block_size)
    fill_kernel(const uint32_t *starts, uint32_t table_size, DeviceFill *fill)
{
  unsigned long long sum = 0;
  uint32_t fullest = 0;
  for (uint64_t i = thread_item(); i < table_size; i += uint64_t(gridDim.x) * block_size) {
    const uint32_t n = starts[i + 1] - starts[i];
    sum += uint64_t(n) * n;
    fullest = max(fullest, n);
  }
  for (int step = 16; step != 0; step /= 2) sum += __shfl_xor_sync(~0u, sum, step);
  fullest = warp_max(fullest);
  if (threadIdx.x % 32 == 0) {
    atomicAdd(&fill->sum_of_squares, sum);
    atomicMax(&fill->fullest, fullest);
  }
}

}  // namespace

void launch_look_through(const PhotonSource &source, DevicePointsFound *found, Photon *packed,
                         cudaStream_t stream)
{
  check(cudaMemsetAsync(&found->bounds, 0, sizeof found->bounds, stream), "cudaMemsetAsync");
  // Three times invalid_id.
  check(cudaMemsetAsync(&found->bad_position, 0xff, 3 * sizeof(uint32_t), stream), "cudaMemsetAsync");
  if (source.num_photons == 0) return;
  launch_blocks("kernel that looks through points", look_through_kernel, num_point_blocks, block_size, stream,
                source, found, packed);
}

void launch_fill(const uint32_t *starts, uint32_t table_size, DeviceFill *fill, cudaStream_t stream)
{
  check(cudaMemsetAsync(fill, 0, sizeof *fill, stream), "cudaMemsetAsync");
  launch_blocks("kernel that looks through a grid", fill_kernel, num_blocks, block_size, stream, starts,
                table_size, fill);
}

}  // namespace gpurt::cuda
