// gpurt_scene_export_tree and gpurt_scene_import_tree: the exchange of kd-trees.
#include <cmath>

#include "api/descriptor.h"
#include "api/guard.h"
#include "api/objects.h"

namespace gpurt::api {
namespace {

// A node's first child or a leaf's count has 30 bits.
constexpr uint64_t max_nodes = uint64_t(1) << 30;
constexpr uint64_t max_references = UINT32_MAX;

/// Checks that a walk through a tree stays inside its arrays and within the depth that a traversal has room for.
class TreeChecker {
 public:
  explicit TreeChecker(const HostKdTree &tree) : tree_(tree), is_reached_(tree.nodes.size()) {}

  void run()
  {
    for (size_t i = 0; i < tree_.references.size(); ++i) {
      if (tree_.references[i] >= tree_.num_triangles) {
        fail_invalid("reference {} is {}, but the tree has {} triangles", i, tree_.references[i],
                     tree_.num_triangles);
      }
    }
    if (tree_.nodes.empty()) {
      if (tree_.num_triangles != 0)
        fail_invalid("the tree has {} triangles, but no node", tree_.num_triangles);
      return;
    }
    reach(0, 0, tree_.bounds);
    while (!todo_.empty()) {
      const Entry entry = todo_.back();
      todo_.pop_back();
      if (is_leaf(tree_.nodes[entry.node])) check_leaf(entry.node);
      else check_inner(entry);
    }
  }

 private:
  struct Entry {
    uint32_t node;
    int depth;  // inner nodes above
    Box cell;
  };

  void reach(uint64_t node, int depth, const Box &cell)
  {
    if (is_reached_[node]) fail_invalid("node {} is reached twice", node);
    is_reached_[node] = true;
    todo_.push_back({uint32_t(node), depth, cell});
  }

  void check_leaf(uint32_t i) const
  {
    const KdNode leaf = tree_.nodes[i];
    const uint64_t end = uint64_t(leaf.word) + payload(leaf);
    if (end > tree_.references.size()) {
      fail_invalid("leaf {} has references up to {}, but the tree has {}", i, end, tree_.references.size());
    }
  }

  void check_inner(const Entry &entry)
  {
    const KdNode node = tree_.nodes[entry.node];
    const uint64_t child = payload(node);
    if (child <= entry.node || child + 1 >= tree_.nodes.size()) {
      fail_invalid("the children of node {} are {} and {}; they must come after it and before {}", entry.node,
                   child, child + 1, tree_.nodes.size());
    }
    if (entry.depth + 1 > kd_max_depth) {
      fail_invalid("node {} is at depth {}; a tree is at most {} deep", child, entry.depth + 1, kd_max_depth);
    }
    const int k = axis(node);
    const float cut = plane(node);
    if (!(cut >= at(entry.cell.lo, k) && cut <= at(entry.cell.hi, k))) {
      fail_invalid("the plane of node {} is {}, outside of its cell [{}, {}] on axis {}", entry.node, cut,
                   at(entry.cell.lo, k), at(entry.cell.hi, k), k);
    }
    Box below = entry.cell, above = entry.cell;
    set(below.hi, k, cut);
    set(above.lo, k, cut);
    reach(child, entry.depth + 1, below);
    reach(child + 1, entry.depth + 1, above);
  }

