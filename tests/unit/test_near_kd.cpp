// Rays as the kd-tree's fast kernels carry them: they meet every leaf that holds a triangle which the exact test accepts, and find
// the closest hit though leaves behind it are left out.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <set>

#include "accel/kd_build.h"
#include "core/accel/near_kd.h"
#include "core/accel/trace.h"

namespace gpurt {
namespace {

class Random {
 public:
  explicit Random(uint64_t seed) : engine_(seed) {}
  float between(float lo, float hi) { return std::uniform_real_distribution<float>(lo, hi)(engine_); }
  uint32_t below(uint32_t n) { return uint32_t(engine_() % n); }
  Vec3f point(float size) { return {between(-size, size), between(-size, size), between(-size, size)}; }

 private:
  std::mt19937_64 engine_;
};

struct Mesh {
  std::vector<Vec3f> positions;
  std::vector<UInt3> indices;
  void add(Vec3f a, Vec3f b, Vec3f c)
  {
    const uint32_t n = uint32_t(positions.size());
    positions.insert(positions.end(), {a, b, c});
    indices.push_back({n, n + 1, n + 2});
  }
};

struct Tree {
  HostKdTree tree;
  std::vector<LeafTriangle> triangles;
  NearKdView view{};
};

Tree tree_of(const Mesh &mesh, const KdBuildSettings &settings = {})
{
  Tree t;
  KdSource source;
  source.count = mesh.indices.size();
  source.positions = mesh.positions.data();
  source.indices = mesh.indices.data();
  KdBuildStats stats;
  t.tree = build_kd_tree(source, settings, nullptr, stats);
  for (const uint32_t i : t.tree.references) {
    const UInt3 c = mesh.indices[i];
    t.triangles.push_back({mesh.positions[c.x], i, mesh.positions[c.y], i, mesh.positions[c.z], 0});
  }
  t.view = make_near_kd_view(
      {t.tree.nodes.data(), t.tree.references.data(), t.tree.bounds, uint32_t(t.tree.nodes.size())},
      t.triangles.data());
  return t;
}

constexpr uint32_t no_node = 0xffffffffu;

struct Stack {
  std::vector<uint32_t> word;
  std::vector<std::pair<float, float>> span;
  void push(uint32_t w, float a, float b)
  {
    EXPECT_LE(a, b);
    word.push_back(w);
    span.push_back({a, b});
    EXPECT_LE(word.size(), size_t(kd_max_depth));
  }
  uint32_t pop(float end, float &a, float &b)
  {
    while (!word.empty()) {
      const uint32_t w = word.back();
      std::tie(a, b) = span.back();
      word.pop_back();
      span.pop_back();
      if (a > end) continue;
      b = std::min(b, end);
      return w;
    }
    return no_node;
  }
};

// Calls test(triangle, end) for the triangles of the leaves that the ray meets. False: the ray goes the general way.
template <class Test>
bool walk(const NearKdView &tree, const Ray &ray, Test &&test)
{
  NearRay r;
  NearKdRay q;
  if (!make_near_kd_ray(ray, tree, r, q)) return false;
  float a = q.a, b = q.b, end = ray.tmax + r.end_offset;
  if (a > b) return true;
  Stack stack;
  const auto axes = [&](uint32_t tag) { return q.axis[tag & 3u]; };
  for (uint32_t current = 0; current != no_node;) {
    const KdNode node = tree.nodes[current];
    if (!is_leaf(node)) {
      current = near_kd_step(node, axes, q.width, a, b, stack);
      continue;
    }
    for (uint32_t k = 0; k < payload(node); ++k) test(tree.triangles[node.word + k], r, end);
    current = stack.pop(end, a, b);
  }
  return true;
}

Ray ray_for(const Mesh &mesh, Random &rng, float size, Vec3f shift)
{
  const UInt3 c = mesh.indices[rng.below(uint32_t(mesh.indices.size()))];
  const Vec3f p = mesh.positions[c.x], e = mesh.positions[c.y] - p, f = mesh.positions[c.z] - p;
  const float u = rng.below(3) ? rng.between(0, 1) : 0.0f, v = rng.below(3) ? rng.between(0, 1 - u) : 0.0f;
  const Vec3f target = p + e * u + f * v;
  Ray ray{shift + rng.point(size), 0.0f, {}, infinity};
  if (rng.below(5) == 0) {  // along an axis
    const int k = int(rng.below(3));
    const float o = at(ray.origin, k);
    ray.origin = target;
    set(ray.origin, k, o);
    set(ray.direction, k, at(target, k) < o ? -1.0f : 1.0f);
  } else if (rng.below(4) == 0) {  // from a surface
    ray.origin = target;
    ray.direction = rng.point(1);
  } else {
    ray.direction = target - ray.origin;
    if (rng.below(3) == 0) ray.direction = ray.direction * std::exp2(rng.between(-20, 20));
  }
  return ray;
}

void check(const Mesh &mesh, float size, uint64_t seed, const KdBuildSettings &settings = {},
           uint64_t min_left_out = 100, Vec3f shift = {})
{
  const Tree q = tree_of(mesh, settings);
  Random rng(seed);
  uint64_t num_near = 0, num_hits = 0, num_left_out = 0;
  const int num_rays = 4000;
  for (int i = 0; i < num_rays; ++i) {
    const Ray ray = ray_for(mesh, rng, size, shift);
    std::set<uint32_t> visited;
    if (!walk(q.view, ray,
              [&](const LeafTriangle &x, const NearRay &, float &) { visited.insert(x.triangle); }))
      continue;
    ++num_near;
    TraceRay general;
    if (!prepare_ray(ray.origin, ray.direction, ray.tmin, ray.tmax, general)) continue;
    TriangleRay<TriangleTest::Watertight> triangle_ray;
    make_triangle_ray(general, triangle_ray);
    const auto accepts = [&](Vec3f a, Vec3f b, Vec3f c, TriangleHit &hit) {
      return intersect<EdgeRule::Inclusive>(triangle_ray, a, b, c, ray.tmin, ray.tmax, hit);
    };
    float least = infinity;
    for (uint32_t t = 0; t < mesh.indices.size(); ++t) {
      const UInt3 c = mesh.indices[t];
      TriangleHit hit;
      if (is_degenerate(mesh.positions[c.x], mesh.positions[c.y], mesh.positions[c.z])) continue;
      if (!accepts(mesh.positions[c.x], mesh.positions[c.y], mesh.positions[c.z], hit)) continue;
      ++num_hits;
      least = std::min(least, hit.t);
      ASSERT_TRUE(visited.count(t)) << "ray " << i << ", triangle " << t;
    }
    // With what lies behind a hit left out.
    float found = infinity;
    size_t num_tested = 0;
    walk(q.view, ray, [&](const LeafTriangle &x, const NearRay &r, float &end) {
      ++num_tested;
      TriangleHit hit;
      if (!accepts(x.a, x.b, x.c, hit)) return;
      found = std::min(found, hit.t);
      end = std::min(end, hit.t + r.end_offset);
    });
    num_left_out += num_tested < visited.size();
    ASSERT_EQ(found, least) << "ray " << i;
  }
  EXPECT_GT(num_near, uint64_t(num_rays) * 9 / 10);
  EXPECT_GT(num_hits, uint64_t(num_rays) / 2);
  EXPECT_GE(num_left_out, min_left_out);
}

Mesh soup(Random &rng, int n, float size, float extent, Vec3f shift = {})
{
  Mesh mesh;
  for (int i = 0; i < n; ++i) {
    const Vec3f p = shift + rng.point(extent);
    mesh.add(p + rng.point(size), p + rng.point(size), p + rng.point(size));
  }
  return mesh;
}

TEST(NearKd, VisitsLeavesOfAcceptedTriangles)
{
  Random rng(3);
  check(soup(rng, 1500, 0.1f, 1), 1.5f, 1);
  check(soup(rng, 60, 2.0f, 1), 4.0f, 2);
  check(soup(rng, 1500, 1e-4f, 1e-2f), 1e-2f, 3);
  Mesh needles;
  for (int i = 0; i < 400; ++i) {
    const Vec3f p = rng.point(1), d = rng.point(1);
    needles.add(p, p + d * 2.0f, p + d * 2.0f + rng.point(1e-4f));
  }
  check(needles, 2.0f, 4);
}

TEST(NearKd, FlatCellsAndTreesOfOneLeaf)
{
  Mesh grid;
  for (int z = 0; z < 20; ++z) {
    for (int x = 0; x < 20; ++x) {
      const float fx = float(x), fz = float(z);
      grid.add({fx, 0, fz}, {fx + 1, 0, fz}, {fx, 0, fz + 1});
      grid.add({fx + 1, 0, fz}, {fx + 1, 0, fz + 1}, {fx, 0, fz + 1});
      if ((x + z) % 3 == 0) grid.add({fx, 1, fz}, {fx, 2, fz}, {fx, 1, fz + 1});
    }
  }
  check(grid, 20.0f, 5);
  // One leaf, of more triangles than stand in it.
  Random rng(7);
  Mesh few = soup(rng, 40, 1.0f, 0.1f);
  KdBuildSettings settings;
  settings.max_depth = 1;
  check(few, 2.0f, 6, settings, 0);
  Mesh many;
  for (int i = 0; i < 200; ++i) many.add({0, 0, 0}, {1, float(i) * 1e-3f, 0}, {0, 1, 1});
  check(many, 2.0f, 8, {}, 0);
}

// Far from the origin coordinates have few bits left: more is left to rounding.
TEST(NearKd, ServesMeshesFarFromTheOrigin)
{
  Random rng(9);
  check(soup(rng, 800, 0.1f, 1, {300, -200, 100}), 1.5f, 9, {}, 100, {300, -200, 100});
  check(soup(rng, 800, 0.1f, 1, {30000, 0, 100}), 1.5f, 10, {}, 0, {30000, 0, 100});
}

}  // namespace
}  // namespace gpurt
