// The bvh's structure: what the builder promises whatever the input.
#include "accel/bvh_split.h"
#include "bvh_check.h"

namespace gpurt {
namespace {

using namespace test;

HostBvh build(const Mesh &mesh, BvhBuildStats &stats, int num_threads = 2)
{
  HostBvh tree;
  tbb::task_arena arena(num_threads);
  arena.execute([&] { tree = build_bvh(source_of(mesh), std::make_shared<MemoryTracker>(0), stats); });
  return tree;
}

TEST(BvhBuild, LeavesHoldWhatLiesInTheirBoxes)
{
  Random rng(3);
  Mesh grid;
  for (int i = 0; i < 4000; ++i) {
    const auto g = [&] { return float(int(rng.below(9)) - 4); };
    grid.add({g(), g(), g()}, {g(), g(), g()}, {g(), g(), g()});
  }
  Mesh far = soup(rng, 500, 0.3f, 1);
  for (Vec3f &p : far.positions) p = p + Vec3f{1e6f, -1e6f, 1e6f};
  Mesh tiny = soup(rng, 500, 0.3f, 1), huge = tiny;
  for (Vec3f &p : tiny.positions) p = p * 1e-41f;  // denormal numbers
  for (Vec3f &p : huge.positions) p = p * 2.5e38f;
  for (const Mesh &mesh :
       {soup(rng, 20000, 0.05f, 1), soup(rng, 500, 3, 1), needles_of(rng, 2000), grid, icosphere(4, 1),
        box({-1, -1, -1}, {1, 1, 1}), soup(rng, 300, 1e-3f, 1000), far, tiny, huge}) {
    BvhBuildStats stats;
    const HostBvh tree = build(mesh, stats);
    expect_sound(mesh, tree, stats);
    expect_complete(mesh, tree, rng, 6);
  }
}

// A node contains the boxes that it was made from, exactly.
TEST(BvhBuild, NodesContainTheirBoxes)
{
  Random rng(31);
  for (int i = 0; i < 100000; ++i) {
    const float scale = std::ldexp(1.0f, int(rng.below(120)) - 60);
    const Vec3f center = rng.point(scale * (i % 3 ? 1.0f : 1e-6f));
    Box box[2];
    for (Box &b : box) {
      const Vec3f p = rng.point(scale), q = p + rng.point(scale) * (i % 2 ? 1.0f : 0x1p-20f);
      b = {min(p, q), max(p, q)};
      if (i % 7 == 0) b.hi.y = b.lo.y;
    }
    // Every other frame asks for no margin.
    const BvhFrame frame{center, scale, i % 2 ? 32 * scale : 0.0f};
    const double margin = frame.reach * bvh_margin;
    const BvhBoxes made = boxes_of(make_bvh_node(box[0], 1, box[1], 2, frame), frame);
    for (int c = 0; c < 2; ++c) {
      for (int k = 0; k < 3; ++k) {
        // Half extents have eight bits, of which child 0's lowest may be raised once more by what lies below it.
        const double size = double(at(box[c].hi, k)) - at(box[c].lo, k);
        const double reach = std::max(std::abs(double(at(box[c].hi, k)) - at(center, k)),
                                      std::abs(double(at(box[c].lo, k)) - at(center, k)));
        const double room = margin + (size + margin) * 0x1p-7 + reach * 0x1p-22;
        ASSERT_LE(made.lo[c][k], at(box[c].lo, k) - margin);
        ASSERT_GE(made.hi[c][k], at(box[c].hi, k) + margin);
        ASSERT_GE(made.lo[c][k], at(box[c].lo, k) - room);
        ASSERT_LE(made.hi[c][k], at(box[c].hi, k) + room);
      }
    }
  }
}

// Both parts of a cut triangle together cover it, and neither leaves its own side or the reference's box.
TEST(BvhBuild, CutsLoseNothing)
{
  Random rng(32);
  for (int i = 0; i < 5000; ++i) {
    Mesh mesh;
    mesh.add(rng.point(1), rng.point(1), rng.point(i % 2 ? 1.0f : 1e-3f));
    const KdSource source = source_of(mesh);
    const Vec3f a = mesh.positions[0], b = mesh.positions[1], c = mesh.positions[2];
    std::vector<KdReference> parts = {{min(a, min(b, c)), 0, max(a, max(b, c)), 0}};
    for (int cut = 0; cut < 5; ++cut) {
      const size_t victim = rng.below(uint32_t(parts.size()));
      const KdReference r = parts[victim];
      const int axis = int(rng.below(3));
      const float position = rng.uniform(at(r.lo, axis), at(r.hi, axis));
      Box part[2];
      cut_reference(source, r, axis, position, part);
      parts.erase(parts.begin() + ptrdiff_t(victim));
      for (int s = 0; s < 2; ++s) {
        if (is_empty(part[s])) continue;
        for (int k = 0; k < 3; ++k) {
          ASSERT_GE(at(part[s].lo, k), at(r.lo, k));
          ASSERT_LE(at(part[s].hi, k), at(r.hi, k));
        }
        ASSERT_TRUE(s == 0 ? at(part[0].hi, axis) <= position : at(part[1].lo, axis) >= position);
        parts.push_back({part[s].lo, 0, part[s].hi, 0});
      }
      ASSERT_FALSE(parts.empty());
    }
    for (int n = 0; n < 20; ++n) {
      double u = rng.uniform(0, 1), v = rng.uniform(0, 1);
      if (u + v > 1) u = 1 - u, v = 1 - v;
      bool is_covered = false;
      for (const KdReference &r : parts) {
        bool contains = true;
        for (int k = 0; k < 3; ++k) {
          const double x = at(a, k) + u * (double(at(b, k)) - at(a, k)) + v * (double(at(c, k)) - at(a, k));
          contains &= x >= at(r.lo, k) - 1e-15 && x <= at(r.hi, k) + 1e-15;
        }
        is_covered |= contains;
      }
      ASSERT_TRUE(is_covered) << i;
    }
  }
}

TEST(BvhBuild, SplitsInSpaceBoundWhatTheyAdd)
{
  Random rng(33);
  const Mesh mesh = needles_of(rng, 5000);
  BvhBuildStats stats;
  const HostBvh tree = build(mesh, stats);
  expect_sound(mesh, tree, stats);
  EXPECT_GT(tree.references.size(), mesh.triangles.size() * 11 / 10) << "long triangles are worth cutting";
  // Small ones are not.
  const Mesh small = icosphere(5, 1);
  EXPECT_LT(build(small, stats).references.size(), small.triangles.size() * 21 / 20);
}

TEST(BvhBuild, EmptyAndDegenerateInputGivesATreeWithoutNodes)
{
  BvhBuildStats stats;
  EXPECT_EQ(build({}, stats).root, bvh_empty);
  Mesh points;
  for (int i = 0; i < 100; ++i) points.add({1, 2, 3}, {1, 2, 3}, {1, 2, 3});
  points.add({0, 0, 0}, {1, 1, 1}, {3, 3, 3});
  const HostBvh tree = build(points, stats);
  EXPECT_EQ(tree.root, bvh_empty);
  EXPECT_TRUE(tree.nodes.empty());
  EXPECT_TRUE(tree.references.empty());
}

TEST(BvhBuild, OneTriangleIsOneLeafAndTwoApartAreTwo)
{
  Mesh mesh;
  mesh.add({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  BvhBuildStats stats;
  const HostBvh one = build(mesh, stats);
  EXPECT_TRUE(one.nodes.empty());
  EXPECT_EQ(one.root, bvh_leaf(0, 1));
  mesh.add({1000, 0, 0}, {1001, 0, 0}, {1000, 1, 0});
  const HostBvh two = build(mesh, stats);
  ASSERT_EQ(two.nodes.size(), 1u);
  EXPECT_EQ(two.root, 0u);
  EXPECT_EQ(two.nodes[0].child0, bvh_leaf(0, 1));
  EXPECT_EQ(two.nodes[0].child1, bvh_leaf(1, 1));
  EXPECT_EQ(stats.depth, 1u);
}

// Catalogue row 16.
TEST(BvhBuild, FlatAndCoincidentTrianglesEnd)
{
  Random rng(5);
  Mesh flat, all_alike;
  for (int i = 0; i < 100000; ++i) {
    const Vec3f p = {rng.uniform(-1, 1), 0.25f, rng.uniform(-1, 1)};
    flat.add(p, p + Vec3f{0.01f, 0, 0}, p + Vec3f{0, 0, 0.01f});
  }
  for (int i = 0; i < 20000; ++i) all_alike.add({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  BvhBuildStats stats;
  expect_sound(flat, build(flat, stats), stats);
  EXPECT_LT(stats.depth, 40u);
  // Nothing tells them apart; all leaves are small all the same.
  expect_sound(all_alike, build(all_alike, stats), stats);
  EXPECT_LE(stats.depth, 15u);
}

// Catalogue row 17.
TEST(BvhBuild, ReferencesStayBoundedWhereAllTrianglesMeet)
{
  Random rng(6);
  Mesh star;
  for (int i = 0; i < 100000; ++i) star.add({0, 0, 0}, rng.direction(), rng.direction());
  BvhBuildStats stats;
  expect_sound(star, build(star, stats), stats);
}

// Catalogue row 18: each triangle half as large as the last, around one point.
TEST(BvhBuild, DepthStaysBelowTheCap)
{
  Mesh deep;
  for (int i = 0; i < 240; ++i) {
    const float s = std::ldexp(1.0f, 110 - i);
    deep.add({s, s, s}, {1.5f * s, s, s}, {s, 1.5f * s, 1.25f * s});
  }
  BvhBuildStats stats;
  const HostBvh tree = build(deep, stats);
  expect_sound(deep, tree, stats);
  Random rng(7);
  expect_complete(deep, tree, rng, 4);
  // The same with many at every size, so that levels are short where halving has to begin.
  Mesh crowded;
  for (const UInt3 &t : deep.triangles) {
    for (int n = 0; n < 100; ++n)
      crowded.add(deep.positions[t.x] * rng.uniform(0.9f, 1.1f), deep.positions[t.y], deep.positions[t.z]);
  }
  expect_sound(crowded, build(crowded, stats), stats);
}

TEST(BvhBuild, TheTreeDoesNotDependOnThreads)
{
  Random rng(8);
  Mesh mesh = soup(rng, 100000, 0.02f, 1);
  mesh.add(icosphere(5, 0.5f));
  mesh.add(needles_of(rng, 5000));
  BvhBuildStats one_stats, many_stats;
  const HostBvh one = build(mesh, one_stats, 1), many = build(mesh, many_stats, 7);
  ASSERT_EQ(one.nodes.size(), many.nodes.size());
  EXPECT_EQ(std::memcmp(one.nodes.data(), many.nodes.data(), one.nodes.size() * sizeof(BvhNode)), 0);
  EXPECT_EQ(one.references, many.references);
  EXPECT_EQ(one.root, many.root);
  EXPECT_EQ(one_stats.sah_cost, many_stats.sah_cost);
  EXPECT_EQ(one_stats.depth, many_stats.depth);
  expect_sound(mesh, one, one_stats);
}

TEST(BvhBuild, ScalesByPowersOfTwoGiveTheSameTree)
{
  Random rng(9);
  const Mesh mesh = soup(rng, 5000, 0.1f, 1);
  BvhBuildStats stats;
  const HostBvh tree = build(mesh, stats);
  for (int e : {-60, -20, 20, 60}) {
    Mesh scaled = mesh;
    for (Vec3f &p : scaled.positions) p = {std::ldexp(p.x, e), std::ldexp(p.y, e), std::ldexp(p.z, e)};
    BvhBuildStats scaled_stats;
    const HostBvh other = build(scaled, scaled_stats);
    EXPECT_EQ(tree.references, other.references);
    EXPECT_EQ(tree.nodes.size(), other.nodes.size());
  }
}

TEST(BvhBuild, BoxesAreNotCut)
{
  Random rng(34);
  std::vector<Box> boxes;
  for (int i = 0; i < 3000; ++i) {
    const Vec3f p = rng.point(1), q = rng.point(1);
    boxes.push_back(i % 10 == 0 ? empty_box() : Box{min(p, q), max(p, q)});
  }
  KdSource source;
  source.count = boxes.size();
  source.boxes = boxes.data();
  BvhBuildStats stats;
  const HostBvh tree = build_bvh(source, nullptr, stats);
  std::vector<uint32_t> sorted = tree.references, expected;
  for (uint32_t i = 0; i < boxes.size(); ++i) {
    if (!is_empty(boxes[i])) expected.push_back(i);
  }
  std::sort(sorted.begin(), sorted.end());
  EXPECT_EQ(sorted, expected);
}

TEST(BvhBuild, RunningOutOfMemoryLeavesNothingBehind)
{
  Random rng(10);
  const Mesh mesh = soup(rng, 100000, 0.02f, 1);
  const auto memory = std::make_shared<MemoryTracker>(4u << 20);
  BvhBuildStats stats;
  try {
    build_bvh(source_of(mesh), memory, stats);
    FAIL() << "4 MiB cannot be enough";
  } catch (const Error &error) {
    EXPECT_EQ(error.result(), GPURT_ERROR_OUT_OF_MEMORY);
  }
  EXPECT_EQ(memory->used(), 0u);
}

// The tree exchange knows kd-trees alone.
TEST(BvhBuild, IsNotExported)
{
  BuildOptions options;
  options.accel = Accel::Bvh;
  const auto committed = commit(scene_of(icosphere(1, 1)), options);
  try {
    committed->export_tree(0);
    FAIL();
  } catch (const Error &error) {
    EXPECT_EQ(error.result(), GPURT_ERROR_INVALID_ARGUMENT);
    EXPECT_NE(std::string(error.what()).find("kdtree"), std::string::npos) << error.what();
  }
  EXPECT_EQ(committed->accel_facts().accel, Accel::Bvh);
  EXPECT_GT(committed->accel_facts().num_nodes, 0u);
  EXPECT_GT(committed->accel_facts().accel_bytes, 80u * 48u);
}

}  // namespace
}  // namespace gpurt
