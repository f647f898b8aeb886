// Every hit of every ray: a kernel that counts, a scan that makes room, a kernel that writes.
//
// Both kernels list a ray's hits in order, one traversal a hit, so that no ray needs memory for hits that it may or may
// not have, and each hit is written once to its place.
#include <cub/device/device_scan.cuh>

#include "core/accel/trace.h"
#include "cuda/accel/dispatch.h"
#include "cuda/accel/ray_io.h"

namespace gpurt::cuda {
namespace {

template <class Variant>
__global__ void __launch_bounds__(block_size)
    count_all_kernel(const __grid_constant__ TraceScene s, const Ray *rays, uint64_t num_rays,
                     bool aligned_rays, uint64_t *counts)
{
  const uint64_t i = thread_item();
  if (i >= num_rays) return;
  const Ray ray = load_ray(rays, i, aligned_rays);
  uint64_t count = 0;
  trace_all_in_order<Variant::test, Variant::masks, Variant::placements>(s.accel, s.scene, ray,
                                                                         [&](const Hit &) { ++count; });
  counts[i] = count;
}

template <class Variant>
__global__ void __launch_bounds__(block_size)
    fill_all_kernel(const __grid_constant__ TraceScene s, const Ray *rays, uint64_t num_rays,
                    bool aligned_rays, const uint64_t *offsets, uint64_t first_hit, bool compact, void *hits,
                    bool aligned_hits)
{
  const uint64_t i = thread_item();
  if (i >= num_rays) return;
  const Ray ray = load_ray(rays, i, aligned_rays);
  uint64_t at = offsets[i] - first_hit;
  const uint64_t end = offsets[i + 1] - first_hit;
  if (at == end) return;
  trace_all_in_order<Variant::test, Variant::masks, Variant::placements>(
      s.accel, s.scene, ray, [&](const Hit &hit) {
        if (compact) store_hit(static_cast<CompactHit *>(hits), at, compact_hit(s.scene, hit), aligned_hits);
        else store_hit(static_cast<FullHit *>(hits), at, full_hit(s.scene, hit), aligned_hits);
        ++at;
      });
  GPURT_ASSERT(at == end);
}

}  // namespace

void launch_count_all(const TraceScene &scene, const Ray *rays, uint64_t num_rays, uint64_t *counts,
                      cudaStream_t stream)
{
  dispatch(scene, [&]<class Variant>(Variant) {
    launch("kernel that counts all hits", count_all_kernel<Variant>, num_rays, stream, scene, rays, num_rays,
           is_aligned_16(rays), counts);
  });
}

void launch_fill_all(const TraceScene &scene, const Ray *rays, uint64_t num_rays, const uint64_t *offsets,
                     uint64_t first_hit, bool compact, void *hits, cudaStream_t stream)
{
  dispatch(scene, [&]<class Variant>(Variant) {
    launch("kernel that writes all hits", fill_all_kernel<Variant>, num_rays, stream, scene, rays, num_rays,
           is_aligned_16(rays), offsets, first_hit, compact, hits, is_aligned_16(hits));
  });
}

uint64_t scan_scratch_bytes(uint64_t n)
{
  size_t bytes = 0;
  check(
      cub::DeviceScan::ExclusiveScan(nullptr, bytes, static_cast<const uint64_t *>(nullptr),
                                     static_cast<uint64_t *>(nullptr), ::cuda::std::plus<>{}, uint64_t(0), n),
      "cub::DeviceScan::ExclusiveScan");
  return bytes;
}

void scan_counts(const uint64_t *counts, uint64_t n, uint64_t base, uint64_t *sums, void *scratch,
                 uint64_t scratch_bytes, cudaStream_t stream)
{
  size_t bytes = scratch_bytes;
  check(cub::DeviceScan::ExclusiveScan(scratch, bytes, counts, sums, ::cuda::std::plus<>{}, base, n, stream),
        "cub::DeviceScan::ExclusiveScan");
}

}  // namespace gpurt::cuda
