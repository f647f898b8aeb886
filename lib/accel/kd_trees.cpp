#include "accel/kd_trees.h"

#include <tbb/parallel_for.h>

#include <algorithm>

#include "accel/kd_build.h"
#include "accel/kd_cache.h"
#include "accel/kd_check.h"

namespace gpurt {
namespace {

// A placement costs a transform and a traversal of its own: far more than a step.
constexpr float placement_traversal_cost = 0.1f;

class TreesBuilder {
 public:
  TreesBuilder(const CompiledScene &scene, const BuildOptions &options,
               const std::shared_ptr<MemoryTracker> &memory,
               const std::function<void(gpurt_log_level, const std::string &)> &log, uint64_t most_triangles)
      : scene_(scene), options_(options), memory_(memory), log_(log), most_triangles_(most_triangles)
  {}

  KdTrees build()
  {
    facts_.accel = Accel::KdTree;
    facts_.triangle_test = options_.triangle_test;
    std::vector<CachedTree> trees = make_trees();
    KdTrees result;
    for (size_t g = 0; g < scene_.groups.size(); ++g) {
      count_references(trees[g].tree);
      result.groups.push_back(std::move(trees[g].tree));
    }
    result.placements = std::move(trees.back().tree);
    facts_.num_nodes += result.placements.nodes.size();
    result.facts = facts_;
    return result;
  }

 private:
  // An imported tree may carry references that no leaf has.
  void count_references(const HostKdTree &tree)
  {
    facts_.num_nodes += tree.nodes.size();
    for (const KdNode node : tree.nodes) facts_.num_references += is_leaf(node) ? payload(node) : 0;
  }

  KdSource source_of(size_t g) const
  {
    const Group &group = scene_.groups[g];
    KdSource source;
    source.count = group.num_triangles;
    source.positions = scene_.positions.data();
    source.indices = scene_.indices.data() + group.first_triangle;
    return source;
  }

  // The trees of all groups, then that of the placements.
  std::vector<CachedTree> make_trees()
  {
    const size_t num_groups = scene_.groups.size();
    const bool uses_cache = !options_.cache_path.empty() && options_.imported.empty();
    const uint64_t key = uses_cache ? kd_cache_key(scene_.hash, options_) : 0;
    if (uses_cache) {
      std::string reason;
      if (auto trees = read_kd_cache(options_.cache_path, key, reason)) {
        if (are_sound(*trees, reason)) {
          facts_.from_cache = true;
          for (const CachedTree &t : *trees) facts_.sah_cost += t.sah_cost;
          return std::move(*trees);
        }
      }
      log(fmt::format("building the kd-tree: cannot use the cache {}: {}", options_.cache_path, reason));
    }

    std::vector<CachedTree> trees(num_groups + 1);
    std::vector<bool> is_imported(num_groups, false);
    for (const auto &[id, tree] : options_.imported) {
      const size_t g = group_of_tree(scene_, id);
      facts_.tree_depth = std::max(facts_.tree_depth, check_tree(*tree, g));
      trees[g].tree = *tree;
      is_imported[g] = true;
      facts_.from_cache = true;
    }
    const KdBuildSettings settings = {options_.max_depth, options_.traversal_cost, options_.empty_bonus};
    std::vector<KdBuildStats> stats(num_groups + 1);
    tbb::parallel_for(size_t(0), num_groups + 1, [&](size_t g) {
      if (g == num_groups) {
        trees[g].tree = build_placement_tree(stats[g]);
      } else if (!is_imported[g] && scene_.groups[g].num_triangles <= most_triangles_) {
        trees[g].tree = build_kd_tree(source_of(g), settings, memory_, stats[g]);
      }
      trees[g].sah_cost = stats[g].sah_cost;
    });
    for (const KdBuildStats &s : stats) {
      facts_.tree_depth = std::max(facts_.tree_depth, s.depth);
      facts_.sah_cost += s.sah_cost;
    }
    if (uses_cache) write_kd_cache(options_.cache_path, key, trees);
    return trees;
  }

  HostKdTree build_placement_tree(KdBuildStats &stats) const
  {
    std::vector<Box> boxes;
    boxes.reserve(scene_.placements.size());
    for (const Placement &p : scene_.placements) {
      boxes.push_back(scene_.groups[p.group].num_triangles == 0 ? empty_box() : p.bounds);
    }
    KdSource source;
    source.count = boxes.size();
    source.boxes = boxes.data();
    KdBuildSettings settings;
    settings.traversal_cost = placement_traversal_cost;
    return build_kd_tree(source, settings, memory_, stats);
  }

  // `g` one past the last group: the tree of the placements.
  uint32_t check_tree(const HostKdTree &tree, size_t g) const
  {
    if (g == scene_.groups.size()) {
      return check_kd_tree(tree, scene_.placements.size(),
                           [&](uint32_t p) { return scene_.placements[p].bounds; });
    }
    const KdSource source = source_of(g);
    return check_kd_tree(tree, source.count, [&](uint32_t t) {
      const UInt3 c = source.indices[t];
      return extend(extend(Box{source.positions[c.x], source.positions[c.x]}, source.positions[c.y]),
                    source.positions[c.z]);
    });
  }

  bool are_sound(const std::vector<CachedTree> &trees, std::string &reason)
  {
    const size_t num_groups = scene_.groups.size();
    if (trees.size() != num_groups + 1) {
      reason = "it has another number of trees";
      return false;
    }
    try {
      for (size_t g = 0; g <= num_groups; ++g) {
        facts_.tree_depth = std::max(facts_.tree_depth, check_tree(trees[g].tree, g));
      }
    } catch (const Error &error) {
      reason = error.what();
      facts_.tree_depth = 0;
      return false;
    }
    return true;
  }

  void log(const std::string &message) const
  {
    if (log_) log_(GPURT_LOG_INFO, message);
  }

  const CompiledScene &scene_;
  const BuildOptions &options_;
  const std::shared_ptr<MemoryTracker> &memory_;
  const std::function<void(gpurt_log_level, const std::string &)> &log_;
  const uint64_t most_triangles_;
  AccelFacts facts_;
};

}  // namespace

KdTrees build_kd_trees(const CompiledScene &scene, const BuildOptions &options,
                       const std::shared_ptr<MemoryTracker> &memory,
                       const std::function<void(gpurt_log_level, const std::string &)> &log,
                       uint64_t most_triangles)
{
  return TreesBuilder(scene, options, memory, log, most_triangles).build();
}

size_t group_of_tree(const CompiledScene &scene, uint32_t tree)
{
  if (tree == 0) return 0;
  const auto &geometry = scene.group_geometry;
  for (size_t g = 1; g < geometry.size(); ++g) {
    if (geometry[g] == tree - 1) return g;
  }
  fail_invalid("there is no kd-tree {}: geometry {} is not placed more than once", tree, tree - 1);
}

}  // namespace gpurt
