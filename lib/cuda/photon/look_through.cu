// Looks through points: their bounds, and the first ones that are not allowed; packs them by the way. And through a table: how full it is.
#include "cuda/launch.h"
#include "cuda/photon/kernels.h"
#include "cuda/warp_reduce.h"

namespace gpurt::cuda {
namespace {

constexpr unsigned num_blocks = 1024;
// Points are read from memory, not from a cache: more threads wait for it.
constexpr unsigned num_point_blocks = 4096;

// Bits that are ordered as the floats are.
__host__ __device__ uint32_t ordered_bits(float x)
{
  const uint32_t bits = float_bits(x);
  return (bits & 0x80000000u) != 0 ? ~bits : bits | 0x80000000u;
}
__host__ __device__ float from_ordered_bits(uint32_t bits)
{
  return float_from_bits((bits & 0x80000000u) != 0 ? bits & 0x7fffffffu : ~bits);
}

__device__ bool is_flux(Vec3f f)
{
  return f.x >= 0.0f && f.y >= 0.0f && f.z >= 0.0f && max_component(f) <= max_photon_flux;
}

__global__ void begin_kernel(DevicePointsFound *found)
{
  for (int k = 0; k < 3; ++k) {
    found->lo[k] = ordered_bits(infinity);
    found->hi[k] = ordered_bits(-infinity);
  }
  found->bad_position = found->bad_flux = found->bad_normal = invalid_id;
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
  for (int k = 0; k < 3; ++k) {
    const uint32_t lo = warp_min(ordered_bits(at(bounds.lo, k))),
                   hi = warp_max(ordered_bits(at(bounds.hi, k)));
    if (threadIdx.x % 32 == 0) {
      atomicMin(&found->lo[k], lo);
      atomicMax(&found->hi[k], hi);
    }
  }
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
  launch_blocks("kernel that looks through points", begin_kernel, 1, 1, stream, found);
  if (source.num_photons == 0) return;
  launch_blocks("kernel that looks through points", look_through_kernel, num_point_blocks, block_size, stream,
                source, found, packed);
}

Box bounds_of(const DevicePointsFound &found)
{
  const auto vector = [](const uint32_t(&bits)[3]) {
    return Vec3f{from_ordered_bits(bits[0]), from_ordered_bits(bits[1]), from_ordered_bits(bits[2])};
  };
  return {vector(found.lo), vector(found.hi)};
}

void launch_fill(const uint32_t *starts, uint32_t table_size, DeviceFill *fill, cudaStream_t stream)
{
  check(cudaMemsetAsync(fill, 0, sizeof *fill, stream), "cudaMemsetAsync");
  launch_blocks("kernel that looks through a grid", fill_kernel, num_blocks, block_size, stream, starts,
                table_size, fill);
}

}  // namespace gpurt::cuda
