// Stages 'transform' and 'bound': which roots may be seen by a group of samples.
#include "cuda/launch.h"
#include "cuda/reyes/stages.h"

namespace gpurt::cuda {
namespace {

// Lanes that share a root: each takes a row of a patch's control points.
constexpr uint32_t root_lanes = 4;

// The largest over the lanes of a root.
__device__ float root_max(float x)
{
  x = max(x, __shfl_xor_sync(0xffffffffu, x, 1));
  return max(x, __shfl_xor_sync(0xffffffffu, x, 2));
}

// Whether a triangle may be seen.
__device__ bool is_triangle_seen(const ReyesBatch &b, const RootRange &range, uint32_t primitive)
{
  RasterPoint p[3];
  transform_triangle(b.scene, b.projection, range,
                     b.scene.scene.segments[range.segment].first_triangle + primitive, p);
  const float x[3] = {p[0].x, p[1].x, p[2].x}, y[3] = {p[0].y, p[1].y, p[2].y},
              w[3] = {p[0].w, p[1].w, p[2].w};
  return can_be_seen(x, y, w, 3, largest_coordinates(x, y, w, 3), b.rect);
}

// What may be seen is kept, patches in raster coordinates.
__global__ void __launch_bounds__(block_size)
    bound_roots(const __grid_constant__ ReyesBatch b, uint64_t first_root, uint32_t n)
{
  const uint64_t i = thread_item() / root_lanes;
  const uint32_t lane = threadIdx.x % root_lanes;
  const uint32_t root = uint32_t(first_root + min(i, uint64_t(n) - 1));
  const RootRange range = range_of_root(b.scene, root);
  bool blends = false;
  if (b.blends != nullptr)
    blends = b.scene.scene.materials[b.scene.scene.segments[range.segment].material].blends != 0;
  const bool is_there = i < n && (b.visible == nullptr || (b.visible[root / 32] >> root % 32 & 1) != 0) &&
                        (b.blends == nullptr || (b.kinds >> (blends ? 1 : 0) & 1) != 0);
  const uint32_t primitive = uint32_t(root - range.first_root);
  const bool is_patch = b.scene.patches[range.segment].num_patches != 0;
  RasterPoint row[4];
  RasterPoint largest{0.0f, 0.0f, 0.0f};
  FrustumReach reach{-infinity, -infinity, -infinity, -infinity, -infinity};
  if (is_there && is_patch) {
    const Vec3f *points = b.scene.control_points +
                          (size_t(b.scene.patches[range.segment].first_patch) + primitive) * 16 + 4 * lane;
    for (int k = 0; k < 4; ++k) {
      row[k] = transform_to_raster(b.scene, b.projection, range.placement, points[k]);
      largest = {max(largest.x, abs(row[k].x)), max(largest.y, abs(row[k].y)), max(largest.w, abs(row[k].w))};
      reach = max(reach, frustum_reach(row[k].x, row[k].y, row[k].w, b.rect));
    }
  }
  largest = {root_max(largest.x), root_max(largest.y), root_max(largest.w)};
  reach = {root_max(reach.left), root_max(reach.right), root_max(reach.top), root_max(reach.bottom),
           root_max(reach.front)};
  const bool is_seen =
      is_there && is_patch && reach.front >= smallest_w && can_be_seen(reach, largest, b.rect);
  if (is_there && !is_patch && lane == 0 && is_triangle_seen(b, range, primitive))
    b.triangles[atomicAdd(&b.numbers->num_triangles, 1u)] = root;
  // One addition for the patches of a warp.
  const uint32_t seen = __ballot_sync(0xffffffffu, is_seen && lane == 0), warp_lane = threadIdx.x % 32;
  uint32_t slot = 0;
  if (warp_lane == 0 && seen != 0) slot = atomicAdd(&b.numbers->num_slots, uint32_t(__popc(seen)));
  slot = __shfl_sync(0xffffffffu, slot, 0) + uint32_t(__popc(seen & ((1u << (warp_lane - lane)) - 1)));
  if (!is_seen) return;
  RasterPatch &patch = b.patches[slot];
  for (uint32_t k = 0; k < 4; ++k) {
    patch.x[4 * lane + k] = row[k].x;
    patch.y[4 * lane + k] = row[k].y;
    patch.w[4 * lane + k] = row[k].w;
  }
  if (lane != 0) return;
  b.largest[slot] = largest;
  b.roots[slot] = root;
  if (b.blends != nullptr) b.blends[slot] = blends ? 1 : 0;
}

}  // namespace

void launch_bound_roots(const ReyesBatch &batch, uint64_t first_root, uint32_t num_roots, cudaStream_t stream)
{
  launch("REYES stage 'bound'", bound_roots, uint64_t(num_roots) * root_lanes, stream, batch, first_root,
         num_roots);
}

}  // namespace gpurt::cuda
