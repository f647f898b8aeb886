// Kd-trees built on a CUDA device: their structure, node by node; and what its threads do for a cell, by one thread of the
// host. Hits are compared by tests/cuda.
#include <cuda_runtime_api.h>

#include "cuda/accel/build/kd_builder.h"
#include "cuda/accel/build/kd_node.h"
#include "cuda/lanes.h"
#include "device_mesh.h"
#include "device_meshes.h"
#include "kd_soundness.h"

namespace gpurt {
namespace {

using namespace test;
using cuda::DeviceKdTree;
using cuda::DeviceMemory;

// The tree that the device builds, by one thread.
HostKdTree build_serially(const Mesh &mesh, KdBuildStats &stats)
{
  using namespace cuda;
  const BuildScene scene = {mesh.positions.data(), mesh.triangles.data()};
  HostKdTree tree;
  tree.num_triangles = mesh.triangles.size();
  tree.bounds = empty_box();
  std::vector<BuildReference> from, to;
  for (uint32_t i = 0; i < mesh.triangles.size(); ++i) {
    const UInt3 c = mesh.triangles[i];
    const Vec3f p = mesh.positions[c.x], q = mesh.positions[c.y], r = mesh.positions[c.z];
    if (is_degenerate(p, q, r)) continue;
    from.push_back({min(p, min(q, r)), i, max(p, max(q, r)), 0});
    tree.bounds = extend(tree.bounds, Box{from.back().lo, from.back().hi});
  }
  if (from.empty()) return tree;
  const uint32_t count = uint32_t(from.size());
  const KdBuildCosts costs = {
      kd_default_traversal_cost, 1.0f - kd_default_empty_bonus,
      std::min(uint32_t(8.0 + 1.3 * std::log2(double(count))), uint32_t(kd_max_depth))};
  std::vector<KdBuildCell> cells = {{tree.bounds, 0, count, 8 * count}}, next;
  const auto small = std::make_unique<KdSmallShared>();
  const auto large = std::make_unique<KdLargeShared>();
  for (uint32_t depth = 0; !cells.empty(); ++depth) {
    next.clear();
    to.clear();
    const uint32_t first_node = uint32_t(tree.nodes.size());
    for (const KdBuildCell &cell : cells) {
      const BuildReference *references = from.data() + cell.first;
      KdChoice choice;
      if (cell.count <= kd_small_cell)
        choose_small(SerialGroup(), references, cell, depth, costs, *small, choice);
      else choose_large(SerialGroup(), references, cell, depth, costs, *large, choice);
      if (!choice.is_split) {
        stats.depth = depth;
        tree.nodes.push_back({cell.count == 0 ? 0 : uint32_t(tree.references.size()), cell.count << 2 | 3u});
        for (uint32_t i = 0; i < cell.count; ++i) tree.references.push_back(references[i].triangle);
        continue;
      }
      EXPECT_LE(uint64_t(choice.num[0]) + choice.num[1], cell.budget);
      tree.nodes.push_back({float_bits(choice.position),
                            uint32_t(first_node + cells.size() + next.size()) << 2 | uint32_t(choice.axis)});
      const uint32_t below = uint32_t(to.size()), above = below + choice.num[0];
      to.resize(above + choice.num[1]);
      uint32_t num[2];
      partition_cell(SerialGroup(), scene, references, cell, choice, to.data() + below, to.data() + above,
                     num);
      EXPECT_LE(num[0], choice.num[0]);
      EXPECT_LE(num[1], choice.num[1]);
      KdBuildCell child[2];
      make_child_cells(cell, choice, num, below, above, child);
      next.insert(next.end(), child, child + 2);
    }
    std::swap(cells, next);
    std::swap(from, to);
  }
  return tree;
}

TEST(DeviceKdAlgorithms, GiveSoundTreesOneByOne)
{
  Random rng(3);
  for (const NamedMesh &m : device_meshes()) {
    SCOPED_TRACE(m.name);
    KdBuildStats stats;
    const HostKdTree tree = build_serially(m.mesh, stats);
    expect_sound(m.mesh, tree, stats);
    if (!tree.nodes.empty()) expect_complete(m.mesh, tree, rng, 2);
  }
}

class CudaKd : public testing::Test {
 protected:
  void SetUp() override
  {
    if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
    memory = std::make_shared<DeviceMemory>(0, 0);
    stream.emplace();
  }
  DeviceKdTree build(const DeviceMesh &mesh) const
  {
    return cuda::build_kd_tree_on_device(mesh.view, mesh.group, {}, memory, stream->get());
  }

