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
                             const std::shared_ptr<DeviceMemory> &memory, cudaStream_t stream)
{
  std::vector<const HostKdTree *> sources;
  for (const HostKdTree &tree : trees.groups) sources.push_back(&tree);
  sources.push_back(&trees.placements);
  uint64_t num_nodes = 0, num_references = 0, num_leaf_triangles = 0;
  for (const HostKdTree *tree : sources) {
    if (tree == &trees.placements)
      num_leaf_triangles = num_references;  // its leaves hold no triangles; it is the last
    trees_.push_back({num_nodes, tree->nodes.size(), num_references, tree->references.size(),
                      tree->num_triangles, tree->bounds});
    num_nodes += tree->nodes.size();
    num_references += tree->references.size();
  }
  nodes_ = DeviceBuffer<KdNode>(memory, num_nodes, "the kd-tree's nodes");
  references_ = DeviceBuffer<uint32_t>(memory, num_references, "the kd-tree's references");
  triangles_ = DeviceBuffer<LeafTriangle>(memory, num_leaf_triangles, "the kd-tree's triangles");
  for (size_t i = 0; i < sources.size(); ++i) {
    copy_to_device(nodes_.data() + trees_[i].first_node, std::span(std::as_const(sources[i]->nodes)), stream);
    copy_to_device(references_.data() + trees_[i].first_reference,
                   std::span(std::as_const(sources[i]->references)), stream);
  }
  // The kernels have read what they read and written all triangles before this returns, or any buffer goes.
  const WaitAtEnd wait(stream);
  std::vector<KdGroupView> group_views;
  for (size_t g = 0; g < trees.groups.size(); ++g) {
    const Tree &tree = trees_[g];
    LeafTriangle *triangles = triangles_.data() + tree.first_reference;
    launch_gather_leaf_triangles(view, scene.groups[g].first_triangle,
                                 references_.data() + tree.first_reference, tree.num_references, triangles,
                                 stream);
    group_views.push_back({tree_view(tree), triangles});
  }
  groups_ = upload(memory, std::span<const KdGroupView>(group_views), "the kd-trees' views", stream);
  view_ = {groups_.data(), tree_view(trees_.back()), uint32_t(trees.groups.size())};
}

KdTreeView DeviceKdAccel::tree_view(const Tree &tree) const
{
  return {nodes_.data() + tree.first_node, references_.data() + tree.first_reference, tree.bounds,
          uint32_t(tree.num_nodes)};
}

uint64_t DeviceKdAccel::bytes() const
{
  return nodes_.bytes() + references_.bytes() + triangles_.bytes() + groups_.bytes();
}

HostKdTree DeviceKdAccel::download(size_t group, cudaStream_t stream) const
{
  const Tree &tree = trees_[group];
  HostKdTree host;
  host.nodes = copy_to_host(nodes_.data() + tree.first_node, tree.num_nodes, stream);
  host.references = copy_to_host(references_.data() + tree.first_reference, tree.num_references, stream);
  host.bounds = tree.bounds;
  host.num_triangles = tree.num_triangles;
  return host;
}

}  // namespace gpurt::cuda
