#include "accel/bvh_build.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_invoke.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <bit>

#include "accel/build_references.h"
#include "accel/bvh_layout.h"
#include "accel/bvh_split.h"

namespace gpurt {
namespace {

constexpr const char *build_memory = "building the bvh";

// Nodes with more references than this are split by several threads, those with fewer by one task each. The nodes' order
// depends on it, and on nothing that differs between machines.
constexpr uint64_t task_size = 4096;

// Of a step, in tests of a primitive. A step costs about as much as a triangle test; the optimum is flat. A placement
// costs a transform and a traversal of its own: far more.
constexpr double triangle_traversal_cost = 1.0, placement_traversal_cost = 0.1;
// Splits in space are tried where the children of the best split by object overlap by more than this share of the root:
// with ten times less, trees of regular meshes take twice as long and are no better.
// Source: Stich et al. 2009.
constexpr double min_overlap = 1e-4;

// A node to be built.
struct Part {
  BvhExtent extent;
  uint32_t depth;
  uint64_t spare;  // references that splits in space may add below it
};

// A finished part of the tree: nodes and references depth first, counted from the part's first.
struct Subtree {
  uint32_t root = bvh_empty;
  std::vector<BvhBuildNode> nodes;
  std::vector<uint32_t> references;
  Reservation reservation;
};

// The upper part of the tree while it is built.
struct UpperNode {
  Box box[2];
  std::unique_ptr<UpperNode> child[2];
  std::unique_ptr<Subtree> subtree;  // instead of children
};

BvhExtent measure(const KdReference *references, uint64_t count)
{
  BvhExtent extent = BvhExtent::empty();
  for (uint64_t i = 0; i < count; ++i) extent.add(references[i]);
  return extent;
}

BvhExtent measure_in_parallel(const References &references)
{
  return tbb::parallel_reduce(
      tbb::blocked_range<uint64_t>(0, references.size(), partition_grain), BvhExtent::empty(),
      [&](const tbb::blocked_range<uint64_t> &range, BvhExtent extent) {
        extent.add(measure(references.data() + range.begin(), range.size()));
        return extent;
      },
      [](BvhExtent a, const BvhExtent &b) {
        a.add(b);
        return a;
      });
}

class Builder {
 public:
  Builder(const KdSource &source, const std::shared_ptr<MemoryTracker> &memory)
      : source_(source),
        memory_(memory),
        traversal_cost_(source.boxes != nullptr ? placement_traversal_cost : triangle_traversal_cost)
  {}

  HostBvh build(BvhBuildStats &stats)
  {
    if (source_.count > bvh_max_references) {
      fail(GPURT_ERROR_UNSUPPORTED,
           "a bvh can refer to {} primitives, not {}; split the geometry or use the kdtree accelerator",
           bvh_max_references, source_.count);
    }
    References references = make_references(source_, memory_, build_memory);
    HostBvh tree;
    const uint64_t count = references.size();
    if (count == 0) return tree;
    const BvhExtent extent = measure_in_parallel(references);
    tree.bounds = extent.bounds;
    tree.frame = make_bvh_frame(extent.bounds);
    root_area_ = half_area(extent.bounds);
    const uint64_t most = std::min(count * bvh_max_references_per_primitive, uint64_t(bvh_max_references));
    const Part root = {extent, 0, source_.boxes != nullptr ? 0 : most - count};
    std::unique_ptr<UpperNode> top = build_upper(std::move(references), root);
    BvhBuildTree whole = join(*top);
    top.reset();
    {
      const Reservation reinserting(memory_, whole.nodes.size() * reinsert_bytes_per_node, build_memory);
      reinsert(whole.nodes.data(), whole.nodes.size(), whole.root);
    }
    lay_out_bvh(whole, traversal_cost_, memory_, tree, stats);
    return tree;
  }

 private:
  // Memory that a thread keeps from task to task: references of the nodes on the way down, as a stack of blocks.
  struct Scratch {
    std::vector<std::unique_ptr<KdReference[]>> blocks;
  };

