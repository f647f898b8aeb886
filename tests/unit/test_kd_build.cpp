// The kd-tree's structure: what builders promise whatever the input.
#include "kd_soundness.h"

namespace gpurt {
namespace {

using namespace test;

HostKdTree build(const Mesh &mesh, KdBuildStats &stats, int num_threads = 2, KdBuildSettings settings = {})
{
  KdSource source;
  source.count = mesh.triangles.size();
  source.positions = mesh.positions.data();
  source.indices = mesh.triangles.data();
  HostKdTree tree;
  tbb::task_arena arena(num_threads);
  arena.execute([&] { tree = build_kd_tree(source, settings, std::make_shared<MemoryTracker>(0), stats); });
  return tree;
}

TEST(KdBuild, LeavesHoldWhatLiesInTheirCells)
{
  Random rng(3);
  Mesh needles, grid;
  for (int i = 0; i < 2000; ++i) {
    const Vec3f p = rng.point(1), d = rng.direction();
    needles.add(p, p + d * 2.0f, p + d * 2.0f + rng.point(1e-4f));
  }
  for (int i = 0; i < 4000; ++i) {
    const auto g = [&] { return float(int(rng.below(9)) - 4); };
    grid.add({g(), g(), g()}, {g(), g(), g()}, {g(), g(), g()});
  }
  for (const Mesh &mesh : {soup(rng, 20000, 0.05f, 1), soup(rng, 500, 3, 1), needles, grid, icosphere(4, 1),
                           box({-1, -1, -1}, {1, 1, 1}), soup(rng, 300, 1e-3f, 1000)}) {
    KdBuildStats stats;
    const HostKdTree tree = build(mesh, stats);
    expect_sound(mesh, tree, stats);
    expect_complete(mesh, tree, rng, 6);
  }
}

TEST(KdBuild, EmptyAndDegenerateInputGivesATreeWithoutNodes)
{
  KdBuildStats stats;
  EXPECT_TRUE(build({}, stats).nodes.empty());
  Mesh points;
  for (int i = 0; i < 100; ++i) points.add({1, 2, 3}, {1, 2, 3}, {1, 2, 3});
  points.add({0, 0, 0}, {1, 1, 1}, {3, 3, 3});
  const HostKdTree tree = build(points, stats);
  EXPECT_TRUE(tree.nodes.empty());
  EXPECT_TRUE(tree.references.empty());
}

TEST(KdBuild, OneTriangleIsOneLeaf)
{
  Mesh mesh;
  mesh.add({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  KdBuildStats stats;
  const HostKdTree tree = build(mesh, stats);
  ASSERT_EQ(tree.nodes.size(), 1u);
  EXPECT_TRUE(is_leaf(tree.nodes[0]));
  EXPECT_EQ(payload(tree.nodes[0]), 1u);
}

TEST(KdBuild, DegeneracyIsExact)
{
  EXPECT_TRUE(is_degenerate({0, 0, 0}, {1, 1, 1}, {2, 2, 2}));
  EXPECT_TRUE(is_degenerate({1, 2, 3}, {1, 2, 3}, {5, 1, 7}));
  EXPECT_TRUE(is_degenerate({1e-30f, 2e30f, 0}, {1e-30f, 2e30f, 5}, {1e-30f, 2e30f, -7}));
  EXPECT_FALSE(is_degenerate({0, 0, 0}, {1, 1, 1}, {2, 2, std::nextafter(2.0f, 3.0f)}));
  EXPECT_FALSE(is_degenerate({1e6f, 1e6f, 0}, {1e6f + 1, 1e6f, 0}, {1e6f, 1e6f, 1e-30f}));
  EXPECT_FALSE(is_degenerate({0, 0, 0}, {1e-20f, 0, 0}, {0, 1e-20f, 0}));  // a product that vanishes in float
  // p, p + d, p + 3d with every sum exact.
  EXPECT_TRUE(is_degenerate({0.1f, 0.7f, -0.3f}, {0.1f + 0.5f, 0.7f, -0.3f}, {0.1f + 1.5f, 0.7f, -0.3f}));
}

// Catalogue row 16.
TEST(KdBuild, FlatCellsEnd)
{
  Random rng(5);
  Mesh flat, all_alike;
  for (int i = 0; i < 100000; ++i) {
    const Vec3f p = {rng.uniform(-1, 1), 0.25f, rng.uniform(-1, 1)};
    flat.add(p, p + Vec3f{0.01f, 0, 0}, p + Vec3f{0, 0, 0.01f});
  }
  for (int i = 0; i < 20000; ++i) all_alike.add({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  KdBuildStats stats;
  const HostKdTree tree = build(flat, stats);
  expect_sound(flat, tree, stats);
  EXPECT_LT(stats.depth, 40u);
  const HostKdTree one = build(all_alike, stats);
  expect_sound(all_alike, one, stats);
  EXPECT_LE(one.references.size(), 2 * all_alike.triangles.size());
}

// Catalogue row 17, smaller.
TEST(KdBuild, ReferencesStayBoundedWhereAllTrianglesMeet)
{
  Random rng(6);
  Mesh star;
  for (int i = 0; i < 20000; ++i) star.add({0, 0, 0}, rng.direction(), rng.direction());
  KdBuildSettings eager;
  eager.traversal_cost = 1e-3f;  // splits whatever it may
  for (const KdBuildSettings &settings : {KdBuildSettings{}, eager}) {
    KdBuildStats stats;
    expect_sound(star, build(star, stats, 2, settings), stats);
  }
}

TEST(KdBuild, DepthStaysBelowTheCap)
{
  Mesh deep;
  for (int i = 0; i < 90; ++i) {
    const float s = std::ldexp(1.0f, -i);
    deep.add({s, s, s}, {1.5f * s, s, s}, {s, 1.5f * s, 1.25f * s});
  }
  KdBuildStats stats;
  KdBuildSettings settings;
  settings.max_depth = 200;
  settings.traversal_cost = 1e-3f;
  const HostKdTree tree = build(deep, stats, 2, settings);
  expect_sound(deep, tree, stats);
  EXPECT_GT(stats.depth, 30u);
  settings.max_depth = 5;
  build(deep, stats, 2, settings);
  EXPECT_LE(stats.depth, 5u);
  build(deep, stats);
  EXPECT_LE(stats.depth, uint32_t(8 + 1.3 * std::log2(90.0)));
}

TEST(KdBuild, TheTreeDoesNotDependOnThreads)
{
  Random rng(8);
  Mesh mesh = soup(rng, 100000, 0.02f, 1);
  mesh.add(icosphere(5, 0.5f));
  KdBuildStats one_stats, many_stats;
  const HostKdTree one = build(mesh, one_stats, 1), many = build(mesh, many_stats, 7);
  ASSERT_EQ(one.nodes.size(), many.nodes.size());
  EXPECT_EQ(std::memcmp(one.nodes.data(), many.nodes.data(), one.nodes.size() * sizeof(KdNode)), 0);
  EXPECT_EQ(one.references, many.references);
  EXPECT_EQ(one_stats.sah_cost, many_stats.sah_cost);
}

TEST(KdBuild, ScalesByPowersOfTwoGiveTheSameTree)
{
  Random rng(9);
  const Mesh mesh = soup(rng, 5000, 0.1f, 1);
  KdBuildStats stats;
  const HostKdTree tree = build(mesh, stats);
  for (int e : {-60, -20, 20, 60}) {
    Mesh scaled = mesh;
    for (Vec3f &p : scaled.positions) p = {std::ldexp(p.x, e), std::ldexp(p.y, e), std::ldexp(p.z, e)};
    KdBuildStats scaled_stats;
    const HostKdTree other = build(scaled, scaled_stats);
    EXPECT_EQ(tree.references, other.references);
    EXPECT_EQ(tree.nodes.size(), other.nodes.size());
  }
}

TEST(KdBuild, RunningOutOfMemoryLeavesNothingBehind)
{
  Random rng(10);
  const Mesh mesh = soup(rng, 100000, 0.02f, 1);
  KdSource source;
  source.count = mesh.triangles.size();
  source.positions = mesh.positions.data();
  source.indices = mesh.triangles.data();
  const auto memory = std::make_shared<MemoryTracker>(4u << 20);
  KdBuildStats stats;
  try {
    build_kd_tree(source, {}, memory, stats);
    FAIL() << "4 MiB cannot be enough";
  } catch (const Error &error) {
    EXPECT_EQ(error.result(), GPURT_ERROR_OUT_OF_MEMORY);
  }
  EXPECT_EQ(memory->used(), 0u);
}

}  // namespace
}  // namespace gpurt
