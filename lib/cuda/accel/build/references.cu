// References to a group's triangles, and their bounds.
#include <cub/device/device_select.cuh>

#include "core/accel/degenerate.h"
#include "cuda/accel/build/kernels.h"
#include "cuda/launch.h"
#include "cuda/warp_reduce.h"

namespace gpurt::cuda {
namespace {

constexpr unsigned threads = 256;

__global__ void __launch_bounds__(threads)
    make_references_kernel(BuildScene scene, uint32_t num_triangles, BuildReference *references,
                           BuildCounters *counters)
{
  __shared__ uint32_t sums[threads / warp_size];
  const BlockGroup group(sums);
  Box bounds = empty_box(), centers = empty_box();
  uint32_t num_degenerate = 0;
  const uint32_t first = blockIdx.x * chunk_size, end = min(first + chunk_size, num_triangles);
  for (uint32_t i = first + threadIdx.x; i < end; i += threads) {
    const UInt3 c = scene.indices[i];
    const Vec3f a = scene.positions[c.x], b = scene.positions[c.y], d = scene.positions[c.z];
    BuildReference r = {{infinity, infinity, infinity}, i, {-infinity, -infinity, -infinity}, 0};
    if (has_no_area(a, b, d)) {
      ++num_degenerate;
    } else {
      r.lo = min(a, min(b, d));
      r.hi = max(a, max(b, d));
      bounds = extend(bounds, Box{r.lo, r.hi});
      centers = extend(centers, center_of(r));
    }
    store_reference(references + i, r);
  }
  extend_by_all(group, counters->bounds, bounds);
  extend_by_all(group, counters->centers, centers);
  num_degenerate = warp_sum(num_degenerate);
  if (threadIdx.x % warp_size == 0 && num_degenerate != 0) add_to(&counters->num_degenerate, num_degenerate);
}

struct IsThere {
  __device__ bool operator()(const BuildReference &r) const { return r.lo.x <= r.hi.x; }
};

__global__ void clear_counters_kernel(BuildCounters *counters)
{
  *counters = {};
  counters->bounds = counters->centers = empty_ordered_box();
}

__global__ void make_root_kernel(BuildLevel level, uint32_t count, uint32_t spare)
{
  BuildNode root = {};
  root.bounds = level.counters->bounds;
  root.centers = level.counters->centers;
  root.count = count;
  root.spare = spare;
  root.child = invalid_id;
  level.nodes[0] = root;
  level.counters->num_nodes = 1;
  if (class_of(count) == SmallNode) {
    level.counters->num_small_references = count;
    BuildReference *to = references_of(root, nullptr, level.small_nodes);
    for (uint32_t i = 0; i < count; ++i) to[i] = level.from[i];
  } else {
    // The root is alone in the list of its class.
    level.next_list[class_of(count)][0] = 0;
  }
}

}  // namespace

void launch_make_references(const BuildScene &scene, uint32_t num_triangles, BuildReference *references,
                            BuildCounters *counters, cudaStream_t stream)
{
  clear_counters_kernel<<<1, 1, 0, stream>>>(counters);
  check(cudaGetLastError(), "kernel that clears a build's counters");
  if (num_triangles == 0) return;
  make_references_kernel<<<(num_triangles + chunk_size - 1) / chunk_size, threads, 0, stream>>>(
      scene, num_triangles, references, counters);
  check(cudaGetLastError(), "kernel that makes references to triangles");
}

uint64_t drop_scratch_bytes(uint32_t count)
{
  size_t bytes = 0;
  check(cub::DeviceSelect::If(nullptr, bytes, static_cast<const BuildReference *>(nullptr),
                              static_cast<BuildReference *>(nullptr), static_cast<uint32_t *>(nullptr),
                              int(count), IsThere()),
        "cub::DeviceSelect::If");
  return bytes;
}

void launch_drop_empty(const BuildReference *from, uint32_t count, BuildReference *to, uint32_t *num_kept,
                       void *scratch, uint64_t scratch_bytes, cudaStream_t stream)
{
  size_t bytes = scratch_bytes;
  check(cub::DeviceSelect::If(scratch, bytes, from, to, num_kept, int(count), IsThere(), stream),
        "cub::DeviceSelect::If");
}

void launch_make_root(const BuildState &state, uint32_t count, uint32_t spare, cudaStream_t stream)
{
  make_root_kernel<<<1, 1, 0, stream>>>(state.level, count, spare);
  check(cudaGetLastError(), "kernel that makes a bvh's root");
}

}  // namespace gpurt::cuda
