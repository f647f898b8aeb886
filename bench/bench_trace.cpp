// Rays per second of one thread, beside Embree called directly in the same run.
//
//   bench_trace [--repeats N] [--size N] SCENE...
//
// SCENE is a glTF file or bumps:N. Ray sets: primary (raster order), diffuse (cosine directions from the primary hits),
// ao (the same, any hit, a fifth of the scene's diagonal long), random (origins in the bounds). Methods take turns on
// blocks of rays; time is the thread's own, so that other work on the machine disturbs it little.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <ctime>
#include <random>

#include "embree_reference.h"
#include "gpurt_scene.h"

namespace {

using bench::Vec3;

double thread_seconds()
{
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
Vec3 operator*(Vec3 a, float s) { return {a.x * s, a.y * s, a.z * s}; }
float dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Vec3 cross(Vec3 a, Vec3 b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
Vec3 normalize(Vec3 a) { return a * (1 / std::sqrt(dot(a, a))); }

gpurt_ray make_ray(Vec3 o, Vec3 d, float tmax) { return {{o.x, o.y, o.z}, 0, {d.x, d.y, d.z}, tmax}; }

struct RaySet {
  const char *name;
  bool any;
  std::vector<gpurt_ray> rays;
};

std::vector<RaySet> make_rays(const bench::TriangleScene &scene, const bench::EmbreeReference &reference,
                              uint32_t size)
{
  std::mt19937 rng(1);
  const auto uniform = [&] { return float(rng() >> 8) * 0x1p-24f; };
  std::vector<RaySet> sets = {
      {"primary", false, {}}, {"diffuse", false, {}}, {"ao", true, {}}, {"random", false, {}}};
  Vec3 lo = scene.positions[0], hi = lo;
  for (Vec3 p : scene.positions) {
    lo = {std::min(lo.x, p.x), std::min(lo.y, p.y), std::min(lo.z, p.z)};
    hi = {std::max(hi.x, p.x), std::max(hi.y, p.y), std::max(hi.z, p.z)};
  }
  const float diagonal = std::sqrt(dot(hi - lo, hi - lo));

  const auto &m = scene.camera;
  const uint32_t width = size, height = size * 3 / 4;
  const float slope = std::tan(scene.yfov_rad / 2);
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      const float px = (2 * (float(x) + 0.5f) / float(width) - 1) * slope * float(width) / float(height);
      const float py = (1 - 2 * (float(y) + 0.5f) / float(height)) * slope;
      const Vec3 d = {m[0] * px + m[1] * py - m[2], m[4] * px + m[5] * py - m[6],
                      m[8] * px + m[9] * py - m[10]};
      sets[0].rays.push_back(make_ray({m[3], m[7], m[11]}, normalize(d), INFINITY));
    }
  }
  std::vector<gpurt_hit> hits(sets[0].rays.size());
  reference.closest(sets[0].rays.data(), hits.data(), hits.size());
  for (size_t i = 0; i < hits.size(); ++i) {
    const Vec3 o = {lo.x + (hi.x - lo.x) * uniform(), lo.y + (hi.y - lo.y) * uniform(),
                    lo.z + (hi.z - lo.z) * uniform()};
    const float cosine = 2 * uniform() - 1, angle = 6.2831853f * uniform(),
                sine = std::sqrt(1 - cosine * cosine);
    sets[3].rays.push_back(make_ray(o, {sine * std::cos(angle), sine * std::sin(angle), cosine}, INFINITY));
    if (hits[i].primitive == GPURT_INVALID_ID) continue;
    const gpurt_ray &r = sets[0].rays[i];
    const auto t = scene.triangles[hits[i].primitive];
    const Vec3 a = scene.positions[t[0]], b = scene.positions[t[1]], c = scene.positions[t[2]];
    const Vec3 d = {r.direction[0], r.direction[1], r.direction[2]};
    Vec3 n = normalize(cross(b - a, c - a));
    if (dot(n, d) > 0) n = n * -1;
    const Vec3 p = a + (b - a) * hits[i].u + (c - a) * hits[i].v;
    const Vec3 s = normalize(std::abs(n.x) > 0.5f ? Vec3{n.y, -n.x, 0} : Vec3{0, n.z, -n.y}), q = cross(n, s);
    const float radius = std::sqrt(uniform()), phi = 6.2831853f * uniform();
    const Vec3 w =
        s * (radius * std::cos(phi)) + q * (radius * std::sin(phi)) + n * std::sqrt(1 - radius * radius);
    const Vec3 from = p + n * (1e-6f * diagonal);
    sets[1].rays.push_back(make_ray(from, w, INFINITY));
    sets[2].rays.push_back(make_ray(from, w, 0.2f * diagonal));
  }
  return sets;
}

struct Method {
  const char *name;
  gpurt_scene scene;  // NULL: Embree directly
};

void trace(gpurt_scene scene, bool any, const gpurt_ray *rays, gpurt_hit *hits, uint8_t *occluded, size_t n)
{
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = any ? GPURT_QUERY_ANY : GPURT_QUERY_CLOSEST;
  desc.num_rays = n;
  desc.rays = rays;
  desc.hits = any ? nullptr : hits;
  desc.occluded = any ? occluded : nullptr;
  bench::check(gpurt_scene_trace(scene, &desc), "tracing");
}

void run(const bench::TriangleScene &scene, const char *isa, const bench::EmbreeReference &reference,
         const std::vector<Method> &methods, const RaySet &set, int repeats)
{
  constexpr size_t block = 16384;
  const size_t n = set.rays.size();
  std::vector<std::vector<double>> seconds(methods.size());  // [method][round]
  std::vector<gpurt_hit> hits(n), reference_hits(n);
  std::vector<uint8_t> occluded(n), reference_occluded(n);
  std::vector<size_t> num_different(methods.size());
  for (int round = 0; round <= repeats; ++round) {  // the first one warms up
    std::vector<double> total(methods.size(), 0.0);
    for (size_t first = 0; first < n; first += block) {
      const size_t count = std::min(block, n - first);
      for (size_t k = 0; k < methods.size(); ++k) {
        const bool is_reference = methods[k].scene == nullptr;
        gpurt_hit *h = (is_reference ? reference_hits : hits).data() + first;
        uint8_t *o = (is_reference ? reference_occluded : occluded).data() + first;
        const double begin = thread_seconds();
        if (!is_reference) trace(methods[k].scene, set.any, set.rays.data() + first, h, o, count);
        else if (set.any) reference.occluded(set.rays.data() + first, o, count);
        else reference.closest(set.rays.data() + first, h, count);
        total[k] += thread_seconds() - begin;
        if (round != 0 || is_reference) continue;
        for (size_t i = first; i < first + count; ++i) {
          num_different[k] += set.any ? occluded[i] != reference_occluded[i]
                                      : (hits[i].primitive == GPURT_INVALID_ID) !=
                                            (reference_hits[i].primitive == GPURT_INVALID_ID);
        }
      }
    }
    for (size_t k = 0; k < methods.size() && round > 0; ++k) seconds[k].push_back(total[k]);
  }
  const auto quantile = [](std::vector<double> s, double q) {
    std::sort(s.begin(), s.end());
    return s[size_t(q * double(s.size() - 1) + 0.5)];
  };
  const double yardstick = quantile(seconds[0], 0.5);
  for (size_t k = 0; k < methods.size(); ++k) {
    const double median = quantile(seconds[k], 0.5);
    std::printf(
        "{\"bench\":\"trace\",\"method\":\"%s\",\"scene\":\"%s\",\"triangles\":%zu,\"rays\":\"%s\",\"num_"
        "rays\":%zu,"
        "\"threads\":1,\"isa\":\"%s\",\"mrays_per_s\":%.3f,\"spread\":%.3f,\"ratio_to_embree\":%.3f,"
        "\"hit_or_miss_differs\":%zu}\n",
        methods[k].name, scene.name.c_str(), scene.triangles.size(), set.name, n, isa,
        double(n) / median * 1e-6, (quantile(seconds[k], 0.9) - quantile(seconds[k], 0.1)) / median,
        yardstick / median, num_different[k]);
    std::fflush(stdout);
  }
}

}  // namespace