  // Halving by number alone still reaches single references from here, and depth does not allow more.
  static bool must_halve(uint64_t count, uint32_t depth)
  {
    return uint32_t(bvh_max_depth) - depth <= uint32_t(std::bit_width(count - 1));
  }

  // None: a leaf, or, where there are too many references for one, halves.
  BvhSplit choose_split(const KdReference *references, uint64_t count, const Part &part) const
  {
    BvhSplit none;
    if (count == 1) return none;
    Box side[2];
    BvhSplit best;
    if (!must_halve(count, part.depth)) {
      best = find_object_split(references, count, part.extent, side);
      if (part.spare != 0) {
        const Box overlap = {max(side[0].lo, side[1].lo), min(side[0].hi, side[1].hi)};
        if (best.kind == BvhSplitKind::None || half_area(overlap) > min_overlap * root_area_) {
          const BvhSplit spatial = find_spatial_split(source_, references, count, part.extent, part.spare);
          if (spatial.kind != BvhSplitKind::None &&
              (best.kind == BvhSplitKind::None || spatial.cost < best.cost))
            best = spatial;
        }
      }
    }
    const double area = half_area(part.extent.bounds);
    if (count <= bvh_max_leaf_size &&
        (best.kind == BvhSplitKind::None || area * double(count) <= area * traversal_cost_ + best.cost))
      return none;
    return best;
  }

  enum class Side { First, Second, Both };
  static Side side_of(const KdReference &r, const BvhSplit &split)
  {
    const double lo = at(r.lo, split.axis), hi = at(r.hi, split.axis);
    if (split.kind == BvhSplitKind::Object)
      return bin_of(split, lo + hi) <= split.bin ? Side::First : Side::Second;
    if (bin_of(split, hi) <= split.bin) return Side::First;
    return bin_of(split, lo) > split.bin ? Side::Second : Side::Both;
  }

  // Appends the references of both sides; returns their numbers.
  void partition(const KdReference *references, uint64_t count, const BvhSplit &split, KdReference *out[2],
                 uint64_t num[2]) const
  {
    num[0] = num[1] = 0;
    for (uint64_t i = 0; i < count; ++i) {
      const KdReference &r = references[i];
      switch (side_of(r, split)) {
        case Side::First:
          out[0][num[0]++] = r;
          break;
        case Side::Second:
          out[1][num[1]++] = r;
          break;
        case Side::Both: {
          Box part[2];
          cut_reference(source_, r, split.axis, split.position, part);
          for (int s = 0; s < 2; ++s) {
            if (!is_empty(part[s])) out[s][num[s]++] = {part[s].lo, r.id, part[s].hi, 0};
          }
        }
      }
    }
  }

  // The half with the smaller centres along the longest extent of centres, of equal ones those that come first.
  static void halve(const KdReference *references, uint64_t count, const BvhExtent &extent,
                    KdReference *out[2], uint64_t num[2])
  {
    int axis = 0;
    for (int k = 1; k < 3; ++k) {
      if (extent.hi[k] - extent.lo[k] > extent.hi[axis] - extent.lo[axis]) axis = k;
    }
    std::vector<std::pair<double, uint64_t>> order(count);
    for (uint64_t i = 0; i < count; ++i)
      order[i] = {double(at(references[i].lo, axis)) + at(references[i].hi, axis), i};
    num[0] = count / 2;
    num[1] = count - num[0];
    std::nth_element(order.begin(), order.begin() + ptrdiff_t(num[0]), order.end());
    const auto [median, median_index] = order[num[0]];
    uint64_t next[2] = {0, 0};
    for (uint64_t i = 0; i < count; ++i) {
      const std::pair key = {double(at(references[i].lo, axis)) + at(references[i].hi, axis), i};
      const int s = key < std::pair(median, median_index) ? 0 : 1;
      out[s][next[s]++] = references[i];
    }
  }

