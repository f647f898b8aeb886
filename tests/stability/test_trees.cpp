// Rows 16, 17, 18: geometry that makes builders or trees degenerate.
#include <chrono>

#include "../support/judge.h"
#include "catalogue.h"

namespace {

using namespace gpurt_test;

class Trees : public Stability {
 protected:
  double build_seconds(const Mesh &mesh, Scene &scene, int repetitions = 2)
  {
    double best = infinite;
    for (int i = 0; i < repetitions; ++i) {
      scene = make_scene(mesh);
      best = std::min(best, facts_of(scene).build_seconds);
    }
    return best;
  }

  uint64_t count_failures(gpurt_scene scene, const Mesh &mesh, const std::vector<gpurt_ray> &rays,
                          const char *title)
  {
    const ExactOracle oracle(mesh);
    const TestPrecision &precision =
        method().test == GPURT_TRIANGLE_DOUBLE ? double_precision : float_precision;
    const std::vector<gpurt_hit> hits = trace_closest(scene, rays);
    Tally tally(title + std::string(", ") + method().name);
    for (size_t i = 0; i < rays.size(); ++i) {
      const RayTruth truth = oracle(rays[i], precision);
      gpurt_hit hit = hits[i];
      const Candidate *c = truth.find(hit.primitive);
      // See test_exactness.cpp: float tests know t less well.
      if (!method().is_exact() && c != nullptr && std::isfinite(hit.t))
        hit.t = std::clamp(hit.t, c->t_low, c->t_high);
      tally.add(judge_closest(truth, rays[i], hit), rays[i], "row's", hit.primitive, hit.t, truth);
    }
    return tally.failures();
  }
};
GPURT_STABILITY_SUITE(Trees);

// Small triangles strewn over a cube or over one plane of it.
Mesh strewn(uint64_t n, bool in_plane)
{
  std::mt19937_64 rng(16);
  Mesh mesh;
  // As large as leaves a tenth of the plane, or the like of each layer of the cube, covered.
  const double size = in_plane ? 0.3 / std::sqrt(double(n)) : 0.5 / std::cbrt(double(n));
  for (uint64_t i = 0; i < n; ++i) {
    const double c[3] = {uniform(rng), uniform(rng), in_plane ? 0.5 : uniform(rng)};
    const uint32_t first = uint32_t(mesh.vertices.size());
    for (int corner = 0; corner < 3; ++corner) {
      Point p;
      for (int k = 0; k < 3; ++k) p[k] = float(c[k] + (in_plane && k == 2 ? 0 : size * uniform(rng, -1, 1)));
      mesh.vertices.push_back(p);
    }
    mesh.triangles.push_back({first, first + 1, first + 2});
  }
  return mesh;
}

TEST_P(Trees, Row16FlatCells)
{
  const uint64_t n = count(100000, 1000000);
  Scene uniform_scene, flat_scene;
  const double uniform_seconds = build_seconds(strewn(n, false), uniform_scene);
  const Mesh flat = strewn(n, true);
  const double flat_seconds = build_seconds(flat, flat_scene);
  const gpurt_scene_facts facts = facts_of(flat_scene);
  uint64_t bad = flat_seconds > 5 * uniform_seconds;
  const uint32_t cap = std::min(48u, uint32_t(8 + 1.3 * std::log2(double(n))));
  bad += method().is_kdtree() && facts.tree_depth > cap;
  bad += method().accel == GPURT_ACCEL_BVH && (facts.tree_depth > 64 || facts.num_references > 2 * n);
  std::vector<gpurt_ray> rays;
  std::mt19937_64 rng(161);
  for (int i = 0; i < 4000; ++i) {
    const Point target =
        i % 2 == 0 ? Point{float(uniform(rng)), float(uniform(rng)), 0.5f}
                   : point_in_triangle(flat, pick(rng, flat.triangles.size()), uniform(rng), uniform(rng));
    rays.push_back(ray_towards(
        {float(uniform(rng)), float(uniform(rng)), i % 3 == 0 ? 0.5f : float(uniform(rng, -1, 2))}, target));
  }
  bad += count_failures(flat_scene, flat, rays, "row 16");
  char text[160];
  std::snprintf(text, sizeof text,
                method().is_embree()
                    ? "%.2f times the time of a uniform cloud"
                    : "%.2f times the time of a uniform cloud, depth %u, %.2f references a triangle",
                flat_seconds / uniform_seconds, facts.tree_depth, double(facts.num_references) / double(n));
  record(16, method(), bad, rays.size() + 2, text);
}

TEST_P(Trees, Row17Overlap)
{
  const uint64_t n = count(20000, 100000);
  std::mt19937_64 rng(17);
  Mesh mesh;
  for (uint64_t i = 0; i < n; ++i) {
    // Through (0.5, 0.5, 0.5), which is inside of a third of them and a corner of another.
    const uint32_t first = uint32_t(mesh.vertices.size());
    const Point d = uniform_direction(rng), e = uniform_direction(rng);
    const float far = i % 3 == 0 ? 0.0f : -0.5f;
    for (const auto &[u, v] : {std::array<float, 2>{far, far}, {1, 0}, {0, 1}}) {
      mesh.vertices.push_back(
          {0.5f + u * d[0] + v * e[0], 0.5f + u * d[1] + v * e[1], 0.5f + u * d[2] + v * e[2]});
    }
    mesh.triangles.push_back({first, first + 1, first + 2});
  }
  const Scene scene = make_scene(mesh);
  const gpurt_scene_facts facts = facts_of(scene);
  uint64_t bad = !method().is_embree() && facts.num_references > 8 * n;
  std::vector<gpurt_ray> rays;
  RaySource source(mesh, {}, 17);
  for (int i = 0; i < 60; ++i)
    rays.push_back(i % 2 == 0 ? ray_towards(source.bounds().sample(rng, 1.5), {0.5f, 0.5f, 0.5f})
                              : source(RayKind(i % 5)));
  bad += count_failures(scene, mesh, rays, "row 17");
  char text[96] = "";
  if (!method().is_embree())
    std::snprintf(text, sizeof text, "%.2f references a triangle, depth %u",
                  double(facts.num_references) / double(n), facts.tree_depth);
  record(17, method(), bad, rays.size() + 1, text);
}

// A chain: every inner node cuts off the half of its cell that is further from 0; `depth` inner nodes on the way down.
struct Chain {
  std::vector<gpurt_kdtree_node> nodes;
  std::vector<uint32_t> references;
};
Chain make_chain(const Mesh &mesh, uint32_t depth)
{
  Chain chain;
  const auto add_leaf = [&](size_t node, float low, float high) {
    const uint32_t first = uint32_t(chain.references.size());
    for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
      const auto [x0, x1] = std::minmax({mesh.corner(t, 0)[0], mesh.corner(t, 1)[0], mesh.corner(t, 2)[0]});
      if (x1 >= low && x0 <= high) chain.references.push_back(t);
    }
    chain.nodes[node] = {first, uint32_t(chain.references.size() - first) << 2 | 3u};
  };
  chain.nodes.resize(1);
  size_t node = 0;
  float high = 2;
  for (uint32_t i = 0; i < depth; ++i) {
    const float plane = std::ldexp(1.0f, -int(i));
    uint32_t word;
    std::memcpy(&word, &plane, sizeof word);
    const uint32_t child = uint32_t(chain.nodes.size());
    chain.nodes.resize(child + 2);
    chain.nodes[node] = {word, child << 2};
    add_leaf(child + 1, plane, high);
    node = child;
    high = plane;
  }
  add_leaf(node, 0, high);
  return chain;
}

