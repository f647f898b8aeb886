// Rows 4, 5, 6, 7, 9, 10, 11: rays and meshes that lose bits, judged by exact geometry.
#include "../support/judge.h"
#include "catalogue.h"

namespace {

using namespace gpurt_test;

class Exactness : public Stability {
 protected:
  /// Failures of rays among what exact geometry allows.
  ///
  /// Float-only tests know t less well than the oracle's bound, which is that of a test that measures t in double: of
  /// them only the triangle is judged, with t moved to where the oracle has it. How far it was away is noted.
  uint64_t count_failures(gpurt_scene scene, const ExactOracle &oracle, const std::vector<gpurt_ray> &rays,
                          int row)
  {
    const TestPrecision &precision =
        method().test == GPURT_TRIANGLE_DOUBLE ? double_precision : float_precision;
    const std::vector<gpurt_hit> hits = trace_closest(scene, rays);
    Tally tally("row " + std::to_string(row) + ", " + method().name);
    for (size_t i = 0; i < rays.size(); ++i) {
      const RayTruth truth = oracle(rays[i], precision);
      gpurt_hit hit = hits[i];
      const Candidate *c = truth.find(hit.primitive);
      if (!method().is_exact() && c != nullptr && std::isfinite(hit.t)) {
        const float t = std::clamp(hit.t, c->t_low, c->t_high);
        if (t != hit.t) worst_t_ = std::max(worst_t_, std::abs(double(hit.t) - t) / std::abs(double(t)));
        hit.t = t;
      }
      tally.add(judge_closest(truth, rays[i], hit), rays[i], "row's", hit.primitive, hit.t, truth);
    }
    wrong_ += tally[Outcome::Wrong];
    leaks_ += tally[Outcome::Leak];
    return tally.failures();
  }
  std::string note() const
  {
    char text[128];
    std::snprintf(text, sizeof text, "%llu leaks and %llu wrong; t off by up to %.2g beyond its bound",
                  static_cast<unsigned long long>(leaks_), static_cast<unsigned long long>(wrong_), worst_t_);
    return text;
  }

