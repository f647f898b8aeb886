// The ray/triangle tests against exact or wider arithmetic, and their behaviour at the ends of the float range.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/accel/ray_triangle.h"

namespace gpurt {
namespace {

struct Triangle {
  Vec3f a, b, c;
};

template <TriangleTest Test, EdgeRule Rule = EdgeRule::Inclusive>
bool hit(const Triangle &x, const Ray &ray, TriangleHit &h)
{
  TraceRay r;
  if (!prepare_ray(ray.origin, ray.direction, ray.tmin, ray.tmax, r)) return false;
  TriangleRay<Test> t;
  make_triangle_ray(r, t);
  if (!intersect<Rule>(t, x.a, x.b, x.c, r.tmin, r.tmax, h)) return false;
  h.t = caller_t(r, h.t);
  return true;
}

class RayTriangle : public testing::Test {
 protected:
  std::mt19937 rng{7};
  float uniform(float lo, float hi) { return lo + (hi - lo) * float(rng() >> 8) * 0x1p-24f; }
  Vec3f point(float size) { return {uniform(-size, size), uniform(-size, size), uniform(-size, size)}; }
};

// t, u, v in long double by Cramer's rule.
struct Reference {
  long double t, u, v;
};
Reference reference(const Triangle &x, const Ray &r)
{
  using L = long double;
  const L ax = L(x.b.x) - x.a.x, ay = L(x.b.y) - x.a.y, az = L(x.b.z) - x.a.z;
  const L bx = L(x.c.x) - x.a.x, by = L(x.c.y) - x.a.y, bz = L(x.c.z) - x.a.z;
  const L sx = L(r.origin.x) - x.a.x, sy = L(r.origin.y) - x.a.y, sz = L(r.origin.z) - x.a.z;
  const L dx = r.direction.x, dy = r.direction.y, dz = r.direction.z;
  const L px = dy * bz - dz * by, py = dz * bx - dx * bz, pz = dx * by - dy * bx;
  const L qx = sy * az - sz * ay, qy = sz * ax - sx * az, qz = sx * ay - sy * ax;
  const L det = ax * px + ay * py + az * pz;
  return {(bx * qx + by * qy + bz * qz) / det, (sx * px + sy * py + sz * pz) / det,
          (dx * qx + dy * qy + dz * qz) / det};
}

TEST_F(RayTriangle, AgreesWithWiderArithmeticAwayFromEdges)
{
  int hits = 0;
  for (int i = 0; i < 200000; ++i) {
    const Triangle x = {point(1), point(1), point(1)};
    const Vec3f origin = point(3);
    const Vec3f target = x.a * uniform(-0.5f, 1) + x.b * uniform(-0.5f, 1) + x.c * uniform(-0.5f, 1);
    const Ray r = {origin, 0, target - origin, infinity};
    const Reference e = reference(x, r);
    // Away from edges by more than the rounding of coordinates up to 4, magnified by the triangle's shape.
    const long double margin = std::min({e.u, e.v, 1 - e.u - e.v});
    if (std::abs(margin) < 1e-2L || std::abs(e.t) < 1e-3L) continue;
    const bool expected = margin > 0 && e.t > 0;
    TriangleHit w, d, m;
    ASSERT_EQ(hit<TriangleTest::Watertight>(x, r, w), expected) << i;
    ASSERT_EQ(hit<TriangleTest::Double>(x, r, d), expected) << i;
    ASSERT_EQ(hit<TriangleTest::MollerTrumbore>(x, r, m), expected) << i;
    if (!expected) continue;
    ++hits;
    // Measured in double and rounded once: half an ulp, and the reference's own rounding.
    EXPECT_NEAR(w.t, double(e.t), 0.51 * 0x1p-23 * w.t);
    EXPECT_NEAR(w.u, double(e.u), 0x1p-24);
    EXPECT_NEAR(w.v, double(e.v), 0x1p-24);
    EXPECT_EQ(w.t, d.t);
    EXPECT_EQ(w.u, d.u);
    EXPECT_EQ(w.v, d.v);
    EXPECT_NEAR(m.u, double(e.u),
                1e-2);  // float: the triangle's shape magnifies rounding, at most as the margin allows
  }
  EXPECT_GT(hits, 5000);
}

TEST_F(RayTriangle, BarycentricsWeighSecondAndThirdCorner)
{
  const Triangle x = {{0, 0, 5}, {4, 0, 5}, {0, 4, 5}};
  const Ray r = {{1, 2, 0}, 0, {0, 0, 2}, infinity};
  TriangleHit h;
  ASSERT_TRUE(hit<TriangleTest::Watertight>(x, r, h));
  EXPECT_EQ(h.t, 2.5f);
  EXPECT_EQ(h.u, 0.25f);
  EXPECT_EQ(h.v, 0.5f);
  ASSERT_TRUE(hit<TriangleTest::MollerTrumbore>(x, r, h));
  EXPECT_EQ(h.t, 2.5f);
  EXPECT_EQ(h.u, 0.25f);
  EXPECT_EQ(h.v, 0.5f);
}

TEST_F(RayTriangle, TheIntervalIsInclusive)
{
  const Triangle x = {{-1, -1, 3}, {1, -1, 3}, {0, 1, 3}};
  TriangleHit h;
  EXPECT_TRUE(hit<TriangleTest::Watertight>(x, {{0, 0, 0}, 3, {0, 0, 1}, 3}, h));
  EXPECT_FALSE(hit<TriangleTest::Watertight>(x, {{0, 0, 0}, std::nextafter(3.0f, 4.0f), {0, 0, 1}, 9}, h));
  EXPECT_FALSE(hit<TriangleTest::Watertight>(x, {{0, 0, 0}, 0, {0, 0, 1}, std::nextafter(3.0f, 2.0f)}, h));
  EXPECT_TRUE(hit<TriangleTest::Watertight>(x, {{0, 0, 6}, 0, {0, 0, -1}, infinity}, h));  // from behind
  EXPECT_TRUE(hit<TriangleTest::Watertight>(x, {{0, 0, 6}, -5, {0, 0, 1}, -3}, h));  // negative t is legal
}

TEST_F(RayTriangle, SignsOfZeroChangeNoBit)
{
  for (int i = 0; i < 2000; ++i) {
    // Small integers: edges and corners are hit exactly, and often.
    const auto grid = [&] { return float(int(rng() % 5) - 2); };
    const Triangle x = {{grid(), grid(), grid()}, {grid(), grid(), grid()}, {grid(), grid(), grid()}};
    const int axis = int(rng() % 3);
    const float z = 0.0f;
    for (int signs = 0; signs < 4; ++signs) {
      Ray plus = {{grid(), grid(), grid()}, 0, {z, z, z}, infinity}, minus = plus;
      set(plus.direction, axis, 1.0f);
      set(minus.direction, axis, 1.0f);
      if (signs & 1) set(minus.direction, (axis + 1) % 3, -0.0f);
      if (signs & 2) set(minus.direction, (axis + 2) % 3, -0.0f);
      TriangleHit p{}, m{};
      const bool hp = hit<TriangleTest::Watertight>(x, plus, p),
                 hm = hit<TriangleTest::Watertight>(x, minus, m);
      ASSERT_EQ(hp, hm);
      if (!hp) continue;
      EXPECT_EQ(float_bits(p.t), float_bits(m.t));
      EXPECT_EQ(float_bits(p.u), float_bits(m.u));
      EXPECT_EQ(float_bits(p.v), float_bits(m.v));
    }
  }
}

TEST_F(RayTriangle, InvalidRaysMiss)
{
  const Triangle x = {{-1, -1, 3}, {1, -1, 3}, {0, 1, 3}};
  const float nan = std::nanf(""), inf = infinity;
  TriangleHit h;
  const Ray bad[] = {
      {{0, 0, 0}, 0, {0, 0, 0}, inf},   {{0, 0, 0}, 0, {-0.0f, 0, 0}, inf}, {{nan, 0, 0}, 0, {0, 0, 1}, inf},
      {{0, inf, 0}, 0, {0, 0, 1}, inf}, {{0, 0, 0}, 0, {0, nan, 1}, inf},   {{0, 0, 0}, 0, {0, 0, inf}, inf},
      {{0, 0, 0}, nan, {0, 0, 1}, inf}, {{0, 0, 0}, 0, {0, 0, 1}, nan},     {{0, 0, 0}, 4, {0, 0, 1}, 2}};
  for (const Ray &r : bad) {
    EXPECT_FALSE((hit<TriangleTest::Watertight>(x, r, h)));
    EXPECT_FALSE((hit<TriangleTest::MollerTrumbore>(x, r, h)));
    EXPECT_FALSE((hit<TriangleTest::Double>(x, r, h)));
  }
}

TEST_F(RayTriangle, DirectionsScaledByPowersOfTwoMeetTheSame)
{
  for (int i = 0; i < 20000; ++i) {
    const Triangle x = {point(1), point(1), point(1)};
    const Ray r = {point(2), 0, point(1), infinity};
    TriangleHit h, g;
    const bool expected = hit<TriangleTest::Watertight>(x, r, h);
    for (int e : {-20, 20, -60, 90}) {
      Ray s = r;
      s.direction = {std::ldexp(r.direction.x, e), std::ldexp(r.direction.y, e),
                     std::ldexp(r.direction.z, e)};
      ASSERT_EQ(hit<TriangleTest::Watertight>(x, s, g), expected);
      if (!expected) continue;
      EXPECT_EQ(g.t, std::ldexp(h.t, -e));
      EXPECT_EQ(g.u, h.u);
      EXPECT_EQ(g.v, h.v);
    }
  }
}

TEST_F(RayTriangle, DenormalAndHugeDirectionsAreMet)
{
  const Triangle x = {{-1, -1, 3}, {1, -1, 3}, {0, 1, 3}};
  TriangleHit h;
  EXPECT_TRUE(hit<TriangleTest::Watertight>(x, {{0, 0, 0}, 0, {0, 0, 1e-40f}, infinity}, h));
  EXPECT_EQ(h.t, infinity);  // 3e40 is beyond the largest float
  EXPECT_FALSE(hit<TriangleTest::Watertight>(x, {{0, 0, 0}, 0, {0, 0, -1e-40f}, infinity}, h));
  EXPECT_TRUE(hit<TriangleTest::Watertight>(x, {{0, 0, 0}, 0, {0, 0, 3e38f}, infinity}, h));
  EXPECT_NEAR(h.t, 3 / 3e38, 1e-44);
  // Where t fits, it is as exact as the denormal direction.
  const Triangle near = {{-1e-4f, -1e-4f, 1e-4f}, {1e-4f, -1e-4f, 1e-4f}, {0, 1e-4f, 1e-4f}};
  const float tiny = 0x1p-130f;
  EXPECT_TRUE(hit<TriangleTest::Watertight>(near, {{0, 0, 0}, 0, {0, 0, tiny}, infinity}, h));
  EXPECT_EQ(h.t, std::ldexp(1e-4f, 130));
}

TEST_F(RayTriangle, ScalesByPowersOfTwoKeepEveryBit)
{
  for (int i = 0; i < 5000; ++i) {
    const Triangle x = {point(1), point(1), point(1)};
    const Ray r = {point(2), 0, point(1), infinity};
    TriangleHit h, g;
    const bool expected = hit<TriangleTest::Watertight>(x, r, h);
    for (int e :
         {-60, -20, 20, 60, 100}) {  // beyond: products overflow or vanish, and the exact path decides
      const auto scaled = [&](Vec3f p) {
        return Vec3f{std::ldexp(p.x, e), std::ldexp(p.y, e), std::ldexp(p.z, e)};
      };
      ASSERT_EQ(hit<TriangleTest::Watertight>({scaled(x.a), scaled(x.b), scaled(x.c)},
                                              {scaled(r.origin), 0, r.direction, infinity}, g),
                expected);
      if (!expected) continue;
      EXPECT_EQ(g.t, std::ldexp(h.t, e));
      EXPECT_EQ(g.u, h.u);
      EXPECT_EQ(g.v, h.v);
    }
  }
}

TEST_F(RayTriangle, DegenerateTrianglesAreNeverHit)
{
  TriangleHit h;
  for (int i = 0; i < 20000; ++i) {
    // Exactly collinear: small integers.
    const auto grid = [&] { return float(int(rng() % 9) - 4); };
    const Vec3f a = {grid(), grid(), grid()}, e = {grid(), grid(), grid()};
    const Triangle line = {a, a + e, a + e * float(int(rng() % 5) - 2)};
    const Vec3f through = line.a + (line.c - line.a) * 0.5f;
    Ray r = {{grid() * 2, grid() * 2, grid() * 2}, 0, {0, 0, 0}, infinity};
    r.direction = through - r.origin;
    EXPECT_FALSE((hit<TriangleTest::MollerTrumbore>({a, a, a}, r, h)));
    EXPECT_FALSE((hit<TriangleTest::Watertight>({a, a, line.c}, r, h)));
    EXPECT_FALSE((hit<TriangleTest::Watertight>({line.c, a, a}, r, h)));
    EXPECT_FALSE((hit<TriangleTest::Double>({a, line.b, a}, r, h)));
  }
}

// Catalogue row 9: a needle of 1e5:1 seen at half a degree.
TEST_F(RayTriangle, NeedlesSeenEdgeOnGiveExactDistances)
{
  const Triangle needle = {{0, 0, 0}, {1, 0, 0}, {0.5f, 1e-5f, 0}};
  int hits = 0;
  for (int i = 0; i < 100000; ++i) {
    const float x = uniform(0.1f, 0.9f), y = uniform(-1e-6f, 1.1e-5f);
    const float phi = uniform(0.0f, 6.28318f), distance = uniform(1.0f, 20.0f), slope = 0.0087265f;
    const Vec3f d = {std::cos(phi), std::sin(phi), -slope};
    const Ray r = {{x - d.x * distance, y - d.y * distance, slope * distance}, 0, d, infinity};
    TriangleHit h;
    if (!hit<TriangleTest::Watertight>(needle, r, h)) continue;
    ++hits;
    const long double t = -static_cast<long double>(r.origin.z) / r.direction.z;
    // The plane's distance, unless the ray passes the needle's end by rounding: within the needle then.
    EXPECT_LE(std::abs(h.t - t), 8 * 0x1p-23 * t) << i;
  }
  EXPECT_GT(hits, 10000);
}

// A ray through the edge or corner of a fan: the inclusive rule finds a triangle, the half-open rule exactly one.
TEST_F(RayTriangle, EachPointOfAFanHasOneOwner)
{
  for (int i = 0; i < 20000; ++i) {
    const auto grid = [&] { return float(int(rng() % 33) - 16); };
    const Vec3f centre = {grid(), grid(), 4 + grid() * 0.0625f};
    constexpr int n = 6;
    Vec3f rim[n];
    for (int k = 0; k < n; ++k) {
      const float angle = float(k) * 1.0471976f;
      rim[k] = {centre.x + std::round(64 * std::cos(angle)), centre.y + std::round(64 * std::sin(angle)),
                4 + grid() * 0.0625f};
    }
    const int target = int(rng() % 3);
    Vec3f p = centre;
    if (target == 1) p = (centre + rim[rng() % n]) * 0.5f;
    if (target == 2) p = centre + Vec3f{grid(), grid(), 0};
    // Across, and aslant from afar: then the edge is met within rounding only.
    Ray r = {{p.x, p.y, -8}, 0, {0, 0, 1}, infinity};
    if (i & 1) {
      r.origin = {grid() * 0.25f, grid() * 0.25f, -64};
      r.direction = p - r.origin;
    }
    int inclusive = 0, half_open = 0, in_double = 0;
    TriangleHit h;
    for (int k = 0; k < n; ++k) {
      const Triangle x = {centre, rim[k], rim[(k + 1) % n]};
      inclusive += hit<TriangleTest::Watertight>(x, r, h);
      half_open += hit<TriangleTest::Watertight, EdgeRule::HalfOpen>(x, r, h);
      in_double += hit<TriangleTest::Double, EdgeRule::HalfOpen>(x, r, h);
    }
    EXPECT_GE(inclusive, 1) << i;
    EXPECT_EQ(half_open, 1) << i;
    EXPECT_EQ(in_double, 1) << i;
  }
}

}  // namespace
}  // namespace gpurt