TEST_P(Trees, Row18DeepTree)
{
  // Triangles between x = 2^-k and 2^(1-k), slightly turned, each half as large as the last.
  Mesh mesh;
  std::mt19937_64 rng(18);
  for (int k = 0; k < 60; ++k) {
    const float s = std::ldexp(1.0f, -k), tilt = float(uniform(rng, 0, 0.3));
    mesh.append({{{s * (1 + tilt), 0, 0}, {s * 1.1f, s, 0}, {s * 1.5f, s * 0.25f, s}}, {{0, 1, 2}}});
  }
  std::vector<gpurt_ray> rays;
  RaySource source(mesh, {}, 18);
  for (int i = 0; i < 6000; ++i) {
    const size_t t = pick(rng, mesh.triangles.size());
    const Point target = point_in_triangle(mesh, t, uniform(rng), uniform(rng));
    if (i % 3 == 0) rays.push_back(source(RayKind(i / 3 % 5)));
    else if (i % 3 == 1) rays.push_back(ray_towards(source.bounds().sample(rng, 1.5), target));
    // From nearby, so that small triangles are more than a point; and along the chain.
    else
      rays.push_back(ray_towards({-target[0], target[1] * float(uniform(rng, 0.5, 1.5)), target[2]}, target));
  }
  const Scene scene = make_scene(mesh);
  uint64_t bad = count_failures(scene, mesh, rays, "row 18"), total = rays.size();
  std::string note;

  if (!method().is_embree()) note = "own tree of depth " + std::to_string(facts_of(scene).tree_depth);
  if (method().is_kdtree()) {
    for (const uint32_t depth : {48u, 49u}) {
      Chain chain = make_chain(mesh, depth);
      gpurt_kdtree tree = GPURT_KDTREE_INIT;
      tree.num_nodes = chain.nodes.size();
      tree.num_references = chain.references.size();
      tree.num_triangles = mesh.triangles.size();
      const Bounds b = bounds_of(mesh);
      std::copy_n(b.lo.begin(), 3, tree.bounds_min);
      std::copy_n(b.hi.begin(), 3, tree.bounds_max);
      tree.bounds_min[0] = 0;
      tree.bounds_max[0] = 2;
      tree.nodes = chain.nodes.data();
      tree.references = chain.references.data();
      Scene imported = make_scene();
      add_mesh(imported, mesh);
      const gpurt_result result = gpurt_scene_import_tree(imported, &tree);
      ++total;
      if (depth > 48) {
        bad += result != GPURT_ERROR_INVALID_ARGUMENT;
        continue;
      }
      EXPECT_EQ(result, GPURT_OK) << gpurt_last_error();
      bad += result != GPURT_OK;
      commit_scene(imported);
      EXPECT_EQ(facts_of(imported).tree_depth, depth);
      bad += count_failures(imported, mesh, rays, "row 18, imported");
      total += rays.size();
    }
    note += ", imported of 48; 49 refused";
  }
  record(18, method(), bad, total, note);
}

}  // namespace
