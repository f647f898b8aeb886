#include "cuda/accel/probe_trees.h"

#include "cuda/accel/near_kd_lane.h"

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
    const uint32_t all = __reduce_add_sync(~0u, uint32_t(x));
    if (threadIdx.x % 32 == 0) atomicAdd(&sum, static_cast<unsigned long long>(all));
  };
  add(work.rays, own.rays);
  add(work.nodes, own.nodes);
  add(work.leaves, own.leaves);
  add(work.triangles, own.triangles);
}

__global__ void __launch_bounds__(block_size)
    probe_bvh_kernel(const __grid_constant__ TraceScene s, uint32_t num_triangles, uint32_t num_rays,
                     float tmin, TreeWork *work)
{
  const uint32_t i = uint32_t(thread_item());
  TreeWork own = {};
  NearRay r;
  const Ray ray = probe_ray(s.scene, num_triangles, tmin, i);
  if (i < num_rays && make_near_ray(ray, s.world.tree, r)) {
    own.rays = 1;
    Pending pending;
    pending.count = 0;
    pending.triangle = invalid_id;
    pending.lower = ray.tmax;
    float end = ray.tmax + r.end_offset;
    uint32_t stack[bvh_max_depth + 1];
    stack[0] = bvh_empty;
    uint32_t *top = stack + 1;
    uint32_t current = s.world.tree.root;
    while (current != bvh_empty) {
      if (!is_bvh_leaf(current)) {
        step<true>(s.world.tree.nodes, r, end, current, top);
        ++own.nodes;
      } else {
        closest_in_leaf(s.world.triangles, r, ray.tmin, current, invalid_id, end, pending);
        ++own.leaves;
        own.triangles += leaf_size(current);
        current = pop(top);
      }
    }
  }
  add_up(*work, own);
}

__global__ void __launch_bounds__(block_size)
    probe_kd_kernel(const __grid_constant__ TraceScene s, uint32_t num_triangles, uint32_t num_rays,
                    float tmin, TreeWork *work)
{
  __shared__ WarpAxes axes[block_size / kd_warp_size];
  const uint32_t i = uint32_t(thread_item());
  TreeWork own = {};
  NearRay r;
  NearKdRay q;
  const Ray ray = probe_ray(s.scene, num_triangles, tmin, i);
  if (i < num_rays && make_near_kd_ray(ray, s.near_kd, r, q)) {
    own.rays = 1;
    const unsigned lane = threadIdx.x % kd_warp_size;
    WarpAxes &warp_axes = axes[threadIdx.x / kd_warp_size];
    set_axes(warp_axes, lane, q);
    const LaneAxes lane_axes{&warp_axes.axis[0][lane]};
    Pending pending;
    pending.count = 0;
    pending.triangle = invalid_id;
    pending.lower = ray.tmax;
    float end = ray.tmax + r.end_offset, a = q.a, b = q.b;
    uint4 entries[kd_stack_size];
    NearKdStack stack{entries, 0};
    stack.clear();
    KdNode node = first_kd_node(s.near_kd, a, b);
    while (node.tag != kd_end) {
      if (!is_leaf(node)) {
        node = load_kd_node(s.near_kd.nodes, near_kd_step(node, lane_axes, q.width, a, b, stack));
        ++own.nodes;
      } else {
        test_kd_leaf(s.near_kd, node, [&](const LeafTriangle &x, uint32_t place) {
          closest_in_triangle(x, x.triangle, place, r, ray.tmin, invalid_id, end, pending);
          ++own.triangles;
          return false;
        });
        ++own.leaves;
        node = pop_kd_node(s.near_kd.nodes, stack, end, a, b);
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
  launch("kernel that probes a bvh", probe_bvh_kernel, num_rays, stream, bvh, num_triangles, num_rays, tmin,
         work);
  launch("kernel that probes a kd-tree", probe_kd_kernel, num_rays, stream, kd_tree, num_triangles, num_rays,
         tmin, work + 1);
}

double expected_time(const TreeWork &work, bool is_kd_tree)
{
  if (work.rays == 0) return 0;
  constexpr double node[2] = {1.0, 1.3}, leaf[2] = {0.6, 1.8}, triangle = 1.2;
  return (node[is_kd_tree] * double(work.nodes) + leaf[is_kd_tree] * double(work.leaves) +
          triangle * double(work.triangles)) /
         double(work.rays);
}

}  // namespace gpurt::cuda