  double worst_t_ = 0;
  uint64_t leaks_ = 0, wrong_ = 0;
};
GPURT_STABILITY_SUITE(Exactness);

TEST_P(Exactness, Row04AxisParallelInFace)
{
  Mesh mesh = voxel_surface(1, [](int, int, int) { return true; });
  mesh.append(moved(mesh, 0.7, {2, 0.3, 0}, false));
  const ExactOracle oracle(mesh);
  const Scene scene = make_scene(mesh);
  const Bounds b = bounds_of(mesh);
  std::mt19937_64 rng(4);
  std::vector<gpurt_ray> rays;
  for (uint64_t i = 0; i < count(20000, 200000); ++i) {
    // Each other coordinate of the origin lies in a face's plane, or half way, or anywhere.
    Point o = b.sample(rng, 1.5), d = {0, 0, 0};
    const int axis = int(pick(rng, 3));
    for (int k = 0; k < 3; ++k) {
      if (k != axis && rng() % 4 != 0) o[k] = mesh.vertices[pick(rng, mesh.vertices.size())][k];
      d[k] = rng() & 1 ? 0.0f : -0.0f;
    }
    d[axis] = rng() & 1 ? 1.0f : -1.0f;
    // Some begin in the plane of the face that they hit first.
    if (rng() % 4 == 0) o[axis] = mesh.vertices[pick(rng, mesh.vertices.size())][axis];
    rays.push_back(make_ray(o, d));
  }
  const uint64_t bad = count_failures(scene, oracle, rays, 4);
  record(4, method(), bad, rays.size(), note());
}

TEST_P(Exactness, Row05NegativeZero)
{
  const Mesh mesh = voxel_ball(16);
  const Scene scene = make_scene(mesh);
  RaySource source(mesh, {}, 5);
  std::mt19937_64 rng(5);
  std::vector<gpurt_ray> rays, swapped;
  for (uint64_t i = 0; i < count(50000, 500000); ++i) {
    gpurt_ray ray = source(RayKind::Axis);
    if (i % 3 == 0) {
      // One zero, as a direction or as an origin.
      ray = source(RayKind::Random);
      ray.direction[pick(rng, 3)] = 0;
      ray.origin[pick(rng, 3)] = 0;
    }
    gpurt_ray other = ray;
    for (int k = 0; k < 3; ++k) {
      if (other.direction[k] == 0) other.direction[k] = -other.direction[k];
      if (other.origin[k] == 0) other.origin[k] = -other.origin[k];
    }
    rays.push_back(ray);
    swapped.push_back(other);
  }
  const std::vector<gpurt_hit> a = trace_closest(scene, rays), b = trace_closest(scene, swapped);
  uint64_t bad = 0;
  for (size_t i = 0; i < a.size(); ++i) bad += std::memcmp(&a[i], &b[i], sizeof a[i]) != 0;
  record(5, method(), bad, rays.size());
}

TEST_P(Exactness, Row06OriginOnSplitPlane)
{
  const Mesh mesh = icosphere(4);
  const ExactOracle oracle(mesh);
  // The planes of the library's tree, whichever accelerator is tested.
  const Device cpu = make_device();
  Scene tree;
  GPURT_ASSERT_OK(gpurt_scene_create(cpu, tree.out()));
  add_mesh(tree, mesh);
  commit(tree);
  const std::vector<SplitPlane> planes = split_planes(exported_nodes(tree));
  const Scene scene = make_scene(mesh);
  RaySource source(mesh, planes, 6);
  std::vector<gpurt_ray> rays;
  for (uint64_t i = 0; i < count(20000, 200000); ++i) {
    const gpurt_ray ray = source(RayKind::SplitPlane);
    gpurt_ray back = ray;
    for (float &d : back.direction) d = -d;
    rays.push_back(ray);
    rays.push_back(back);
  }
  const uint64_t bad = count_failures(scene, oracle, rays, 6);
  record(6, method(), bad, rays.size(), note());
}

TEST_P(Exactness, Row07ExtremeDirections)
{
  // Near enough that t stays finite for directions of 1e-40.
  const Mesh mesh = quad({-1, -1, -1e-3f}, {1, -1, -1e-3f}, {1, 1, -1e-3f}, {-1, 1, -1e-3f});
  const Scene scene = make_scene(mesh);
  std::mt19937_64 rng(7);
  std::vector<gpurt_ray> rays, normalised;
  std::vector<int> exponents;
  for (uint64_t i = 0; i < count(20000, 200000); ++i) {
    const double scale = std::array{1e-40, 1e-38, 1e-30, 1e-20, 1e15, 1e30}[i % 6];
    const Point o = {float(uniform(rng, -1.2, 1.2)), float(uniform(rng, -1.2, 1.2)), 0};
    const double d[3] = {i % 5 == 0 ? 0.0 : uniform(rng, -50, 50), uniform(rng, -50, 50), -1};
    Point direction, twin;
    for (int k = 0; k < 3; ++k) direction[k] = float(d[k] * scale);
    // The twin points the very same way, denormal bits and all: a power of two brings it near 1.
    int exponent;
    std::frexp(std::max({std::abs(direction[0]), std::abs(direction[1]), std::abs(direction[2])}), &exponent);
    for (int k = 0; k < 3; ++k) twin[k] = float(std::ldexp(double(direction[k]), -exponent));
    rays.push_back(make_ray(o, direction));
    normalised.push_back(make_ray(o, twin));
    exponents.push_back(exponent);
  }
  const std::vector<gpurt_hit> a = trace_closest(scene, rays), b = trace_closest(scene, normalised);
  uint64_t bad = 0, num_hits = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    num_hits += !is_miss(b[i]);
    bad +=
        a[i].primitive != b[i].primitive || (!is_miss(b[i]) && a[i].t != std::ldexp(b[i].t, -exponents[i]));
  }
  EXPECT_GT(num_hits, rays.size() / 4);
  record(7, method(), bad, rays.size());
}

