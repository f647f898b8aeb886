#include "accel/bvh_layout.h"

#include <tbb/parallel_for.h>

#include <algorithm>

#include "accel/bvh_split.h"

namespace gpurt {

void lay_out_bvh(BvhBuildTree &whole, double traversal_cost, const std::shared_ptr<MemoryTracker> &memory,
                 HostBvh &tree, BvhBuildStats &stats)
{
  constexpr const char *what = "laying out the bvh";
  const uint64_t num_nodes = whole.nodes.size(), num_references = whole.references.size();
  const Reservation final_arrays(memory, num_nodes * sizeof(BvhNode) + num_references * sizeof(uint32_t),
                                 what);
  TrackedArray<uint32_t> order(memory, num_nodes, what);
  tree.references.reserve(num_references);
  // Of the rays that meet the tree, those that meet a box; all, where nothing has an area.
  const double root_area = half_area(tree.bounds);
  const auto share = [&](const Box &box) { return root_area > 0 ? half_area(box) / root_area : 1.0; };
  // What is left to be laid out, and the child's word to be told where it lies.
  struct Todo {
    uint32_t word;
    uint32_t depth;
    double share;
    uint32_t *parent;
  };
  std::vector<Todo> todo = {{whole.root, 0, share(tree.bounds), &tree.root}};
  uint32_t num_placed = 0;
  while (!todo.empty()) {
    const Todo next = todo.back();
    todo.pop_back();
    stats.depth = std::max(stats.depth, next.depth);
    if (is_bvh_leaf(next.word)) {
      const uint32_t first = uint32_t(tree.references.size()), count = leaf_size(next.word);
      const uint32_t *leaf = whole.references.data() + leaf_first(next.word);
      tree.references.insert(tree.references.end(), leaf, leaf + count);
      *next.parent = bvh_leaf(first, count);
      stats.sah_cost += next.share * double(count);
      continue;
    }
    BvhBuildNode &node = whole.nodes[next.word];
    if (half_area(node.box[1]) > half_area(node.box[0])) {
      std::swap(node.box[0], node.box[1]);
      std::swap(node.child[0], node.child[1]);
    }
    *next.parent = num_placed;
    order[num_placed++] = next.word;
    stats.sah_cost += next.share * traversal_cost;
    for (int s = 1; s >= 0; --s)
      todo.push_back({node.child[s], next.depth + 1, share(node.box[s]), &node.child[s]});
  }
  tree.nodes.resize(num_nodes);
  tbb::parallel_for(uint64_t(0), num_nodes, [&](uint64_t i) {
    const BvhBuildNode &node = whole.nodes[order[i]];
    tree.nodes[i] = make_bvh_node(node.box[0], node.child[0], node.box[1], node.child[1], tree.frame);
  });
}

}  // namespace gpurt
