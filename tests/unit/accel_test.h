// Scenes made by hand, the CPU backend over them, and brute force to compare with.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <random>

#include "accel/kd_build.h"
#include "core/accel/trace.h"
#include "cpu/committed_scene.h"
#include "cpu/cpu_backend.h"

namespace gpurt::test {

class Random {
 public:
  explicit Random(uint32_t seed) : rng_(seed) {}
  uint32_t below(uint32_t n) { return uint32_t(rng_() % n); }
  float uniform(float lo, float hi) { return lo + (hi - lo) * float(rng_() >> 8) * 0x1p-24f; }
  Vec3f point(float size) { return {uniform(-size, size), uniform(-size, size), uniform(-size, size)}; }
  Vec3f direction()
  {
    for (;;) {
      const Vec3f p = point(1);
      if (length2(p) > 1e-3f && length2(p) <= 1) return normalize(p);
    }
  }

 private:
  std::mt19937 rng_;
};

struct Mesh {
  std::vector<Vec3f> positions;
  std::vector<UInt3> triangles;

  void add(Vec3f a, Vec3f b, Vec3f c)
  {
    const uint32_t n = uint32_t(positions.size());
    positions.insert(positions.end(), {a, b, c});
    triangles.push_back({n, n + 1, n + 2});
  }
  void add(Mesh other)  // a copy: it may be this one
  {
    const uint32_t n = uint32_t(positions.size());
    positions.insert(positions.end(), other.positions.begin(), other.positions.end());
    for (UInt3 t : other.triangles) triangles.push_back({t.x + n, t.y + n, t.z + n});
  }
};

inline Mesh icosphere(int levels, float radius)
{
  const float t = 1.618034f;
  Mesh m;
  m.positions = {{-1, t, 0},  {1, t, 0},  {-1, -t, 0}, {1, -t, 0}, {0, -1, t},  {0, 1, t},
                 {0, -1, -t}, {0, 1, -t}, {t, 0, -1},  {t, 0, 1},  {-t, 0, -1}, {-t, 0, 1}};
  m.triangles = {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                 {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                 {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
  for (int l = 0; l < levels; ++l) {
    std::map<std::pair<uint32_t, uint32_t>, uint32_t> middle;
    const auto mid = [&](uint32_t a, uint32_t b) {
      const auto [it, is_new] =
          middle.try_emplace({std::min(a, b), std::max(a, b)}, uint32_t(m.positions.size()));
      if (is_new) m.positions.push_back(normalize(m.positions[a]) + normalize(m.positions[b]));
      return it->second;
    };
    std::vector<UInt3> finer;
    for (UInt3 x : m.triangles) {
      const uint32_t a = mid(x.x, x.y), b = mid(x.y, x.z), c = mid(x.z, x.x);
      finer.insert(finer.end(), {{x.x, a, c}, {x.y, b, a}, {x.z, c, b}, {a, b, c}});
    }
    m.triangles = finer;
  }
  for (Vec3f &p : m.positions) p = normalize(p) * radius;
  return m;
}

inline Mesh box(Vec3f lo, Vec3f hi)
{
  Mesh m;
  for (int i = 0; i < 8; ++i)
    m.positions.push_back({i & 1 ? hi.x : lo.x, i & 2 ? hi.y : lo.y, i & 4 ? hi.z : lo.z});
  m.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                 {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return m;
}

inline Mesh soup(Random &rng, int count, float size, float extent)
{
  Mesh m;
  for (int i = 0; i < count; ++i) {
    const Vec3f p = rng.point(extent);
    m.add(p + rng.point(size), p + rng.point(size), p + rng.point(size));
  }
  return m;
}

/// Puts meshes into a compiled scene: geometry and instance ids count in the order of the calls.
class SceneMaker {
 public:
  SceneMaker() : scene_(std::make_shared<CompiledScene>())
  {
    Material material{};
    material.base_color_texture = invalid_id;
    scene_->materials = {material};
    scene_->groups.push_back({0, 0, empty_box()});
    scene_->group_geometry.push_back(invalid_id);
    scene_->bounds = empty_box();
  }

  uint32_t add_material(const Material &material)
  {
    scene_->materials.push_back(material);
    return uint32_t(scene_->materials.size() - 1);
  }

  /// World-space meshes must come before shared ones.
  void add_world(const Mesh &mesh, uint32_t material = 0)
  {
    add_segment(0, mesh, material, num_instances_++);
    scene_->bounds = extend(scene_->bounds, scene_->groups[0].bounds);
  }

  void add_shared(const Mesh &mesh, const std::vector<Transform> &places,
                  const std::vector<Transform> &inverses, uint32_t material = 0)
  {
    const uint32_t g = uint32_t(scene_->groups.size());
    scene_->groups.push_back({uint32_t(scene_->indices.size()), 0, empty_box()});
    scene_->group_geometry.push_back(num_geometries_);
    add_segment(g, mesh, material, invalid_id);
    for (size_t i = 0; i < places.size(); ++i) {
      Placement p{};
      p.object_to_world = places[i];
      p.world_to_object = inverses[i];
      p.group = g;
      p.instance = num_instances_++;
      p.first_light = invalid_id;
      p.bounds = empty_box();
      for (Vec3f x : mesh.positions) {
        const Vec3f y = transform_point(p.object_to_world, x);
        p.bounds = extend(p.bounds, Vec3f{next_down(y.x), next_down(y.y), next_down(y.z)});
        p.bounds = extend(p.bounds, Vec3f{next_up(y.x), next_up(y.y), next_up(y.z)});
      }
      scene_->bounds = extend(scene_->bounds, p.bounds);
      scene_->placements.push_back(p);
    }
  }

  std::shared_ptr<CompiledScene> scene() const { return scene_; }

 private:
  void add_segment(uint32_t group, const Mesh &mesh, uint32_t material, uint32_t instance)
  {
    CompiledScene &s = *scene_;
    const uint32_t first_vertex = uint32_t(s.positions.size()), first_triangle = uint32_t(s.indices.size());
    s.positions.insert(s.positions.end(), mesh.positions.begin(), mesh.positions.end());
    for (UInt3 t : mesh.triangles) {
      s.indices.push_back({t.x + first_vertex, t.y + first_vertex, t.z + first_vertex});
      s.triangle_segment.push_back(uint32_t(s.segments.size()));
      for (uint32_t v : {t.x, t.y, t.z})
        s.groups[group].bounds = extend(s.groups[group].bounds, mesh.positions[v]);
    }
    Segment segment{};
    segment.first_triangle = first_triangle;
    segment.num_triangles = uint32_t(mesh.triangles.size());
    segment.first_vertex = first_vertex;
    segment.first_normal = segment.first_uv = segment.first_light = invalid_id;
    segment.material = material;
    segment.geometry = num_geometries_++;
    segment.instance = instance;
    s.segments.push_back(segment);
    s.groups[group].num_triangles += segment.num_triangles;
    s.has_alpha_masks |= s.materials[material].alpha_cutoff > 0;
    s.hash = s.hash * 0x9e3779b97f4a7c15ull + s.indices.size();
  }

  std::shared_ptr<CompiledScene> scene_;
  uint32_t num_geometries_ = 0, num_instances_ = 0;
};

inline std::shared_ptr<CompiledScene> scene_of(const Mesh &mesh)
{
  SceneMaker maker;
  maker.add_world(mesh);
  return maker.scene();
}

inline BuildOptions kd_options(TriangleTest test = TriangleTest::Watertight)
{
  BuildOptions options;
  options.accel = Accel::KdTree;
  options.triangle_test = test;
  return options;
}

inline CpuBackend &backend()
{
  static CpuBackend b({});
  return b;
}

inline std::shared_ptr<const CpuScene> commit(std::shared_ptr<const CompiledScene> scene,
                                              const BuildOptions &options = kd_options())
{
  return std::static_pointer_cast<const CpuScene>(backend().commit(std::move(scene), options));
}

/// Tests every triangle of every placement, as an accelerator that leaves nothing out.
template <TriangleTest Test, EdgeRule Rule, class Visitor>
void visit_all_triangles(const SceneView &scene, const TraceRay &ray, Visitor &visitor)
{
  const auto visit_group = [&](const Group &g, const TraceRay &r, uint32_t placement) {
    TriangleRay<Test> t;
    make_triangle_ray(r, t);
    for (uint32_t i = g.first_triangle; i < g.first_triangle + g.num_triangles; ++i) {
      const UInt3 c = scene.indices[i];
      const Vec3f a = scene.positions[c.x], b = scene.positions[c.y], d = scene.positions[c.z];
      if (is_degenerate(a, b, d)) continue;
      const float limit =
          r.exponent == ray.exponent ? visitor.limit : scale_by_power(visitor.limit, r.exponent);
      TriangleHit h;
      if (!intersect<Rule>(t, a, b, d, r.tmin, limit, h)) continue;
      if (placement != invalid_id && r.exponent != 0) h.t = scale_by_power(h.t, -r.exponent);
      visitor(i, placement, h);
    }
  };
  visit_group(scene.groups[0], ray, invalid_id);
  for (uint32_t p = 0; p < scene.num_placements; ++p) {
    const Placement &place = scene.placements[p];
    TraceRay r;
    if (!prepare_ray(transform_point(place.world_to_object, ray.origin),
                     transform_vector(place.world_to_object, ray.direction), ray.tmin, ray.tmax, r)) {
      continue;
    }
    visit_group(scene.groups[place.group], r, p);
  }
}

template <TriangleTest Test = TriangleTest::Watertight>
Hit brute_force(const SceneView &scene, const Ray &ray)
{
  const Hit miss = {ray.tmax, 0, 0, invalid_id, invalid_id};
  TraceRay r;
  if (!prepare_ray(ray.origin, ray.direction, ray.tmin, ray.tmax, r)) return miss;
  ClosestVisitor<true> visitor{&scene, r.tmax, miss, 0};
  visit_all_triangles<Test, EdgeRule::Inclusive>(scene, r, visitor);
  if (visitor.best.triangle != invalid_id) visitor.best.t = caller_t(r, visitor.best.t);
  return visitor.best;
}

inline std::vector<Hit> brute_force_all(const SceneView &scene, const Ray &ray)
{
  std::vector<Hit> hits;
  TraceRay r;
  if (!prepare_ray(ray.origin, ray.direction, ray.tmin, ray.tmax, r)) return hits;
  const auto sink = [&](Hit h) {
    h.t = caller_t(r, h.t);
    hits.push_back(h);
  };
  AllVisitor<true, decltype(sink)> visitor{&scene, r.tmax, sink, 0};
  visit_all_triangles<TriangleTest::Watertight, EdgeRule::HalfOpen>(scene, r, visitor);
  std::sort(hits.begin(), hits.end(), [&](const Hit &a, const Hit &b) { return hit_precedes(scene, a, b); });
  return hits;
}

inline bool same_bits(const Hit &a, const Hit &b)
{
  return float_bits(a.t) == float_bits(b.t) && float_bits(a.u) == float_bits(b.u) &&
         float_bits(a.v) == float_bits(b.v) && a.triangle == b.triangle && a.placement == b.placement;
}

inline std::string text(const Hit &h)
{
  return fmt::format("t {:.9g} u {:.9g} v {:.9g} triangle {} placement {}", h.t, h.u, h.v,
                     int32_t(h.triangle), int32_t(h.placement));
}

inline std::vector<Hit> trace(const CpuScene &scene, const std::vector<Ray> &rays)
{
  std::vector<Hit> hits(rays.size());
  scene.accel().closest(scene.accel(), rays.data(), hits.data(), uint32_t(rays.size()));
  return hits;
}

inline std::vector<uint8_t> trace_occluded(const CpuScene &scene, const std::vector<Ray> &rays)
{
  std::vector<uint8_t> occluded(rays.size());
  scene.accel().occluded(scene.accel(), rays.data(), occluded.data(), uint32_t(rays.size()));
  return occluded;
}

/// Rays from around the scene and within it, many of them along axes.
inline std::vector<Ray> mixed_rays(Random &rng, int count, float extent)
{
  std::vector<Ray> rays;
  for (int i = 0; i < count; ++i) {
    Ray r = {rng.point(i % 3 == 0 ? extent * 3 : extent), 0, rng.direction(), infinity};
    if (i % 3 == 0) r.direction = rng.point(extent) - r.origin;
    if (i % 5 == 0) {
      r.direction = {0, 0, 0};
      set(r.direction, int(rng.below(3)), rng.below(2) ? 1.0f : -1.0f);
    }
    if (i % 7 == 0) r.tmax = rng.uniform(0, 2 * extent);
    if (i % 11 == 0) r.tmin = rng.uniform(-extent, extent);
    if (r.tmin > r.tmax) r.tmin = 0;
    rays.push_back(r);
  }
  return rays;
}

// A point of a triangle in double, and what a box has to leave to its rounding.
struct TrianglePoint {
  std::array<double, 3> p;
  double slack;
};

/// The i-th of a triangle's points: some of them on an edge, some at a corner.
inline TrianglePoint point_of(const Mesh &mesh, uint32_t triangle, Random &rng, int i)
{
  const UInt3 c = mesh.triangles[triangle];
  const Vec3f a = mesh.positions[c.x], b = mesh.positions[c.y], d = mesh.positions[c.z];
  float u = rng.uniform(0, 1), v = rng.uniform(0, 1);
  if (i % 4 == 0) u = 0;
  if (i % 8 == 0) v = 1;
  if (u + v > 1) u = 1 - u, v = 1 - v;
  TrianglePoint point{};
  for (int k = 0; k < 3; ++k) {
    point.p[k] = at(a, k) + u * (double(at(b, k)) - at(a, k)) + v * (double(at(d, k)) - at(a, k));
    point.slack = std::max(point.slack, std::abs(point.p[k]));
  }
  point.slack *= 1e-12;
  return point;
}

}  // namespace gpurt::test
