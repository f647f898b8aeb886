// Rays as the bvh's fast kernels carry them: no box is left out that the general traversal needs, and the interval for a
// triangle's t holds the t that the exact test gives.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "accel/bvh_build.h"
#include "core/accel/bvh_node.h"
#include "core/accel/near_ray.h"
#include "core/accel/trace.h"
#include "random_values.h"

namespace gpurt {
namespace {

BvhView view_of(const Box &bounds) { return {nullptr, nullptr, bounds, make_bvh_frame(bounds), 0}; }

// A ray from `from` through `to`, with an unusual component now and then.
Ray ray_through(Vec3f from, Vec3f to, Random &rng)
{
  Ray ray{from, 0.0f, to - from, infinity};
  if (rng.below(4) == 0) ray.direction = ray.direction * rng.magnitude(-20, 20);
  return ray;
}

// Triangles from needles to large ones, facing the ray or nearly edge-on: of all that the edge functions accept, the exact
// t lies in the interval; and what they reject, the exact test rejects.
TEST(NearRay, IntervalsHoldTheExactT)
{
  Random rng(5);
  uint64_t num_inside = 0, num_outside = 0, num_unclear = 0;
  double widest = 0;
  for (int i = 0; i < 2000000; ++i) {
    const Vec3f center = rng.point(1.0f);
    const Vec3f origin = i % 3 == 0 ? center + rng.point(rng.magnitude(-16, 0)) : rng.point(3.0f);
    Vec3f corner[3];
    const float size = rng.magnitude(-14, 0);
    Vec3f stretch = {1, 1, 1};
    if (i % 2) set(stretch, int(rng.below(3)), rng.magnitude(-16, 0));
    for (Vec3f &c : corner) {
      const Vec3f d = rng.point(size);
      c = center + Vec3f{d.x * stretch.x, d.y * stretch.y, d.z * stretch.z};
    }
    if (i % 5 == 0) {
      // Nearly edge-on: the ray's way lies almost in the triangle's plane.
      const Vec3f along = center - origin;
      corner[2] = corner[0] + along * rng.between(-0.5f, 0.5f) + rng.point(rng.magnitude(-24, -6));
    }
    const float u = rng.between(-0.05f, 1.0f), v = rng.between(-0.05f, 1.05f - u);
    const Vec3f target = corner[0] + (corner[1] - corner[0]) * u + (corner[2] - corner[0]) * v;
    const Ray ray = ray_through(origin, target, rng);
    const BvhView tree = view_of({{-1.5f, -1.5f, -1.5f}, {1.5f, 1.5f, 1.5f}});
    NearRay near;
    TraceRay general;
    if (!prepare_ray(ray.origin, ray.direction, ray.tmin, ray.tmax, general)) continue;
    if (!make_near_ray(ray, tree, near)) continue;
    TriangleRay<TriangleTest::Watertight> triangle_ray;
    make_triangle_ray(general, triangle_ray);
    TriangleHit hit;
    // The whole line counts, so that t behind the origin is seen as well.
    const bool is_hit = intersect<EdgeRule::Inclusive>(triangle_ray, corner[0], corner[1], corner[2],
                                                       -infinity, infinity, hit);
    HitInterval interval;
    switch (test_near(near, corner[0], corner[1], corner[2], interval)) {
      case EdgeVerdict::Outside:
        ++num_outside;
        ASSERT_FALSE(is_hit) << i;
        break;
      case EdgeVerdict::Inside:
        ++num_inside;
        ASSERT_TRUE(is_hit) << i;
        // What is not a number says nothing, and the kernels read it so.
        if (std::isnan(interval.lower) || std::isnan(interval.upper)) break;
        ASSERT_LE(interval.lower, hit.t) << i;
        ASSERT_GE(interval.upper, hit.t) << i;
        if (i % 10 == 2) widest = std::max(widest, double(interval.upper - interval.lower) / std::abs(hit.t));
        break;
      case EdgeVerdict::Unclear:
        ++num_unclear;
        break;
    }
  }
  EXPECT_GT(num_inside, 1000000u);
  EXPECT_GT(num_outside, 100000u);
  std::printf("%llu inside, %llu outside, %llu unclear\n", (unsigned long long)num_inside,
              (unsigned long long)num_outside, (unsigned long long)num_unclear);
}

// A node over the box of a triangle that the exact test accepts is met, also with what lies behind the hit cut off, and where
// rounding alone lets the ray meet the triangle. Far rays come from up to 2^16 times as far as near ones.
void meet_boxes(bool are_far)
{
  Random rng(6);
  uint64_t num_hits = 0, num_widened = 0;
  for (int i = 0; i < 1000000; ++i) {
    const float scale = std::exp2(float(int(rng.below(40)) - 20));
    const Vec3f shift = i % 4 ? Vec3f{0, 0, 0} : rng.point(scale * 1000);
    const Box bounds = {shift - vec3(scale), shift + vec3(scale)};
    const BvhView tree = view_of(bounds);
    Vec3f corner[3];
    const Vec3f middle = rng.point(0.5f * scale);
    for (Vec3f &c : corner) c = shift + middle + rng.point(scale * (i % 2 ? 0.4f : 1e-3f));
    if (i % 7 == 0) corner[1].y = corner[2].y = corner[0].y;  // flat
    const float u = rng.between(0.0f, 1.0f), v = rng.between(0.0f, 1.0f - u);
    // On the border, where rounding decides, every other time.
    const Vec3f target = i % 2 ? corner[0] + (corner[1] - corner[0]) * u + (corner[2] - corner[0]) * v
                               : corner[0] + (corner[1] - corner[0]) * u;
    const float distance = i % 3 ? 0.8f : 8.0f;
    const float how_far = are_far ? rng.magnitude(0, 16) : 1.0f;
    const Vec3f from = shift + rng.point(scale * distance * how_far);
    Ray ray = ray_through(from, target, rng);
    if (i % 11 == 0) {  // along an axis
      const int k = int(rng.below(3));
      ray.origin = target;
      set(ray.origin, k, at(from, k));
      const float zero = i % 2 ? -0.0f : 0.0f;
      ray.direction = {zero, zero, zero};
      set(ray.direction, k, at(target, k) - at(from, k));
    }
    NearRay near = {};
    TraceRay general;
    if (!prepare_ray(ray.origin, ray.direction, ray.tmin, ray.tmax, general)) continue;
    float widening = 0.0f;
    if (!(are_far ? make_far_ray(ray, tree, near, widening) : make_near_ray(ray, tree, near))) continue;
    num_widened += widening != 0.0f;
    TriangleRay<TriangleTest::Watertight> triangle_ray;
    make_triangle_ray(general, triangle_ray);
    TriangleHit hit;
    if (!intersect<EdgeRule::Inclusive>(triangle_ray, corner[0], corner[1], corner[2], 0.0f, infinity, hit))
      continue;
    ++num_hits;
    const Box box = {min(corner[0], min(corner[1], corner[2])), max(corner[0], max(corner[1], corner[2]))};
    const BvhNode node = make_bvh_node(box, 1, box, 2, tree.frame);
    const float end = hit.t + near.end_offset;
    float enter, leave;
    clip_near(near, node.center0, half0(node.half[0]) + widening, half0(node.half[1]) + widening,
              half0(node.half[2]) + widening, end, enter, leave);
    ASSERT_FALSE(enter > leave) << i;
    clip_near(near, node.center1, half1(node.half[0]) + widening, half1(node.half[1]) + widening,
              half1(node.half[2]) + widening, end, enter, leave);
    ASSERT_FALSE(enter > leave) << i;
  }
  EXPECT_GT(num_hits, are_far ? 300000u : 600000u);
  EXPECT_EQ(num_widened > 300000u, are_far);
}

TEST(NearRay, MeetsTheBoxesOfAcceptedTriangles) { meet_boxes(false); }
TEST(FarRay, MeetsTheBoxesOfAcceptedTriangles) { meet_boxes(true); }

// What the fast kernels do not serve goes the general way: none of these is called near.
TEST(NearRay, RefusesWhatIsNotOrdinary)
{
  const BvhView tree = view_of({{-1, -1, -1}, {1, 1, 1}});
  NearRay near;
  const Ray good{{0, 0, 5}, 0.0f, {0, 0.1f, -1}, infinity};
  EXPECT_TRUE(make_near_ray(good, tree, near));
  const float nan = std::nanf("");
  std::vector<Ray> bad(11, good);
  bad[0].origin.x = 1e6f;  // far away
  float widening = 0;
  EXPECT_TRUE(make_far_ray(bad[0], tree, near, widening));
  EXPECT_GT(widening, 0.0f);
  EXPECT_TRUE(make_far_ray(good, tree, near, widening));
  EXPECT_EQ(widening, 0.0f);
  bad[1].origin.y = nan;
  bad[2].direction = {0, 0, 0};
  bad[3].direction.x = nan;
  bad[4].direction.z = -infinity;
  bad[5].tmin = nan;
  bad[6].tmax = -1.0f;
  bad[7].tmin = bad[7].tmax = 1e9f;    // starts far beyond the tree
  bad[8].direction = {0, 0, -1e-30f};  // scaled by the general way
  bad[9].tmin = -infinity;
  bad[10].tmax = nan;
  for (size_t i = 0; i < bad.size(); ++i) {
    EXPECT_FALSE(make_near_ray(bad[i], tree, near)) << i;
    if (i != 0) EXPECT_FALSE(make_far_ray(bad[i], tree, near, widening)) << i;
  }
  for (int k = 0; k < 3; ++k) {  // whichever is looked at last
    Ray none = good;
    set(none.origin, k, nan);
    EXPECT_FALSE(make_near_ray(none, tree, near)) << k;
    none = good;
    set(none.direction, k, nan);
    EXPECT_FALSE(make_near_ray(none, tree, near)) << k;
  }
  EXPECT_FALSE(make_far_ray({{1e16f, 0, 0}, 0.0f, {-1, 0, 0}, infinity}, tree, near, widening));
  // A tree so large that products might overflow.
  EXPECT_FALSE(make_near_ray(good, view_of({{-1e30f, -1e30f, -1e30f}, {1e30f, 1e30f, 1e30f}}), near));
}

}  // namespace
}  // namespace gpurt