  const HostKdTree &tree_;
  std::vector<bool> is_reached_;
  std::vector<Entry> todo_;
};

std::shared_ptr<const HostKdTree> read_tree(const gpurt_kdtree &d)
{
  if (d.num_nodes > max_nodes) fail_invalid("num_nodes is {}; a tree has at most {}", d.num_nodes, max_nodes);
  if (d.num_references > max_references) {
    fail_invalid("num_references is {}; a tree has at most {}", d.num_references, max_references);
  }
  if (d.num_triangles >= invalid_id) {
    fail_invalid("num_triangles is {}; a tree has at most {}", d.num_triangles, invalid_id - 1);
  }
  if (d.num_nodes != 0) require(d.nodes, "nodes");
  if (d.num_references != 0) require(d.references, "references");
  auto tree = std::make_shared<HostKdTree>();
  tree->bounds = {{d.bounds_min[0], d.bounds_min[1], d.bounds_min[2]},
                  {d.bounds_max[0], d.bounds_max[1], d.bounds_max[2]}};
  tree->num_triangles = d.num_triangles;
  if (d.num_nodes != 0 &&
      (!is_finite(tree->bounds.lo) || !is_finite(tree->bounds.hi) || is_empty(tree->bounds))) {
    fail_invalid("bounds_min and bounds_max are not finite, or bounds_min exceeds bounds_max");
  }
  tree->nodes.resize(d.num_nodes);
  if (d.num_nodes != 0) std::memcpy(tree->nodes.data(), d.nodes, d.num_nodes * sizeof(KdNode));
  if (d.num_references != 0) tree->references.assign(d.references, d.references + d.num_references);
  TreeChecker(*tree).run();
  return tree;
}

// Triangles of a tree as far as the description tells: how many a patch becomes, a commit decides.
bool count_triangles(const GeometryData &geometry, uint64_t &sum)
{
  if (geometry.kind != GeometryKind::Mesh) return false;
  sum += geometry.mesh.indices.size();
  return true;
}

void check_tree_fits(const SceneData &data, uint32_t tree, uint64_t num_triangles)
{
  std::vector<uint32_t> num_uses(data.geometries.size());
  for (const InstanceData &instance : data.instances) num_uses[instance.geometry]++;
  uint64_t sum = 0;
  bool is_known = true;
  if (tree == 0) {
    for (size_t g = 0; g < num_uses.size() && is_known; ++g) {
      if (num_uses[g] == 1) is_known = count_triangles(data.geometries[g], sum);
    }
  } else {
    const uint32_t geometry = tree - 1;
    if (geometry >= data.geometries.size()) {
      fail_invalid("tree is {}, for geometry {}, but the scene has {} geometries", tree, geometry,
                   data.geometries.size());
    }
    if (num_uses[geometry] < 2) {
      fail_invalid(
          "tree is {}, but geometry {} is placed {} times; only what is placed more often than once has a "
          "tree "
          "of its own",
          tree, geometry, num_uses[geometry]);
    }
    is_known = count_triangles(data.geometries[geometry], sum);
  }
  if (is_known && sum != num_triangles) {
    fail_invalid("num_triangles is {}, but tree {} of the scene has {}", num_triangles, tree, sum);
  }
}

// Fills sizes and, where there are arrays, copies.
void export_to(const HostKdTree &tree, gpurt_kdtree &d)
{
  const uint64_t node_capacity = d.num_nodes, reference_capacity = d.num_references;
  d.num_nodes = tree.nodes.size();
  d.num_references = tree.references.size();
  d.num_triangles = tree.num_triangles;
  for (int axis = 0; axis < 3; ++axis) {
    d.bounds_min[axis] = at(tree.bounds.lo, axis);
    d.bounds_max[axis] = at(tree.bounds.hi, axis);
  }
  if (!d.nodes && !d.references) return;
  if (d.num_nodes != 0) require(d.nodes, "nodes");
  if (d.num_references != 0) require(d.references, "references");
  if (node_capacity < d.num_nodes || reference_capacity < d.num_references) {
    fail_invalid(
        "nodes and references have room for {} and {}, but the tree has {} and {}; ask for the sizes with "
        "both "
        "NULL first",
        node_capacity, reference_capacity, d.num_nodes, d.num_references);
  }
  if (d.num_nodes != 0) std::memcpy(d.nodes, tree.nodes.data(), d.num_nodes * sizeof(KdNode));
  if (d.num_references != 0) {
    std::memcpy(d.references, tree.references.data(), d.num_references * sizeof(uint32_t));
  }
}

}  // namespace
}  // namespace gpurt::api

using namespace gpurt;
using namespace gpurt::api;

gpurt_result gpurt_scene_export_tree(gpurt_scene scene, gpurt_kdtree *tree)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    gpurt_kdtree d = read_descriptor(static_cast<const gpurt_kdtree *>(tree), "tree");
    export_to(s->require_commit()->committed->export_tree(d.tree), d);
    write_output(tree, d, "tree");
  });
}

gpurt_result gpurt_scene_import_tree(gpurt_scene scene, const gpurt_kdtree *tree)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    const gpurt_kdtree d = read_descriptor(tree, "tree");
    auto imported = read_tree(d);
    const std::scoped_lock lock(s->changing);
    check_tree_fits(s->data, d.tree, d.num_triangles);
    s->imported_trees[d.tree] = std::move(imported);
  });
}
