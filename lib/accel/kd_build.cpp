#include "accel/kd_build.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "accel/build_references.h"
#include "accel/isa.h"
#include "accel/kd_split.h"
#include "core/accel/clipped_triangle.h"

namespace gpurt {
namespace {

constexpr const char *build_memory = "building the kd-tree";

// Cells with more references than this are split by several threads, those with fewer by one task each. The nodes'
// order depends on it, and on nothing that differs between machines.
constexpr uint64_t task_size = 4096;

// A cell to be built.
struct Cell {
  Box box;
  uint32_t depth;
  uint64_t budget;  // references that its leaves may have together; never less than the cell has
};

// A finished part of the tree: nodes in the order of the final tree, their indices counted from the part's root.
struct Subtree {
  std::vector<KdNode> nodes;
  std::vector<uint32_t> references;
  double cost = 0;
  uint32_t depth = 0;
  Reservation reservation;
};

// The upper part of the tree while it is built.
struct UpperNode {
  KdSplit split{};
  std::unique_ptr<UpperNode> child[2];
  std::unique_ptr<Subtree> subtree;  // instead of children
  double cost = 0;                   // of this step
};

KdNode inner_node(const KdSplit &split, uint32_t first_child)
{
  return {float_bits(split.position), first_child << 2 | uint32_t(split.axis)};
}

Box part_of(const Box &box, const KdSplit &split, int side)
{
  Box part = box;
  set(side == 0 ? part.hi : part.lo, split.axis, split.position);
  return part;
}

Box common_part(const Box &a, const Box &b) { return {max(a.lo, b.lo), min(a.hi, b.hi)}; }

enum class Side { Below, Above, Across };

Side side_of(const KdReference &r, const KdSplit &split)
{
  const float lo = at(r.lo, split.axis), hi = at(r.hi, split.axis);
  if (hi <= split.position && (lo < split.position || split.planar_first)) return Side::Below;
  return lo >= split.position ? Side::Above : Side::Across;
}

class Builder {
 public:
  Builder(const KdSource &source, const KdBuildSettings &settings,
          const std::shared_ptr<MemoryTracker> &memory)
      : source_(source), memory_(memory), kernels_(kd_build_kernels(isa_name()))
  {
    cost_.traversal_cost = settings.traversal_cost > 0 ? settings.traversal_cost : kd_default_traversal_cost;
    cost_.empty_factor = 1.0f - (settings.empty_bonus < 0   ? 0.0f
                                 : settings.empty_bonus > 0 ? settings.empty_bonus
                                                            : kd_default_empty_bonus);
    max_depth_ = settings.max_depth;
  }

  HostKdTree build(KdBuildStats &stats)
  {
    if (source_.count > 0x3fffffffu) {
      fail(GPURT_ERROR_UNSUPPORTED, "a kd-tree can refer to 2^30 - 1 primitives, not {}; split the geometry",
           source_.count);
    }
    References references = make_references(source_, memory_, build_memory);
    bounds_ = empty_box();
    for (uint64_t i = 0; i < references.size(); ++i)
      bounds_ = extend(bounds_, Box{references[i].lo, references[i].hi});
    HostKdTree tree;
    tree.bounds = bounds_;
    tree.num_triangles = source_.count;
    const uint64_t count = references.size();
    if (count == 0) return tree;
    if (max_depth_ == 0) max_depth_ = uint32_t(8.0 + 1.3 * std::log2(double(count)));
    max_depth_ = std::min(max_depth_, uint32_t(kd_max_depth));
    root_area_ = area(bounds_);
    const Cell root = {bounds_, 0, std::min(count * kd_max_references_per_primitive, uint64_t(0xffffffffu))};
    std::unique_ptr<UpperNode> top = build_upper(std::move(references), root);
    return lay_out(std::move(tree), *top, stats);
  }

 private:
  // Memory that a thread keeps from task to task.
  struct Scratch {
    KdSplitScratch split;
    // References of the cells on the way down, as a stack of blocks.
    std::vector<std::unique_ptr<KdReference[]>> blocks;
  };

