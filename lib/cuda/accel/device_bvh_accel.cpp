#include "cuda/accel/device_bvh_accel.h"

#include "cuda/accel/build/refit.h"
#include "cuda/accel/kernels.h"
#include "cuda/lanes.h"

namespace gpurt::cuda {
namespace {

// A refitted tree that the surface area heuristic expects to be slower than it was by more than this is built anew: a
// build takes about five times as long as a refit.
constexpr double max_drift = 1.3;

DeviceBvh build_or_refit(const DeviceBvh *old, const SceneView &view, const Group &group,
                         const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream)
{
  double seconds = 0;
  if (old != nullptr && old->is_complete && old->root != bvh_empty) {
    bool fits;
    DeviceBvh tree = refit_bvh(*old, view, memory, stream, fits);
    if (fits && tree.sah_cost <= max_drift * tree.built_sah_cost) return tree;
    seconds = tree.seconds;
  }
  DeviceBvh tree = build_bvh_on_device(view, group, memory, stream);
  tree.seconds += seconds;
  return tree;
}

}  // namespace

DeviceBvhAccel::DeviceBvhAccel(const CompiledScene &scene, const SceneView &view, const BvhTrees &trees,
                               uint64_t most_host_triangles, const DeviceBvhAccel *previous,
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
    return BvhView{nodes, nullptr, tree.bounds, tree.frame, tree.root};
  };
  std::vector<BvhGroupView> group_views;
  for (size_t g = 0; g < trees.groups.size(); ++g) {
    if (scene.groups[g].num_triangles > most_host_triangles) {
      const DeviceBvh *old = previous != nullptr && built_.size() < previous->built_.size()
                                 ? &previous->built_[built_.size()]
                                 : nullptr;
      const DeviceBvh &tree = built_.emplace_back(build_or_refit(old, view, scene.groups[g], memory, stream));
      group_views.push_back(
          {{tree.nodes.data(), nullptr, tree.bounds, tree.frame, tree.root}, tree.triangles.data()});
      continue;
    }
    const HostBvh &tree = trees.groups[g];
    uint32_t *group_references = references.data() + first_reference;
    LeafTriangle *triangles = triangles_.data() + first_reference;
    copy_to_device(group_references, std::span<const uint32_t>(tree.references), stream);
    launch_gather_leaf_triangles(view, scene.groups[g].first_triangle, group_references,
                                 tree.references.size(), triangles, stream);
    first_reference += tree.references.size();
    group_views.push_back({place(tree), triangles});
  }
  if (!group_views.empty()) world_ = group_views[0];
  BvhView placements = place(trees.placements);
  placements.references = placement_references_.data();
  groups_ = upload(memory, std::span<const BvhGroupView>(group_views), "the bvhs' views", stream);
  view_ = {groups_.data(), placements, uint32_t(trees.groups.size())};
}

uint64_t DeviceBvhAccel::bytes() const
{
  uint64_t bytes = nodes_.bytes() + triangles_.bytes() + placement_references_.bytes() + groups_.bytes();
  for (const DeviceBvh &tree : built_) bytes += tree.nodes.bytes() + tree.triangles.bytes();
  return bytes;
}

}  // namespace gpurt::cuda
