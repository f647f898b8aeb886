// The bvh accelerator: trees of all groups in the layout of bvh_view.h.
#include <tbb/parallel_for.h>

#include "accel/bvh_trees.h"
#include "accel/tracked_array.h"
#include "cpu/accel/accelerator.h"
#include "cpu/accel/bvh_view.h"
#include "cpu/accel/fill_blocks.h"
#include "cpu/kernels.h"

namespace gpurt {
namespace {

constexpr const char *tree_memory = "the bvh";

// One group's tree in the CPU's layout.
class GroupBvh {
 public:
  GroupBvh() = default;
  GroupBvh(const HostBvh &tree, const CompiledScene &scene, const Group &group,
           const std::shared_ptr<MemoryTracker> &memory)
      : bounds_(tree.bounds), frame_(tree.frame), nodes_(memory, tree.nodes.size(), tree_memory)
  {
    const uint64_t num_nodes = tree.nodes.size();
    uint64_t next_block = 0;
    struct Leaf {
      uint32_t word, first_block;
    };
    std::vector<Leaf> leaves;
    const auto give_blocks = [&](uint32_t child) {
      if (child == bvh_empty || !is_bvh_leaf(child)) return child;
      const uint32_t first_block = uint32_t(next_block);
      leaves.push_back({child, first_block});
      next_block += num_blocks(leaf_size(child));
      return bvh_leaf(first_block, leaf_size(child));
    };
    root_ = give_blocks(tree.root);
    for (uint64_t i = 0; i < num_nodes; ++i) {
      BvhNode node = tree.nodes[i];
      node.child0 = give_blocks(node.child0);
      node.child1 = give_blocks(node.child1);
      nodes_[i] = node;
    }
    blocks_ = TrackedArray<TriangleBlock>(memory, next_block, tree_memory);
    tbb::parallel_for(size_t(0), leaves.size(), [&](size_t i) {
      const Leaf &leaf = leaves[i];
      fill_blocks(scene, group.first_triangle, tree.references.data() + leaf_first(leaf.word),
                  leaf_size(leaf.word), blocks_.data() + leaf.first_block);
    });
  }

  CpuBvhGroup view() const { return {{nodes_.data(), nullptr, bounds_, frame_, root_}, blocks_.data()}; }
  uint64_t bytes() const { return nodes_.bytes() + blocks_.bytes(); }

 private:
  Box bounds_{};
  BvhFrame frame_{};
  uint32_t root_ = bvh_empty;
  TrackedArray<BvhNode> nodes_;
  TrackedArray<TriangleBlock> blocks_;
};

class BvhAccelerator final : public Accelerator {
 public:
  BvhAccelerator(const AccelContext &context, const BuildOptions &options) : scene_(context.scene)
  {
    const std::shared_ptr<MemoryTracker> &memory = context.memory;
    const size_t num_groups = scene_->groups.size();
    BvhTrees trees = build_bvh_trees(*scene_, options.triangle_test, memory);
    facts_ = trees.facts;
    groups_.resize(num_groups);
    tbb::parallel_for(size_t(0), num_groups, [&](size_t g) {
      groups_[g] = GroupBvh(trees.groups[g], *scene_, scene_->groups[g], memory);
      trees.groups[g] = {};
    });
    placements_ = std::move(trees.placements);
    views_reservation_ =
        Reservation(memory,
                    num_groups * sizeof(CpuBvhGroup) + placements_.nodes.size() * sizeof(BvhNode) +
                        placements_.references.size() * sizeof(uint32_t),
                    tree_memory);
    for (const GroupBvh &g : groups_) {
      views_.push_back(g.view());
      facts_.accel_bytes += g.bytes();
    }
    facts_.accel_bytes += views_reservation_.bytes();
    view_.groups = views_.data();
    view_.placements = {placements_.nodes.data(), placements_.references.data(), placements_.bounds,
                        placements_.frame, placements_.root};
    view_.scene = scene_->view();
    const bool has_placements = placements_.root != bvh_empty;
    kernels_ = &cpu_kernels().bvh(options.triangle_test, scene_->has_alpha_masks, has_placements);
    queries_ = {&view_, kernels_->closest, kernels_->occluded};
  }

  const CpuAccel &queries() const override { return queries_; }
  void all(const Ray &ray, void *user, void (*sink)(void *, const Hit &)) const override
  {
    kernels_->all(queries_, ray, user, sink);
  }
  const AccelFacts &facts() const override { return facts_; }
  HostKdTree export_tree(uint32_t) const override { refuse_bvh_export(); }

 private:
  std::shared_ptr<const CompiledScene> scene_;
  std::vector<GroupBvh> groups_;
  HostBvh placements_;
  Reservation views_reservation_;
  std::vector<CpuBvhGroup> views_;
  CpuBvhView view_{};
  const TraceKernels *kernels_ = nullptr;
  CpuAccel queries_{};
  AccelFacts facts_;
};

}  // namespace

std::unique_ptr<Accelerator> make_bvh_accelerator(const AccelContext &context, const BuildOptions &options)
{
  return std::make_unique<BvhAccelerator>(context, options);
}

}  // namespace gpurt