  double area(const Box &box) const
  {
    const double x = double(box.hi.x) - box.lo.x, y = double(box.hi.y) - box.lo.y,
                 z = double(box.hi.z) - box.lo.z;
    return x * y + y * z + z * x;
  }
  // Share of the rays that meet a cell. A cell without area, in a scene without one, is met by all or none.
  double share(const Box &box) const { return root_area_ > 0 ? area(box) / root_area_ : 1.0; }

  KdSplit choose_split(const KdReference *references, uint64_t count, const Cell &cell,
                       KdSplitScratch &scratch) const
  {
    KdSplit none = {infinity, 0, 0, false};
    if (count == 0 || cell.depth >= max_depth_) return none;
    // A cell that is a line or a point has no area to weigh.
    const Vec3f e = cell.box.hi - cell.box.lo;
    if (int(e.x > 0) + int(e.y > 0) + int(e.z > 0) < 2) return none;
    const KdSplit split = find_split(kernels_, references, count, cell.box, cost_, cell.budget, scratch);
    return split.cost < float(count) ? split : none;  // NaN, from overflow, is no split
  }

  // Bounds of a reference on both sides of a plane that it lies across; empty where nothing of it is.
  void split_reference(const KdReference &r, const Box &cell, const KdSplit &split, Box side[2]) const
  {
    const Box box = {r.lo, r.hi};
    side[0] = part_of(box, split, 0);
    side[1] = part_of(box, split, 1);
    if (source_.boxes != nullptr) return;
    const UInt3 c = source_.indices[r.id];
    ClippedTriangle polygon(source_.positions[c.x], source_.positions[c.y], source_.positions[c.z]);
    polygon.clip(cell);
    if (polygon.is_empty()) return;
    Box below, above;
    polygon.split(split.axis, split.position, below, above);
    below = common_part(side[0], below);
    above = common_part(side[1], above);
    if (is_empty(below) && is_empty(above)) return;
    side[0] = below;
    side[1] = above;
  }

  // Appends the references of both sides; returns their numbers.
  void partition(const KdReference *references, uint64_t count, const Box &cell, const KdSplit &split,
                 KdReference *out[2], uint64_t num[2]) const
  {
    num[0] = num[1] = 0;
    for (uint64_t i = 0; i < count; ++i) {
      const KdReference &r = references[i];
      switch (side_of(r, split)) {
        case Side::Below:
          out[0][num[0]++] = r;
          break;
        case Side::Above:
          out[1][num[1]++] = r;
          break;
        case Side::Across: {
          Box part[2];
          split_reference(r, cell, split, part);
          for (int s = 0; s < 2; ++s) {
            if (!is_empty(part[s])) out[s][num[s]++] = {part[s].lo, r.id, part[s].hi, 0};
          }
        }
      }
    }
  }

  // Upper bounds of the numbers that partition() will write.
  static void count_sides(const KdReference *references, uint64_t count, const KdSplit &split,
                          uint64_t num[2])
  {
    num[0] = num[1] = 0;
    for (uint64_t i = 0; i < count; ++i) {
      const Side side = side_of(references[i], split);
      num[0] += side != Side::Above;
      num[1] += side != Side::Below;
    }
  }

  // What the budget leaves over the present references is shared out in their proportion.
  static void child_cells(const Cell &cell, const KdSplit &split, const uint64_t num[2], Cell child[2])
  {
    const uint64_t used = num[0] + num[1], spare = cell.budget - used;
    const uint64_t first = used == 0 ? 0 : uint64_t(double(spare) * (double(num[0]) / double(used)));
    const uint64_t extra[2] = {std::min(first, spare), spare - std::min(first, spare)};
    for (int s = 0; s < 2; ++s) child[s] = {part_of(cell.box, split, s), cell.depth + 1, num[s] + extra[s]};
  }

  // ---- Large cells: one task a child, loops over references in parallel.