int main(int argc, char **argv)
{
  int repeats = 5;
  uint32_t size = 512;
  std::vector<std::string> scenes;
  for (int i = 1; i < argc; ++i) {
    if (!std::strcmp(argv[i], "--repeats") && i + 1 < argc) repeats = std::max(1, std::atoi(argv[++i]));
    else if (!std::strcmp(argv[i], "--size") && i + 1 < argc)
      size = uint32_t(std::max(8, std::atoi(argv[++i])));
    else scenes.push_back(argv[i]);
  }
  if (scenes.empty()) scenes = {"bumps:250000"};

  gpurt_device device = nullptr;
  gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
  desc.type = GPURT_DEVICE_CPU;
  desc.num_threads = 1;
  bench::check(gpurt_device_create(&desc, &device), "creating the device");
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  bench::check(gpurt_device_get_properties(device, &properties), "reading the device");

  for (const std::string &what : scenes) {
    const bench::TriangleScene source = bench::load_scene(what);
    bench::EmbreeReference reference(source, 1);
    reference.build();
    bench::GpurtScene embree(device, source), watertight(device, source), moller(device, source),
        precise(device, source), bvh(device, source), bvh_moller(device, source);
    embree.commit(GPURT_ACCEL_EMBREE);
    watertight.commit(GPURT_ACCEL_KDTREE, GPURT_TRIANGLE_WATERTIGHT);
    moller.commit(GPURT_ACCEL_KDTREE, GPURT_TRIANGLE_MOLLER_TRUMBORE);
    precise.commit(GPURT_ACCEL_KDTREE, GPURT_TRIANGLE_DOUBLE);
    bvh.commit(GPURT_ACCEL_BVH, GPURT_TRIANGLE_WATERTIGHT);
    bvh_moller.commit(GPURT_ACCEL_BVH, GPURT_TRIANGLE_MOLLER_TRUMBORE);
    const std::vector<Method> methods = {{"embree_raw", nullptr},
                                         {"gpurt_embree", embree.get()},
                                         {"gpurt_kdtree_watertight", watertight.get()},
                                         {"gpurt_kdtree_moller_trumbore", moller.get()},
                                         {"gpurt_kdtree_double", precise.get()},
                                         {"gpurt_bvh_watertight", bvh.get()},
                                         {"gpurt_bvh_moller_trumbore", bvh_moller.get()}};
    for (const RaySet &set : make_rays(source, reference, size)) {
      run(source, properties.instruction_set, reference, methods, set, repeats);
    }
  }
  gpurt_device_release(device);
  return 0;
}
