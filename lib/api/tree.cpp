// gpurt_scene_export_tree and gpurt_scene_import_tree: the exchange of kd-trees.
#include <cstring>

#include "accel/kd_check.h"
#include "api/descriptor.h"
#include "api/guard.h"
#include "api/objects.h"

namespace gpurt::api {
namespace {

// Not more than check_kd_tree allows, so that the arrays can be copied before it looks at them.
constexpr uint64_t max_nodes = (uint64_t(1) << 30) - 1;
constexpr uint64_t max_references = UINT32_MAX;

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
  tree->nodes.resize(d.num_nodes);
  if (d.num_nodes != 0) std::memcpy(tree->nodes.data(), d.nodes, d.num_nodes * sizeof(KdNode));
  if (d.num_references != 0) tree->references.assign(d.references, d.references + d.num_references);
  if (d.num_nodes == 0 && d.num_triangles != 0) {
    fail_invalid("the kd-tree has {} triangles, but no node", d.num_triangles);
  }
  check_kd_tree(*tree, d.num_triangles, nullptr);  // a commit checks it against the triangles
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