  std::unique_ptr<UpperNode> build_upper(References references, const Cell &cell)
  {
    auto node = std::make_unique<UpperNode>();
    if (references.size() <= task_size) {
      node->subtree = build_subtree(references.data(), references.size(), cell);
      return node;
    }
    const uint64_t count = references.size();
    {
      // Not the thread's own: while it waits for others it may take up another cell.
      const auto scratch = std::make_unique<KdSplitScratch>();
      node->split = choose_split(references.data(), count, cell, *scratch);
    }
    if (node->split.cost == infinity) {
      node->subtree = build_leaf(references, cell);
      return node;
    }
    node->cost = share(cell.box) * cost_.traversal_cost;
    References child[2];
    partition_in_parallel(
        references, memory_, build_memory,
        [&](const KdReference *r, uint64_t n, uint64_t num[2]) { count_sides(r, n, node->split, num); },
        [&](const KdReference *r, uint64_t n, KdReference *out[2], uint64_t num[2]) {
          partition(r, n, cell.box, node->split, out, num);
        },
        child);
    references.free();
    const uint64_t num[2] = {child[0].size(), child[1].size()};
    Cell child_cell[2];
    child_cells(cell, node->split, num, child_cell);
    tbb::parallel_invoke([&] { node->child[0] = build_upper(std::move(child[0]), child_cell[0]); },
                         [&] { node->child[1] = build_upper(std::move(child[1]), child_cell[1]); });
    return node;
  }

  std::unique_ptr<Subtree> build_leaf(const References &references, const Cell &cell)
  {
    auto out = std::make_unique<Subtree>();
    out->nodes.resize(1);
    add_leaf(*out, 0, references.data(), references.size(), cell);
    account(*out);
    return out;
  }

  // ---- Small cells: one thread, depth first.

  std::unique_ptr<Subtree> build_subtree(const KdReference *references, uint64_t count, const Cell &cell)
  {
    auto out = std::make_unique<Subtree>();
    out->nodes.reserve(count * 2);
    out->references.reserve(count * 2);
    out->nodes.resize(1);
    build_node(*out, 0, references, count, cell, scratch_.local(), 0);
    out->nodes.shrink_to_fit();
    out->references.shrink_to_fit();
    account(*out);
    return out;
  }

  void account(Subtree &subtree) const
  {
    subtree.reservation = Reservation(
        memory_, subtree.nodes.size() * sizeof(KdNode) + subtree.references.size() * sizeof(uint32_t),
        build_memory);
  }

  void add_leaf(Subtree &out, uint32_t slot, const KdReference *references, uint64_t count,
                const Cell &cell) const
  {
    const uint32_t first = count == 0 ? 0 : uint32_t(out.references.size());
    for (uint64_t i = 0; i < count; ++i) out.references.push_back(references[i].id);
    out.nodes[slot] = {first, uint32_t(count) << 2 | 3u};
    out.cost += share(cell.box) * double(count);
    out.depth = std::max(out.depth, cell.depth);
  }

  // `level` counts from the subtree's root: every level has a block of its own for the references of both children.
  void build_node(Subtree &out, uint32_t slot, const KdReference *references, uint64_t count,
                  const Cell &cell, Scratch &scratch, uint32_t level)
  {
    const KdSplit split = choose_split(references, count, cell, scratch.split);
    if (split.cost == infinity) {
      add_leaf(out, slot, references, count, cell);
      return;
    }
    // Side by side from both ends of the block, which has room for every reference on both sides.
    if (scratch.blocks.size() <= level) scratch.blocks.resize(level + 1);
    if (scratch.blocks[level] == nullptr) scratch.blocks[level].reset(new KdReference[2 * task_size]);
    KdReference *side[2] = {scratch.blocks[level].get(), scratch.blocks[level].get() + task_size};
    uint64_t num[2];
    partition(references, count, cell.box, split, side, num);
    Cell child[2];
    child_cells(cell, split, num, child);
    out.cost += share(cell.box) * cost_.traversal_cost;
    const uint32_t first_child = uint32_t(out.nodes.size());
    out.nodes.resize(first_child + 2);
    out.nodes[slot] = inner_node(split, first_child);
    build_node(out, first_child, side[0], num[0], child[0], scratch, level + 1);
    build_node(out, first_child + 1, side[1], num[1], child[1], scratch, level + 1);
  }

