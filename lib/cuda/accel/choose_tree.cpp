#include "cuda/accel/choose_tree.h"

#include <algorithm>

#include "cuda/accel/device_kd_quads.h"
#include "cuda/accel/near.h"
#include "cuda/accel/probe_trees.h"
#include "cuda/lanes.h"
#include "error.h"
#include "memory.h"

namespace gpurt::cuda {
namespace {

// A probe takes some tens of milliseconds, the more the larger the scene, at a tenth to a fifth of what the bvh takes.
constexpr uint64_t min_probed_triangles = 200'000, max_probed_triangles = 16u << 20;
constexpr uint32_t num_probe_rays = 1u << 14;
constexpr double min_gain = 0.95;  // a kd-tree takes several times the memory, too

// What a kd-tree holds while it is built, and with its triangles, was 370 to 420 bytes a triangle in scenes that were
// measured (docs/kdtree.md).
constexpr uint64_t probe_bytes_per_triangle = 512;
constexpr uint64_t probe_share = 4;  // of the memory that is free, one part in so many

uint64_t free_bytes(const MemoryTracker &tracker)
{
  size_t free_on_device = 0, total = 0;
  check(cudaMemGetInfo(&free_on_device, &total), "cudaMemGetInfo");
  const uint64_t limit = tracker.limit() != 0 ? tracker.limit() : UINT64_MAX, used = tracker.used();
  return std::min<uint64_t>(free_on_device, limit > used ? limit - used : 0);
}

// A kd-tree of the scene's first group, as far as the probe needs it.
struct ProbedTree {
  ProbedTree(const Group &group, const TraceScene &bvh, const DeviceKdSettings &settings,
             const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream)
      : tree(build_kd_tree_on_device(bvh.scene, group, settings, memory, stream)),
        quads(bvh.scene, group,
              {tree.nodes.data(), tree.references.data(), tree.bounds, uint32_t(tree.num_nodes)},
              tree.num_references, memory, stream),
        scene(bvh)
  {
    scene.has_bvhs = false;
    scene.kd_quads = quads.view();
    scene.near_triangles = scene.kd_quads.triangles;
  }

  const DeviceKdTree tree;
  const DeviceKdQuads quads;
  TraceScene scene;
};

TreeChoice probe(const Group &group, const TraceScene &bvh, const DeviceKdSettings &settings,
                 const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream)
{
  const ProbedTree kd_tree(group, bvh, settings, memory, stream);
  const DeviceBuffer<TreeWork> counted(memory, 2, "a probe's counters");
  const WaitAtEnd wait(stream);
  if (!has_near_kernels(kd_tree.scene))
    return {false, "the fast kernels do not serve a kd-tree of this scene"};
  launch_probe_trees(bvh, kd_tree.scene, uint32_t(group.num_triangles), num_probe_rays, counted.data(),
                     stream);
  TreeWork work[2];
  check(cudaMemcpyAsync(work, counted.data(), sizeof work, cudaMemcpyDeviceToHost, stream),
        "cudaMemcpyAsync");
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  if (work[0].rays == 0 || work[1].rays == 0) return {false, "a probe found no rays near the scene"};
  const double share = expected_time(work[1], true) / expected_time(work[0], false);
  const auto mean = [](unsigned long long sum, unsigned long long n) { return double(sum) / double(n); };
  return {
      share < min_gain,
      fmt::format("a probe of {} rays expects a kd-tree to take {:.2f} of a bvh's time: {:.1f} steps, "
                  "{:.1f} leaves and {:.1f} tests a ray against {:.1f}, {:.1f} and {:.1f}",
                  work[1].rays, share, mean(work[1].nodes, work[1].rays), mean(work[1].leaves, work[1].rays),
                  mean(work[1].triangles, work[1].rays), mean(work[0].nodes, work[0].rays),
                  mean(work[0].leaves, work[0].rays), mean(work[0].triangles, work[0].rays))};
}

}  // namespace

TreeChoice choose_tree(const CompiledScene &scene, const TraceScene &bvh, const DeviceKdSettings &settings,
                       const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream)
{
  const uint64_t num_triangles = scene.groups.empty() ? 0 : scene.groups[0].num_triangles;
  if (num_triangles < min_probed_triangles || num_triangles > max_probed_triangles) {
    return {false,
            fmt::format("scenes of {} to {} triangles in world space are probed for kd-trees, this one "
                        "has {}",
                        min_probed_triangles, max_probed_triangles, num_triangles)};
  }
  if (!may_have_quads(bvh) || !has_near_kernels(bvh)) {
    return {false,
            "the fast kernels of kd-trees serve neither alpha masks nor placements nor other triangle tests"};
  }
  const uint64_t needed = num_triangles * probe_bytes_per_triangle,
                 available = free_bytes(*memory->tracker()) / probe_share;
  if (needed > available) {
    return {false, fmt::format("probing a kd-tree takes some {} bytes, and a quarter of the memory that is "
                               "free, {} bytes, is less",
                               needed, available)};
  }
  try {
    return probe(scene.groups[0], bvh, settings, memory, stream);
  } catch (const Error &error) {
    if (error.result() != GPURT_ERROR_OUT_OF_MEMORY && error.result() != GPURT_ERROR_UNSUPPORTED) throw;
    return {false, fmt::format("there was no room for a kd-tree to probe: {}", error.what())};
  }
}

}  // namespace gpurt::cuda
