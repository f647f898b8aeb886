#include "cuda/accel/probe_trees.h"

#include "cuda/accel/bvh_walk.h"
#include "cuda/accel/quad_walk.h"
#include "cuda/warp_reduce.h"

namespace gpurt::cuda {
namespace {

__device__ uint32_t mix(uint32_t x)
{
  x ^= x >> 16;
  x *= 0x7feb352du;
  x ^= x >> 15;
  x *= 0x846ca68bu;
  return x ^ x >> 16;
}

__device__ Ray probe_ray(const SceneView &scene, uint32_t num_triangles, float tmin, uint32_t i)
{
  const uint32_t triangle = uint32_t(uint64_t(mix(4 * i)) * num_triangles >> 32);
  const UInt3 c = scene.indices[triangle];
  const Vec3f a = scene.positions[c.x], b = scene.positions[c.y], d = scene.positions[c.z];
  const Vec3f middle = {(a.x + b.x + d.x) / 3.0f, (a.y + b.y + d.y) / 3.0f, (a.z + b.z + d.z) / 3.0f};
  const auto component = [&](uint32_t k) { return float(int(mix(4 * i + k) >> 8) - (1 << 23)) + 0.5f; };
  const Vec3f direction = {component(1), component(2), component(3)};
  return {middle, tmin / max_component(abs(direction)), direction, infinity};
}

__device__ void add_up(TreeWork &work, TreeWork own)
{
  const auto add = [](unsigned long long &sum, unsigned long long x) {
    const uint32_t all = warp_sum(uint32_t(x));
    if (threadIdx.x % 32 == 0) atomicAdd(&sum, static_cast<unsigned long long>(all));
  };
  add(work.rays, own.rays);
  add(work.nodes, own.nodes);
  add(work.leaves, own.leaves);
  add(work.triangles, own.triangles);
}

template <class Walk>
__global__ void __launch_bounds__(block_size)
    probe_kernel(const __grid_constant__ TraceScene s, uint32_t num_triangles, uint32_t num_rays, float tmin,
                 TreeWork *work)
{
  __shared__ typename Walk::Shared shared[block_size / warp_size];
  const uint32_t i = uint32_t(thread_item());
  TreeWork own = {};
  const Ray ray = probe_ray(s.scene, num_triangles, tmin, i);
  typename Walk::Entry stack[Walk::stack_size];
  Walk walk(stack, &shared[threadIdx.x / warp_size], threadIdx.x % warp_size);
  if (i < num_rays && walk.begin(s, ray, stack)) {
    own.rays = 1;
    uint32_t references[pending_capacity];
    Pending pending;
    pending.references = references;
    clear(pending, ray.tmax);
    float end = ray.tmax + walk.ray.end_offset;
    while (!walk.has_ended()) {
      if (!walk.is_at_leaf()) {
        walk.template step<true>(s, end);
        ++own.nodes;
      } else {
        walk.test_leaf(s, [&](const LeafTriangle &x, uint32_t triangle, uint32_t reference) {
          closest_in_triangle(x, triangle, reference, walk.ray, ray.tmin, invalid_id, end, pending);
          ++own.triangles;
          return false;
        });
        ++own.leaves;
        walk.pop(end);
      }
    }
  }
  add_up(*work, own);
}

}  // namespace

void launch_probe_trees(const TraceScene &bvh, const TraceScene &kd_tree, uint32_t num_triangles,
                        uint32_t num_rays, TreeWork *work, cudaStream_t stream)
{
  check(cudaMemsetAsync(work, 0, 2 * sizeof(TreeWork), stream), "cudaMemsetAsync");
  const float tmin = bvh.world.tree.frame.half_extent * 0x1p-12f;
  launch("kernel that probes a bvh", probe_kernel<BvhWalk>, num_rays, stream, bvh, num_triangles, num_rays,
         tmin, work);
  launch("kernel that probes a kd-tree", probe_kernel<QuadWalk>, num_rays, stream, kd_tree, num_triangles,
         num_rays, tmin, work + 1);
}

double expected_time(const TreeWork &work, bool is_kd_tree)
{
  if (work.rays == 0) return 0;
  constexpr double node[2] = {1.0, 2.3}, leaf[2] = {0.6, 2.0}, triangle = 1.2;
  return (node[is_kd_tree] * double(work.nodes) + leaf[is_kd_tree] * double(work.leaves) +
          triangle * double(work.triangles)) /
         double(work.rays);
}

}  // namespace gpurt::cuda
