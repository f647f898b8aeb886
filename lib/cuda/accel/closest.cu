// The closest hit of every ray: a thread a ray, while-while traversal with the stack in local memory.
//
// Source: Aila and Laine 2009.
#include "core/accel/trace.h"
#include "cuda/accel/dispatch.h"
#include "cuda/accel/near.h"
#include "cuda/accel/ray_io.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

namespace {

template <class Variant>
__global__ void __launch_bounds__(block_size, Variant::min_blocks)
    closest_kernel(const __grid_constant__ TraceScene s, const Ray *rays, uint64_t num_rays,
                   bool aligned_rays, HitLayout layout, void *hits, bool aligned_hits)
{
  const uint64_t i = thread_item();
  if (i >= num_rays) return;
  const Ray ray = load_ray(rays, i, aligned_rays);
  const Hit hit =
      trace_closest<Variant::test, Variant::masks, Variant::placements>(Variant::accel(s), s.scene, ray);
  if (layout == HitLayout::Internal) static_cast<Hit *>(hits)[i] = hit;
  else if (layout == HitLayout::Compact)
    store_hit(static_cast<CompactHit *>(hits), i, compact_hit(s.scene, hit), aligned_hits);
  else store_hit(static_cast<FullHit *>(hits), i, full_hit(s.scene, hit), aligned_hits);
}

}  // namespace

void launch_closest(const TraceScene &scene, const Ray *rays, uint64_t num_rays, HitLayout layout, void *hits,
                    const RayOrder &order, cudaStream_t stream)
{
  if (suits_near_kernels(scene, rays, layout, hits, order)) {
    launch_near(scene, TraceQuery::Closest, rays, uint32_t(num_rays), layout, hits, order, stream);
    return;
  }
  dispatch(scene, [&]<class Variant>(Variant) {
    launch("closest-hit kernel", closest_kernel<Variant>, num_rays, stream, scene, rays, num_rays,
           is_aligned_16(rays), layout, hits, is_aligned_16(hits));
  });
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
