#include "cuda/accel/device_bvh_accel.h"

#include "cuda/accel/kernels.h"
#include "cuda/lanes.h"

namespace gpurt::cuda {

DeviceBvhAccel::DeviceBvhAccel(const CompiledScene &scene, const SceneView &view, const BvhTrees &trees,
                               const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream)
{
  uint64_t num_nodes = trees.placements.nodes.size(), num_references = 0;
  for (const HostBvh &tree : trees.groups) {
    num_nodes += tree.nodes.size();
    num_references += tree.references.size();
  }
  nodes_ = DeviceBuffer<BvhNode>(memory, num_nodes, "the bvh's nodes");
  triangles_ = DeviceBuffer<LeafTriangle>(memory, num_references, "the bvh's triangles");
  placement_references_ =
      upload(memory, std::span<const uint32_t>(trees.placements.references), "the bvh's placements", stream);
  // Leaves hold their triangles: the lists are needed no longer than it takes to gather them.
  const DeviceBuffer<uint32_t> references(memory, num_references, "the bvh's references");
  // The kernels have read what they read and written all triangles before this returns, or any buffer goes.
  const WaitAtEnd wait(stream);
  uint64_t first_node = 0, first_reference = 0;
  const auto place = [&](const HostBvh &tree) {
    BvhNode *nodes = nodes_.data() + first_node;
    copy_to_device(nodes, std::span<const BvhNode>(tree.nodes), stream);
    first_node += tree.nodes.size();
    return BvhView{nodes, nullptr, tree.bounds, tree.center, tree.root};
  };
  std::vector<BvhGroupView> group_views;
  for (size_t g = 0; g < trees.groups.size(); ++g) {
    const HostBvh &tree = trees.groups[g];
    uint32_t *group_references = references.data() + first_reference;
    LeafTriangle *triangles = triangles_.data() + first_reference;
    copy_to_device(group_references, std::span<const uint32_t>(tree.references), stream);
    launch_gather_leaf_triangles(view, scene.groups[g].first_triangle, group_references,
                                 tree.references.size(), triangles, stream);
    first_reference += tree.references.size();
    group_views.push_back({place(tree), triangles});
  }
  BvhView placements = place(trees.placements);
  placements.references = placement_references_.data();
  groups_ = upload(memory, std::span<const BvhGroupView>(group_views), "the bvhs' views", stream);
  view_ = {groups_.data(), placements, uint32_t(trees.groups.size())};
}

uint64_t DeviceBvhAccel::bytes() const
{
  return nodes_.bytes() + triangles_.bytes() + placement_references_.bytes() + groups_.bytes();
}

}  // namespace gpurt::cuda