  // Upper bounds of the numbers that partition() will write.
  static void count_sides(const KdReference *references, uint64_t count, const BvhSplit &split,
                          uint64_t num[2])
  {
    num[0] = num[1] = 0;
    for (uint64_t i = 0; i < count; ++i) {
      const Side side = side_of(references[i], split);
      num[0] += side != Side::Second;
      num[1] += side != Side::First;
    }
  }

  // What the budget leaves over is shared out in proportion to the references.
  static void make_children(const Part &part, uint64_t count, const BvhExtent extent[2],
                            const uint64_t num[2], Part child[2])
  {
    const uint64_t used = num[0] + num[1], added = used > count ? used - count : 0;
    const uint64_t spare = part.spare - added;
    const uint64_t first = std::min(spare, uint64_t(double(spare) * (double(num[0]) / double(used))));
    child[0] = {extent[0], part.depth + 1, first};
    child[1] = {extent[1], part.depth + 1, spare - first};
  }

  // ---- Large nodes: one task a child, loops over references in parallel.

  std::unique_ptr<UpperNode> build_upper(References references, const Part &part)
  {
    auto node = std::make_unique<UpperNode>();
    const uint64_t count = references.size();
    if (count <= task_size) {
      node->subtree = build_subtree(references.data(), count, part);
      return node;
    }
    const BvhSplit split = choose_split(references.data(), count, part);
    References child[2];
    if (split.kind != BvhSplitKind::None) {
      partition_in_parallel(
          references, memory_, build_memory,
          [&](const KdReference *r, uint64_t n, uint64_t num[2]) { count_sides(r, n, split, num); },
          [&](const KdReference *r, uint64_t n, KdReference *out[2], uint64_t num[2]) {
            partition(r, n, split, out, num);
          },
          child);
    }
    if (child[0].size() == 0 || child[1].size() == 0) {
      KdReference *out[2];
      uint64_t num[2];
      for (int s = 0; s < 2; ++s) {
        child[s] = References(memory_, s == 0 ? count / 2 : count - count / 2, build_memory);
        out[s] = child[s].data();
      }
      const Reservation order(memory_, count * 16, build_memory);
      halve(references.data(), count, part.extent, out, num);
    }
    references.free();
    const BvhExtent extent[2] = {measure_in_parallel(child[0]), measure_in_parallel(child[1])};
    const uint64_t num[2] = {child[0].size(), child[1].size()};
    Part child_part[2];
    make_children(part, count, extent, num, child_part);
    for (int s = 0; s < 2; ++s) node->box[s] = extent[s].bounds;
    tbb::parallel_invoke([&] { node->child[0] = build_upper(std::move(child[0]), child_part[0]); },
                         [&] { node->child[1] = build_upper(std::move(child[1]), child_part[1]); });
    return node;
  }

  // ---- Small nodes: one thread, depth first.

  std::unique_ptr<Subtree> build_subtree(const KdReference *references, uint64_t count, const Part &part)
  {
    auto out = std::make_unique<Subtree>();
    out->nodes.reserve(count);
    out->references.reserve(count + count / 4);
    out->root = build_node(*out, references, count, part, scratch_.local(), 0);
    out->nodes.shrink_to_fit();
    out->references.shrink_to_fit();
    out->reservation = Reservation(
        memory_, out->nodes.size() * sizeof(BvhBuildNode) + out->references.size() * sizeof(uint32_t),
        build_memory);
    return out;
  }

  static uint32_t add_leaf(Subtree &out, const KdReference *references, uint64_t count)
  {
    const uint32_t first = uint32_t(out.references.size());
    for (uint64_t i = 0; i < count; ++i) out.references.push_back(references[i].id);
    return bvh_leaf(first, uint32_t(count));
  }

