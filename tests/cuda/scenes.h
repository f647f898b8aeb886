// Scenes and rays for comparing devices bit by bit. All are functions of indices and seeds.
#pragma once

#include <functional>

#include "../support/gpurt_test.h"
#include "../support/short_form.h"

namespace gpurt_test {

using Vec = std::array<float, 3>;

/// A small counter-based generator: the same numbers on every machine, whatever the standard library.
class Random {
 public:
  explicit Random(uint64_t seed) : state_(seed * 0x9e3779b97f4a7c15u + 0x1234567u) {}
  uint32_t bits()
  {
    state_ += 0x9e3779b97f4a7c15u;
    uint64_t z = state_;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return uint32_t((z ^ (z >> 31)) >> 32);
  }
  uint32_t below(uint32_t n) { return uint32_t(uint64_t(bits()) * n >> 32); }
  float unit() { return float(bits() >> 8) * 0x1p-24f; }
  float between(float lo, float hi) { return lo + (hi - lo) * unit(); }
  Vec inside(Vec lo, Vec hi) { return {between(lo[0], hi[0]), between(lo[1], hi[1]), between(lo[2], hi[2])}; }

 private:
  uint64_t state_;
};

inline void place(gpurt_scene scene, uint32_t geometry, const std::array<float, 12> &transform)
{
  gpurt_instance_desc desc = GPURT_INSTANCE_DESC_INIT;
  desc.geometry = geometry;
  std::memcpy(desc.transform, transform.data(), sizeof desc.transform);
  uint32_t id;
  GPURT_EXPECT_OK(gpurt_scene_add_instance(scene, &desc, &id));
}

/// Height field whose cells are up to 500 times as long as wide, with some triangles of no area.
inline Mesh needle_terrain(uint32_t n)
{
  Mesh m;
  Random random(7);
  for (uint32_t z = 0; z <= n; ++z) {
    for (uint32_t x = 0; x <= n; ++x)
      m.vertices.push_back(
          {float(x) * 0.01f, random.between(0, 0.3f), float(z) * 5.0f + 1.5f * float(x % 3)});
  }
  const auto at = [&](uint32_t x, uint32_t z) { return z * (n + 1) + x; };
  for (uint32_t z = 0; z < n; ++z) {
    for (uint32_t x = 0; x < n; ++x) {
      m.triangles.push_back({at(x, z), at(x, z + 1), at(x + 1, z + 1)});
      m.triangles.push_back({at(x, z), at(x + 1, z + 1), at(x + 1, z)});
      if ((x ^ z) % 64 == 0) m.triangles.push_back({at(x, z), at(x, z), at(x + 1, z)});
    }
  }
  return m;
}

/// An axis-aligned box with corners lo and hi.
inline Mesh box(Vec lo, Vec hi)
{
  Mesh m;
  for (int i = 0; i < 8; ++i)
    m.vertices.push_back({i & 1 ? hi[0] : lo[0], i & 2 ? hi[1] : lo[1], i & 4 ? hi[2] : lo[2]});
  m.triangles = {{0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}, {0, 1, 5}, {0, 5, 4},
                 {2, 6, 7}, {2, 7, 3}, {0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}};
  return m;
}

// Where rays are aimed: the points that a scene is made of, in world space.
struct RayTargets {
  Mesh mesh;  // a sample of the scene's triangles, in world space
  Vec lo{}, hi{};
  std::vector<std::pair<int, float>> planes{};  // (axis, position) of the kd-tree's splits
};

struct TestScene {
  std::string name;
  std::function<RayTargets(gpurt_scene)> fill;  // adds geometry; the planes are found after the commit
};

inline void set_bounds(RayTargets &targets)
{
  targets.lo = targets.hi = targets.mesh.vertices.at(0);
  for (const Vec &v : targets.mesh.vertices) {
    for (int k = 0; k < 3; ++k) {
      targets.lo[k] = std::min(targets.lo[k], v[k]);
      targets.hi[k] = std::max(targets.hi[k], v[k]);
    }
  }
}

inline RayTargets fill_icosphere(gpurt_scene scene)
{
  RayTargets targets{icosphere(6)};
  add_mesh(scene, targets.mesh);
  set_bounds(targets);
  return targets;
}

inline RayTargets fill_terrain(gpurt_scene scene)
{
  RayTargets targets{needle_terrain(160)};
  add_mesh(scene, targets.mesh);
  set_bounds(targets);
  return targets;
}

/// Houses on an integer grid, two geometries shared by many instances, turned, mirrored and scaled by powers of two.
inline RayTargets fill_city(gpurt_scene scene)
{
  RayTargets targets;
  targets.mesh = quad({-32, 0, -32}, {-32, 0, 32}, {32, 0, 32}, {32, 0, -32});
  add_mesh(scene, targets.mesh);
  Mesh house = box({0, 0, 0}, {1, 2, 1}), tower = box({0, 0, 0}, {1, 4, 1});
  tower.append(box({0, 4, 0}, {1, 5, 1}));  // two faces in one plane
  const Mesh *shapes[2] = {&house, &tower};
  const uint32_t ids[2] = {add_mesh(scene, house, 0, false), add_mesh(scene, tower, 0, false)};
  Random random(3);
  for (int z = -16; z < 16; ++z) {
    for (int x = -16; x < 16; ++x) {
      const int shape = int(random.below(2));
      const float size = random.below(4) == 0 ? 0.5f : 1.0f, mirror = random.below(2) ? -size : size;
      const float tx = float(2 * x), tz = float(2 * z);
      const bool turned = random.below(2);
      const std::array<float, 12> t =
          turned ? std::array<float, 12>{0, 0, size, tx, 0, size, 0, 0, mirror, 0, 0, tz}
                 : std::array<float, 12>{mirror, 0, 0, tx, 0, size, 0, 0, 0, 0, size, tz};
      place(scene, ids[shape], t);
      Mesh world = *shapes[shape];
      world.map([&](Vec v) {
        Vec w;
        for (int k = 0; k < 3; ++k)
          w[k] = t[4 * k] * v[0] + t[4 * k + 1] * v[1] + t[4 * k + 2] * v[2] + t[4 * k + 3];
        return w;
      });
      targets.mesh.append(world);
    }
  }
  set_bounds(targets);
  return targets;
}

/// What the alpha of leaves is: where they are, or how much of light they let pass.
enum class Leaves { Mask, Blend };

/// Quads whose alpha comes from a texture, in the world or shared.
inline RayTargets fill_leaves(gpurt_scene scene, Leaves kind, bool is_shared)
{
  std::vector<uint8_t> texels(64 * 64 * 4, 255);
  Random random(11);
  for (size_t i = 3; i < texels.size(); i += 4) texels[i] = uint8_t(random.bits() >> 24);
  gpurt_texture_desc texture = GPURT_TEXTURE_DESC_INIT;
  texture.width = texture.height = 64;
  texture.texels = texels.data();
  uint32_t texture_id, material_id;
  GPURT_EXPECT_OK(gpurt_scene_add_texture(scene, &texture, &texture_id));
  gpurt_material_desc material = GPURT_MATERIAL_DESC_INIT;
  material.alpha_cutoff = kind == Leaves::Mask ? 0.5f : 0.0f;
  material.blends = kind == Leaves::Blend;
  material.base_color_texture = texture_id;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &material, &material_id));
  Mesh leaves;
  std::vector<std::array<float, 2>> uvs;
  for (int i = 0; i < 2000; ++i) {
    const Vec c = random.inside({-4, 0, -4}, {4, 4, 4}), u = random.inside({-1, -1, -1}, {1, 1, 1}),
              v = random.inside({-1, -1, -1}, {1, 1, 1});
    const auto corner = [&](float a, float b) {
      return Vec{c[0] + a * u[0] + b * v[0], c[1] + a * u[1] + b * v[1], c[2] + a * u[2] + b * v[2]};
    };
    leaves.append(quad(corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)));
    uvs.insert(uvs.end(), {{0, 0}, {3, 0}, {3, 3}, {0, 3}});
  }
  gpurt_mesh_desc desc = GPURT_MESH_DESC_INIT;
  desc.material = material_id;
  desc.vertices.data = leaves.vertices.data();
  desc.vertices.count = leaves.vertices.size();
  desc.indices.data = leaves.triangles.data();
  desc.indices.count = leaves.triangles.size();
  desc.uvs.data = uvs.data();
  desc.uvs.count = uvs.size();
  uint32_t geometry;
  GPURT_EXPECT_OK(gpurt_scene_add_mesh(scene, &desc, &geometry));
  RayTargets targets;
  for (int i = 0; i < (is_shared ? 3 : 1); ++i) {
    const float x = float(10 * i);
    place(scene, geometry, {1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, 0});
    Mesh world = leaves;
    targets.mesh.append(world.map([&](Vec v) { return Vec{v[0] + x, v[1], v[2]}; }));
  }
  targets.mesh.append(icosphere(3));
  add_mesh(scene, icosphere(3));
  set_bounds(targets);
  return targets;
}

