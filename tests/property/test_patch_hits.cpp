// From hits back to patches, and bounds in pixels of a camera: on the CPU and on a CUDA device.
#include <algorithm>

#include "../support/patch_shapes.h"

namespace {

using namespace gpurt_test;
using Placement = std::array<float, 12>;

constexpr Placement as_it_is = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

class PatchHits : public ::testing::TestWithParam<gpurt_device_type> {
 protected:
  void SetUp() override
  {
    if (GetParam() == GPURT_DEVICE_CUDA && !has_cuda()) GTEST_SKIP() << "no CUDA device";
  }
};
INSTANTIATE_TEST_SUITE_P(Cpu, PatchHits, ::testing::Values(GPURT_DEVICE_CPU));
INSTANTIATE_TEST_SUITE_P(Cuda, PatchHits, ::testing::Values(GPURT_DEVICE_CUDA));

Point3 transformed(const Placement &m, const Point3 &p, double w)
{
  Point3 q;
  for (size_t i = 0; i < 3; ++i) {
    q[i] = double(m[4 * i + 3]) * w;
    for (size_t j = 0; j < 3; ++j) q[i] += double(m[4 * i + j]) * p[j];
  }
  return q;
}

Point3 cross(const Point3 &a, const Point3 &b)
{
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double length(const Point3 &a) { return std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }
Point3 minus(const Point3 &a, const Point3 &b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

struct Located {
  std::vector<gpurt_patch_point> points;
  std::vector<std::array<float, 3>> positions, normals;
};

Located locate(gpurt_scene scene, const std::vector<gpurt_hit> &hits)
{
  Located l;
  l.points.resize(hits.size());
  l.positions.resize(hits.size());
  l.normals.resize(hits.size());
  gpurt_locate_desc desc = GPURT_LOCATE_DESC_INIT;
  desc.num_hits = hits.size();
  desc.hits = hits.data();
  desc.points = l.points.data();
  desc.positions = l.positions.data()->data();
  desc.normals = l.normals.data()->data();
  GPURT_EXPECT_OK(gpurt_scene_locate(scene, &desc));
  return l;
}

gpurt_scene_facts facts_of(gpurt_scene scene)
{
  gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
  GPURT_EXPECT_OK(gpurt_scene_get_facts(scene, &facts));
  return facts;
}

void commit_in_pixels(gpurt_scene scene, float pixels, float tolerance = 0)
{
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.patch_pixels = pixels;
  build.patch_tolerance = tolerance;
  GPURT_ASSERT_OK(gpurt_scene_commit(scene, &build));
}

gpurt_ray ray_between(const Point3 &from, const Point3 &to)
{
  gpurt_ray ray{};
  for (size_t k = 0; k < 3; ++k) {
    ray.origin[k] = float(from[k]);
    ray.direction[k] = float(to[k] - from[k]);
  }
  ray.tmax = 1e30f;
  return ray;
}
Point3 point_of(const gpurt_ray &ray, const gpurt_hit &hit)
{
  Point3 p;
  for (size_t k = 0; k < 3; ++k) p[k] = double(ray.origin[k]) + double(hit.t) * double(ray.direction[k]);
  return p;
}

// A geometry that is placed once by a transform that mirrors, one that is placed twice, and a mesh: hits lie within the bound
// of the patch's own point at what is told, and position and normal are those of the definition.
TEST_P(PatchHits, LieWhereTheirPatchesSay)
{
  Device device = make_device(GetParam());
  std::mt19937_64 rng(11);
  const std::vector<std::vector<PatchNet>> nets = {closed_patches(2, 0.15, 5), poles(5)};
  const std::vector<std::vector<Placement>> places = {
      {{-1.3f, 0.2f, 0, -3, 0.1f, 0.9f, 0.3f, 1, 0, 0.1f, 1.1f, -2}},
      {{0.5f, 0, 0, 3, 0, 0, -0.7f, 0, 0, 0.6f, 0, 0}, {0, 0.4f, 0, 0, 0.4f, 0, 0, 4, 0, 0, 0.4f, 0}}};
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_mesh(scene, quad({-9, -9, -9}, {9, -9, -9}, {9, -9, 9}, {-9, -9, 9}));
  uint32_t first_instance[2] = {1, 2};
  for (size_t g = 0; g < 2; ++g) EXPECT_EQ(add_patches(scene, nets[g], 0, places[g]), g + 1);
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_BVH;
  build.patch_tolerance = 0.01f;
  GPURT_ASSERT_OK(gpurt_scene_commit(scene, &build));
  const double bound = facts_of(scene).patch_error;

  std::vector<gpurt_ray> rays;
  for (int i = 0; i < 6000; ++i) {
    const size_t g = rng() & 1;
    const Placement &place = places[g][pick(rng, places[g].size())];
    const PatchNet &net = nets[g][pick(rng, nets[g].size())];
    const Point3 to = transformed(place, evaluate(net, uniform(rng), uniform(rng)).p, 1);
    rays.push_back(ray_between({uniform(rng, -6, 6), uniform(rng, -6, 6), uniform(rng, -6, 6)}, to));
  }
  rays.push_back(ray_between({0, 20, 0}, {0, 21, 0}));  // misses
  std::vector<gpurt_hit> hits = trace_closest(scene, rays);
  for (gpurt_hit &hit : hits) {
    if (hit.geometry == 0) hit.primitive = GPURT_INVALID_ID;  // the mesh
  }
  const Located located = locate(scene, hits);
  size_t num_hits[3] = {};
  double worst = 0;
  for (size_t i = 0; i < hits.size(); ++i) {
    const gpurt_patch_point &at = located.points[i];
    const gpurt_hit &hit = hits[i];
    if (hit.primitive == GPURT_INVALID_ID) {
      EXPECT_EQ(at.patch, GPURT_INVALID_ID);
      EXPECT_EQ(located.positions[i][1], 0);
      continue;
    }
    const size_t g = hit.geometry - 1;
    ASSERT_LT(at.patch, nets[g].size());
    ASSERT_TRUE(at.u >= 0 && at.u <= 1 && at.v >= 0 && at.v <= 1);
    const size_t place = hit.instance - first_instance[g];
    num_hits[g + place]++;
    const Placement &m = places[g][place];
    const SurfacePoint s = evaluate(nets[g][at.patch], double(at.u), double(at.v));
    const Point3 p = transformed(m, s.p, 1);
    worst = std::max(worst, length(minus(p, point_of(rays[i], hit))));
    // Single precision, of coordinates below 8.
    for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(double(located.positions[i][k]), p[k], 2e-6);
    Point3 n = cross(transformed(m, s.du, 0), transformed(m, s.dv, 0));
    const double size = length(n);
    if (size < 1e-2) continue;  // poles
    // The transforms of the first two placements mirror; the normal is that of the patch, moved.
    const Point3 x = transformed(m, {1, 0, 0}, 0), y = transformed(m, {0, 1, 0}, 0),
                 z = transformed(m, {0, 0, 1}, 0);
    const Point3 xy = cross(x, y);
    const double side = xy[0] * z[0] + xy[1] * z[1] + xy[2] * z[2] < 0 ? -1 : 1;
    for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(double(located.normals[i][k]), side * n[k] / size, 1e-4);
  }
  for (size_t n : num_hits) EXPECT_GT(n, 100u);
  std::printf("bound %.3g, largest distance %.3g\n", bound, worst);
  // Rays and hits are of single precision too: 2^-22 of 16 metres.
  EXPECT_LE(worst, bound + 4e-6);
  EXPECT_GE(worst, 0.1 * bound);

  // Compact records say the same once their geometry and instance are said.
  for (uint32_t instance : {1u, 3u}) {
    std::vector<gpurt_hit_compact> compact;
    std::vector<size_t> from;
    for (size_t i = 0; i < hits.size(); ++i) {
      if (hits[i].primitive == GPURT_INVALID_ID || hits[i].instance != instance) continue;
      compact.push_back({hits[i].t, hits[i].u, hits[i].v, hits[i].primitive});
      from.push_back(i);
    }
    std::vector<gpurt_patch_point> points(compact.size());
    std::vector<std::array<float, 3>> positions(compact.size());
    gpurt_locate_desc desc = GPURT_LOCATE_DESC_INIT;
    desc.format = GPURT_HIT_COMPACT;
    desc.num_hits = compact.size();
    desc.hits = compact.data();
    desc.geometry = instance == 1 ? 1 : 2;
    desc.instance = instance;
    desc.points = points.data();
    desc.positions = positions.data()->data();
    GPURT_ASSERT_OK(gpurt_scene_locate(scene, &desc));
    for (size_t k = 0; k < from.size(); ++k) {
      EXPECT_EQ(points[k].patch, located.points[from[k]].patch);
      EXPECT_EQ(points[k].u, located.points[from[k]].u);
      EXPECT_EQ(points[k].v, located.points[from[k]].v);
      EXPECT_EQ(positions[k], located.positions[from[k]]);
    }
  }
}

TEST_P(PatchHits, SayWhatIsWrong)
{
  Device device = make_device(GetParam());
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_mesh(scene, quad({-9, -9, -9}, {9, -9, -9}, {9, -9, 9}, {-9, -9, 9}));
  add_patches(scene, {flat_patch({0, 0, 0}, {1, 0, 0}, {0, 1, 0})});
  add_patches(scene, {flat_patch({0, 0, 2}, {1, 0, 0}, {0, 1, 0})}, 0, {});
  gpurt_hit hits[2] = {{1, 0, 0, GPURT_INVALID_ID, GPURT_INVALID_ID, GPURT_INVALID_ID, {0, 0}},
                       {1, 0.25f, 0.25f, 0, 1, 1, {0, 0}}};
  gpurt_patch_point points[2] = {{7, 7, 7}, {7, 7, 7}};
  float normals[6] = {};
  gpurt_locate_desc desc = GPURT_LOCATE_DESC_INIT;
  desc.num_hits = 2;
  desc.hits = hits;
  desc.points = points;
  const auto refuse = [&](const std::string &part) {
    EXPECT_EQ(gpurt_scene_locate(scene, &desc), GPURT_ERROR_INVALID_ARGUMENT) << part;
    EXPECT_NE(std::string(gpurt_last_error()).find(part), std::string::npos) << gpurt_last_error();
    EXPECT_EQ(points[0].patch, 7u);
  };
  refuse("never committed");
  commit(scene, GPURT_ACCEL_BVH);
  const gpurt_hit good = hits[1];
  const auto refuse_hit = [&](const std::string &part, auto change) {
    change(hits[1]);
    refuse(part);
    hits[1] = good;
  };
  refuse_hit("hit 1 is on geometry 0, which has no patches", [](gpurt_hit &h) { h.geometry = 0; });
  refuse_hit("hit 1 is of geometry 2, which the last commit", [](gpurt_hit &h) { h.geometry = 2; });
  refuse_hit("hit 1 is of geometry 4294967295", [](gpurt_hit &h) { h.geometry = GPURT_INVALID_ID; });
  refuse_hit("hit 1 is of primitive 2, but geometry 1 has 2 triangles",
             [](gpurt_hit &h) { h.primitive = 2; });
  refuse_hit("hit 1 is at u 1, v 0.25", [](gpurt_hit &h) { h.u = 1; });
  refuse_hit("hit 1 is at u nan", [](gpurt_hit &h) { h.u = std::nanf(""); });
  // The instance is of no matter unless it places the surface.
  hits[1].instance = 0;
  desc.normals = normals;
  refuse("hit 1 is of instance 0, which does not place geometry 1");
  desc.geometry = 1;
  refuse("geometry is 1, but hits of GPURT_HIT_FULL");
  desc.geometry = 0;
  desc.normals = &hits[0].t;
  refuse("overlap");
  desc.normals = nullptr;
  desc.format = gpurt_hit_format(2);
  refuse("format is 2");
  desc.format = GPURT_HIT_FULL;
  desc.points = nullptr;
  refuse("points is NULL");
  desc.points = points;
  GPURT_EXPECT_OK(gpurt_scene_locate(scene, &desc));
  EXPECT_EQ(points[0].patch, GPURT_INVALID_ID);
  EXPECT_EQ(points[1].patch, 0u);
  desc = GPURT_LOCATE_DESC_INIT;
  GPURT_EXPECT_OK(gpurt_scene_locate(scene, &desc));  // nothing to do
}

// What a camera at the origin sees of a ball of patches at a depth, in triangles.
uint64_t triangles_at(gpurt_device device, const std::vector<float> &depths, float pixels)
{
  Scene scene;
  EXPECT_EQ(gpurt_scene_create(device, scene.out()), GPURT_OK);
  std::vector<Placement> places(depths.size(), as_it_is);
  for (size_t i = 0; i < depths.size(); ++i) places[i][11] = -depths[i];
  add_patches(scene, closed_patches(2, 0.15, 77), 0, places);
  add_camera(scene, {0, 0, 0}, 0.8f);
  commit_in_pixels(scene, pixels);
  EXPECT_LE(facts_of(scene).patch_error_pixels, double(pixels));
  return facts_of(scene).num_triangles;
}

// Triangles go as the depth's inverse, until there are two a patch; the nearest placement decides.
TEST_P(PatchHits, FarPatchesHaveFewerTriangles)
{
  Device device = make_device(GetParam());
  const uint64_t near = triangles_at(device, {20}, 0.05f), far = triangles_at(device, {80}, 0.05f);
  std::printf("%llu and %llu triangles\n", (unsigned long long)near, (unsigned long long)far);
  // Four times the depth is a quarter of the triangles; whole numbers along both axes are rounded up.
  EXPECT_LT(double(far), 0.35 * double(near));
  EXPECT_GT(double(far), 0.2 * double(near));
  EXPECT_EQ(triangles_at(device, {80, 20, 300}, 0.05f), near);
  EXPECT_EQ(triangles_at(device, {1e5f}, 0.1f), 2u * 24);
}

// Through random pixels of random cameras, about and within a surface, the hit and the patch's own point with its (u, v) are
// no further apart in the picture than was asked for. No ray from within finds a crack.
TEST_P(PatchHits, BoundInPixelsHolds)
{
  Device device = make_device(GetParam());
  std::mt19937_64 rng(12);
  double worst_share = 0;
  for (int round = 0; round < 10; ++round) {
    const float pixels = round % 3 == 0 ? 8.0f : round % 3 == 1 ? 2.0f : 0.5f;
    const double reach = round % 2 == 0 ? 0.75 : 3;
    Scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
    std::vector<Placement> places = {as_it_is};
    if (round % 4 == 3) places.push_back({0, 2, 0, 5, 0.5f, 0, 0, 0, 0, 0, -1, 1});
    const std::vector<PatchNet> nets = closed_patches(2, 0.15, uint64_t(100 + round));
    add_patches(scene, nets, 0, places);
    Point3 eye;
    for (double &c : eye) c = uniform(rng, -reach, reach) * 0.5773;
    add_turned_camera(scene, eye, rng, 1.2f);
    const bool with_tolerance = round % 5 == 4;
    commit_in_pixels(scene, pixels, with_tolerance ? 0.002f : 0.0f);
    const gpurt_scene_facts facts = facts_of(scene);
    EXPECT_GT(facts.patch_error_pixels, 0);
    if (with_tolerance) {
      EXPECT_LE(facts.patch_error, 0.002);
    }
    // The eye is among the control points of a patch: no bound is told, but what is seen is looked at all the same.
    const bool is_bound = std::isfinite(facts.patch_error_pixels);
    if (is_bound) {
      EXPECT_LE(facts.patch_error_pixels, double(pixels));
    }
    gpurt_camera_desc camera = GPURT_CAMERA_DESC_INIT;
    GPURT_ASSERT_OK(gpurt_scene_get_camera(scene, 0, &camera));
    const auto axis = [&](size_t c) {
      return Point3{double(camera.transform[c]), double(camera.transform[4 + c]),
                    double(camera.transform[8 + c])};
    };
    const Point3 x = axis(0), y = axis(1), z = axis(2), from = axis(3);
    const double half = std::tan(0.6);
    std::vector<gpurt_ray> rays;
    for (int i = 0; i < 4000; ++i) {
      const double a = uniform(rng, -half, half), b = uniform(rng, -half, half);
      Point3 to;
      for (size_t k = 0; k < 3; ++k) to[k] = from[k] + a * x[k] + b * y[k] - z[k];
      rays.push_back(ray_between(from, to));
    }
    const std::vector<gpurt_hit> hits = trace_closest(scene, rays);
    const Located located = locate(scene, hits);
    // In pixels of a picture of 512 x 512, which it is by default.
    const auto place_of = [&](const Point3 &p) {
      const Point3 d = minus(p, from);
      const auto along = [&](const Point3 &e) { return d[0] * e[0] + d[1] * e[1] + d[2] * e[2]; };
      const double scale = 256 / half / -along(z);
      return std::array<double, 3>{along(x) * scale, along(y) * scale, -along(z)};
    };
    double worst = 0;
    for (size_t i = 0; i < hits.size(); ++i) {
      if (hits[i].primitive == GPURT_INVALID_ID) continue;
      Point3 own;
      for (size_t k = 0; k < 3; ++k) own[k] = double(located.positions[i][k]);
      const auto a = place_of(own), b = place_of(point_of(rays[i], hits[i]));
      // Distances along rays are good to 2^-20 of 4 on Embree, and a pixel is this wide there.
      const double rounding = 4e-6 / (b[2] * half / 256);
      worst = std::max(worst, std::hypot(a[0] - b[0], a[1] - b[1]) - rounding);
    }
    std::printf("%g pixels: bound %.3g, largest %.3g, %llu triangles\n", double(pixels),
                facts.patch_error_pixels, worst, (unsigned long long)facts.num_triangles);
    if (is_bound) {
      EXPECT_LE(worst, facts.patch_error_pixels);
    }
    worst_share = std::max(worst_share, worst / double(pixels));

    // From the middle of the surface, at boundaries of patches and all over them.
    rays.clear();
    for (int i = 0; i < 4000; ++i) {
      const double across = i % 2 == 0 ? double(rng() & 1) : uniform(rng), along = uniform(rng);
      const bool is_row = rng() & 1;
      const SurfacePoint s =
          evaluate(nets[pick(rng, nets.size())], is_row ? along : across, is_row ? across : along);
      rays.push_back(ray_between({uniform(rng, -0.2, 0.2), uniform(rng, -0.2, 0.2), 0}, s.p));
    }
    size_t num_missed = 0;
    for (const gpurt_hit &hit : trace_closest(scene, rays)) num_missed += hit.primitive == GPURT_INVALID_ID;
    EXPECT_EQ(num_missed, 0u) << "round " << round;
  }
  // The bound is no idle one: second derivatives and depths are bounded by hulls, along with the distance's direction.
  EXPECT_GT(worst_share, 0.05);
}

// Of a patch that the eye lies in, that much is said; one behind it has a bound.
TEST_P(PatchHits, SayWhereNoBoundIsProven)
{
  Device device = make_device(GetParam());
  const PatchNet bowl = [] {
    PatchNet net = flat_patch({-1, -1, 0}, {2, 0, 0}, {0, 2, 0});
    for (size_t k : {5, 6, 9, 10}) net[k][2] = 0.5f;
    return net;
  }();
  for (const bool is_on : {true, false}) {
    Scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
    add_patches(scene, {bowl});
    const Point3 middle = evaluate(bowl, 0.5, 0.5).p;
    add_camera(scene, {float(middle[0]), float(middle[1]), float(middle[2]) - (is_on ? 0.0f : 0.4f)}, 0.8f);
    commit_in_pixels(scene, 4);
    // It looks along -z: from below, all of the patch is behind it.
    const gpurt_scene_facts facts = facts_of(scene);
    EXPECT_EQ(std::isinf(facts.patch_error_pixels), is_on) << facts.patch_error_pixels;
    EXPECT_LT(facts.num_triangles, 400000u);
  }
}

}  // namespace
