// Whether anything lies along each ray: traversal ends at the first hit.
#include "core/accel/trace.h"
#include "cuda/accel/dispatch.h"
#include "cuda/accel/near.h"
#include "cuda/accel/ray_io.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

namespace {

template <class Variant>
__global__ void __launch_bounds__(block_size, Variant::min_blocks)
    any_kernel(const __grid_constant__ TraceScene s, const Ray *rays, uint64_t num_rays, bool aligned_rays,
               uint8_t *occluded)
{
  const uint64_t i = thread_item();
  if (i >= num_rays) return;
  const Ray ray = load_ray(rays, i, aligned_rays);
  occluded[i] =
      trace_any<Variant::test, Variant::masks, Variant::placements>(Variant::accel(s), s.scene, ray) ? 1 : 0;
}

}  // namespace

void launch_any(const TraceScene &scene, const Ray *rays, uint64_t num_rays, uint8_t *occluded,
                const RayOrder &order, cudaStream_t stream)
{
  if (suits_near_kernels(scene, rays, HitLayout::Internal, occluded, order)) {
    launch_near(scene, TraceQuery::Any, rays, uint32_t(num_rays), HitLayout::Compact, occluded, order,
                stream);
    return;
  }
  dispatch(scene, [&]<class Variant>(Variant) {
    launch("any-hit kernel", any_kernel<Variant>, num_rays, stream, scene, rays, num_rays,
           is_aligned_16(rays), occluded);
  });
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
