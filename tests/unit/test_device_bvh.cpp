// Bvhs built and refitted on a CUDA device: their structure, node by node. Hits are compared by tests/cuda.
#include <cuda_runtime_api.h>

#include "cuda/accel/build/refit.h"
#include "cuda/lanes.h"
#include "device_mesh.h"
#include "device_meshes.h"

namespace gpurt {
namespace {

using namespace test;
using cuda::DeviceBvh;
using cuda::DeviceMemory;

HostBvh download(const DeviceBvh &tree)
{
  HostBvh host;
  host.bounds = tree.bounds;
  host.frame = tree.frame;
  host.root = tree.root;
  host.nodes.resize(tree.nodes.size());
  std::vector<LeafTriangle> triangles(tree.triangles.size());
  if (!host.nodes.empty())
    cuda::check(cudaMemcpy(host.nodes.data(), tree.nodes.data(), tree.nodes.bytes(), cudaMemcpyDeviceToHost),
                "cudaMemcpy");
  if (!triangles.empty())
    cuda::check(
        cudaMemcpy(triangles.data(), tree.triangles.data(), tree.triangles.bytes(), cudaMemcpyDeviceToHost),
        "cudaMemcpy");
  for (const LeafTriangle &t : triangles) host.references.push_back(t.triangle);
  return host;
}

void expect_same(const HostBvh &a, const HostBvh &b)
{
  EXPECT_EQ(a.root, b.root);
  EXPECT_EQ(a.references, b.references);
  ASSERT_EQ(a.nodes.size(), b.nodes.size());
  EXPECT_TRUE(a.nodes.empty() ||
              std::memcmp(a.nodes.data(), b.nodes.data(), a.nodes.size() * sizeof(BvhNode)) == 0);
}

BvhBuildStats stats_of(const DeviceBvh &tree)
{
  BvhBuildStats stats;
  stats.depth = tree.depth;
  stats.sah_cost = tree.sah_cost;
  return stats;
}

class CudaBvh : public testing::Test {
 protected:
  void SetUp() override
  {
    if (!has_cuda()) GTEST_SKIP() << "no CUDA device";
    memory = std::make_shared<DeviceMemory>(0, 0);
    stream.emplace();
  }
  DeviceBvh build(const DeviceMesh &mesh) const
  {
    return cuda::build_bvh_on_device(mesh.view, mesh.group, memory, stream->get());
  }

  std::shared_ptr<DeviceMemory> memory;
  std::optional<cuda::Stream> stream;
};

TEST_F(CudaBvh, LeavesHoldWhatLiesInTheirBoxes)
{
  Random rng(4);
  for (const NamedMesh &m : device_meshes()) {
    SCOPED_TRACE(m.name);
    const DeviceMesh mesh(m.mesh, memory, stream->get());
    const DeviceBvh tree = build(mesh);
    const HostBvh host = download(tree);
    expect_sound(m.mesh, host, stats_of(tree));
    expect_complete(m.mesh, host, rng, 3);
  }
}

TEST_F(CudaBvh, HaveNoNodesWhereThereIsNothingToHit)
{
  Mesh points;
  EXPECT_EQ(build(DeviceMesh(points, memory, stream->get())).root, bvh_empty);
  for (int i = 0; i < 10000; ++i) points.add({1, 2, 3}, {1, 2, 3}, {1, 2, 3});
  const DeviceBvh tree = build(DeviceMesh(points, memory, stream->get()));
  EXPECT_EQ(tree.root, bvh_empty);
  EXPECT_FALSE(tree.is_complete);
}

TEST_F(CudaBvh, AreTheSameInEveryRun)
{
  Random rng(5);
  Mesh large = soup(rng, 300000, 0.01f, 1);
  large.add(needles_of(rng, 20000));
  large.add(icosphere(6, 0.7f));
  const DeviceMesh mesh(large, memory, stream->get());
  const DeviceBvh first = build(mesh);
  const HostBvh host = download(first);
  expect_sound(large, host, stats_of(first));
  for (int i = 0; i < 3; ++i) {
    const DeviceBvh again = build(mesh);
    expect_same(download(again), host);
    EXPECT_EQ(again.sah_cost, first.sah_cost);
  }
}

// 10^6 triangles with one centre, which nothing tells apart.
TEST_F(CudaBvh, EndWhereAllTrianglesMeet)
{
  Random rng(6);
  Mesh one_place, star;
  for (int i = 0; i < 1000000; ++i) one_place.add({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  for (int i = 0; i < 200000; ++i) star.add({0, 0, 0}, rng.direction(), rng.direction());
  for (const Mesh &m : {one_place, star}) {
    const DeviceBvh tree = build(DeviceMesh(m, memory, stream->get()));
    expect_sound(m, download(tree), stats_of(tree));
  }
}

TEST_F(CudaBvh, KeepTheMemoryLimit)
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
      cuda::build_bvh_on_device(mesh->view, mesh->group, little, stream->get());
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

TEST_F(CudaBvh, AreRefittedToWhatHasMoved)
{
  Random rng(8);
  for (const NamedMesh &m : device_meshes()) {
    const std::string name = m.name;
    if (name == "mixed" || name == "tiny" || name == "huge" || name == "grid")
      continue;  // with degenerate triangles
    SCOPED_TRACE(name);
    const DeviceMesh mesh(m.mesh, memory, stream->get());
    const DeviceBvh tree = build(mesh);
    // In place: the same tree, but for triangles that were cut, whose parts are whole now.
    bool fits = false;
    const DeviceBvh same = cuda::refit_bvh(tree, mesh.view, memory, stream->get(), fits);
    ASSERT_TRUE(fits);
    expect_sound(m.mesh, download(same), stats_of(same));
    if (tree.triangles.size() == m.mesh.triangles.size()) {
      expect_same(download(same), download(tree));
      EXPECT_NEAR(same.sah_cost, tree.sah_cost, 1e-4 * tree.sah_cost);
    } else {
      EXPECT_GT(same.sah_cost, tree.sah_cost * 0.9999);
    }
    if (name == "shrinking" || name == "crowded") continue;  // sums below lose what is small
    Mesh moved = m.mesh;
    for (Vec3f &p : moved.positions) p = {p.x + 0.25f * p.y, p.y - 0.5f * p.z, p.z + 3.0f};
    const DeviceMesh moved_mesh(moved, memory, stream->get());
    const DeviceBvh refitted = cuda::refit_bvh(tree, moved_mesh.view, memory, stream->get(), fits);
    if (!fits) continue;  // rounding took a triangle's area
    EXPECT_TRUE(refitted.is_refitted);
    const HostBvh host = download(refitted);
    expect_sound(moved, host, stats_of(refitted));
    expect_complete(moved, host, rng, 3);
  }
}

TEST_F(CudaBvh, AreNotRefittedWhereATriangleHasNoAreaLeft)
{
  Random rng(9);
  Mesh m = soup(rng, 5000, 0.1f, 1);
  const DeviceBvh tree = build(DeviceMesh(m, memory, stream->get()));
  m.positions[m.triangles[4321].x] = m.positions[m.triangles[4321].y];
  bool fits = true;
  cuda::refit_bvh(tree, DeviceMesh(m, memory, stream->get()).view, memory, stream->get(), fits);
  EXPECT_FALSE(fits);
}

}  // namespace
}  // namespace gpurt
