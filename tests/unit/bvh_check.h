// What every bvh promises, whoever built it.
#pragma once

#include "accel/bvh_build.h"
#include "accel_test.h"

namespace gpurt::test {

inline KdSource source_of(const Mesh &mesh)
{
  KdSource source;
  source.count = mesh.triangles.size();
  source.positions = mesh.positions.data();
  source.indices = mesh.triangles.data();
  return source;
}

inline bool is_kept(const Mesh &mesh, uint32_t t)
{
  const UInt3 c = mesh.triangles[t];
  return !is_degenerate(mesh.positions[c.x], mesh.positions[c.y], mesh.positions[c.z]);
}

// Leaves and nodes are reached once each, leaves fill the list of references, and depths are as told.
inline void expect_sound(const Mesh &mesh, const HostBvh &tree, const BvhBuildStats &stats)
{
  std::vector<int> node_seen(tree.nodes.size()), reference_seen(tree.references.size());
  std::vector<std::pair<uint32_t, uint32_t>> todo = {{tree.root, 0}};
  uint32_t depth = 0;
  while (!todo.empty() && tree.root != bvh_empty) {
    const auto [word, level] = todo.back();
    todo.pop_back();
    depth = std::max(depth, level);
    if (is_bvh_leaf(word)) {
      ASSERT_LE(leaf_first(word) + leaf_size(word), tree.references.size());
      for (uint32_t i = 0; i < leaf_size(word); ++i) ++reference_seen[leaf_first(word) + i];
    } else {
      ASSERT_LT(word, tree.nodes.size());
      ++node_seen[word];
      todo.push_back({tree.nodes[word].child0, level + 1});
      todo.push_back({tree.nodes[word].child1, level + 1});
    }
  }
  for (int n : node_seen) ASSERT_EQ(n, 1);
  for (int n : reference_seen) ASSERT_EQ(n, 1);
  EXPECT_EQ(depth, stats.depth);
  EXPECT_LE(depth, uint32_t(bvh_max_depth));
  EXPECT_LE(tree.references.size(), bvh_max_references_per_primitive * mesh.triangles.size());
  std::vector<int> triangle_seen(mesh.triangles.size());
  for (uint32_t t : tree.references) {
    ASSERT_LT(t, mesh.triangles.size());
    ++triangle_seen[t];
  }
  for (uint32_t t = 0; t < mesh.triangles.size(); ++t)
    ASSERT_EQ(triangle_seen[t] != 0, is_kept(mesh, t)) << t;
}

// Every point of every triangle lies in all boxes on the way to a leaf that holds it.
inline void expect_complete(const Mesh &mesh, const HostBvh &tree, Random &rng, int points_per_triangle)
{
  for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (!is_kept(mesh, t)) continue;
    for (int i = 0; i < points_per_triangle; ++i) {
      const auto [p, slack] = point_of(mesh, t, rng, i);
      bool is_found = false;
      std::vector<uint32_t> todo = {tree.root};
      while (!todo.empty() && !is_found) {
        const uint32_t word = todo.back();
        todo.pop_back();
        if (is_bvh_leaf(word)) {
          for (uint32_t r = 0; r < leaf_size(word); ++r)
            is_found |= tree.references[leaf_first(word) + r] == t;
          continue;
        }
        const BvhNode &node = tree.nodes[word];
        const BvhBoxes boxes = boxes_of(node, tree.frame);
        for (int child = 0; child < 2; ++child) {
          bool contains = true;
          for (int k = 0; k < 3; ++k)
            contains &= p[k] >= boxes.lo[child][k] - slack && p[k] <= boxes.hi[child][k] + slack;
          if (contains) todo.push_back(child == 0 ? node.child0 : node.child1);
        }
      }
      ASSERT_TRUE(is_found) << "triangle " << t << " at " << p[0] << " " << p[1] << " " << p[2];
    }
  }
}

inline Mesh needles_of(Random &rng, int count)
{
  Mesh needles;
  for (int i = 0; i < count; ++i) {
    const Vec3f p = rng.point(1), d = rng.direction();
    needles.add(p, p + d * 2.0f, p + d * 2.0f + rng.point(1e-4f));
  }
  return needles;
}

}  // namespace gpurt::test
