// Gathers within a radius: a thread a query; where normals are tested, four lanes, which share the photons of a row.
//
// Four lanes have the loads of a row's photons in flight at once, which pays where a photon that is near enough costs a
// second load. The parts of a sum are those that a single thread makes (map_query.h): the bits are those of the CPU.
#include "cuda/launch.h"
#include "cuda/photon/kernels.h"

namespace gpurt::cuda {
namespace {

template <bool Normals>
constexpr unsigned lanes_of = Normals ? num_flux_parts : 1;

// Calls visit(i, d2, probe) for what this lane's part of the query counts.
template <bool Normals, class Visit>
__device__ void gather_part(const PhotonGrid &grid, const DeviceGather &gather, uint32_t query, unsigned part,
                            Visit &&visit)
{
  const Vec3f p = gather.positions[query];
  const uint32_t normal = Normals ? encode_any_normal(gather.normals[query]) : 0u;
  const float radius2 = gather.range.radius * gather.range.radius;
  for_each_range(grid, p, gather.range.radius, [&](uint32_t begin, uint32_t end) {
    for (uint32_t i = begin + (part - begin) % lanes_of<Normals>; i < end; i += lanes_of<Normals>) {
      const PhotonProbe probe = load_probe(grid, i);
      const float d2 = length2(probe.position - p);
      if (!(d2 < radius2)) continue;
      if (Normals && normal_dot(normal, load_rest(grid, i).normal) <= gather.range.min_dot) continue;
      visit(i, d2, probe);
    }
  });
}

// What the lanes of a query have found together, for its first lane.
__device__ uint32_t join_lanes(uint32_t x)
{
  x += __shfl_xor_sync(~0u, x, 1);
  return x + __shfl_xor_sync(~0u, x, 2);
}
__device__ float join_lanes(float x)
{
  x = x + __shfl_xor_sync(~0u, x, 1);
  return x + __shfl_xor_sync(~0u, x, 2);
}

// The place of this thread's query in the order, and its part. Lanes beyond the last query do the last one's work again.
template <bool Normals>
__device__ uint32_t query_place(const DeviceGather &gather)
{
  return min(uint32_t(thread_item() / lanes_of<Normals>), gather.num_queries - 1);
}
__device__ uint32_t query_at(const DeviceGather &gather, uint32_t place)
{
  return gather.order != nullptr ? gather.order[place] : place;
}
template <bool Normals>
__device__ bool writes(const DeviceGather &gather)
{
  return thread_item() / lanes_of<Normals> < gather.num_queries && threadIdx.x % lanes_of<Normals> == 0;
}

template <bool Normals>
__global__ void __launch_bounds__(block_size)
    count_kernel(const __grid_constant__ PhotonGrid grid, const __grid_constant__ DeviceGather gather)
{
  const uint32_t query = query_at(gather, query_place<Normals>(gather));
  uint32_t count = 0;
  gather_part<Normals>(grid, gather, query, threadIdx.x % lanes_of<Normals>,
                       [&](uint32_t, float, const PhotonProbe &) { ++count; });
  if constexpr (Normals) count = join_lanes(count);
  if (writes<Normals>(gather)) gather.counts[query] = count;
}

// The kernel is a parameter: the square root that cones need would cost the others registers.
template <bool Normals, GatherKernel Kernel>
__global__ void __launch_bounds__(block_size)
    sum_kernel(const __grid_constant__ PhotonGrid grid, const __grid_constant__ DeviceGather gather)
{
  const uint32_t query = query_at(gather, query_place<Normals>(gather));
  RangeQuery range = gather.range;
  range.kernel = Kernel;
  FluxSum sum{};
  gather_part<Normals>(
      grid, gather, query, threadIdx.x % lanes_of<Normals>,
      [&](uint32_t, float d2, const PhotonProbe &probe) { add(sum, probe.flux, kernel_weight(range, d2)); });
  if constexpr (Normals) {
    sum = {{join_lanes(sum.flux.x), join_lanes(sum.flux.y), join_lanes(sum.flux.z)}, join_lanes(sum.count)};
  }
  if (!writes<Normals>(gather)) return;
  gather.sums[query] = sum.flux * gather.range.flux_scale;
  if (gather.counts != nullptr) gather.counts[query] = sum.count;
}

// Lists keep the order of a single thread.
template <bool Normals>
__global__ void __launch_bounds__(block_size)
    list_kernel(const __grid_constant__ PhotonGrid grid, const __grid_constant__ DeviceGather gather)
{
  const uint64_t item = thread_item();
  if (item >= gather.num_queries) return;
  const uint32_t query = query_at(gather, uint32_t(item));
  const Vec3f p = gather.positions[query];
  const uint32_t normal = Normals ? encode_any_normal(gather.normals[query]) : 0u;
  uint64_t place = gather.offsets[query] - gather.first_listed;
  gpurt::gather(grid, p, gather.range.radius, [&](uint32_t i, float d2, const PhotonProbe &probe) {
    if (Normals && normal_dot(normal, load_rest(grid, i).normal) <= gather.range.min_dot) return;
    if (gather.ids != nullptr) gather.ids[place] = photon_id(grid, i, probe);
    if (gather.distances != nullptr) gather.distances[place] = sqrt(d2);
    ++place;
  });
}

}  // namespace

void launch_count(const PhotonGrid &grid, const DeviceGather &gather, cudaStream_t stream)
{
  const uint64_t n = gather.num_queries;
  if (gather.normals != nullptr)
    launch("kernel that counts near photons of like normals", count_kernel<true>, n * lanes_of<true>, stream,
           grid, gather);
  else launch("kernel that counts near photons", count_kernel<false>, n, stream, grid, gather);
}

template <GatherKernel Kernel>
void launch_sum_of_kernel(const PhotonGrid &grid, const DeviceGather &gather, cudaStream_t stream)
{
  const uint64_t n = gather.num_queries;
  if (gather.normals != nullptr)
    launch("kernel that sums near photons of like normals", sum_kernel<true, Kernel>, n * lanes_of<true>,
           stream, grid, gather);
  else launch("kernel that sums near photons", sum_kernel<false, Kernel>, n, stream, grid, gather);
}

void launch_sum(const PhotonGrid &grid, const DeviceGather &gather, cudaStream_t stream)
{
  switch (gather.range.kernel) {
    case GatherKernel::Constant:
      return launch_sum_of_kernel<GatherKernel::Constant>(grid, gather, stream);
    case GatherKernel::Cone:
      return launch_sum_of_kernel<GatherKernel::Cone>(grid, gather, stream);
    case GatherKernel::Quadratic:
      return launch_sum_of_kernel<GatherKernel::Quadratic>(grid, gather, stream);
  }
}

void launch_list(const PhotonGrid &grid, const DeviceGather &gather, cudaStream_t stream)
{
  const uint64_t n = gather.num_queries;
  if (gather.normals != nullptr)
    launch("kernel that lists near photons of like normals", list_kernel<true>, n, stream, grid, gather);
  else launch("kernel that lists near photons", list_kernel<false>, n, stream, grid, gather);
}

}  // namespace gpurt::cuda