inline RayTargets fill_foliage(gpurt_scene scene) { return fill_leaves(scene, Leaves::Mask, true); }
inline RayTargets fill_veils(gpurt_scene scene) { return fill_leaves(scene, Leaves::Blend, false); }
inline RayTargets fill_shared_veils(gpurt_scene scene) { return fill_leaves(scene, Leaves::Blend, true); }

inline std::vector<TestScene> test_scenes()
{
  return {{"icosphere", fill_icosphere}, {"terrain", fill_terrain}, {"city", fill_city},
          {"foliage", fill_foliage},     {"veils", fill_veils},     {"shared_veils", fill_shared_veils}};
}

/// All of them; in the short form one that is plain, one of placements, one of placed masks and one that blends in the world.
inline std::vector<TestScene> scenes_of_each_kind()
{
  std::vector<TestScene> scenes = test_scenes();
  if (is_short_form())
    std::erase_if(scenes, [](const TestScene &s) { return s.name == "terrain" || s.name == "shared_veils"; });
  return scenes;
}

/// Planes of the world-space tree, read back from the tree itself; none where the scene has only shared geometry.
inline std::vector<std::pair<int, float>> split_planes(gpurt_scene scene)
{
  gpurt_kdtree tree = GPURT_KDTREE_INIT;
  GPURT_EXPECT_OK(gpurt_scene_export_tree(scene, &tree));
  std::vector<gpurt_kdtree_node> nodes(tree.num_nodes);
  std::vector<uint32_t> references(tree.num_references);
  tree.nodes = nodes.data();
  tree.references = references.data();
  GPURT_EXPECT_OK(gpurt_scene_export_tree(scene, &tree));
  std::vector<std::pair<int, float>> planes;
  for (const gpurt_kdtree_node &n : nodes) {
    float position;
    std::memcpy(&position, &n.word, sizeof position);
    if ((n.tag & 3) != 3) planes.push_back({int(n.tag & 3), position});
  }
  return planes;
}

