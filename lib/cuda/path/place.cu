#include "cuda/path/place.h"

#include "cuda/launch.h"
#include "cuda/path/queue_items.h"

namespace gpurt::cuda {
namespace {

__global__ void __launch_bounds__(block_size) flag_kernel(const Ray *rays, uint32_t n, uint32_t *flags)
{
  const uint64_t i = thread_item();
  if (i < n) flags[i] = is_there(rays, uint32_t(i), n) ? 1 : 0;
}

template <class Queue>
__global__ void __launch_bounds__(block_size)
    move_kernel(Queue from, uint32_t n, Queue to, const uint32_t *places)
{
  const uint64_t i = thread_item();
  if (is_there(from.rays, uint32_t(i), n)) move_item(from, uint32_t(i), to, places[i]);
}

}  // namespace

uint64_t placement_bytes(Compaction method, uint32_t n)
{
  switch (method) {
    case Compaction::Pyramid:
      return pyramid_bytes(n);
    case Compaction::NaiveScan:
      return naive_scan_bytes(n);
    case Compaction::LibraryScan:
      return library_scan_bytes(n);
    default:
      return block_scan_bytes(n);
  }
}

void launch_flag_rays(const Ray *rays, uint32_t n, uint32_t *flags, cudaStream_t stream)
{
  launch("kernel that flags rays", flag_kernel, n, stream, rays, n, flags);
}

void launch_place(const Placement &p, uint32_t n, uint32_t *places, uint32_t *total, cudaStream_t stream)
{
  if (p.method == Compaction::Pyramid) launch_place_by_pyramid(p.flags, n, p.memory, places, total, stream);
  else if (p.method == Compaction::NaiveScan)
    launch_place_by_naive_scan(p.flags, n, p.memory, places, total, stream);
  else if (p.method == Compaction::LibraryScan)
    launch_place_by_library_scan(p.flags, n, p.memory, p.memory_bytes, places, total, stream);
  else launch_place_by_block_scan(p.flags, n, p.memory, places, total, stream);
}

void launch_move_rays(const RayQueue &from, uint32_t n, const RayQueue &to, const uint32_t *places,
                      cudaStream_t stream)
{
  launch("kernel that moves rays to their places", move_kernel<RayQueue>, n, stream, from, n, to, places);
}

void launch_move_shadows(const ShadowQueue &from, uint32_t n, const ShadowQueue &to, const uint32_t *places,
                         cudaStream_t stream)
{
  launch("kernel that moves shadow rays to their places", move_kernel<ShadowQueue>, n, stream, from, n, to,
         places);
}

}  // namespace gpurt::cuda
