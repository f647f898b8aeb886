// Subtrees that are badly placed find a better place, and nothing is lost on the way.
#include "accel/bvh_reinsert.h"

#include "accel/bvh_split.h"
#include "bvh_check.h"

namespace gpurt {
namespace {

using namespace test;

struct Tree {
  std::vector<BvhBuildNode> nodes;
  std::vector<Box> leaves;  // by the leaf's first reference
  uint32_t root = 0;
};

Box bounds_of(const Tree &tree, uint32_t word)
{
  if (is_bvh_leaf(word)) return tree.leaves[leaf_first(word)];
  return extend(bounds_of(tree, tree.nodes[word].child[0]), bounds_of(tree, tree.nodes[word].child[1]));
}

// A tree over [first, first + count), split where `share` says, parents before children.
uint32_t split(Tree &tree, uint32_t first, uint32_t count, Random &rng, bool is_chain)
{
  if (count == 1) return bvh_leaf(first, 1);
  const uint32_t node = uint32_t(tree.nodes.size()), left = is_chain ? 1 : 1 + rng.below(count - 1);
  tree.nodes.emplace_back();
  const uint32_t child[2] = {split(tree, first, left, rng, is_chain),
                             split(tree, first + left, count - left, rng, is_chain)};
  for (int s = 0; s < 2; ++s) {
    tree.nodes[node].child[s] = child[s];
    tree.nodes[node].box[s] = bounds_of(tree, child[s]);
  }
  return node;
}

Tree random_tree(Random &rng, uint32_t count, bool is_chain = false)
{
  Tree tree;
  for (uint32_t i = 0; i < count; ++i) {
    const Vec3f p = rng.point(1), q = p + rng.point(i % 50 == 0 ? 1.0f : 0.02f);
    tree.leaves.push_back({min(p, q), max(p, q)});
  }
  tree.root = split(tree, 0, count, rng, is_chain);
  return tree;
}

struct Measured {
  double area = 0;  // of all nodes but the root
  uint32_t depth = 0;
};

// Every leaf is there once, every node at most once, and boxes are those of what is below them.
Measured expect_whole(const Tree &tree)
{
  Measured m;
  std::vector<int> leaf_seen(tree.leaves.size()), node_seen(tree.nodes.size());
  std::vector<std::pair<uint32_t, uint32_t>> todo = {{tree.root, 0}};
  while (!todo.empty()) {
    const auto [word, depth] = todo.back();
    todo.pop_back();
    m.depth = std::max(m.depth, depth);
    if (is_bvh_leaf(word)) {
      EXPECT_EQ(leaf_size(word), 1u);
      ++leaf_seen[leaf_first(word)];
      continue;
    }
    if (++node_seen[word] > 1) {
      ADD_FAILURE() << "node " << word << " hangs at two places";
      return m;
    }
    for (int s = 0; s < 2; ++s) {
      const BvhBuildNode &node = tree.nodes[word];
      const Box below = bounds_of(tree, node.child[s]);
      for (int k = 0; k < 3; ++k) {
        EXPECT_EQ(at(node.box[s].lo, k), at(below.lo, k));
        EXPECT_EQ(at(node.box[s].hi, k), at(below.hi, k));
      }
      if (!is_bvh_leaf(node.child[s])) m.area += half_area(node.box[s]);
      todo.push_back({node.child[s], depth + 1});
    }
  }
  for (const int n : leaf_seen) EXPECT_EQ(n, 1);
  for (const int n : node_seen) EXPECT_EQ(n, 1);
  return m;
}

TEST(BvhReinsert, MakesRandomTreesBetterAndLosesNothing)
{
  Random rng(41);
  for (int i = 0; i < 40; ++i) {
    Tree tree = random_tree(rng, 2 + rng.below(400));
    const Measured before = expect_whole(tree);
    reinsert(tree.nodes.data(), tree.nodes.size(), tree.root);
    const Measured after = expect_whole(tree);
    EXPECT_LE(after.area, before.area);
    // Splits at random leave much to be gained; trees of a few leaves have nowhere else to put them.
    if (tree.leaves.size() > 100) {
      EXPECT_LT(after.area, 0.5 * before.area) << tree.leaves.size();
    }
  }
}

// As deep as trees may be, from the start: every place that lies deeper is refused.
TEST(BvhReinsert, KeepsTheDepth)
{
  Random rng(42);
  for (int i = 0; i < 50; ++i) {
    Tree tree = random_tree(rng, uint32_t(bvh_max_depth) + 1, true);
    const Measured before = expect_whole(tree);
    ASSERT_EQ(before.depth, uint32_t(bvh_max_depth));
    reinsert(tree.nodes.data(), tree.nodes.size(), tree.root);
    const Measured after = expect_whole(tree);
    EXPECT_LE(after.depth, uint32_t(bvh_max_depth));
    EXPECT_LT(after.area, before.area);
  }
}

TEST(BvhReinsert, LeavesTreesOfOneNodeAlone)
{
  Random rng(43);
  Tree tree = random_tree(rng, 2);
  reinsert(tree.nodes.data(), 1, tree.root);
  expect_whole(tree);
  reinsert(nullptr, 0, bvh_leaf(0, 1));
}

// What splits alone do badly: a floor sinks three to five nodes deep, and makes all of them as wide as it is.
TEST(BvhReinsert, FloorsDoNotSinkIntoWhatStandsOnThem)
{
  for (const float height : {-0.1f, -0.09f, 0.0f, 0.05f}) {
    SCOPED_TRACE(height);
    Mesh mesh = icosphere(5, 0.1f);
    const uint32_t floor = uint32_t(mesh.triangles.size());
    mesh.add({-1, height, -1}, {1, height, -1}, {1, height, 1});
    mesh.add({-1, height, -1}, {1, height, 1}, {-1, height, 1});
    BvhBuildStats stats;
    const HostBvh tree = build_bvh(source_of(mesh), nullptr, stats);
    expect_sound(mesh, tree, stats);
    uint32_t deepest = 0;
    std::vector<std::pair<uint32_t, uint32_t>> todo = {{tree.root, 0}};
    while (!todo.empty()) {
      const auto [word, depth] = todo.back();
      todo.pop_back();
      if (!is_bvh_leaf(word)) {
        for (const uint32_t child : {tree.nodes[word].child0, tree.nodes[word].child1})
          todo.push_back({child, depth + 1});
        continue;
      }
      for (uint32_t i = 0; i < leaf_size(word); ++i) {
        if (tree.references[leaf_first(word) + i] >= floor) deepest = std::max(deepest, depth);
      }
    }
    EXPECT_LE(deepest, 2u) << "of " << stats.depth;
  }
}

}  // namespace
}  // namespace gpurt
