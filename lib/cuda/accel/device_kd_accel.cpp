#include "cuda/accel/device_kd_accel.h"

#include "cuda/accel/kernels.h"
#include "cuda/lanes.h"

namespace gpurt::cuda {
namespace {

template <class T>
std::vector<T> copy_to_host(const T *from, uint64_t count, cudaStream_t stream)
{
  std::vector<T> values(count);
  if (values.empty()) return values;
  check(cudaMemcpyAsync(values.data(), from, count * sizeof(T), cudaMemcpyDeviceToHost, stream),
        "cudaMemcpyAsync");
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  return values;
}

}  // namespace

DeviceKdAccel::DeviceKdAccel(const CompiledScene &scene, const SceneView &view, const KdTrees &trees,
                             uint64_t most_host_triangles, const DeviceKdSettings &settings,
                             const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream)
{
  const auto is_built_here = [&](size_t g) { return scene.groups[g].num_triangles > most_host_triangles; };
  std::vector<const HostKdTree *> sources;
  uint64_t num_nodes = trees.placements.nodes.size(), num_references = trees.placements.references.size(),
           num_leaf_triangles = 0;  // the leaves of the tree over placements hold none
  for (size_t g = 0; g < trees.groups.size(); ++g) {
    if (is_built_here(g)) {
      const DeviceKdTree &tree =
          built_.emplace_back(build_kd_tree_on_device(view, scene.groups[g], settings, memory, stream));
      num_leaf_triangles += tree.num_references;
    } else {
      num_nodes += trees.groups[g].nodes.size();
      num_references += trees.groups[g].references.size();
      num_leaf_triangles += trees.groups[g].references.size();
    }
  }
  nodes_ = DeviceBuffer<KdNode>(memory, num_nodes, "the kd-tree's nodes");
  references_ = DeviceBuffer<uint32_t>(memory, num_references, "the kd-tree's references");
  triangles_ = DeviceBuffer<LeafTriangle>(memory, num_leaf_triangles, "the kd-tree's triangles");
  uint64_t first_node = 0, first_reference = 0;
  const auto place = [&](const HostKdTree &tree) {
    KdNode *nodes = nodes_.data() + first_node;
    uint32_t *references = references_.data() + first_reference;
    copy_to_device(nodes, std::span<const KdNode>(tree.nodes), stream);
    copy_to_device(references, std::span<const uint32_t>(tree.references), stream);
    first_node += tree.nodes.size();
    first_reference += tree.references.size();
    trees_.push_back({{nodes, references, tree.bounds, uint32_t(tree.nodes.size())},
                      tree.references.size(),
                      tree.num_triangles});
  };
  // The kernels have read what they read and written all triangles before this returns, or any buffer goes.
  const WaitAtEnd wait(stream);
  std::vector<KdGroupView> group_views;
  LeafTriangle *triangles = triangles_.data();
  for (size_t g = 0, num_built = 0; g < trees.groups.size(); ++g) {
    if (is_built_here(g)) {
      const DeviceKdTree &tree = built_[num_built++];
      trees_.push_back({{tree.nodes.data(), tree.references.data(), tree.bounds, uint32_t(tree.num_nodes)},
                        tree.num_references,
                        scene.groups[g].num_triangles});
    } else {
      place(trees.groups[g]);
    }
    const Tree &tree = trees_.back();
    launch_gather_leaf_triangles(view, scene.groups[g].first_triangle, tree.view.references,
                                 tree.num_references, triangles, stream);
    group_views.push_back({tree.view, triangles});
    triangles += tree.num_references;
  }
  place(trees.placements);
  groups_ = upload(memory, std::span<const KdGroupView>(group_views), "the kd-trees' views", stream);
  view_ = {groups_.data(), trees_.back().view, uint32_t(trees.groups.size())};
  if (trees.facts.triangle_test == TriangleTest::Watertight && view.num_placements == 0 &&
      !view.has_alpha_masks && !trees.groups.empty())
    quads_ = DeviceKdQuads(view, scene.groups[0], trees_[0].view, trees_[0].num_references, memory, stream);
}

uint64_t DeviceKdAccel::bytes() const
{
  uint64_t bytes =
      nodes_.bytes() + references_.bytes() + triangles_.bytes() + groups_.bytes() + quads_.bytes();
  for (const DeviceKdTree &tree : built_) bytes += tree.nodes.bytes() + tree.references.bytes();
  return bytes;
}

HostKdTree DeviceKdAccel::download(size_t group, cudaStream_t stream) const
{
  const Tree &tree = trees_[group];
  HostKdTree host;
  host.nodes = copy_to_host(tree.view.nodes, tree.view.num_nodes, stream);
  host.references = copy_to_host(tree.view.references, tree.num_references, stream);
  host.bounds = tree.view.bounds;
  host.num_triangles = tree.num_triangles;
  return host;
}

}  // namespace gpurt::cuda
