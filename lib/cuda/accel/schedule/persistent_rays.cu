// Closest and any hits in bvhs by persistent threads, for scenes and triangle tests that the fast kernels do not serve: as many
// as the device holds, which draw rays from a pool, a warp 32 of them, and trace them to their ends.
//
// Source: Aila and Laine 2009, persistent threads; the talk's pool of rays.
#include "cuda/accel/dispatch.h"
#include "cuda/accel/schedule/ray_work.h"

namespace gpurt::cuda {

GPURT_KERNELS_BEGIN

namespace {

template <TriangleTest Test, bool Any>
__global__ void __launch_bounds__(block_size)
    persistent_rays_kernel(const __grid_constant__ TraceScene s, const __grid_constant__ RayBatch batch,
                           Alignment aligned, RayPool pool, DeviceCounters *counters)
{
  uint32_t num_refills = 0;
  for (;;) {
    const uint64_t first = draw(pool, warp_size);
    if (first >= batch.num_rays) break;
    ++num_refills;
    const uint64_t i = first + lane_index();
    if (i < batch.num_rays) {
      const Ray ray = load_ray(batch.rays, i, aligned.rays);
      if constexpr (Any) {
        batch.occluded[i] = trace_any<Test, true, true>(s.bvhs, s.scene, ray) ? 1 : 0;
      } else {
        const Hit hit = trace_closest<Test, true, true>(s.bvhs, s.scene, ray);
        store_closest(s.scene, batch, i, aligned.hits, hit);
      }
    }
    __syncwarp();
  }
  if (lane_index() == 0) add_count(&counters->ray_refills, num_refills);
}

template <TriangleTest Test>
void launch_with(const TraceScene &scene, const RayBatch &batch, RayPool pool, DeviceCounters *counters,
                 cudaStream_t stream)
{
  auto kernel = persistent_rays_kernel<Test, false>;
  if constexpr (!counts_lanes) {
    if (batch.occluded != nullptr) kernel = persistent_rays_kernel<Test, true>;
  }
  launch_persistent(persistent_kernel_name, kernel, batch.num_rays, stream, scene, batch, alignment_of(batch),
                    pool, counters);
}

}  // namespace

void launch_persistent_rays(const TraceScene &scene, const RayBatch &batch, RayPool pool,
                            DeviceCounters *counters, cudaStream_t stream)
{
  if constexpr (!counts_lanes) {
    if (scene.triangle_test == TriangleTest::MollerTrumbore)
      return launch_with<TriangleTest::MollerTrumbore>(scene, batch, pool, counters, stream);
    if (scene.triangle_test == TriangleTest::Double)
      return launch_with<TriangleTest::Double>(scene, batch, pool, counters, stream);
  }
  launch_with<TriangleTest::Watertight>(scene, batch, pool, counters, stream);
}

GPURT_KERNELS_END
}  // namespace gpurt::cuda
