#include "accel/kd_check.h"

namespace gpurt {
namespace {

struct Visit {
  uint32_t node;
  uint32_t depth;
  Box cell;
};

bool contains(const Box &outer, const Box &inner)
{
  return outer.lo.x <= inner.lo.x && outer.lo.y <= inner.lo.y && outer.lo.z <= inner.lo.z &&
         outer.hi.x >= inner.hi.x && outer.hi.y >= inner.hi.y && outer.hi.z >= inner.hi.z;
}

}  // namespace

uint32_t check_kd_tree(const HostKdTree &tree, uint64_t num_primitives,
                       const std::function<Box(uint32_t)> &primitive_bounds)
{
  const uint64_t num_nodes = tree.nodes.size(), num_references = tree.references.size();
  if (tree.num_triangles != num_primitives) {
    fail_invalid("the kd-tree is of {} triangles, the geometry has {}; export the tree again",
                 tree.num_triangles, num_primitives);
  }
  if (num_nodes > 0x3fffffffu) fail_invalid("the kd-tree has {} nodes and can have 2^30 - 1", num_nodes);
  if (num_references > 0xffffffffu)
    fail_invalid("the kd-tree has {} references and can have 2^32 - 1", num_references);
  for (uint64_t i = 0; i < num_references; ++i) {
    if (tree.references[i] >= num_primitives) {
      fail_invalid("reference {} of the kd-tree is triangle {}, but there are {}", i, tree.references[i],
                   num_primitives);
    }
  }
  if (num_nodes == 0) return 0;
  if (!is_finite(tree.bounds.lo) || !is_finite(tree.bounds.hi) || is_empty(tree.bounds)) {
    fail_invalid("the kd-tree's bounds are empty or not finite");
  }
  if (primitive_bounds) {
    for (const uint32_t primitive : tree.references) {
      if (!contains(tree.bounds, primitive_bounds(primitive))) {
        fail_invalid("the kd-tree's bounds do not contain triangle {}", primitive);
      }
    }
  }

  std::vector<bool> is_reached(num_nodes, false);
  std::vector<Visit> todo = {{0, 0, tree.bounds}};
  uint32_t depth = 0;
  uint64_t num_reached = 0;
  while (!todo.empty()) {
    const Visit visit = todo.back();
    todo.pop_back();
    const uint32_t i = visit.node;
    if (is_reached[i]) fail_invalid("node {} of the kd-tree is reached twice", i);
    is_reached[i] = true;
    ++num_reached;
    const KdNode node = tree.nodes[i];
    if (is_leaf(node)) {
      depth = max(depth, visit.depth);
      if (uint64_t(node.word) + payload(node) > num_references && payload(node) != 0) {
        fail_invalid("leaf {} of the kd-tree refers to references {} to {}, but there are {}", i, node.word,
                     uint64_t(node.word) + payload(node) - 1, num_references);
      }
      continue;
    }
    if (visit.depth >= uint32_t(kd_max_depth)) {
      fail_invalid("node {} of the kd-tree has children at depth {}; {} is the limit", i, visit.depth + 1,
                   kd_max_depth);
    }
    const uint64_t child = payload(node);
    if (child <= i || child + 1 >= num_nodes) {
      fail_invalid(
          "node {} of the kd-tree has its children at {} and {}; they must come after it, and there are {} "
          "nodes",
          i, child, child + 1, num_nodes);
    }
    const float p = plane(node);
    const float lo = at(visit.cell.lo, axis(node)), hi = at(visit.cell.hi, axis(node));
    if (!(p >= lo && p <= hi)) {
      fail_invalid("node {} of the kd-tree splits at {}, outside of its cell from {} to {}", i, p, lo, hi);
    }
    Visit below = {uint32_t(child), visit.depth + 1, visit.cell},
          above = {uint32_t(child + 1), visit.depth + 1, visit.cell};
    set(below.cell.hi, axis(node), p);
    set(above.cell.lo, axis(node), p);
    todo.push_back(above);
    todo.push_back(below);
  }
  if (num_reached != num_nodes) {
    uint64_t i = 0;
    while (is_reached[i]) ++i;
    fail_invalid("node {} of the kd-tree is never reached", i);
  }
  return depth;
}

}  // namespace gpurt