TEST_P(Exactness, Row09GrazingNeedle)
{
  std::mt19937_64 rng(9);
  uint64_t bad = 0, total = 0;
  double worst_ulp = 0;
  for (int turn = 0; turn < 8; ++turn) {
    // 1e5 long and 1 wide, anywhere in space.
    Mesh mesh =
        moved({{{0, 0, 0}, {1e5f, 0.5f, 0}, {0, 1, 0}}, {{0, 1, 2}}}, 1, {double(turn) * 10, -30, 1e3});
    for (int i = 0; i < turn; ++i) mesh = moved(mesh);
    const ExactOracle oracle(mesh);
    const Scene scene = make_scene(mesh);
    double axis[3], normal[3], length = 0, area = 0;
    const Point a = mesh.corner(0, 0), b = mesh.corner(0, 1), c = mesh.corner(0, 2);
    const double e2[3] = {double(c[0]) - a[0], double(c[1]) - a[1], double(c[2]) - a[2]};
    for (int k = 0; k < 3; ++k) axis[k] = double(b[k]) - a[k], length += axis[k] * axis[k];
    for (double &x : axis) x /= std::sqrt(length);
    for (int k = 0; k < 3; ++k) {
      normal[k] = axis[(k + 1) % 3] * e2[(k + 2) % 3] - axis[(k + 2) % 3] * e2[(k + 1) % 3];
      area += normal[k] * normal[k];
    }
    for (double &x : normal) x /= std::sqrt(area);
    std::vector<gpurt_ray> rays;
    for (uint64_t i = 0; i < count(4000, 40000); ++i) {
      const Point p = point_in_triangle(mesh, 0, uniform(rng), uniform(rng));
      // Along the needle, half a degree above its plane.
      const double angle = 0.5 / 57.29577951308232, s = rng() & 1 ? 1 : -1, far = uniform(rng, 10, 1e4);
      Point o, d;
      for (int k = 0; k < 3; ++k) {
        d[k] = float(s * std::cos(angle) * axis[k] - std::sin(angle) * normal[k]);
        o[k] = float(p[k] - far * d[k]);
      }
      rays.push_back(make_ray(o, d));
    }
    const TestPrecision &precision =
        method().test == GPURT_TRIANGLE_DOUBLE ? double_precision : float_precision;
    const std::vector<gpurt_hit> hits = trace_closest(scene, rays);
    for (size_t i = 0; i < rays.size(); ++i) {
      const RayTruth truth = oracle(rays[i], precision);
      ++total;
      if (is_miss(hits[i])) {
        // Allowed unless the needle is met clear of its edges.
        bad += truth.nearest != GPURT_INVALID_ID;
        continue;
      }
      if (truth.candidates.empty()) {
        ++bad;
        continue;
      }
      const Candidate &c = truth.candidates[0];
      const float t = std::clamp(hits[i].t, c.t_low, c.t_high);
      const double ulp =
          std::abs(double(hits[i].t) - t) / (std::nextafter(std::abs(t), infinite) - std::abs(t));
      worst_ulp = std::max(worst_ulp, ulp);
      bad += !(ulp <= 8);
    }
  }
  char text[64];
  std::snprintf(text, sizeof text, "t off by up to %.3g ulp", worst_ulp);
  record(9, method(), bad, total, text);
}

TEST_P(Exactness, Row10HugeOffset)
{
  const NamedMesh m = mesh_of_kind("offset");
  const ExactOracle oracle(m.mesh);
  const Scene scene = make_scene(m.mesh);
  RaySource source(m.mesh, {}, 10);
  std::vector<gpurt_ray> rays;
  for (uint64_t i = 0; i < count(30000, 300000); ++i) rays.push_back(source(RayKind(i % 8)));
  const uint64_t bad = count_failures(scene, oracle, rays, 10);
  record(10, method(), bad, rays.size(), note());
}

TEST_P(Exactness, Row11Scale)
{
  const Mesh mesh = moved(icosphere(4), 1, {0.3, -0.2, 0.1});
  const Scene unit = make_scene(mesh);
  RaySource source(mesh, {}, 11);
  std::vector<gpurt_ray> rays;
  for (uint64_t i = 0; i < count(20000, 200000); ++i) rays.push_back(source(RayKind(i % 8)));
  const std::vector<gpurt_hit> expected = trace_closest(unit, rays);
  uint64_t bad = 0, total = 0;
  for (const double scale : {0x1p-20, 0x1p20, 1e-6, 1e6}) {
    const Mesh scaled = moved(mesh, scale, {0, 0, 0}, false);
    const Scene scene = make_scene(scaled);
    std::vector<gpurt_ray> scaled_rays = rays;
    for (gpurt_ray &r : scaled_rays) {
      for (float &o : r.origin) o = float(o * scale);
    }
    total += rays.size();
    if (scale == 0x1p-20 || scale == 0x1p20) {
      const std::vector<gpurt_hit> hits = trace_closest(scene, scaled_rays);
      for (size_t i = 0; i < hits.size(); ++i) {
        bad += hits[i].primitive != expected[i].primitive ||
               (!is_miss(hits[i]) && double(hits[i].t) != double(expected[i].t) * scale);
      }
    } else {
      bad += count_failures(scene, ExactOracle(scaled), scaled_rays, 11);
    }
  }
  record(11, method(), bad, total, note());
}

}  // namespace
