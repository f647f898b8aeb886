// The kd-tree accelerator: trees of all groups, built, imported or read from a cache, in the layout of kd_view.h.
#include <tbb/parallel_for.h>

#include <algorithm>

#include "accel/kd_trees.h"
#include "accel/tracked_array.h"
#include "cpu/accel/accelerator.h"
#include "cpu/accel/fill_blocks.h"
#include "cpu/kernels.h"

namespace gpurt {
namespace {

constexpr const char *tree_memory = "the kd-tree";

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
      if (count == 0) return;
      fill_blocks(scene, group.first_triangle, tree.references.data() + first, count,
                  blocks_.data() + nodes_[i].word);
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
      : scene_(context.scene), memory_(context.memory)
  {
    const size_t num_groups = scene_->groups.size();
    KdTrees trees = build_kd_trees(*scene_, options, memory_, context.log);
    facts_ = trees.facts;
    groups_.resize(num_groups);
    tbb::parallel_for(size_t(0), num_groups, [&](size_t g) {
      groups_[g] = GroupTree(trees.groups[g], *scene_, scene_->groups[g], memory_);
      trees.groups[g] = {};
    });
    placements_ = std::move(trees.placements);
    views_reservation_ =
        Reservation(memory_,
                    num_groups * sizeof(CpuKdGroup) + placements_.nodes.size() * sizeof(KdNode) +
                        placements_.references.size() * 4,
                    tree_memory);

    for (const GroupTree &g : groups_) {
      views_.push_back(g.view());
      facts_.accel_bytes += g.bytes();
    }
    facts_.accel_bytes += views_reservation_.bytes();
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
    const size_t g = group_of_tree(*scene_, tree);
    return groups_[g].to_host(scene_->groups[g]);
  }

 private:
  std::shared_ptr<const CompiledScene> scene_;
  std::shared_ptr<MemoryTracker> memory_;
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
