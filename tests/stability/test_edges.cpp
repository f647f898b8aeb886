// Rows 1, 2, 3, 13, 14, 15: rays through what triangles share.
#include <numeric>

#include "catalogue.h"

namespace {

using namespace gpurt_test;

class Edges : public Stability {};
GPURT_STABILITY_SUITE(Edges);

// A point inside the unit icosphere, well clear of it.
Point inside(std::mt19937_64 &rng)
{
  const Point d = uniform_direction(rng);
  const float r = float(0.85 * std::cbrt(uniform(rng)));
  return {r * d[0], r * d[1], r * d[2]};
}

TEST_P(Edges, Row01EdgeLeak)
{
  const Mesh mesh = icosphere(5);
  const std::vector<Edge> edges = edges_of(mesh);
  const Scene scene = make_scene(mesh);
  std::mt19937_64 rng(1);
  const uint64_t total = count(400000, 10000000);
  const uint64_t misses = count_hits(
      scene, total,
      [&](uint64_t) {
        const Edge e = edges[pick(rng, edges.size())];
        return ray_towards(inside(rng), between(mesh.vertices[e[0]], mesh.vertices[e[1]], 0.5));
      },
      [](const gpurt_ray &, const gpurt_hit &hit) { return is_miss(hit); });
  record(1, method(), misses, total);
}

TEST_P(Edges, Row02VertexLeak)
{
  const Mesh mesh = icosphere(5);
  const Scene scene = make_scene(mesh);
  std::mt19937_64 rng(2);
  const uint64_t total = count(400000, 10000000);
  const uint64_t misses = count_hits(
      scene, total,
      [&](uint64_t) { return ray_towards(inside(rng), mesh.vertices[pick(rng, mesh.vertices.size())]); },
      [](const gpurt_ray &, const gpurt_hit &hit) { return is_miss(hit); });
  record(2, method(), misses, total);
}

// Columns of cubes that a vertical ray at a half integer touches: it may pass a taller one along its wall, but none may
// let it through where it is the lowest. All coordinates are small integers: t has no rounding to hide behind.
TEST_P(Edges, Row03IntegerGrid)
{
  const int n = is_full_run() ? 64 : 32;
  const auto is_solid = [n](int i, int j, int k) {
    const int x = 2 * i + 1 - n, y = 2 * j + 1 - n, z = 2 * k + 1 - n;
    return x * x + y * y + z * z <= n * n;
  };
  const Scene scene = make_scene(voxel_surface(n, is_solid));
  const auto top = [&](int i, int k) {
    for (int j = n; j-- > 0;) {
      if (i >= 0 && i < n && k >= 0 && k < n && is_solid(i, j, k)) return j + 1;
    }
    return 0;
  };
  std::vector<gpurt_ray> rays;
  std::vector<float> lowest;
  for (int x = 1; x < 2 * n; ++x) {
    for (int z = 1; z < 2 * n; ++z) {
      int height = n;
      for (const int i : {(x - 1) / 2, x / 2}) {
        for (const int k : {(z - 1) / 2, z / 2}) height = std::min(height, top(i, k));
      }
      if (height == 0) continue;
      rays.push_back(make_ray({0.5f * x, float(n + 3), 0.5f * z}, {0, -1, 0}));
      lowest.push_back(float(n + 3 - height));
    }
  }
  const uint64_t bad =
      count_hits(scene, rays, [&](size_t i, const gpurt_hit &h) { return is_miss(h) || h.t > lowest[i]; });
  record(3, method(), bad, rays.size());
}

TEST_P(Edges, Row13NearLayers)
{
  const Mesh inner = icosphere(5);
  Mesh both = inner;
  Mesh outer = inner;
  outer.map([](Point v) {
    for (float &c : v) c = float(c * (1 + 4e-5));
    return v;
  });
  both.append(outer);
  const Scene scene = make_scene(both);
  const uint32_t num_inner = uint32_t(inner.triangles.size());
  std::mt19937_64 rng(13);
  const uint64_t total = count(200000, 2000000);
  // Even rays look outwards from within, odd ones inwards from outside, at points of the surface of all kinds.
  const uint64_t bad = count_hits(
      scene, total,
      [&](uint64_t i) {
        const size_t t = pick(rng, inner.triangles.size());
        const Point target = i % 3 == 0
                                 ? inner.corner(t, 0)
                                 : point_in_triangle(inner, t, uniform(rng), i % 3 == 1 ? 0 : uniform(rng));
        if (i & 1) {
          const Point d = uniform_direction(rng);
          // From outside, but towards the near side: the sphere must not hide its own point.
          const float s = target[0] * d[0] + target[1] * d[1] + target[2] * d[2] < 0 ? -1.0f : 1.0f;
          return ray_towards(
              {target[0] + 2 * target[0] + s * d[0], target[1] * 3 + s * d[1], target[2] * 3 + s * d[2]},
              target);
        }
        return ray_towards(inside(rng), target);
      },
      [&](const gpurt_ray &ray, const gpurt_hit &hit) {
        const double r2 = double(ray.origin[0]) * ray.origin[0] + double(ray.origin[1]) * ray.origin[1] +
                          double(ray.origin[2]) * ray.origin[2];
        return is_miss(hit) || (r2 < 1) != (hit.primitive < num_inner);
      });
  record(13, method(), bad, total);
}

TEST_P(Edges, Row14CoplanarDuplicates)
{
  const Mesh single = icosphere(4);
  Mesh twice = single;
  twice.triangles.insert(twice.triangles.end(), single.triangles.begin(), single.triangles.end());
  std::vector<uint32_t> order(twice.triangles.size()), lower(single.triangles.size(), GPURT_INVALID_ID);
  std::iota(order.begin(), order.end(), 0u);
  std::mt19937_64 rng(14);
  for (size_t i = order.size(); i-- > 1;) std::swap(order[i], order[pick(rng, i + 1)]);
  Mesh shuffled = twice;
  for (uint32_t i = 0; i < order.size(); ++i) {
    shuffled.triangles[i] = twice.triangles[order[i]];
    uint32_t &first = lower[order[i] % single.triangles.size()];
    first = std::min(first, i);
  }
  RaySource source(single, {}, 14);
  std::vector<gpurt_ray> rays;
  for (uint64_t i = 0; i < count(100000, 1000000); ++i) rays.push_back(source(RayKind(i % 5)));
  const int runs = 3;
  uint64_t bad = 0;
  std::vector<gpurt_hit> first_run;
  for (int run = 0; run < runs; ++run) {
    const Scene scene = make_scene(shuffled);
    const std::vector<gpurt_hit> hits = trace_closest(scene, rays);
    if (run == 0) first_run = hits;
    for (size_t i = 0; i < hits.size(); ++i) {
      const uint32_t p = hits[i].primitive;
      bad += p != first_run[i].primitive ||
             (!is_miss(hits[i]) && lower[order[p] % single.triangles.size()] != p);
    }
  }
  record(14, method(), bad, runs * rays.size());
}

TEST_P(Edges, Row15MultiHit)
{
  const Mesh cube = voxel_surface(1, [](int, int, int) { return true; });
  Mesh stack;
  for (int i = 0; i < 24; ++i) {
    // The first cubes touch, face on face; the others stand apart, turned.
    if (i < 12) stack.append(moved(cube, 1, {0, double(i), 0}, false));
    else stack.append(moved(cube, 1, {0.1 * i, 1.5 * i, 0}));
  }
  ASSERT_TRUE(is_closed(stack));
  const Scene scene = make_scene(stack);
  RaySource source(stack, {}, 15);
  std::vector<gpurt_ray> rays;
  const uint64_t total = count(100000, 1000000);
  for (uint64_t i = 0; i < total; ++i) {
    gpurt_ray ray = source(RayKind(i % 5));
    if (i % 11 == 0)
      ray =
          make_ray({float(pick(source.rng(), 3)) * 0.5f, -4, float(pick(source.rng(), 3)) * 0.5f}, {0, 1, 0});
    ray.tmin = std::numeric_limits<float>::lowest();
    rays.push_back(ray);
  }
  std::vector<uint64_t> offsets;
  const std::vector<gpurt_hit> hits = trace_all(scene, rays, offsets);
  uint64_t odd = 0, unsorted = 0, repeated = 0;
  for (size_t i = 0; i < rays.size(); ++i) {
    std::set<uint32_t> seen;
    bool is_sorted = true, is_repeated = false;
    for (uint64_t h = offsets[i]; h < offsets[i + 1]; ++h) {
      is_repeated = is_repeated || !seen.insert(hits[h].primitive).second;
      if (h != offsets[i])
        is_sorted = is_sorted && !(hits[h].t < hits[h - 1].t) &&
                    (hits[h].t > hits[h - 1].t || hits[h].primitive > hits[h - 1].primitive);
    }
    odd += (offsets[i + 1] - offsets[i]) & 1;
    unsorted += !is_sorted;
    repeated += is_repeated;
  }
  record(15, method(), odd + unsorted + repeated, total,
         std::to_string(odd) + " odd, " + std::to_string(unsorted) + " unsorted, " +
             std::to_string(repeated) + " repeated");
}

}  // namespace
