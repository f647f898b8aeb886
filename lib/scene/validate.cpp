#include "scene/validate.h"

#include <cmath>
#include <limits>

#include "error.h"
#include "scene/parallel.h"
#include "scene/trigonometry.h"

namespace gpurt {
namespace {

// Texture coordinates are floats: beyond this a texel has less than 8 bits of position within it.
constexpr uint32_t max_texture_size = 65536;

// The fourth power of a metal's roughness, which the GGX distribution divides by, must not vanish in float.
constexpr float min_roughness = 1e-4f;

const char *const channel_names[3] = {"red", "green", "blue"};

void check_finite(Vec3f v, const char *what)
{
  if (!is_finite(v)) fail_invalid("{} is ({}, {}, {}); it must be finite", what, v.x, v.y, v.z);
}

void check_radiance(Vec3f v, const char *what)
{
  check_finite(v, what);
  if (min_component(v) < 0) fail_invalid("{} is ({}, {}, {}); it must not be negative", what, v.x, v.y, v.z);
}

void check_share(float x, const char *what)
{
  if (!(x >= 0 && x <= 1)) fail_invalid("{} is {}; it must be in [0, 1]", what, x);
}

void check_room(size_t count, const char *what)
{
  if (count >= invalid_id) fail_invalid("a scene has room for {} {}", invalid_id, what);
}

// The first float of the texels for which is_bad(value, channel), or the number of floats.
template <class Predicate>
uint64_t find_texel(const TextureData &texture, const Predicate &is_bad)
{
  const uint64_t count = uint64_t(texture.width) * texture.height * 4;
  const std::byte *texels = texture.texels->data();
  return find_first(count, [&](uint64_t i) {
    float value;
    std::memcpy(&value, texels + i * sizeof(float), sizeof(float));
    return is_bad(value, int(i % 4));
  });
}

// Throws if a float texture has a channel for which is_bad.
template <class Predicate>
void check_texels(const TextureData &texture, const Predicate &is_bad, const char *rule)
{
  if (texture.format != TexelFormat::Rgba32f) return;
  const uint64_t i = find_texel(texture, is_bad);
  const uint64_t num_values = uint64_t(texture.width) * texture.height * 4;
  if (i == num_values) return;
  float value;
  std::memcpy(&value, texture.texels->data() + i * sizeof(float), sizeof(float));
  fail_invalid("channel {} of the texel at ({}, {}) is {}; {}", i % 4, i / 4 % texture.width,
               i / 4 / texture.width, value, rule);
}

void check_material(const SceneData &scene, uint32_t material)
{
  if (material >= scene.materials.size()) {
    fail_invalid("there is no material {}; the scene has {}", material, scene.materials.size() - 1);
  }
}

template <class T>
void check_finite_array(const SharedArray<T> &values, const char *what, bool (*is_ok)(const T &))
{
  const uint64_t i = find_first(values.size(), [&](uint64_t k) { return !is_ok(values[k]); });
  if (i != values.size()) fail_invalid("{} {} is not finite", what, i);
}

bool is_finite_vec3(const Vec3f &v) { return is_finite(v); }
bool is_finite_vec2(const Vec2f &v) { return is_finite(v.x) && is_finite(v.y); }

Vec3d column(const AffineDouble &t, int j) { return {t[j], t[4 + j], t[8 + j]}; }

}  // namespace

uint32_t add_texture(SceneData &scene, TextureData texture)
{
  check_room(scene.textures.size(), "textures");
  if (uint32_t(texture.format) > uint32_t(TexelFormat::Rgba32f)) {
    fail_invalid("there is no texture format {}", uint32_t(texture.format));
  }
  for (Wrap wrap : {texture.wrap_u, texture.wrap_v}) {
    if (uint32_t(wrap) > uint32_t(Wrap::Mirror)) fail_invalid("there is no wrap mode {}", uint32_t(wrap));
  }
  if (texture.width == 0 || texture.height == 0) {
    fail_invalid("the texture is {} x {} texels; it needs at least one", texture.width, texture.height);
  }
  if (texture.width > max_texture_size || texture.height > max_texture_size) {
    fail_invalid("the texture is {} x {} texels; make it at most {} wide and high", texture.width,
                 texture.height, max_texture_size);
  }
  const uint64_t expected =
      uint64_t(texture.width) * texture.height * (texture.format == TexelFormat::Rgba32f ? 16 : 4);
  if (!texture.texels || texture.texels->size() != expected) {
    fail_invalid("the texture has {} bytes of texels; {} x {} texels of its format take {}",
                 texture.texels ? texture.texels->size() : 0, texture.width, texture.height, expected);
  }
  check_texels(texture, [](float x, int) { return !is_finite(x); }, "it must be finite");
  scene.textures.push_back(std::move(texture));
  return uint32_t(scene.textures.size() - 1);
}

namespace {

// Per metre, such that exp(-absorption distance) is the colour; infinity where nothing is left.
Vec3f absorption_of(Vec3f color, float distance)
{
  Vec3f absorption{0, 0, 0};
  for (int c = 0; c < 3; ++c) {
    const float left = at(color, c);
    if (left == 0) set(absorption, c, infinity);
    else if (left < 1) set(absorption, c, float(-natural_logarithm(left) / double(distance)));
  }
  return absorption;
}

// Whether any texel is not opaque.
bool has_alpha(const TextureData &texture)
{
  const std::byte *texels = texture.texels->data();
  const uint64_t n = uint64_t(texture.width) * texture.height;
  if (texture.format != TexelFormat::Rgba32f)
    return find_first(n, [&](uint64_t i) { return texels[4 * i + 3] != std::byte{255}; }) != n;
  return find_first(n, [&](uint64_t i) {
           float alpha;
           std::memcpy(&alpha, texels + 16 * i + 12, sizeof alpha);
           return alpha != 1.0f;
         }) != n;
}

}  // namespace

uint32_t add_material(SceneData &scene, const MaterialSettings &settings)
{
  check_room(scene.materials.size(), "materials");
  if (uint32_t(settings.type) > uint32_t(MaterialType::Metal)) {
    fail_invalid("there is no material type {}", uint32_t(settings.type));
  }
  for (int c = 0; c < 3; ++c) {
    const float x = at(settings.base_color, c);
    if (!(x >= 0 && x <= 1))
      fail_invalid("the base colour's {} is {}; it must be in [0, 1]", channel_names[c], x);
  }
  check_share(settings.alpha, "alpha");
  if (!(settings.alpha_cutoff >= 0) || !is_finite(settings.alpha_cutoff)) {
    fail_invalid("alpha_cutoff is {}; it must be finite and not negative", settings.alpha_cutoff);
  }
  if (settings.blends && settings.alpha_cutoff > 0) {
    fail_invalid("the material blends, and alpha_cutoff is {}; set it to 0, or blends to 0",
                 settings.alpha_cutoff);
  }
  check_radiance(settings.emission, "emission");
  Material m = default_material();
  m.type = settings.type;
  m.base_color = settings.base_color;
  m.alpha = settings.alpha;
  m.alpha_cutoff = settings.alpha_cutoff;
  m.emission = settings.emission;
  m.base_color_texture = settings.base_color_texture;
  m.two_sided_emission = settings.two_sided_emission ? 1 : 0;
  if (settings.type == MaterialType::Metal) {
    if (!(settings.roughness >= min_roughness && settings.roughness <= 1)) {
      fail_invalid("the metal's roughness is {}; it must be in [{}, 1]; use a mirror for smoother surfaces",
                   settings.roughness, min_roughness);
    }
    m.alpha_ggx = settings.roughness * settings.roughness;
  }
  if (settings.type == MaterialType::Glass && settings.ior != 0) {
    if (!(settings.ior > 0) || !is_finite(settings.ior)) {
      fail_invalid("the glass's index of refraction is {}; it must be positive and finite, or 0 for 1.5",
                   settings.ior);
    }
    m.ior = settings.ior;
  }
  if (settings.base_color_texture != invalid_id) {
    if (settings.base_color_texture >= scene.textures.size()) {
      fail_invalid("the base colour names a texture that does not exist; the scene has {}",
                   scene.textures.size());
    }
    check_texels(
        scene.textures[settings.base_color_texture], [](float x, int) { return !(x >= 0 && x <= 1); },
        "a base colour must be in [0, 1]");
  }
  if (settings.emission_texture != invalid_id) {
    if (settings.emission_texture >= scene.textures.size()) {
      fail_invalid("the emission names a texture that does not exist; the scene has {}",
                   scene.textures.size());
    }
    check_texels(
        scene.textures[settings.emission_texture],
        [&](float x, int channel) {
          return channel < 3 && (x < 0 || !is_finite(x * at(settings.emission, channel)));
        },
        "radiance, which it multiplies, must not be negative and must stay finite");
    if (max_component(m.emission) > 0) m.emission_texture = settings.emission_texture;
  }
  for (int c = 0; c < 3; ++c) {
    const float x = at(settings.attenuation_color, c);
    if (!(x >= 0 && x <= 1))
      fail_invalid("attenuation_color's {} is {}; it must be in [0, 1]", channel_names[c], x);
  }
  if (!(settings.attenuation_distance >= 0) || !is_finite(settings.attenuation_distance)) {
    fail_invalid(
        "attenuation_distance is {}; it must be a finite number of metres, or 0 for glass that does not "
        "absorb",
        settings.attenuation_distance);
  }
  if (settings.type == MaterialType::Glass && settings.attenuation_distance > 0)
    m.absorption = absorption_of(settings.attenuation_color, settings.attenuation_distance);
  // What lets nothing through is opaque, and costs no more.
  if (settings.blends) {
    m.blends = m.alpha < 1 ||
               (m.base_color_texture != invalid_id && has_alpha(scene.textures[m.base_color_texture]));
  }
  scene.materials.push_back(m);
  return uint32_t(scene.materials.size() - 1);
}

SharedArray<UInt3> sequential_triangles(uint64_t num_vertices)
{
  if (num_vertices % 3 != 0) {
    fail_invalid(
        "{} vertices without indices are no whole number of triangles; give a multiple of 3, or indices",
        num_vertices);
  }
  if (num_vertices >= invalid_id)
    fail_invalid("{} vertices are too many; a mesh has room for 2^32 - 2", num_vertices);
  std::vector<UInt3> corners(num_vertices / 3);
  parallel_for_each(corners.size(), [&](uint64_t i) {
    const uint32_t k = uint32_t(3 * i);
    corners[i] = {k, k + 1, k + 2};
  });
  return SharedArray<UInt3>(std::move(corners));
}

uint32_t add_mesh(SceneData &scene, MeshData mesh, uint32_t material)
{
  check_room(scene.geometries.size(), "geometries");
  check_material(scene, material);
  const uint64_t num_vertices = mesh.vertices.size();
  if (num_vertices >= invalid_id)
    fail_invalid("{} vertices are too many; a mesh has room for 2^32 - 2", num_vertices);
  if (mesh.indices.size() >= invalid_id) {
    fail_invalid("{} triangles are too many; a mesh has room for 2^32 - 2", mesh.indices.size());
  }
  if (!mesh.normals.empty() && mesh.normals.size() != num_vertices) {
    fail_invalid("there are {} normals for {} vertices; give one each, or none", mesh.normals.size(),
                 num_vertices);
  }
  if (!mesh.uvs.empty() && mesh.uvs.size() != num_vertices) {
    fail_invalid("there are {} texture coordinates for {} vertices; give one each, or none", mesh.uvs.size(),
                 num_vertices);
  }
  check_finite_array(mesh.vertices, "vertex", is_finite_vec3);
  check_finite_array(mesh.normals, "normal", is_finite_vec3);
  check_finite_array(mesh.uvs, "texture coordinate", is_finite_vec2);
  const uint64_t bad = find_first(mesh.indices.size(), [&](uint64_t i) {
    const UInt3 c = mesh.indices[i];
    return c.x >= num_vertices || c.y >= num_vertices || c.z >= num_vertices;
  });
  if (bad != mesh.indices.size()) {
    const UInt3 c = mesh.indices[bad];
    const uint32_t corners[3] = {c.x, c.y, c.z};
    const int k = c.x >= num_vertices ? 0 : (c.y >= num_vertices ? 1 : 2);
    fail_invalid("index {} (corner {} of triangle {}) is {}, but there are {} vertices",
                 3 * bad + uint64_t(k), k, bad, corners[k], num_vertices);
  }
  GeometryData geometry;
  geometry.kind = GeometryKind::Mesh;
  geometry.material = material;
  geometry.mesh = std::move(mesh);
  scene.geometries.push_back(std::move(geometry));
  return uint32_t(scene.geometries.size() - 1);
}

void set_vertices(SceneData &scene, uint64_t geometry, SharedArray<Vec3f> vertices,
                  SharedArray<Vec3f> normals)
{
  if (geometry >= scene.geometries.size()) {
    fail_invalid("geometry is {}, but the scene has {} geometries, which count from 0", geometry,
                 scene.geometries.size());
  }
  GeometryData &g = scene.geometries[geometry];
  if (g.kind != GeometryKind::Mesh)
    fail_invalid("geometry {} is no mesh; only meshes have vertices to set", geometry);
  if (vertices.size() != g.mesh.vertices.size()) {
    fail_invalid("there are {} vertices for a mesh of {}; give as many, or add another mesh", vertices.size(),
                 g.mesh.vertices.size());
  }
  if (normals.size() != g.mesh.normals.size()) {
    fail_invalid("there are {} normals for a mesh with {}; give as many", normals.size(),
                 g.mesh.normals.size());
  }
  check_finite_array(vertices, "vertex", is_finite_vec3);
  check_finite_array(normals, "normal", is_finite_vec3);
  g.mesh.vertices = std::move(vertices);
  g.mesh.normals = std::move(normals);
}

uint32_t add_patches(SceneData &scene, PatchData patches, uint32_t material)
{
  check_room(scene.geometries.size(), "geometries");
  check_material(scene, material);
  const uint64_t count = patches.control_points.size();
  if (count % 16 != 0) {
    fail_invalid("{} control points are no whole number of patches; a bicubic patch takes 16", count);
  }
  check_finite_array(patches.control_points, "control point", is_finite_vec3);
  GeometryData geometry;
  geometry.kind = GeometryKind::Patches;
  geometry.material = material;
  geometry.patches = std::move(patches);
  scene.geometries.push_back(std::move(geometry));
  return uint32_t(scene.geometries.size() - 1);
}

uint32_t add_instance(SceneData &scene, uint32_t geometry, const AffineDouble &object_to_world)
{
  check_room(scene.instances.size(), "instances");
  if (geometry >= scene.geometries.size()) {
    fail_invalid("there is no geometry {}; the scene has {}", geometry, scene.geometries.size());
  }
  for (int i = 0; i < 12; ++i) {
    if (!std::isfinite(object_to_world[i]) || !is_finite(float(object_to_world[i]))) {
      fail_invalid("row {}, column {} of the transform is {}; it must be finite as a 32-bit float", i / 4,
                   i % 4, object_to_world[i]);
    }
  }
  const double d = determinant(object_to_world);
  if (d == 0 || !std::isfinite(d)) {
    fail_invalid("the transform cannot be inverted (determinant {}); it must not flatten space", d);
  }
  const Transform rounded = to_float(object_to_world), inverted = to_float(inverse(object_to_world));
  for (const auto &row : inverted.m) {
    for (float x : row) {
      if (!is_finite(x))
        fail_invalid("the inverse of the transform exceeds 32-bit floats; make its scale larger");
    }
  }
  if (determinant(to_double(rounded)) == 0) {
    fail_invalid(
        "the transform cannot be inverted once it is rounded to 32-bit floats; make its scale larger");
  }
  scene.instances.push_back({geometry, rounded, object_to_world});
  return uint32_t(scene.instances.size() - 1);
}

uint32_t add_instance(SceneData &scene, uint32_t geometry, const Transform &object_to_world)
{
  return add_instance(scene, geometry, to_double(object_to_world));
}

uint32_t add_light(SceneData &scene, PointLightData light)
{
  check_room(scene.lights.size(), "lights");
  if (light.type != LightType::Point && light.type != LightType::Spot && light.type != LightType::Distant) {
    fail_invalid("light type {} has no light of its own; lamps are materials that emit",
                 uint32_t(light.type));
  }
  check_radiance(light.color, "the light's intensity");
  if (light.type == LightType::Distant) light.position = {0, 0, 0};
  else check_finite(light.position, "the light's position");
  if (light.type == LightType::Point) {
    light.direction = {0, 0, -1};
  } else {
    check_finite(light.direction, "the light's direction");
    if (is_zero(to_double(light.direction)))
      fail_invalid("the light's direction is zero; say where it shines");
    light.direction = to_float(normalize(to_double(light.direction)));
  }
  if (light.type == LightType::Spot) {
    constexpr float quarter = pi / 4, limit = pi / 2;
    if (light.outer_cone_angle_rad == 0) light.outer_cone_angle_rad = quarter;
    const float inner = light.inner_cone_angle_rad, outer = light.outer_cone_angle_rad;
    if (!(inner >= 0 && inner < outer && outer <= limit)) {
      fail_invalid(
          "the spot's cone angles are {} (inner) and {} (outer); 0 <= inner < outer <= pi/2 must hold", inner,
          outer);
    }
  } else {
    light.inner_cone_angle_rad = light.outer_cone_angle_rad = 0;
  }
  scene.lights.push_back(light);
  return uint32_t(scene.lights.size() - 1);
}

uint32_t add_camera(SceneData &scene, const AffineDouble &camera_to_world, float yfov_rad, uint32_t width,
                    uint32_t height)
{
  check_room(scene.cameras.size(), "cameras");
  if (!is_finite(camera_to_world)) fail_invalid("the camera's transform is not finite");
  if (determinant(camera_to_world) == 0) {
    fail_invalid("the camera's transform flattens space; its axes must be independent");
  }
  if (yfov_rad == 0) yfov_rad = pi / 4;
  if (!(yfov_rad > 0 && yfov_rad < pi))
    fail_invalid("the camera's yfov is {} rad; it must be in (0, pi)", yfov_rad);
  // The viewing direction is kept, then the plane that holds it and "up"; the rest is scale and shear.
  const Vec3d z = normalize(column(camera_to_world, 2));
  const Vec3d up = column(camera_to_world, 1);
  const double up_scale = 1 / max_component_abs(up);
  const Vec3d y = normalize(up * up_scale - z * dot(z, up * up_scale));
  const Vec3d x = cross(y, z) * (determinant(camera_to_world) < 0 ? -1 : 1);
  const AffineDouble rigid{x.x, y.x, z.x, camera_to_world[3], x.y, y.y, z.y, camera_to_world[7],
                           x.z, y.z, z.z, camera_to_world[11]};
  const CameraData camera{to_float(rigid), yfov_rad, width, height};
  for (int i = 0; i < 3; ++i) {
    if (!is_finite(camera.transform.m[i][3])) fail_invalid("the camera's position exceeds 32-bit floats");
  }
  scene.cameras.push_back(camera);
  return uint32_t(scene.cameras.size() - 1);
}

void set_environment(SceneData &scene, const EnvironmentData &environment)
{
  check_radiance(environment.radiance, "the environment's radiance");
  if (environment.texture != invalid_id) {
    if (environment.texture >= scene.textures.size()) {
      fail_invalid("the environment names a texture that does not exist; the scene has {}",
                   scene.textures.size());
    }
    check_texels(
        scene.textures[environment.texture], [](float x, int channel) { return channel < 3 && x < 0; },
        "radiance must not be negative");
  }
  scene.environment = environment;
}

}  // namespace gpurt
