// kd-trees made by CGAL, in the form of the tree exchange: axes and cuts from CGAL::Kd_tree, triangles assigned exactly.
#pragma once

#include "rays.h"

namespace gpurt_test {

struct ExchangeTree {
  std::vector<gpurt_kdtree_node> nodes;
  std::vector<uint32_t> references;
  Bounds bounds;
  uint32_t depth = 0;  // inner nodes above the deepest leaf
};

enum class TreePoints { Vertices, Centroids };
enum class TreeCut { Median, SlidingMidpoint };

/// Builds CGAL's tree over the mesh's distinct vertices or its centroids. Cuts are rounded to float; a triangle is in
/// every leaf whose closed cell it touches, by exact arithmetic. Triangles that `is_dropped` are in none.
ExchangeTree build_cgal_tree(const Mesh &mesh, TreePoints points, TreeCut cut, unsigned bucket_size,
                             const std::function<bool(uint32_t)> &is_dropped = nullptr);

}  // namespace gpurt_test
