#include "generated_scene.h"

#include <array>
#include <cmath>
#include <random>

#include "gpurt_scene.h"

namespace bench {
namespace {

struct Geometry {
  std::vector<Vec3> vertices;
  std::vector<std::array<float, 2>> uvs;
  std::vector<std::array<uint32_t, 3>> triangles;
};

class Numbers {
 public:
  explicit Numbers(uint32_t seed) : engine_(seed) {}
  float between(float lo, float hi) { return lo + (hi - lo) * float(engine_() >> 8) * 0x1p-24f; }
  Vec3 in_ball()
  {
    for (;;) {
      const Vec3 p = {between(-1, 1), between(-1, 1), between(-1, 1)};
      if (p.x * p.x + p.y * p.y + p.z * p.z <= 1) return p;
    }
  }

 private:
  std::mt19937 engine_;
};

void add_quad(Geometry &g, Vec3 center, Vec3 u, Vec3 v)
{
  const uint32_t first = uint32_t(g.vertices.size());
  for (const auto &[a, b] : {std::pair{-1.0f, -1.0f}, {1.0f, -1.0f}, {1.0f, 1.0f}, {-1.0f, 1.0f}}) {
    g.vertices.push_back(
        {center.x + a * u.x + b * v.x, center.y + a * u.y + b * v.y, center.z + a * u.z + b * v.z});
    g.uvs.push_back({0.5f + 0.5f * a, 0.5f + 0.5f * b});
  }
  g.triangles.push_back({first, first + 1, first + 2});
  g.triangles.push_back({first, first + 2, first + 3});
}

// A crown of leaves above `root`.
void add_crown(Geometry &g, Vec3 root, uint32_t num_leaves, Numbers &numbers)
{
  for (uint32_t i = 0; i < num_leaves; ++i) {
    const Vec3 p = numbers.in_ball(), u = numbers.in_ball(), v = numbers.in_ball();
    add_quad(g, {root.x + 1.5f * p.x, root.y + 3.5f + 1.5f * p.y, root.z + 1.5f * p.z},
             {0.1f * u.x, 0.1f * u.y, 0.1f * u.z}, {0.1f * v.x, 0.1f * v.y, 0.1f * v.z});
  }
}

void add_trunk(Geometry &g, Vec3 root)
{
  constexpr int num_sides = 12;
  constexpr float radius = 0.12f, height = 3.0f;
  for (int i = 0; i < num_sides; ++i) {
    const float angle = (float(i) + 0.5f) * 6.2831853f / num_sides, c = std::cos(angle), s = std::sin(angle);
    add_quad(g, {root.x + radius * c, root.y + 0.5f * height, root.z + radius * s},
             {-0.27f * radius * s, 0, 0.27f * radius * c}, {0, 0.5f * height, 0});
  }
}

// A sphere that is dented here and there: an octahedron, each face cut into n^2 parts, whose corners are moved.
Geometry make_rock(Numbers &numbers)
{
  constexpr uint32_t n = 25;  // 8 n^2 = 5,000 triangles
  Geometry g;
  const float a = numbers.between(2, 5), b = numbers.between(2, 5);
  for (int face = 0; face < 8; ++face) {
    const float sx = face & 1 ? 1.0f : -1.0f, sy = face & 2 ? 1.0f : -1.0f, sz = face & 4 ? 1.0f : -1.0f;
    std::vector<uint32_t> row, next;
    for (uint32_t i = 0; i <= n; ++i) {
      next.clear();
      for (uint32_t j = 0; j <= n - i; ++j) {
        const float x = sx * float(i), y = sy * float(j), z = sz * float(n - i - j);
        const float size = std::sqrt(x * x + y * y + z * z);
        const float r = 1 + 0.15f * std::sin(a * x / size) * std::cos(b * z / size);
        next.push_back(uint32_t(g.vertices.size()));
        g.vertices.push_back({r * x / size, r * y / size, r * z / size});
        g.uvs.push_back({0, 0});
      }
      for (uint32_t j = 0; j + 1 < row.size(); ++j) {
        g.triangles.push_back({row[j], row[j + 1], next[j]});
        if (j + 1 < next.size()) g.triangles.push_back({row[j + 1], next[j + 1], next[j]});
      }
      row = next;
    }
  }
  return g;
}

uint32_t add(gpurt_scene scene, const Geometry &g, uint32_t material)
{
  gpurt_mesh_desc desc = GPURT_MESH_DESC_INIT;
  desc.material = material;
  desc.vertices = {g.vertices.data(), nullptr, 0, 0, g.vertices.size()};
  desc.indices = {g.triangles.data(), nullptr, 0, 0, g.triangles.size()};
  desc.uvs = {g.uvs.data(), nullptr, 0, 0, g.uvs.size()};
  uint32_t id = 0;
  check(gpurt_scene_add_mesh(scene, &desc, &id), "adding a mesh");
  return id;
}

void place(gpurt_scene scene, uint32_t geometry, Vec3 at, float size, float angle)
{
  gpurt_instance_desc desc = GPURT_INSTANCE_DESC_INIT;
  desc.geometry = geometry;
  const float c = size * std::cos(angle), s = size * std::sin(angle);
  const float transform[12] = {c, 0, s, at.x, 0, size, 0, at.y, -s, 0, c, at.z};
  for (int i = 0; i < 12; ++i) desc.transform[i] = transform[i];
  uint32_t id = 0;
  check(gpurt_scene_add_instance(scene, &desc, &id), "placing a mesh");
}

// A round leaf: a disc is opaque, and the corners about it are holes.
uint32_t add_leaf_material(gpurt_scene scene)
{
  constexpr uint32_t n = 64;
  std::vector<uint8_t> texels(n * n * 4, 255);
  for (uint32_t y = 0; y < n; ++y) {
    for (uint32_t x = 0; x < n; ++x) {
      const float dx = (float(x) + 0.5f) / n - 0.5f, dy = (float(y) + 0.5f) / n - 0.5f;
      if (dx * dx + dy * dy > 0.16f) texels[(y * n + x) * 4 + 3] = 0;
    }
  }
  gpurt_texture_desc texture = GPURT_TEXTURE_DESC_INIT;
  texture.width = texture.height = n;
  texture.texels = texels.data();
  gpurt_material_desc material = GPURT_MATERIAL_DESC_INIT;
  material.alpha_cutoff = 0.5f;
  uint32_t id = 0;
  check(gpurt_scene_add_texture(scene, &texture, &material.base_color_texture), "adding a texture");
  check(gpurt_scene_add_material(scene, &material, &id), "adding a material");
  return id;
}

constexpr float extent = 100.0f;  // half the ground's

struct Shot {
  Vec3 eye, target;
};
Shot shot_of(const std::string &name)
{
  if (name == "leaves") return {{28, 9, 28}, {0, 2, 0}};
  return {{0.9f * extent, 25, 0.9f * extent}, {0, 0, 0}};
}

}  // namespace

bool is_generated(const std::string &name) { return name == "leaves" || name == "rocks" || name == "forest"; }

void fill_generated(const std::string &name, gpurt_scene scene)
{
  Numbers numbers(7);
  Geometry ground;
  add_quad(ground, {0, 0, 0}, {extent, 0, 0}, {0, 0, -extent});
  place(scene, add(scene, ground, 0), {0, 0, 0}, 1, 0);
  if (name == "leaves") {
    Geometry leaves, trunks;
    for (int i = 0; i < 200; ++i) {
      const Vec3 root = {numbers.between(-20, 20), 0, numbers.between(-20, 20)};
      add_crown(leaves, root, 1000, numbers);
      add_trunk(trunks, root);
    }
    place(scene, add(scene, leaves, add_leaf_material(scene)), {0, 0, 0}, 1, 0);
    place(scene, add(scene, trunks, 0), {0, 0, 0}, 1, 0);
    return;
  }
  const bool is_forest = name == "forest";
  const uint32_t leaf = is_forest ? add_leaf_material(scene) : 0;
  std::vector<uint32_t> shapes, trunks;
  for (int i = 0; i < (is_forest ? 4 : 5); ++i) {
    if (is_forest) {
      Geometry crown, trunk;
      add_crown(crown, {0, 0, 0}, 2000, numbers);
      add_trunk(trunk, {0, 0, 0});
      shapes.push_back(add(scene, crown, leaf));
      trunks.push_back(add(scene, trunk, 0));
    } else {
      shapes.push_back(add(scene, make_rock(numbers), 0));
    }
  }
  for (uint32_t i = 0; i < 10000; ++i) {
    const Vec3 at = {numbers.between(-extent, extent), 0, numbers.between(-extent, extent)};
    const float size = numbers.between(0.4f, 1.2f), angle = numbers.between(0, 6.2831853f);
    place(scene, shapes[i % shapes.size()], at, size, angle);
    if (is_forest) place(scene, trunks[i % trunks.size()], at, size, angle);
  }
}

std::map<std::string, std::vector<gpurt_ray>> make_generated_rays(const std::string &name, gpurt_scene scene)
{
  constexpr uint32_t width = generated_width, height = 1024;
  constexpr float far_away = 3.0e38f;
  std::map<std::string, std::vector<gpurt_ray>> sets;
  const Shot shot = shot_of(name);
  const Vec3 d = {shot.target.x - shot.eye.x, shot.target.y - shot.eye.y, shot.target.z - shot.eye.z};
  const float size = std::sqrt(d.x * d.x + d.y * d.y + d.z * d.z), flat = std::sqrt(d.x * d.x + d.z * d.z);
  const Vec3 front = {d.x / size, d.y / size, d.z / size}, right = {-d.z / flat, 0, d.x / flat};
  const Vec3 up = {right.y * front.z - right.z * front.y, right.z * front.x - right.x * front.z,
                   right.x * front.y - right.y * front.x};
  std::vector<gpurt_ray> &primary = sets["primary"];
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      const float a = (float(x) + 0.5f) / height - 1.0f, b = 0.5f - (float(y) + 0.5f) / height;
      primary.push_back({{shot.eye.x, shot.eye.y, shot.eye.z},
                         0.0f,
                         {front.x + a * right.x + b * up.x, front.y + a * right.y + b * up.y,
                          front.z + a * right.z + b * up.z},
                         far_away});
    }
  }
  std::vector<gpurt_hit_compact> hits(primary.size());
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.format = GPURT_HIT_COMPACT;
  desc.num_rays = primary.size();
  desc.rays = primary.data();
  desc.hits = hits.data();
  check(gpurt_scene_trace(scene, &desc), "tracing camera rays");
  Numbers numbers(11);
  const float reach = name == "leaves" ? 20.0f : extent;
  for (size_t i = 0; i < hits.size(); ++i) {
    const gpurt_ray &from = primary[i];
    gpurt_ray ray = from;
    const Vec3 to = numbers.in_ball();
    if (hits[i].primitive != GPURT_INVALID_ID) {
      const float t = hits[i].t * (1.0f - 1e-4f);
      for (int k = 0; k < 3; ++k) ray.origin[k] = from.origin[k] + t * from.direction[k];
    }
    ray.direction[0] = to.x;
    ray.direction[1] = std::abs(to.y);
    ray.direction[2] = to.z;
    sets["diffuse"].push_back(ray);
    ray.tmax = 0.1f * reach;
    sets["ao"].push_back(ray);
    const Vec3 a = numbers.in_ball(), b = numbers.in_ball();
    const float high = name == "leaves" ? 5.0f : 4.0f;
    sets["random"].push_back(
        {{reach * a.x, high * std::abs(a.y), reach * a.z},
         0.0f,
         {reach * (b.x - a.x), high * (std::abs(b.y) - std::abs(a.y)), reach * (b.z - a.z)},
         far_away});
  }
  return sets;
}

}  // namespace bench
