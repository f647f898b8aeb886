// The kd-tree accelerator: trees of all groups, built, imported or read from a cache, in the layout of kd_view.h.
#include <tbb/parallel_for.h>

#include <algorithm>

#include "cpu/accel/accelerator.h"
#include "cpu/accel/kd_build.h"
#include "cpu/accel/kd_cache.h"
#include "cpu/accel/kd_check.h"
#include "cpu/accel/tracked_array.h"
#include "cpu/kernels.h"

namespace gpurt {
namespace {

constexpr const char *tree_memory = "the kd-tree";

// A placement costs a transform and a traversal of its own: far more than a step.
constexpr float placement_traversal_cost = 0.1f;

uint64_t num_blocks(uint64_t num_triangles)
{
  return (num_triangles + triangles_per_block - 1) / triangles_per_block;
}

// One group's tree in the CPU's layout.
class GroupTree {
 public:
  GroupTree() = default;
  GroupTree(const HostKdTree &tree, const CompiledScene &scene, const Group &group,
            const std::shared_ptr<MemoryTracker> &memory)
      : bounds_(tree.bounds), nodes_(memory, tree.nodes.size(), tree_memory)
  {
    const uint64_t num_nodes = tree.nodes.size();
    uint64_t next_block = 0;
    for (uint64_t i = 0; i < num_nodes; ++i) {
      KdNode node = tree.nodes[i];
      if (is_leaf(node)) {
        node.word = uint32_t(next_block);
        next_block += num_blocks(payload(node));
        num_references_ += payload(node);
      }
      nodes_[i] = node;
    }
    if (next_block > 0xffffffffu) {
      fail(GPURT_ERROR_UNSUPPORTED, "the kd-tree's leaves hold {} blocks of triangles and can hold 2^32 - 1",
           next_block);
    }
    blocks_ = TrackedArray<TriangleBlock>(memory, next_block, tree_memory);
    tbb::parallel_for(uint64_t(0), num_nodes, [&](uint64_t i) {
      if (!is_leaf(nodes_[i])) return;
      const uint32_t first = tree.nodes[i].word, count = payload(nodes_[i]);
      for (uint32_t n = 0; n < num_blocks(count) * triangles_per_block; ++n) {
        const uint32_t triangle = group.first_triangle + tree.references[first + std::min(n, count - 1)];
        TriangleBlock &block = blocks_[nodes_[i].word + n / triangles_per_block];
        const uint32_t lane = n % triangles_per_block;
        const UInt3 corner = scene.indices[triangle];
        const Vec3f p[3] = {scene.positions[corner.x], scene.positions[corner.y], scene.positions[corner.z]};
        for (int c = 0; c < 3; ++c) {
          for (int k = 0; k < 3; ++k) block.corner[c][k][lane] = at(p[c], k);
        }
        block.triangle[lane] = triangle;
      }
    });
  }

  CpuKdGroup view() const
  {
    return {{nodes_.data(), nullptr, bounds_, uint32_t(nodes_.size())}, blocks_.data()};
  }
  uint64_t bytes() const { return nodes_.bytes() + blocks_.bytes(); }
  uint64_t num_nodes() const { return nodes_.size(); }
  uint64_t num_references() const { return num_references_; }

  HostKdTree to_host(const Group &group) const
  {
    HostKdTree tree;
    tree.bounds = bounds_;
    tree.num_triangles = group.num_triangles;
    tree.nodes.assign(nodes_.data(), nodes_.data() + nodes_.size());
    tree.references.reserve(num_references_);
    for (KdNode &node : tree.nodes) {
      if (!is_leaf(node)) continue;
      const uint32_t first_block = node.word, count = payload(node);
      node.word = count == 0 ? 0 : uint32_t(tree.references.size());
      for (uint32_t n = 0; n < count; ++n) {
        const TriangleBlock &block = blocks_[first_block + n / triangles_per_block];
        tree.references.push_back(block.triangle[n % triangles_per_block] - group.first_triangle);
      }
    }
    return tree;
  }

 private:
  Box bounds_{};
  TrackedArray<KdNode> nodes_;
  TrackedArray<TriangleBlock> blocks_;
  uint64_t num_references_ = 0;
};

class KdAccelerator final : public Accelerator {
 public:
  KdAccelerator(const AccelContext &context, const BuildOptions &options)
      : scene_(context.scene), memory_(context.memory), log_(context.log)
  {
    const size_t num_groups = scene_->groups.size();
    facts_.accel = Accel::KdTree;
    facts_.triangle_test = options.triangle_test;
    std::vector<CachedTree> trees = make_trees(options);
    groups_.resize(num_groups);
    tbb::parallel_for(size_t(0), num_groups, [&](size_t g) {
      groups_[g] = GroupTree(trees[g].tree, *scene_, scene_->groups[g], memory_);
      trees[g].tree = {};
    });
    placements_ = std::move(trees[num_groups].tree);
    views_reservation_ =
        Reservation(memory_,
                    num_groups * sizeof(CpuKdGroup) + placements_.nodes.size() * sizeof(KdNode) +
                        placements_.references.size() * 4,
                    tree_memory);

    for (const GroupTree &g : groups_) {
      views_.push_back(g.view());
      facts_.accel_bytes += g.bytes();
      facts_.num_nodes += g.num_nodes();
      facts_.num_references += g.num_references();
    }
    facts_.accel_bytes += views_reservation_.bytes();
    facts_.num_nodes += placements_.nodes.size();
    view_.groups = views_.data();
    view_.placements = {placements_.nodes.data(), placements_.references.data(), placements_.bounds,
                        uint32_t(placements_.nodes.size())};
    view_.scene = scene_->view();
    const bool has_placements = !placements_.nodes.empty();
    kernels_ = &cpu_kernels().trace(options.triangle_test, scene_->has_alpha_masks, has_placements);
    queries_ = {&view_, kernels_->closest, kernels_->occluded};
  }

