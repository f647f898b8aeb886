// Photons, their encoding, and the grid over them on the host.
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <random>

#include "../support/photon_sets.h"
#include "cpu/photon/photon_grid.h"
#include "cpu/photon/radix_sort.h"

namespace gpurt {
namespace {

using photon_sets::Point;
using photon_sets::Set;

Vec3f vec(const Point &p) { return {p[0], p[1], p[2]}; }

TEST(PhotonFlux, DecodesWithinAStepOfTheLargestComponent)
{
  std::mt19937 random(1);
  std::uniform_real_distribution<float> unit(0, 1);
  for (int i = 0; i < 100000; ++i) {
    const float scale = std::ldexp(1.0f, int(random() % 250) - 125);
    const Vec3f flux = {unit(random) * scale, unit(random) * scale, i % 3 == 0 ? 0.0f : unit(random) * scale};
    const Vec3f decoded = decode_flux(encode_flux(flux, uint32_t(i)));
    // A step is at most 2^-7 of the largest component, or the smallest unit.
    const float step = std::max(max_component(flux) * 0x1p-7f, 0x1p-126f);
    for (int k = 0; k < 3; ++k) ASSERT_LE(std::abs(at(decoded, k) - at(flux, k)), step) << i << " " << k;
  }
  EXPECT_EQ(encode_flux({0, 0, 0}, 1), 0u);
  EXPECT_EQ(max_component(decode_flux(encode_flux({max_photon_flux, 0, 0}, 1))), max_photon_flux);
  EXPECT_EQ(decode_flux(encode_flux({1, 0.5f, 0.25f}, 9)).y, 0.5f);
}

TEST(PhotonFlux, IsRoundedWithoutBias)
{
  // The small components are far below a step: only rounding up now and then can keep their mean.
  const Vec3f flux = {1.99f, 0.0123f, 0.00017f};
  const int n = 4 << 20;
  double sum[3] = {0, 0, 0};
  for (int i = 0; i < n; ++i) {
    const Vec3f d = decode_flux(encode_flux(flux, uint32_t(i)));
    for (int k = 0; k < 3; ++k) sum[k] += at(d, k);
  }
  for (int k = 0; k < 3; ++k) {
    // A rounded value is off by a step, 2^-7, with probability p: variance p (1 - p) step^2. 5 sigma.
    const double step = 0x1p-7, x = at(flux, k) / step, p = x - std::floor(x);
    EXPECT_NEAR(sum[k] / n, at(flux, k), 5 * step * std::sqrt(p * (1 - p) / n)) << k;
  }
}

TEST(PhotonDirection, DecodesWithinItsSteps)
{
  std::mt19937 random(2);
  for (int i = 0; i < 100000; ++i) {
    const Vec3f d = vec(photon_sets::on_sphere(random, {0, 0, 0}, 1));
    const Vec3f e = decode_direction(encode_direction(d));
    // Steps of 1 / 32767 of the octahedron, half of one off in u and v and one in z, which the sphere stretches by at most sqrt(3).
    ASSERT_LT(length(d - e), 2.2f / 32767) << i;
  }
  for (int axis = 0; axis < 3; ++axis) {
    for (float s : {-1.0f, 1.0f}) {
      Vec3f d = {0, 0, 0};
      set(d, axis, s);
      const Vec3f e = decode_direction(encode_direction(d));
      EXPECT_EQ(at(e, axis), s);
      EXPECT_EQ(length2(e), 1.0f);
    }
  }
}

TEST(PhotonNormal, DotsWithinAStep)
{
  std::mt19937 random(3);
  for (int i = 0; i < 100000; ++i) {
    const Vec3f a = vec(photon_sets::on_sphere(random, {0, 0, 0}, 1));
    const Vec3f b = vec(photon_sets::on_sphere(random, {0, 0, 0}, 1));
    // Either vector is off by at most half a step in each component: sqrt(3) / 254 in length.
    ASSERT_NEAR(normal_dot(encode_normal(a), encode_normal(b)) / (127.0 * 127.0), dot(a, b), 0.0140) << i;
    ASSERT_GT(normal_dot(encode_normal(a), encode_normal(a)), normal_threshold(0.97f));
  }
  EXPECT_EQ(normal_dot(encode_normal({0, -1, 0}), encode_normal({0, -1, 0})), 127 * 127);
  EXPECT_EQ(normal_dot(encode_normal({0, -1, 0}), encode_normal({0, 1, 0}) | 0x7f000000u), -127 * 127);
}

TEST(RadixSort, IsStableForAnyNumberOfThreads)
{
  for (const uint64_t n : {0, 1, 1000, 300000}) {
    for (const int bits : {1, 8, 17, 32}) {
      std::mt19937 random(unsigned(n) + unsigned(bits));
      std::vector<KeyValue> pairs(n);
      for (uint64_t i = 0; i < n; ++i) pairs[i] = {uint32_t(random()) >> (32 - bits), uint32_t(i)};
      std::vector<KeyValue> expected = pairs, scratch(n);
      std::stable_sort(expected.begin(), expected.end(), [](auto a, auto b) { return a.key < b.key; });
      tbb::task_arena arena(bits % 2 == 0 ? 1 : 3);
      arena.execute([&] {
        const KeyValue *sorted = sort_pairs(pairs.data(), scratch.data(), n, bits, nullptr);
        for (uint64_t i = 0; i < n; ++i) {
          ASSERT_EQ(sorted[i].key, expected[i].key);
          ASSERT_EQ(sorted[i].value, expected[i].value);
        }
      });
    }
  }
}

PhotonSource source_of(const std::vector<Point> &points)
{
  return {nullptr, reinterpret_cast<const Vec3f *>(points.data()), nullptr, nullptr, points.size()};
}

CpuPhotonGrid build(const std::vector<Point> &points, float radius, int threads = 2)
{
  tbb::task_arena arena(threads);
  return arena.execute([&] {
    const PhotonSource source = source_of(points);
    uint64_t first_bad;
    const Box bounds = photon_bounds(source, first_bad);
    EXPECT_EQ(first_bad, points.size());
    return CpuPhotonGrid(source, bounds, {radius, false, true}, nullptr);
  });
}

class Grids : public testing::TestWithParam<float> {};

// What a gather visits is exactly what the test of distances lets pass, each once, whatever the size of cells.
TEST_P(Grids, GatherWhatIsWithinTheRadius)
{
  for (const Set &set : photon_sets::all(3000)) {
    const CpuPhotonGrid built = build(set.points, set.radius * GetParam());
    const PhotonGrid grid = built.view();
    ASSERT_EQ(grid.starts[grid.shape.table_size], set.points.size());
    uint64_t total = 0;
    for (const Point &q : photon_sets::queries(set, 200, 5)) {
      std::vector<uint32_t> found, expected;
      gather(grid, vec(q), set.radius, [&](uint32_t i, float d2, const PhotonProbe &probe) {
        EXPECT_EQ(d2, length2(probe.position - vec(q)));
        found.push_back(grid.indices[i]);
      });
      for (size_t i = 0; i < set.points.size(); ++i) {
        if (length2(vec(set.points[i]) - vec(q)) < set.radius * set.radius) expected.push_back(uint32_t(i));
      }
      std::sort(found.begin(), found.end());
      ASSERT_EQ(found, expected) << set.name;
      total += found.size();
    }
    if (set.radius > 1e-5f) {
      EXPECT_GT(total, 0u) << set.name;
    }
  }
}
INSTANTIATE_TEST_SUITE_P(CellsOverRadius, Grids, testing::Values(1.0f, 0.1f, 0.37f, 3.0f));

TEST(PhotonGrid, VisitsFewMoreThanItFinds)
{
  const std::vector<Point> points = photon_sets::uniform(100000, 1);
  const float radius = 0.05f;
  const CpuPhotonGrid built = build(points, radius);
  const PhotonGrid grid = built.view();
  uint64_t found = 0, visited = 0;
  for (const Point &q : photon_sets::uniform(1000, 2)) {
    for_each_range(grid, vec(q), radius, [&](uint32_t begin, uint32_t end) { visited += end - begin; });
    gather(grid, vec(q), radius, [&](uint32_t, float, const PhotonProbe &) { ++found; });
  }
  // A sphere fills 4.2 of the 27 cells; trimming rows leaves about 19 of them.
  EXPECT_LT(double(visited) / double(found), 5.0);
}

TEST(PhotonGrid, HasTheSameBytesForAnyNumberOfThreads)
{
  const std::vector<Point> points = photon_sets::clustered(200000, 3);
  const CpuPhotonGrid one = build(points, 0.002f, 1), three = build(points, 0.002f, 3);
  const PhotonGrid a = one.view(), b = three.view();
  ASSERT_EQ(a.shape.table_size, b.shape.table_size);
  EXPECT_EQ(std::memcmp(a.starts, b.starts, (a.shape.table_size + 1) * 4), 0);
  EXPECT_EQ(std::memcmp(a.probes, b.probes, points.size() * 16), 0);
  EXPECT_EQ(std::memcmp(a.indices, b.indices, points.size() * 4), 0);
  for (size_t i = 1; i < points.size(); ++i) {
    const uint32_t before = photon_entry(a.shape, a.probes[i - 1].position);
    const uint32_t entry = photon_entry(a.shape, a.probes[i].position);
    ASSERT_TRUE(before < entry || (before == entry && a.indices[i - 1] < a.indices[i]));
  }
}

TEST(PhotonGrid, ClampsItsCellsWhereTheRadiusIsTiny)
{
  const GridShape shape = make_grid_shape({{0, 0, 0}, {1e6f, 1e6f, 1e6f}}, 1e-18f, 1000);
  EXPECT_LE(shape.num_cells.x, max_cells_of_axis);
  EXPECT_GE(shape.num_cells.x, max_cells_of_axis / 2);
  EXPECT_LE(shape.table_size, 4096u);
  EXPECT_EQ(build({}, 0.1f).view().starts[0], 0u);
}

TEST(PhotonGrid, FindsNothingNearNoNumber)
{
  const CpuPhotonGrid built = build(photon_sets::uniform(1000, 1), 0.1f);
  for (const float bad : {NAN, INFINITY, -INFINITY, 1e38f}) {
    gather(built.view(), {0.5f, bad, 0.5f}, 0.1f, [](uint32_t, float, const PhotonProbe &) { FAIL(); });
    EXPECT_LT(query_entry(built.view().shape, {bad, 0.5f, bad}), built.view().shape.table_size);
  }
}

TEST(PhotonGrid, NamesTheFirstPhotonThatIsNotFinite)
{
  std::vector<Point> points = photon_sets::uniform(100000, 1);
  points[70001][1] = NAN;
  points[4711][2] = INFINITY;
  uint64_t first_bad;
  photon_bounds(source_of(points), first_bad);
  EXPECT_EQ(first_bad, 4711u);
}

TEST(PhotonGrid, CountsItsMemory)
{
  const auto memory = std::make_shared<MemoryTracker>(2 << 20);
  const std::vector<Point> points = photon_sets::uniform(10000, 1);
  const PhotonSource source = source_of(points);
  const Box bounds = {{0, 0, 0}, {1, 1, 1}};
  {
    const CpuPhotonGrid grid(source, bounds, {0.1f, false, true}, memory);
    EXPECT_EQ(memory->used(), grid.bytes());
  }
  EXPECT_EQ(memory->used(), 0u);
  const std::vector<Point> many = photon_sets::uniform(200000, 1);
  EXPECT_THROW(CpuPhotonGrid(source_of(many), bounds, {0.1f, false, true}, memory), Error);
  EXPECT_EQ(memory->used(), 0u);
}

}  // namespace
}  // namespace gpurt
