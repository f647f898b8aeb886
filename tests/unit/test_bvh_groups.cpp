// The algorithms of the device's builder of bvhs (lib/cuda/accel/build), run by one thread on the host.
#include "device_meshes.h"
#include "serial_builder.h"

namespace gpurt {
namespace {

using namespace test;

HostBvh build(const Mesh &mesh, BvhBuildStats &stats)
{
  return build_serially(mesh.positions, mesh.triangles, uint32_t(mesh.triangles.size()), stats);
}

TEST(BvhGroups, LeavesHoldWhatLiesInTheirBoxes)
{
  Random rng(4);
  for (const NamedMesh &m : device_meshes()) {
    SCOPED_TRACE(m.name);
    BvhBuildStats stats;
    const HostBvh tree = build(m.mesh, stats);
    expect_sound(m.mesh, tree, stats);
    if (m.mesh.triangles.size() <= 30000) expect_complete(m.mesh, tree, rng, 3);
  }
}

TEST(BvhGroups, EmptyAndDegenerateInputGivesATreeWithoutNodes)
{
  BvhBuildStats stats;
  EXPECT_EQ(build({}, stats).root, bvh_empty);
  Mesh points;
  for (int i = 0; i < 100; ++i) points.add({1, 2, 3}, {1, 2, 3}, {1, 2, 3});
  points.add({0, 0, 0}, {1, 1, 1}, {3, 3, 3});
  EXPECT_EQ(build(points, stats).root, bvh_empty);
}

// The surface area heuristic sees no more than a twentieth between the builders.
TEST(BvhGroups, CostWhatTheHostsTreesCost)
{
  for (const NamedMesh &m : device_meshes()) {
    const std::string name = m.name;
    if (name != "needles" && name != "icosphere" && name != "mixed" && name != "soup") continue;
    SCOPED_TRACE(name);
    BvhBuildStats stats, host_stats;
    build(m.mesh, stats);
    build_bvh(source_of(m.mesh), nullptr, host_stats);
    EXPECT_LT(stats.sah_cost, host_stats.sah_cost * 1.05);
    EXPECT_GT(stats.sah_cost, host_stats.sah_cost * 0.8);
  }
}

TEST(BvhGroups, MustHalveWhereOnlyHalvingKeepsTheDepth)
{
  for (uint32_t depth = 0; depth <= uint32_t(bvh_max_depth); ++depth) {
    EXPECT_FALSE(cuda::must_halve(1, depth));
    const uint32_t left = uint32_t(bvh_max_depth) - depth;
    // 2^(left - 1) references still take any split: all but one may go to one side.
    if (left >= 1 && left <= 29) {
      EXPECT_FALSE(cuda::must_halve(uint32_t(1) << (left - 1), depth)) << depth;
      EXPECT_TRUE(cuda::must_halve((uint32_t(1) << (left - 1)) + 1, depth)) << depth;
    }
  }
}

// The order of integers is that of floats.
TEST(BvhGroups, OrderedIntegersAreInTheOrderOfFloats)
{
  const float values[] = {-infinity, -3e38f, -1, -1e-45f, -0.0f, 0.0f, 1e-45f, 1, 3e38f, infinity};
  for (size_t i = 0; i < std::size(values); ++i) {
    EXPECT_EQ(float_bits(cuda::float_from_ordered(cuda::ordered_from_float(values[i]))),
              float_bits(values[i]));
    if (i != 0) {
      EXPECT_LT(cuda::ordered_from_float(values[i - 1]), cuda::ordered_from_float(values[i]));
    }
  }
}

}  // namespace
}  // namespace gpurt