  std::shared_ptr<DeviceMemory> memory;
  std::optional<cuda::Stream> stream;
};

template <class T>
std::vector<T> to_host(const T *from, uint64_t count)
{
  std::vector<T> values(count);
  if (count != 0)
    cuda::check(cudaMemcpy(values.data(), from, count * sizeof(T), cudaMemcpyDeviceToHost), "cudaMemcpy");
  return values;
}

HostKdTree download(const DeviceKdTree &tree, const Mesh &mesh)
{
  HostKdTree host;
  host.nodes = to_host(tree.nodes.data(), tree.num_nodes);
  host.references = to_host(tree.references.data(), tree.num_references);
  host.bounds = tree.bounds;
  host.num_triangles = mesh.triangles.size();
  return host;
}

KdBuildStats stats_of(const DeviceKdTree &tree)
{
  KdBuildStats stats;
  stats.depth = tree.depth;
  stats.sah_cost = tree.sah_cost;
  return stats;
}

void expect_same(const HostKdTree &a, const HostKdTree &b)
{
  EXPECT_EQ(a.references, b.references);
  ASSERT_EQ(a.nodes.size(), b.nodes.size());
  EXPECT_TRUE(a.nodes.empty() ||
              std::memcmp(a.nodes.data(), b.nodes.data(), a.nodes.size() * sizeof(KdNode)) == 0);
}

// The same checks as of the host's trees, and the very tree that one thread makes.
TEST_F(CudaKd, LeavesHoldWhatLiesInTheirCells)
{
  Random rng(4);
  for (const NamedMesh &m : device_meshes()) {
    SCOPED_TRACE(m.name);
    const DeviceMesh mesh(m.mesh, memory, stream->get());
    const DeviceKdTree tree = build(mesh);
    const HostKdTree host = download(tree, m.mesh);
    expect_sound(m.mesh, host, stats_of(tree));
    if (!host.nodes.empty()) expect_complete(m.mesh, host, rng, 3);
    KdBuildStats stats;
    expect_same(host, build_serially(m.mesh, stats));
  }
}

TEST_F(CudaKd, HaveNoNodesWhereThereIsNothingToHit)
{
  Mesh points;
  EXPECT_EQ(build(DeviceMesh(points, memory, stream->get())).num_nodes, 0u);
  for (int i = 0; i < 10000; ++i) points.add({1, 2, 3}, {1, 2, 3}, {1, 2, 3});
  EXPECT_EQ(build(DeviceMesh(points, memory, stream->get())).num_nodes, 0u);
}

TEST_F(CudaKd, AreTheSameInEveryRun)
{
  Random rng(5);
  Mesh large = soup(rng, 200000, 0.01f, 1);
  large.add(icosphere(6, 0.7f));
  const DeviceMesh mesh(large, memory, stream->get());
  const DeviceKdTree first = build(mesh);
  const HostKdTree host = download(first, large);
  expect_sound(large, host, stats_of(first));
  for (int i = 0; i < 3; ++i) {
    const DeviceKdTree again = build(mesh);
    expect_same(download(again, large), host);
    EXPECT_EQ(again.sah_cost, first.sah_cost);
  }
}

// Close to the host's tree, whose upper levels are exact too.
TEST_F(CudaKd, CostNoMoreThanTheHosts)
{
  Random rng(6);
  Mesh mesh = soup(rng, 50000, 0.02f, 1);
  mesh.add(icosphere(6, 0.7f));
  KdSource source;
  source.count = mesh.triangles.size();
  source.positions = mesh.positions.data();
  source.indices = mesh.triangles.data();
  KdBuildStats stats;
  build_kd_tree(source, {}, std::make_shared<MemoryTracker>(0), stats);
  const DeviceKdTree tree = build(DeviceMesh(mesh, memory, stream->get()));
  EXPECT_LT(tree.sah_cost, 1.05 * stats.sah_cost);
  EXPECT_GT(tree.sah_cost, 0.9 * stats.sah_cost);
}

TEST_F(CudaKd, KeepTheMemoryLimit)
{
  Random rng(7);
  const Mesh m = soup(rng, 100000, 0.02f, 1);
  const uint64_t needed = build(DeviceMesh(m, memory, stream->get())).peak_bytes;
  EXPECT_GE(memory->tracker()->peak(), needed);
  for (uint64_t limit : {needed / 20, needed / 3, needed * 3 / 4}) {
    const auto little = std::make_shared<DeviceMemory>(0, limit);
    std::optional<DeviceMesh> mesh;
    try {
      mesh.emplace(m, little, stream->get());
      cuda::build_kd_tree_on_device(mesh->view, mesh->group, {}, little, stream->get());
      ADD_FAILURE() << limit << " bytes cannot be enough";
    } catch (const Error &error) {
      EXPECT_EQ(error.result(), GPURT_ERROR_OUT_OF_MEMORY);
      EXPECT_NE(std::string(error.what()).find("memory limit"), std::string::npos) << error.what();
    }
    mesh.reset();
    EXPECT_EQ(little->tracker()->used(), 0u);
    EXPECT_LE(little->tracker()->peak(), limit);
  }
}

}  // namespace
}  // namespace gpurt
