// gpurt_scene_add_* and gpurt_scene_set_*: from the public structs to lib/scene, which knows the rules.
#include <algorithm>

#include "api/array.h"
#include "api/descriptor.h"
#include "api/guard.h"
#include "scene/validate.h"

namespace gpurt::api {
namespace {

Vec3f vec3_from(const float (&v)[3]) { return {v[0], v[1], v[2]}; }

Transform transform_from(const float (&m)[12])
{
  return {{{m[0], m[1], m[2], m[3]}, {m[4], m[5], m[6], m[7]}, {m[8], m[9], m[10], m[11]}}};
}

AffineDouble affine_from(const float (&m)[12])
{
  AffineDouble affine;
  std::copy(m, m + 12, affine.begin());
  return affine;
}

// Public texture ids count from 1.
uint32_t texture_index(const SceneData &scene, uint32_t id, const char *field)
{
  if (id == 0) return invalid_id;
  if (id > scene.textures.size()) {
    fail_invalid("{} is {}, but the scene has {} textures, which count from 1", field, id,
                 scene.textures.size());
  }
  return id - 1;
}

// Material ids count from 1, and 0 is the default, which lib/scene keeps at index 0.
void check_material(const SceneData &scene, uint32_t id)
{
  if (id >= scene.materials.size()) {
    fail_invalid("material is {}, but the scene has {} materials, which count from 1", id,
                 scene.materials.size() - 1);
  }
}

// A change of the scene: nobody else changes or reads the description meanwhile.
class Change {
 public:
  explicit Change(Scene &scene) : changing_(scene.changing), data_(scene.data_mutex) {}

 private:
  const std::scoped_lock<std::mutex> changing_;
  const std::unique_lock<std::shared_mutex> data_;
};

void drop_imported_trees(Scene &scene)
{
  if (scene.imported_trees.empty()) return;
  scene.imported_trees.clear();
  (*scene.device->log)(GPURT_LOG_INFO,
                       "imported kd-trees are dropped: the geometry of the scene has changed");
}

// Which triangles a tree holds, and in which order, follows from geometries and instances.
void change_shape(Scene &scene)
{
  ++scene.shape_version;
  drop_imported_trees(scene);
}

TextureData read_texture(const gpurt_texture_desc &d, const Device &device)
{
  check_enum(d.format, GPURT_TEXTURE_RGBA32F + 1, "format", "gpurt_texture_format");
  check_enum(d.wrap_u, GPURT_WRAP_MIRROR + 1, "wrap_u", "gpurt_wrap");
  check_enum(d.wrap_v, GPURT_WRAP_MIRROR + 1, "wrap_v", "gpurt_wrap");
  check_enum(d.filter, GPURT_FILTER_NEAREST + 1, "filter", "gpurt_filter");
  check_reserved(d.reserved, "reserved");
  require(d.texels, "texels");
  constexpr uint32_t max_size =
      65536;  // so that the size in bytes cannot overflow; lib/scene has the true rule
  if (d.width == 0 || d.height == 0 || d.width > max_size || d.height > max_size) {
    fail_invalid("the texture is {} x {} texels; width and height must be 1 to {}", d.width, d.height,
                 max_size);
  }
  TextureData texture;
  texture.width = d.width;
  texture.height = d.height;
  texture.format = TexelFormat(d.format);
  texture.wrap_u = Wrap(d.wrap_u);
  texture.wrap_v = Wrap(d.wrap_v);
  texture.nearest = d.filter == GPURT_FILTER_NEAREST;
  const uint64_t bytes = uint64_t(d.width) * d.height * (d.format == GPURT_TEXTURE_RGBA32F ? 16 : 4);
  auto texels = make_counted_array<std::byte>(device, bytes, "the texture");
  std::memcpy(texels->values.data(), d.texels, bytes);
  texture.texels = {texels, &texels->values};
  return texture;
}

MaterialSettings read_material(const gpurt_material_desc &d, const SceneData &scene)
{
  check_enum(d.type, GPURT_MATERIAL_METAL + 1, "type", "gpurt_material_type");
  if (d.two_sided_emission > 1)
    fail_invalid("two_sided_emission is {}; it must be 0 or 1", d.two_sided_emission);
  if (d.blends > 1) fail_invalid("blends is {}; it must be 0 or 1", d.blends);
  MaterialSettings settings;
  settings.type = MaterialType(d.type);
  settings.base_color = vec3_from(d.base_color);
  settings.roughness = d.roughness;
  settings.ior = d.ior;
  settings.alpha = d.alpha;
  settings.alpha_cutoff = d.alpha_cutoff;
  settings.blends = d.blends != 0;
  settings.emission = vec3_from(d.emission);
  settings.base_color_texture = texture_index(scene, d.base_color_texture, "base_color_texture");
  settings.two_sided_emission = d.two_sided_emission != 0;
  settings.emission_texture = texture_index(scene, d.emission_texture, "emission_texture");
  settings.attenuation_color = vec3_from(d.attenuation_color);
  settings.attenuation_distance = d.attenuation_distance;
  return settings;
}

LightType light_type(gpurt_light_type type)
{
  switch (type) {
    case GPURT_LIGHT_SPOT:
      return LightType::Spot;
    case GPURT_LIGHT_DISTANT:
      return LightType::Distant;
    default:
      return LightType::Point;
  }
}

void check_camera_support(const gpurt_camera_desc &d)
{
  check_enum(d.type, GPURT_CAMERA_ORTHOGRAPHIC + 1, "type", "gpurt_camera_type");
  if (d.type == GPURT_CAMERA_ORTHOGRAPHIC) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "orthographic cameras are not supported by this version; use GPURT_CAMERA_PERSPECTIVE with a small "
         "yfov_rad "
         "from far away");
  }
  // NaN counts as set.
  if (!(d.lens_radius == 0) || !(d.focus_distance == 0)) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "lenses are not supported by this version; leave lens_radius and focus_distance 0 for a pinhole");
  }
  if (!(d.shutter_open == 0) || !(d.shutter_close == 0)) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "motion blur is not supported by this version; leave shutter_open and shutter_close 0");
  }
}

}  // namespace
}  // namespace gpurt::api