  // `level` counts from the subtree's root: every level has a block of its own for the references of both children.
  // Returns the word by which a parent refers to the node.
  uint32_t build_node(Subtree &out, const KdReference *references, uint64_t count, const Part &part,
                      Scratch &scratch, uint32_t level) const
  {
    const BvhSplit split = choose_split(references, count, part);
    if (split.kind == BvhSplitKind::None && count <= bvh_max_leaf_size)
      return add_leaf(out, references, count);
    // Side by side in the block, which has room for every reference on both sides.
    if (scratch.blocks.size() <= level) scratch.blocks.resize(level + 1);
    if (scratch.blocks[level] == nullptr) scratch.blocks[level].reset(new KdReference[2 * task_size]);
    KdReference *side[2] = {scratch.blocks[level].get(), scratch.blocks[level].get() + task_size};
    uint64_t num[2] = {0, 0};
    if (split.kind != BvhSplitKind::None) partition(references, count, split, side, num);
    if (num[0] == 0 || num[1] == 0) halve(references, count, part.extent, side, num);
    const BvhExtent extent[2] = {measure(side[0], num[0]), measure(side[1], num[1])};
    Part child[2];
    make_children(part, count, extent, num, child);
    const uint32_t slot = uint32_t(out.nodes.size());
    out.nodes.emplace_back();
    const uint32_t first = build_node(out, side[0], num[0], child[0], scratch, level + 1);
    const uint32_t second = build_node(out, side[1], num[1], child[1], scratch, level + 1);
    out.nodes[slot] = {{extent[0].bounds, extent[1].bounds}, {first, second}};
    return slot;
  }

  // ---- All parts in one tree.

  struct Piece {
    Subtree *subtree;
    uint64_t first_node, first_reference;

    uint32_t relocated(uint32_t child) const
    {
      return child + uint32_t(is_bvh_leaf(child) ? first_reference : first_node);
    }
  };

  struct Layout {
    std::vector<Piece> pieces;
    std::vector<std::pair<uint64_t, BvhBuildNode>> upper;
    uint64_t num_nodes = 0, num_references = 0;
  };

  BvhBuildTree join(UpperNode &top) const
  {
    Layout layout;
    BvhBuildTree whole;
    whole.root = place(top, layout);
    whole.nodes = TrackedArray<BvhBuildNode>(memory_, layout.num_nodes, build_memory);
    whole.references = TrackedArray<uint32_t>(memory_, layout.num_references, build_memory);
    for (const auto &[slot, node] : layout.upper) whole.nodes[slot] = node;
    tbb::parallel_for(size_t(0), layout.pieces.size(), [&](size_t i) {
      const Piece &piece = layout.pieces[i];
      const Subtree &part = *piece.subtree;
      for (uint64_t n = 0; n < part.nodes.size(); ++n) {
        BvhBuildNode node = part.nodes[n];
        for (uint32_t &child : node.child) child = piece.relocated(child);
        whole.nodes[piece.first_node + n] = node;
      }
      std::copy(part.references.begin(), part.references.end(),
                whole.references.data() + piece.first_reference);
      *piece.subtree = {};
    });
    return whole;
  }

  // Gives every part its place, in depth-first order; returns the word by which its parent refers to it.
  static uint32_t place(UpperNode &node, Layout &layout)
  {
    if (node.subtree) {
      Subtree &s = *node.subtree;
      layout.pieces.push_back({&s, layout.num_nodes, layout.num_references});
      layout.num_nodes += s.nodes.size();
      layout.num_references += s.references.size();
      return layout.pieces.back().relocated(s.root);
    }
    const uint64_t slot = layout.num_nodes++;
    const uint32_t first = place(*node.child[0], layout), second = place(*node.child[1], layout);
    layout.upper.push_back({slot, {{node.box[0], node.box[1]}, {first, second}}});
    return uint32_t(slot);
  }

  const KdSource &source_;
  const std::shared_ptr<MemoryTracker> &memory_;
  const double traversal_cost_;
  double root_area_ = 0;
  tbb::enumerable_thread_specific<Scratch> scratch_;
};

}  // namespace

HostBvh build_bvh(const KdSource &source, const std::shared_ptr<MemoryTracker> &memory, BvhBuildStats &stats)
{
  stats = {};
  return Builder(source, memory).build(stats);
}

}  // namespace gpurt
