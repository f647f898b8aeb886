// Every hit of every ray: a kernel that counts crossings with their repetitions, a scan that makes room, a kernel that
// lists and sorts them, a scan over what is left, a kernel that writes.
//
// A traversal may not leave out cells by the hits found so far, as that for the closest hit does: where a ray grazes a
// triangle, the cell through which the triangle is met may lie far from the t that is measured. So a ray's hits are
// listed whole, as the CPU lists them, and sorted by the thread that found them.
#include <cub/device/device_scan.cuh>

#include "core/accel/sort_hits.h"
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
  trace_all<Variant::test, Variant::masks, Variant::placements>(Variant::accel(s), s.scene, ray,
                                                                [&](const Hit &) { ++count; });
  counts[i] = count;
}

template <class Variant>
__global__ void __launch_bounds__(block_size)
    list_all_kernel(const __grid_constant__ TraceScene s, const Ray *rays, uint64_t num_rays,
                    bool aligned_rays, const uint64_t *offsets, uint64_t first_listed, Hit *listed,
                    uint64_t *counts)
{
  const uint64_t i = thread_item();
  if (i >= num_rays) return;
  const uint64_t begin = offsets[i] - first_listed, end = offsets[i + 1] - first_listed;
  uint64_t at = begin;
  if (begin != end) {
    const Ray ray = load_ray(rays, i, aligned_rays);
    trace_all<Variant::test, Variant::masks, Variant::placements>(
        Variant::accel(s), s.scene, ray, [&](const Hit &hit) { listed[at++] = hit; });
  }
  GPURT_ASSERT(at == end);
  counts[i] = sort_hits(s.scene, listed + begin, end - begin);
}

__global__ void __launch_bounds__(block_size)
    write_all_kernel(const __grid_constant__ SceneView scene, uint64_t num_rays, const uint64_t *offsets,
                     uint64_t first_listed, const Hit *listed, const uint64_t *hit_offsets,
                     uint64_t first_hit, bool compact, void *hits, bool aligned_hits)
{
  const uint64_t i = thread_item();
  if (i >= num_rays) return;
  const Hit *from = listed + (offsets[i] - first_listed);
  for (uint64_t k = hit_offsets[i]; k < hit_offsets[i + 1]; ++k) {
    const Hit hit = *from++;
    const uint64_t at = k - first_hit;
    if (compact) store_hit(static_cast<CompactHit *>(hits), at, compact_hit(scene, hit), aligned_hits);
    else store_hit(static_cast<FullHit *>(hits), at, full_hit(scene, hit), aligned_hits);
  }
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

void launch_list_all(const TraceScene &scene, const Ray *rays, uint64_t num_rays, const uint64_t *offsets,
                     uint64_t first_listed, Hit *listed, uint64_t *counts, cudaStream_t stream)
{
  dispatch(scene, [&]<class Variant>(Variant) {
    launch("kernel that lists all hits", list_all_kernel<Variant>, num_rays, stream, scene, rays, num_rays,
           is_aligned_16(rays), offsets, first_listed, listed, counts);
  });
}

void launch_write_all(const SceneView &scene, uint64_t num_rays, const uint64_t *offsets,
                      uint64_t first_listed, const Hit *listed, const uint64_t *hit_offsets,
                      uint64_t first_hit, bool compact, void *hits, cudaStream_t stream)
{
  launch("kernel that writes all hits", write_all_kernel, num_rays, stream, scene, num_rays, offsets,
         first_listed, listed, hit_offsets, first_hit, compact, hits, is_aligned_16(hits));
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