  const CpuAccel &queries() const override { return queries_; }
  void all(const Ray &ray, void *user, void (*sink)(void *, const Hit &)) const override
  {
    kernels_->all(queries_, ray, user, sink);
  }
  const AccelFacts &facts() const override { return facts_; }

  HostKdTree export_tree(uint32_t tree) const override
  {
    const size_t g = group_of(tree);
    return groups_[g].to_host(scene_->groups[g]);
  }

 private:
  // Tree 0 is group 0, tree 1 + g the group of shared geometry g.
  size_t group_of(uint32_t tree) const
  {
    if (tree == 0) return 0;
    const auto &geometry = scene_->group_geometry;
    for (size_t g = 1; g < geometry.size(); ++g) {
      if (geometry[g] == tree - 1) return g;
    }
    fail_invalid("there is no kd-tree {}: geometry {} is not placed more than once", tree, tree - 1);
  }

  KdSource source_of(size_t g) const
  {
    const Group &group = scene_->groups[g];
    KdSource source;
    source.count = group.num_triangles;
    source.positions = scene_->positions.data();
    source.indices = scene_->indices.data() + group.first_triangle;
    return source;
  }

  // The trees of all groups, then that of the placements.
  std::vector<CachedTree> make_trees(const BuildOptions &options)
  {
    const size_t num_groups = scene_->groups.size();
    const bool uses_cache = !options.cache_path.empty() && options.imported.empty();
    const uint64_t key = uses_cache ? kd_cache_key(scene_->hash, options) : 0;
    if (uses_cache) {
      std::string reason;
      if (auto trees = read_kd_cache(options.cache_path, key, reason)) {
        if (are_sound(*trees, reason)) {
          facts_.from_cache = true;
          for (const CachedTree &t : *trees) facts_.sah_cost += t.sah_cost;
          return std::move(*trees);
        }
      }
      log(fmt::format("building the kd-tree: cannot use the cache {}: {}", options.cache_path, reason));
    }

    std::vector<CachedTree> trees(num_groups + 1);
    std::vector<bool> is_imported(num_groups, false);
    for (const auto &[id, tree] : options.imported) {
      const size_t g = group_of(id);
      facts_.tree_depth = std::max(facts_.tree_depth, check_tree(*tree, g));
      trees[g].tree = *tree;
      is_imported[g] = true;
      facts_.from_cache = true;
    }
    const KdBuildSettings settings = {options.max_depth, options.traversal_cost, options.empty_bonus};
    std::vector<KdBuildStats> stats(num_groups + 1);
    tbb::parallel_for(size_t(0), num_groups + 1, [&](size_t g) {
      if (g == num_groups) {
        trees[g].tree = build_placement_tree(stats[g]);
      } else if (!is_imported[g]) {
        trees[g].tree = build_kd_tree(source_of(g), settings, memory_, stats[g]);
      }
      trees[g].sah_cost = stats[g].sah_cost;
    });
    for (const KdBuildStats &s : stats) {
      facts_.tree_depth = std::max(facts_.tree_depth, s.depth);
      facts_.sah_cost += s.sah_cost;
    }
    if (uses_cache) write_kd_cache(options.cache_path, key, trees);
    return trees;
  }

  HostKdTree build_placement_tree(KdBuildStats &stats) const
  {
    std::vector<Box> boxes;
    boxes.reserve(scene_->placements.size());
    for (const Placement &p : scene_->placements) {
      boxes.push_back(scene_->groups[p.group].num_triangles == 0 ? empty_box() : p.bounds);
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
    if (g == scene_->groups.size()) {
      return check_kd_tree(tree, scene_->placements.size(),
                           [&](uint32_t p) { return scene_->placements[p].bounds; });
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
    const size_t num_groups = scene_->groups.size();
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

  std::shared_ptr<const CompiledScene> scene_;
  std::shared_ptr<MemoryTracker> memory_;
  std::function<void(gpurt_log_level, const std::string &)> log_;
  std::vector<GroupTree> groups_;
  HostKdTree placements_;
  Reservation views_reservation_;
  std::vector<CpuKdGroup> views_;
  CpuKdView view_{};
  const TraceKernels *kernels_ = nullptr;
  CpuAccel queries_{};
  AccelFacts facts_;
};

}  // namespace

std::unique_ptr<Accelerator> make_kd_accelerator(const AccelContext &context, const BuildOptions &options)
{
  return std::make_unique<KdAccelerator>(context, options);
}

}  // namespace gpurt