constexpr uint32_t num_ray_kinds = 16;
inline const char *ray_kind_name(uint64_t index)
{
  static const char *const names[num_ray_kinds] = {
      "eye",           "eye",          "random",        "random",
      "axis-parallel", "at an edge",   "at a vertex",   "in a split plane",
      "signed zero",   "limited",      "not finite",    "any length",
      "on a grid",     "from surface", "from far away", "short"};
  return names[index % num_ray_kinds];
}

/// Ray `index` of a scene's endless sequence; its kind is index % num_ray_kinds.
inline gpurt_ray make_ray(const RayTargets &targets, uint64_t index)
{
  constexpr float inf = __builtin_huge_valf(), nan = __builtin_nanf("");
  Random random(index);
  const Vec size{targets.hi[0] - targets.lo[0], targets.hi[1] - targets.lo[1], targets.hi[2] - targets.lo[2]};
  const Vec center{targets.lo[0] + size[0] / 2, targets.lo[1] + size[1] / 2, targets.lo[2] + size[2] / 2};
  const float radius = std::max({size[0], size[1], size[2]});
  const auto wide = [&] {
    const Vec m{0.5f * size[0] + 0.01f * radius, 0.5f * size[1] + 0.01f * radius,
                0.5f * size[2] + 0.01f * radius};
    return random.inside({center[0] - 2 * m[0], center[1] - 2 * m[1], center[2] - 2 * m[2]},
                         {center[0] + 2 * m[0], center[1] + 2 * m[1], center[2] + 2 * m[2]});
  };
  const size_t triangle = random.below(uint32_t(targets.mesh.triangles.size()));
  const int corner = int(random.below(3));
  const Vec p = targets.mesh.corner(triangle, corner), q = targets.mesh.corner(triangle, (corner + 1) % 3);
  const Vec middle{(p[0] + q[0]) / 2, (p[1] + q[1]) / 2, (p[2] + q[2]) / 2};
  const auto ray = [&](Vec o, Vec d) { return gpurt_ray{{o[0], o[1], o[2]}, 0, {d[0], d[1], d[2]}, inf}; };
  const auto towards = [&](Vec o, Vec target) {
    return ray(o, {target[0] - o[0], target[1] - o[1], target[2] - o[2]});
  };
  const Vec direction = random.inside({-1, -1, -1}, {1, 1, 1});
  const auto zero = [&] { return random.below(2) ? 0.0f : -0.0f; };
  const auto along_axis = [&](int k) {
    Vec d{zero(), zero(), zero()};
    d[k] = random.below(2) ? 1.0f : -1.0f;
    return d;
  };

  gpurt_ray r{};
  switch (index % num_ray_kinds) {
    case 0:
    case 1: {  // neighbours of a picture's pixels, from one eye
      const Vec eye{center[0] + 0.6f * radius, center[1] + 0.5f * radius, center[2] + 0.9f * radius};
      const float x = float((index / num_ray_kinds) % 1024) / 1024 - 0.5f,
                  y = float((index / num_ray_kinds / 1024) % 1024) / 1024 - 0.5f;
      return towards(eye, {center[0] + x * size[0] - y * size[2], center[1] + y * size[1],
                           center[2] + y * size[2] + x * size[0]});
    }
    case 2:
    case 3:
      return ray(wide(), direction);
    case 4:
      return ray(random.below(2) ? wide() : middle, along_axis(int(random.below(3))));
    case 5:
      return towards(wide(), middle);
    case 6:
      return towards(wide(), p);
    case 7: {
      r = ray(wide(), direction);
      if (targets.planes.empty()) return r;
      const auto [axis, position] = targets.planes[random.below(uint32_t(targets.planes.size()))];
      r.origin[axis] = position;
      const uint32_t form = random.below(4);
      if (form == 0) r.direction[axis] = zero();
      if (form == 1) {
        const Vec d = along_axis((axis + 1) % 3);
        for (int k = 0; k < 3; ++k) r.direction[k] = d[k];
      }
      if (form == 2) r.direction[axis] = std::copysign(0x1p-130f, direction[0]);
      return r;
    }
    case 8:
      r = ray(wide(), direction);
      r.direction[random.below(3)] = zero();
      if (random.below(2)) r.direction[random.below(3)] = zero();
      return r;
    case 9: {
      r = towards(wide(), middle);  // the point aimed at has t = 1
      const float limits[] = {0,      1,  std::nextafter(1.0f, 0.0f), std::nextafter(1.0f, 2.0f), 0.5f, 2, -1,
                              0.999f, inf};
      r.tmin = limits[random.below(9)];
      r.tmax = limits[random.below(9)];
      return r;
    }
    case 10: {
      r = towards(wide(), middle);
      const float values[] = {nan, -nan, inf, -inf};
      float *fields[] = {&r.origin[0],    &r.origin[1],    &r.origin[2],    &r.tmin,
                         &r.direction[0], &r.direction[1], &r.direction[2], &r.tmax};
      *fields[random.below(8)] = values[random.below(4)];
      if (random.below(8) == 0) r.direction[0] = r.direction[1] = r.direction[2] = zero();
      return r;
    }
    case 11: {
      r = towards(wide(), random.below(2) ? middle : p);
      const float scales[] = {0x1p-149f, 1e-40f, 1e-30f, 0x1p-41f, 0x1p41f, 1e20f, 1e36f, 3e-3f};
      const float s = scales[random.below(8)];
      for (float &d : r.direction) d *= s;
      return r;
    }
    case 12: {
      const Vec o = wide();
      r = ray({std::round(o[0]), std::round(o[1]), std::round(o[2])}, along_axis(int(random.below(3))));
      if (random.below(2))
        r.direction[random.below(3)] = random.below(2) ? 1.0f : -1.0f;  // diagonals of the grid
      return r;
    }
    case 13:
      return ray(random.below(2) ? middle : p, direction);
    case 14: {
      const float far = 1e2f * radius;
      const Vec o{center[0] + far * direction[0], center[1] + far * direction[1],
                  center[2] + far * direction[2]};
      return towards(o, random.below(2) ? middle : wide());
    }
    default: {
      const Vec a = wide();
      r = towards(a, random.below(2) ? middle : wide());
      r.tmax = random.unit();
      return r;
    }
  }
}

}  // namespace gpurt_test
