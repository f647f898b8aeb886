#include "cuda/accel/device_kd_quads.h"

#include <algorithm>

#include "cuda/accel/build/kd_quad_kernels.h"
#include "cuda/accel/kernels.h"
#include "cuda/accel/near.h"
#include "cuda/lanes.h"

namespace gpurt::cuda {
namespace {

uint32_t read_word(const uint32_t *word, cudaStream_t stream)
{
  uint32_t value;
  check(cudaMemcpyAsync(&value, word, sizeof value, cudaMemcpyDeviceToHost, stream), "cudaMemcpyAsync");
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  return value;
}

}  // namespace

DeviceKdQuads::DeviceKdQuads(const SceneView &view, const Group &group, const KdTreeView &tree,
                             uint64_t num_references, const std::shared_ptr<DeviceMemory> &memory,
                             cudaStream_t stream)
{
  const BvhFrame frame = make_bvh_frame(tree.bounds);
  if (tree.num_nodes == 0 || num_references == 0 || frame.reach == 0.0f ||
      tree.num_nodes > kd_quad_max_nodes || num_references >= max_near_references)
    return;
  // Nothing runs on a buffer when it goes.
  const WaitAtEnd wait(stream);
  const uint32_t n = uint32_t(num_references);
  const uint64_t scan_bytes = quad_scan_bytes(std::max(n, tree.num_nodes) + 1);
  const DeviceBuffer<std::byte> scratch(memory, scan_bytes, "a scan's working memory");
  places_ = DeviceBuffer<uint32_t>(memory, n, "places of a kd-tree's triangles");
  {
    const DeviceBuffer<uint32_t> first(memory, group.num_triangles, "first leaves of a kd-tree's triangles");
    const DeviceBuffer<uint32_t> ranks(memory, uint64_t(n) + 1, "places of a kd-tree's triangles");
    launch_first_references(tree.references, n, first.data(), uint32_t(group.num_triangles), ranks.data(),
                            stream);
    launch_quad_scan(ranks.data(), ranks.data(), n + 1, scratch.data(), scan_bytes, stream);
    const uint32_t num_triangles = read_word(ranks.data() + n, stream);
    const DeviceBuffer<uint32_t> listed(memory, num_triangles, "a kd-tree's triangles");
    triangles_ = DeviceBuffer<LeafTriangle>(memory, num_triangles, "a kd-tree's triangles");
    launch_list_triangles(tree.references, n, first.data(), ranks.data(), places_.data(), listed.data(),
                          stream);
    launch_gather_leaf_triangles(view, group.first_triangle, listed.data(), num_triangles, triangles_.data(),
                                 stream);
    check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  }
  const DeviceBuffer<uint32_t> node(memory, tree.num_nodes, "nodes of a kd-tree's levels");
  const DeviceBuffer<uint32_t> first(memory, tree.num_nodes, "nodes of a kd-tree's levels");
  const DeviceBuffer<uint32_t> before(memory, uint64_t(tree.num_nodes) + 1, "nodes of a kd-tree's levels");
  const QuadBuild build = {tree, places_.data(), node.data(), first.data()};
  check(cudaMemsetAsync(node.data(), 0, sizeof(uint32_t), stream), "cudaMemsetAsync");
  uint32_t begin = 0, end = 1;
  while (begin != end) {
    launch_quad_count(build, begin, end, stream);
    // One more than there are nodes: its sum is that of all.
    launch_quad_scan(first.data() + begin, before.data(), end - begin, scratch.data(), scan_bytes, stream);
    const uint32_t num_before = read_word(before.data() + (end - begin - 1), stream);
    const uint32_t last = read_word(first.data() + (end - 1), stream);
    launch_quad_place(build, begin, end, before.data(), stream);
    begin = end;
    end += num_before + last;
  }
  nodes_ = DeviceBuffer<KdQuadNode>(memory, end, "the kd-tree's nodes of two levels");
  launch_quad_write(build, end, frame, nodes_.data(), stream);
  KdNode root;
  check(cudaMemcpyAsync(&root, tree.nodes, sizeof root, cudaMemcpyDeviceToHost, stream), "cudaMemcpyAsync");
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  view_ = {nodes_.data(), places_.data(), triangles_.data(),
           tree.bounds,   frame,          is_leaf(root) ? kd_quad_leaf_bit : 0u};
}

}  // namespace gpurt::cuda