using namespace gpurt;
using namespace gpurt::api;

gpurt_result gpurt_scene_add_texture(gpurt_scene scene, const gpurt_texture_desc *desc, uint32_t *out_texture)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    const gpurt_texture_desc d = read_descriptor(desc);
    require(out_texture, "out_texture");
    TextureData texture = read_texture(d, *s->device);
    const Change change(*s);
    *out_texture = add_texture(s->data, std::move(texture)) + 1;
  });
}

gpurt_result gpurt_scene_add_material(gpurt_scene scene, const gpurt_material_desc *desc,
                                      uint32_t *out_material)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    const gpurt_material_desc d = read_descriptor(desc);
    require(out_material, "out_material");
    const Change change(*s);
    *out_material = add_material(s->data, read_material(d, s->data));
  });
}

gpurt_result gpurt_scene_add_mesh(gpurt_scene scene, const gpurt_mesh_desc *desc, uint32_t *out_geometry)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    const gpurt_mesh_desc d = read_descriptor(desc);
    require(out_geometry, "out_geometry");
    const Device &device = *s->device;
    const Change change(*s);
    check_material(s->data, d.material);
    bool is_shared = false;
    MeshData mesh;
    mesh.vertices = read_array<Vec3f>(d.vertices, "vertices", device, &is_shared);
    mesh.indices = is_given(d.indices) ? read_array<UInt3>(d.indices, "indices", device, &is_shared)
                                       : sequential_triangles(mesh.vertices.size());
    mesh.normals = read_array<Vec3f>(d.normals, "normals", device, &is_shared);
    mesh.uvs = read_array<Vec2f>(d.uvs, "uvs", device, &is_shared);
    s->shared_geometries.reserve(s->shared_geometries.size() + 1);
    const uint32_t geometry = add_mesh(s->data, std::move(mesh), d.material);
    if (is_shared) s->shared_geometries.push_back(geometry);
    change_shape(*s);
    *out_geometry = geometry;
  });
}

gpurt_result gpurt_scene_set_vertices(gpurt_scene scene, uint32_t geometry, const gpurt_array *vertices,
                                      const gpurt_array *normals)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    require(vertices, "vertices");
    const Change change(*s);
    bool is_shared = false;
    SharedArray<Vec3f> new_vertices = read_array<Vec3f>(*vertices, "vertices", *s->device, &is_shared);
    SharedArray<Vec3f> new_normals;
    if (normals) new_normals = read_array<Vec3f>(*normals, "normals", *s->device, &is_shared);
    auto &shared = s->shared_geometries;
    const bool was_shared = std::find(shared.begin(), shared.end(), geometry) != shared.end();
    shared.reserve(shared.size() + 1);
    set_vertices(s->data, geometry, std::move(new_vertices), std::move(new_normals));
    // Indices and texture coordinates may still be the caller's.
    if (is_shared && !was_shared) shared.push_back(geometry);
    drop_imported_trees(*s);
  });
}

