// The kd-tree in nodes of two levels: rays meet every leaf that holds a triangle which the exact test accepts, and find the
// closest hit though leaves behind it are left out.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "accel/kd_build.h"
#include "core/accel/kd_quad_make.h"
#include "core/accel/trace.h"
#include "random_values.h"

namespace gpurt {
namespace {

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

struct Quads {
  HostKdTree tree;
  std::vector<KdQuadNode> nodes;
  std::vector<uint32_t> places;
  std::vector<LeafTriangle> triangles;
  KdQuadView view{};
};

// As the device makes them, level by level.
Quads quads_of(const Mesh &mesh, const KdBuildSettings &settings = {})
{
  Quads q;
  KdSource source;
  source.count = mesh.indices.size();
  source.positions = mesh.positions.data();
  source.indices = mesh.indices.data();
  KdBuildStats stats;
  q.tree = build_kd_tree(source, settings, nullptr, stats);
  std::vector<uint32_t> place_of(mesh.indices.size(), invalid_id);
  for (const uint32_t t : q.tree.references) {
    if (place_of[t] == invalid_id) {
      place_of[t] = uint32_t(q.triangles.size());
      const UInt3 c = mesh.indices[t];
      q.triangles.push_back({mesh.positions[c.x], t, mesh.positions[c.y], t, mesh.positions[c.z], 0});
    }
    q.places.push_back(place_of[t]);
  }
  const BvhFrame frame = make_bvh_frame(q.tree.bounds);
  std::vector<uint32_t> slots = {0};
  for (size_t i = 0; i < slots.size(); ++i) {
    const KdQuadChildren c = kd_quad_children(q.tree.nodes.data(), q.tree.nodes[slots[i]]);
    const uint32_t first = uint32_t(slots.size());
    slots.insert(slots.end(), c.node, c.node + c.count);
    q.nodes.push_back(make_kd_quad_node(q.tree.nodes.data(), slots[i], first, q.places.data(), frame));
  }
  q.view = {q.nodes.data(), q.places.data(), q.triangles.data(),
            q.tree.bounds,  frame,           is_leaf(q.tree.nodes[0]) ? kd_quad_leaf_bit : 0u};
  return q;
}

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
    return kd_quad_end;
  }
};

// Calls test(triangle, end) for the triangles of the leaves that the ray meets. False: the ray goes the general way.
template <class Test>
bool walk(const KdQuadView &tree, const Ray &ray, Test &&test)
{
  NearRay r;
  KdQuadRay q;
  if (!make_kd_quad_ray(ray, tree, r, q)) return false;
  float a = q.a, b = q.b, end = ray.tmax + r.end_offset;
  if (a > b) return true;
  Stack stack;
  const auto axes = [&](uint32_t word) { return q.axis[kd_quad_axis(word)]; };
  for (uint32_t current = tree.root; current != kd_quad_end;) {
    if ((current & kd_quad_leaf_bit) == 0) {
      const KdQuadNode node = tree.nodes[current & kd_quad_index];
      if (!kd_quad_step(node, axes, q.width, current, a, b, stack)) current = stack.pop(end, a, b);
      continue;
    }
    const KdQuadNode leaf = tree.nodes[current & kd_quad_index];
    EXPECT_GT(leaf.word[0], 0u);
    for (uint32_t k = 0; k < leaf.word[0]; ++k) {
      const uint32_t place =
          leaf.word[0] > kd_quad_inline_triangles ? tree.references[leaf.word[1] + k] : leaf.word[1 + k];
      test(tree.triangles[place], r, end);
    }
    current = stack.pop(end, a, b);
  }
  return true;
}

Ray ray_for(const Mesh &mesh, Random &rng, float size)
{
  const UInt3 c = mesh.indices[rng.below(uint32_t(mesh.indices.size()))];
  const Vec3f p = mesh.positions[c.x], e = mesh.positions[c.y] - p, f = mesh.positions[c.z] - p;
  const float u = rng.below(3) ? rng.between(0, 1) : 0.0f, v = rng.below(3) ? rng.between(0, 1 - u) : 0.0f;
  const Vec3f target = p + e * u + f * v;
  Ray ray{rng.point(size), 0.0f, {}, infinity};
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
           uint64_t min_left_out = 100)
{
  const Quads q = quads_of(mesh, settings);
  Random rng(seed);
  uint64_t num_near = 0, num_hits = 0, num_left_out = 0;
  const int num_rays = 4000;
  for (int i = 0; i < num_rays; ++i) {
    const Ray ray = ray_for(mesh, rng, size);
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

TEST(KdQuad, VisitsLeavesOfAcceptedTriangles)
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

TEST(KdQuad, FlatCellsAndTreesOfOneLeaf)
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

// Planes come back where they were to half a step, in every part of the extent.
TEST(KdQuad, PlanesKeepTheirPlaces)
{
  Random rng(9);
  for (int i = 0; i < 100000; ++i) {
    const Vec3f center = rng.point(10);
    const float half = std::exp2(rng.between(-12, 12));
    const BvhFrame frame = make_bvh_frame({center - vec3(half), center + vec3(half)});
    const int k = int(rng.below(3));
    const float x = at(center, k) + half * (i % 10 == 0 ? 1.0f : i % 10 == 1 ? -1.0f : rng.between(-1, 1));
    const uint32_t word = kd_quad_plane(frame, x, k);
    EXPECT_EQ(kd_quad_axis(word), uint32_t(k));
    const double decoded =
        double(at(frame.center, k)) + (double(kd_quad_position(word)) - 1.5) * double(kd_quad_unit(frame));
    EXPECT_LE(std::abs(decoded - double(x)), double(half) * 0x1p-21) << x;
  }
}

}  // namespace
}  // namespace gpurt
