// Stages 'transform' and 'bound': which roots may be seen by a group of samples.
#include "cuda/launch.h"
#include "cuda/reyes/stages.h"

namespace gpurt::cuda {
namespace {

// A thread a root: what may be seen is kept in raster coordinates.
__global__ void __launch_bounds__(block_size)
    bound_roots(const __grid_constant__ ReyesBatch b, uint64_t first_root, uint32_t n)
{
  const uint64_t i = thread_item();
  if (i >= n) return;
  const uint32_t root = uint32_t(first_root + i);
  if (b.visible != nullptr && (b.visible[root / 32] >> root % 32 & 1) == 0) return;
  const RootRange range = range_of_root(b.scene, root);
  const uint32_t primitive = uint32_t(root - range.first_root);
  if (b.scene.patches[range.segment].num_patches != 0) {
    RasterPatch patch;
    transform_patch(b.scene, b.projection, range, primitive, patch);
    const RasterPoint largest = largest_coordinates(patch.x, patch.y, patch.w, 16);
    if (!can_be_seen(patch.x, patch.y, patch.w, 16, largest, b.rect)) return;
    const uint32_t slot = atomicAdd(&b.numbers->num_slots, 1u);
    b.patches[slot] = patch;
    b.largest[slot] = largest;
    b.roots[slot] = root;
    return;
  }
  RasterPoint p[3];
  transform_triangle(b.scene, b.projection, range,
                     b.scene.scene.segments[range.segment].first_triangle + primitive, p);
  const float x[3] = {p[0].x, p[1].x, p[2].x}, y[3] = {p[0].y, p[1].y, p[2].y},
              w[3] = {p[0].w, p[1].w, p[2].w};
  if (!can_be_seen(x, y, w, 3, largest_coordinates(x, y, w, 3), b.rect)) return;
  b.triangles[atomicAdd(&b.numbers->num_triangles, 1u)] = root;
}

}  // namespace

void launch_bound_roots(const ReyesBatch &batch, uint64_t first_root, uint32_t num_roots, cudaStream_t stream)
{
  launch("REYES stage 'bound'", bound_roots, num_roots, stream, batch, first_root, num_roots);
}

}  // namespace gpurt::cuda
