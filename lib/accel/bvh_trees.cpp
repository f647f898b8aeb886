#include "accel/bvh_trees.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace gpurt {

BvhTrees build_bvh_trees(const CompiledScene &scene, TriangleTest triangle_test,
                         const std::shared_ptr<MemoryTracker> &memory, uint64_t most_triangles)
{
  const size_t num_groups = scene.groups.size();
  std::vector<Box> boxes;
  boxes.reserve(scene.placements.size());
  for (const Placement &p : scene.placements)
    boxes.push_back(scene.groups[p.group].num_triangles == 0 ? empty_box() : p.bounds);

  BvhTrees trees;
  trees.groups.resize(num_groups);
  std::vector<BvhBuildStats> stats(num_groups + 1);
  tbb::parallel_for(size_t(0), num_groups + 1, [&](size_t g) {
    KdSource source;
    if (g == num_groups) {
      source.count = boxes.size();
      source.boxes = boxes.data();
      trees.placements = build_bvh(source, memory, stats[g]);
    } else {
      const Group &group = scene.groups[g];
      if (group.num_triangles > most_triangles) return;
      source.count = group.num_triangles;
      source.positions = scene.positions.data();
      source.indices = scene.indices.data() + group.first_triangle;
      trees.groups[g] = build_bvh(source, memory, stats[g]);
    }
  });
  AccelFacts &facts = trees.facts;
  facts.accel = Accel::Bvh;
  facts.triangle_test = triangle_test;
  for (const HostBvh &tree : trees.groups) {
    facts.num_nodes += tree.nodes.size();
    facts.num_references += tree.references.size();
  }
  facts.num_nodes += trees.placements.nodes.size();
  for (const BvhBuildStats &s : stats) {
    facts.tree_depth = std::max(facts.tree_depth, s.depth);
    facts.sah_cost += s.sah_cost;
  }
  return trees;
}

void refuse_bvh_export()
{
  fail_invalid(
      "the scene was committed with bvh, which has no kd-tree to export; commit with the kdtree accelerator");
}

}  // namespace gpurt