  // ---- The final arrays.

  struct Piece {
    Subtree *subtree;
    uint64_t slot;        // of its root
    uint64_t first_node;  // of its other nodes
    uint64_t first_reference;
  };

  HostKdTree lay_out(HostKdTree tree, UpperNode &top, KdBuildStats &stats)
  {
    std::vector<Piece> pieces;
    std::vector<std::pair<uint64_t, KdNode>> upper;
    uint64_t num_nodes = 1, num_references = 0;
    double cost = 0;
    place(top, 0, num_nodes, num_references, cost, stats.depth, upper, pieces);
    if (num_nodes > 0x3fffffffu) {
      fail(GPURT_ERROR_UNSUPPORTED,
           "the kd-tree has {} nodes and can have 2^30 - 1; raise traversal_cost or lower max_depth",
           num_nodes);
    }
    const Reservation final_arrays(memory_, num_nodes * sizeof(KdNode) + num_references * sizeof(uint32_t),
                                   build_memory);
    tree.nodes.resize(num_nodes);
    tree.references.resize(num_references);
    for (const auto &[slot, node] : upper) tree.nodes[slot] = node;
    tbb::parallel_for(size_t(0), pieces.size(), [&](size_t i) {
      const Piece &piece = pieces[i];
      const Subtree &part = *piece.subtree;
      for (uint64_t n = 0; n < part.nodes.size(); ++n) {
        KdNode node = part.nodes[n];
        if (is_leaf(node)) {
          if (payload(node) != 0) node.word += uint32_t(piece.first_reference);
        } else {
          node.tag += uint32_t(piece.first_node - 1) << 2;
        }
        tree.nodes[n == 0 ? piece.slot : piece.first_node + n - 1] = node;
      }
      std::copy(part.references.begin(), part.references.end(),
                tree.references.begin() + ptrdiff_t(piece.first_reference));
      *piece.subtree = {};
    });
    stats.sah_cost = cost;
    return tree;
  }

  // Gives every part its place, in depth-first order.
  void place(UpperNode &node, uint64_t slot, uint64_t &num_nodes, uint64_t &num_references, double &cost,
             uint32_t &depth, std::vector<std::pair<uint64_t, KdNode>> &upper, std::vector<Piece> &pieces)
  {
    if (node.subtree) {
      Subtree &s = *node.subtree;
      pieces.push_back({&s, slot, num_nodes, num_references});
      num_nodes += s.nodes.size() - 1;
      num_references += s.references.size();
      cost += s.cost;
      depth = std::max(depth, s.depth);
      return;
    }
    const uint64_t first_child = num_nodes;
    num_nodes += 2;
    cost += node.cost;
    upper.emplace_back(slot, inner_node(node.split, uint32_t(first_child)));
    for (int s = 0; s < 2; ++s)
      place(*node.child[s], first_child + uint64_t(s), num_nodes, num_references, cost, depth, upper, pieces);
  }

  const KdSource &source_;
  const std::shared_ptr<MemoryTracker> &memory_;
  const KdBuildKernels &kernels_;
  KdCost cost_{};
  uint32_t max_depth_ = 0;
  Box bounds_{};
  double root_area_ = 0;
  tbb::enumerable_thread_specific<Scratch> scratch_;
};

}  // namespace

HostKdTree build_kd_tree(const KdSource &source, const KdBuildSettings &settings,
                         const std::shared_ptr<MemoryTracker> &memory, KdBuildStats &stats)
{
  stats = {};
  return Builder(source, settings, memory).build(stats);
}

}  // namespace gpurt