gpurt_result gpurt_scene_add_patches(gpurt_scene scene, const gpurt_patches_desc *desc,
                                     uint32_t *out_geometry)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    const gpurt_patches_desc d = read_descriptor(desc);
    require(out_geometry, "out_geometry");
    const Change change(*s);
    check_material(s->data, d.material);
    bool is_shared = false;
    PatchData patches;
    patches.control_points = read_array<Vec3f>(d.control_points, "control_points", *s->device, &is_shared);
    s->shared_geometries.reserve(s->shared_geometries.size() + 1);
    const uint32_t geometry = add_patches(s->data, std::move(patches), d.material);
    if (is_shared) s->shared_geometries.push_back(geometry);
    change_shape(*s);
    *out_geometry = geometry;
  });
}

gpurt_result gpurt_scene_add_subdivision(gpurt_scene scene, const gpurt_subdivision_desc *desc,
                                         uint32_t *out_geometry)
{
  return guard([&] {
    get(scene, "scene");
    const gpurt_subdivision_desc d = read_descriptor(desc);
    require(out_geometry, "out_geometry");
    check_enum(d.scheme, GPURT_SUBDIVISION_LOOP + 1, "scheme", "gpurt_subdivision_scheme");
    check_reserved(d.reserved, "reserved");
    fail(GPURT_ERROR_UNSUPPORTED,
         "subdivision surfaces are not supported by this version; refine the mesh and add it with "
         "gpurt_scene_add_mesh, "
         "or convert it to Bezier patches for gpurt_scene_add_patches");
  });
}

gpurt_result gpurt_scene_add_instance(gpurt_scene scene, const gpurt_instance_desc *desc,
                                      uint32_t *out_instance)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    const gpurt_instance_desc d = read_descriptor(desc);
    require(out_instance, "out_instance");
    const Change change(*s);
    if (d.geometry >= s->data.geometries.size()) {
      fail_invalid("geometry is {}, but the scene has {} geometries, which count from 0", d.geometry,
                   s->data.geometries.size());
    }
    const uint32_t instance = add_instance(s->data, d.geometry, transform_from(d.transform));
    change_shape(*s);
    *out_instance = instance;
  });
}

gpurt_result gpurt_scene_add_light(gpurt_scene scene, const gpurt_light_desc *desc, uint32_t *out_light)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    const gpurt_light_desc d = read_descriptor(desc);
    require(out_light, "out_light");
    check_enum(d.type, GPURT_LIGHT_DISTANT + 1, "type", "gpurt_light_type");
    const PointLightData light{light_type(d.type),     vec3_from(d.intensity), vec3_from(d.position),
                               vec3_from(d.direction), d.inner_cone_angle_rad, d.outer_cone_angle_rad};
    const Change change(*s);
    *out_light = add_light(s->data, light);
  });
}

gpurt_result gpurt_scene_set_environment(gpurt_scene scene, const gpurt_environment_desc *desc)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    const gpurt_environment_desc d = read_descriptor(desc);
    const Change change(*s);
    set_environment(s->data, {vec3_from(d.radiance), texture_index(s->data, d.texture, "texture")});
  });
}

gpurt_result gpurt_scene_add_camera(gpurt_scene scene, const gpurt_camera_desc *desc, uint32_t *out_camera)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    const gpurt_camera_desc d = read_descriptor(desc);
    require(out_camera, "out_camera");
    check_camera_support(d);
    const Change change(*s);
    *out_camera = add_camera(s->data, affine_from(d.transform), d.yfov_rad, d.width, d.height);
  });
}

gpurt_result gpurt_scene_get_camera(gpurt_scene scene, uint32_t camera, gpurt_camera_desc *out_desc)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    check_output(out_desc, "out_desc");
    const std::shared_lock lock(s->data_mutex);
    if (camera >= s->data.cameras.size()) {
      fail_invalid("camera is {}, but the scene has {} cameras, which count from 0", camera,
                   s->data.cameras.size());
    }
    const CameraData &from = s->data.cameras[camera];
    gpurt_camera_desc d = GPURT_CAMERA_DESC_INIT;
    for (int i = 0; i < 12; ++i) d.transform[i] = from.transform.m[i / 4][i % 4];
    d.yfov_rad = from.yfov_rad;
    d.width = from.width;
    d.height = from.height;
    write_output(out_desc, d, "out_desc");
  });
}
