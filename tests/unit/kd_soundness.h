// What every builder's kd-trees have to keep.
#pragma once

#include "accel/kd_build.h"
#include "accel/kd_check.h"
#include "accel_test.h"

namespace gpurt::test {

inline void expect_sound(const Mesh &mesh, const HostKdTree &tree, const KdBuildStats &stats)
{
  const uint32_t depth = check_kd_tree(tree, mesh.triangles.size(), [&](uint32_t t) {
    const UInt3 c = mesh.triangles[t];
    return extend(extend(extend(empty_box(), mesh.positions[c.x]), mesh.positions[c.y]), mesh.positions[c.z]);
  });
  EXPECT_EQ(depth, stats.depth);
  EXPECT_LE(depth, uint32_t(kd_max_depth));
  EXPECT_LE(tree.references.size(), 8 * mesh.triangles.size());
}

// Every point of every triangle lies in a closed cell whose leaf holds it.
inline void expect_complete(const Mesh &mesh, const HostKdTree &tree, Random &rng, int points_per_triangle)
{
  for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const UInt3 c = mesh.triangles[t];
    const Vec3f a = mesh.positions[c.x], b = mesh.positions[c.y], d = mesh.positions[c.z];
    if (is_degenerate(a, b, d)) continue;
    for (int i = 0; i < points_per_triangle; ++i) {
      const auto [p, slack] = point_of(mesh, t, rng, i);
      bool is_found = false;
      std::vector<uint32_t> todo = {0};
      while (!todo.empty() && !is_found) {
        const KdNode n = tree.nodes[todo.back()];
        todo.pop_back();
        if (is_leaf(n)) {
          for (uint32_t r = 0; r < payload(n); ++r) is_found |= tree.references[n.word + r] == t;
        } else {
          if (p[axis(n)] <= plane(n) + slack) todo.push_back(payload(n));
          if (p[axis(n)] >= plane(n) - slack) todo.push_back(payload(n) + 1);
        }
      }
      ASSERT_TRUE(is_found) << "triangle " << t << " at " << p[0] << " " << p[1] << " " << p[2];
    }
  }
}

}  // namespace gpurt::test
