#include "scene/gltf_nodes.h"

#include <cmath>

namespace gpurt {
namespace {

std::string node_label(const GltfDocument &document, int index)
{
  return gltf_label("node", size_t(index), document.model().nodes[size_t(index)].name);
}

AffineDouble from_matrix(const GltfDocument &document, const tinygltf::Node &node, int index)
{
  // Column by column in the file.
  const std::vector<double> &m = node.matrix;
  if (m[3] != 0 || m[7] != 0 || m[11] != 0 || m[15] != 1) {
    document.fail("{}: the last row of its matrix is ({}, {}, {}, {}); it must be (0, 0, 0, 1)",
                  node_label(document, index), m[3], m[7], m[11], m[15]);
  }
  return {m[0], m[4], m[8], m[12], m[1], m[5], m[9], m[13], m[2], m[6], m[10], m[14]};
}

AffineDouble from_parts(const GltfDocument &document, const tinygltf::Node &node, int index)
{
  const Vec3d t = node.translation.empty()
                      ? Vec3d{0, 0, 0}
                      : Vec3d{node.translation[0], node.translation[1], node.translation[2]};
  const Vec3d s = node.scale.empty() ? Vec3d{1, 1, 1} : Vec3d{node.scale[0], node.scale[1], node.scale[2]};
  double x = 0, y = 0, z = 0, w = 1;
  if (!node.rotation.empty()) {
    x = node.rotation[0];
    y = node.rotation[1];
    z = node.rotation[2];
    w = node.rotation[3];
    const double norm = std::sqrt(x * x + y * y + z * z + w * w);
    if (!(norm > 0) || !std::isfinite(norm)) {
      document.fail("{}: its rotation ({}, {}, {}, {}) is no quaternion of unit length",
                    node_label(document, index), x, y, z, w);
    }
    x /= norm;
    y /= norm;
    z /= norm;
    w /= norm;
  }
  return {
      (1 - 2 * (y * y + z * z)) * s.x, 2 * (x * y - w * z) * s.y,       2 * (x * z + w * y) * s.z,       t.x,
      2 * (x * y + w * z) * s.x,       (1 - 2 * (x * x + z * z)) * s.y, 2 * (y * z - w * x) * s.z,       t.y,
      2 * (x * z - w * y) * s.x,       2 * (y * z + w * x) * s.y,       (1 - 2 * (x * x + y * y)) * s.z, t.z};
}

AffineDouble local_transform(const GltfDocument &document, int index)
{
  const tinygltf::Node &node = document.model().nodes[size_t(index)];
  return node.matrix.empty() ? from_parts(document, node, index) : from_matrix(document, node, index);
}

// The parent of every node, or -1. A node with two would be in two places, or in a circle.
std::vector<int> find_parents(const GltfDocument &document)
{
  const auto &nodes = document.model().nodes;
  std::vector<int> parents(nodes.size(), -1);
  for (size_t i = 0; i < nodes.size(); ++i) {
    for (int child : nodes[i].children) {
      int &parent = parents[size_t(child)];
      if (parent >= 0) {
        document.fail(
            "{} is a child of both node {} and node {}; give each a node of its own, with the same mesh",
            node_label(document, child), parent, i);
      }
      parent = int(i);
    }
  }
  // With one parent each, whoever does not reach a root runs in a circle. Marks: 1 seen on this walk, 2 reaches one.
  std::vector<uint8_t> marks(nodes.size());
  for (size_t i = 0; i < nodes.size(); ++i) {
    std::vector<int> walk;
    int n = int(i);
    while (n >= 0 && marks[size_t(n)] == 0) {
      marks[size_t(n)] = 1;
      walk.push_back(n);
      n = parents[size_t(n)];
    }
    if (n >= 0 && marks[size_t(n)] == 1) document.fail("{} is its own ancestor", node_label(document, n));
    for (int k : walk) marks[size_t(k)] = 2;
  }
  return parents;
}

}  // namespace

int default_gltf_scene(const GltfDocument &document)
{
  const tinygltf::Model &model = document.model();
  if (model.defaultScene >= 0) return model.defaultScene;
  return model.scenes.empty() ? -1 : 0;
}

std::vector<GltfPlacedNode> place_gltf_nodes(const GltfDocument &document)
{
  const tinygltf::Model &model = document.model();
  const std::vector<int> parents = find_parents(document);
  const int scene = default_gltf_scene(document);
  std::vector<int> roots;
  if (scene >= 0) {
    roots = model.scenes[size_t(scene)].nodes;
  } else {
    document.warn("it has no scene: all its nodes are taken");
    for (size_t i = 0; i < parents.size(); ++i) {
      if (parents[i] < 0) roots.push_back(int(i));
    }
  }
  std::vector<uint8_t> is_root(model.nodes.size());
  for (int root : roots) {
    if (parents[size_t(root)] >= 0) {
      document.fail("scene {} lists {}, which is a child of node {}", scene, node_label(document, root),
                    parents[size_t(root)]);
    }
    if (is_root[size_t(root)]++) document.fail("scene {} lists {} twice", scene, node_label(document, root));
  }

  std::vector<GltfPlacedNode> placed, pending;
  for (auto root = roots.rbegin(); root != roots.rend(); ++root) pending.push_back({*root, identity_affine});
  while (!pending.empty()) {
    GltfPlacedNode p = pending.back();
    pending.pop_back();
    p.to_world = multiply(p.to_world, local_transform(document, p.node));
    if (!is_finite(p.to_world))
      document.fail("{}: its transform is not finite", node_label(document, p.node));
    placed.push_back(p);
    const std::vector<int> &children = model.nodes[size_t(p.node)].children;
    for (auto child = children.rbegin(); child != children.rend(); ++child)
      pending.push_back({*child, p.to_world});
  }
  return placed;
}

}  // namespace gpurt
