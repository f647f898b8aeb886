#include <pybind11/stl.h>

#include <array>
#include <memory>
#include <optional>
#include <string>

#include "arrays.h"
#include "objects.h"

namespace gpurt_python {

namespace {

using Vec3 = std::array<float, 3>;
using Transform = std::array<float, 12>;

std::unique_ptr<Scene> create(const Device &device)
{
  auto scene = std::make_unique<Scene>();
  call([&] { return gpurt_scene_create(device.handle.get(), scene->handle.out()); });
  return scene;
}

std::unique_ptr<Scene> load(const Device &device, const py::bytes &path)
{
  auto scene = std::make_unique<Scene>();
  const std::string path_text = to_path(path);
  call([&] { return gpurt_scene_load(device.handle.get(), path_text.c_str(), scene->handle.out()); });
  return scene;
}

uint32_t add_texture(Scene &scene, int format, uint32_t width, uint32_t height, int wrap_u, int wrap_v,
                     int filter, const py::array &texels)
{
  gpurt_texture_desc desc = GPURT_TEXTURE_DESC_INIT;
  desc.format = static_cast<gpurt_texture_format>(format);
  desc.width = width;
  desc.height = height;
  desc.wrap_u = static_cast<gpurt_wrap>(wrap_u);
  desc.wrap_v = static_cast<gpurt_wrap>(wrap_v);
  desc.filter = static_cast<gpurt_filter>(filter);
  const uint64_t texel_bytes = desc.format == GPURT_TEXTURE_RGBA32F ? 16 : 4;
  desc.texels = packed_data(texels, uint64_t{width} * height * texel_bytes, "texels");
  uint32_t texture = 0;
  call([&] { return gpurt_scene_add_texture(scene.handle.get(), &desc, &texture); });
  return texture;
}

uint32_t add_material(Scene &scene, int type, const Vec3 &base_color, float roughness, float ior, float alpha,
                      float alpha_cutoff, const Vec3 &emission, uint32_t base_color_texture,
                      bool two_sided_emission, bool blends, uint32_t emission_texture,
                      const Vec3 &attenuation_color, float attenuation_distance)
{
  gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
  desc.type = static_cast<gpurt_material_type>(type);
  copy_floats(base_color, desc.base_color);
  desc.roughness = roughness;
  desc.ior = ior;
  desc.alpha = alpha;
  desc.alpha_cutoff = alpha_cutoff;
  copy_floats(emission, desc.emission);
  desc.base_color_texture = base_color_texture;
  desc.two_sided_emission = two_sided_emission;
  desc.blends = blends;
  desc.emission_texture = emission_texture;
  copy_floats(attenuation_color, desc.attenuation_color);
  desc.attenuation_distance = attenuation_distance;
  uint32_t material = 0;
  call([&] { return gpurt_scene_add_material(scene.handle.get(), &desc, &material); });
  return material;
}

uint32_t add_mesh(Scene &scene, const py::object &vertices, const py::object &indices,
                  const py::object &normals, const py::object &uvs, uint32_t material)
{
  gpurt_mesh_desc desc = GPURT_MESH_DESC_INIT;
  desc.material = material;
  desc.vertices = to_gpurt_array<float>(vertices, 3, "vertices");
  desc.indices = to_gpurt_array<uint32_t>(indices, 3, "indices");
  desc.normals = to_gpurt_array<float>(normals, 3, "normals");
  desc.uvs = to_gpurt_array<float>(uvs, 2, "uvs");
  uint32_t geometry = 0;
  call([&] { return gpurt_scene_add_mesh(scene.handle.get(), &desc, &geometry); });
  return geometry;
}

void set_vertices(Scene &scene, uint32_t geometry, const py::object &vertices, const py::object &normals)
{
  const gpurt_array new_vertices = to_gpurt_array<float>(vertices, 3, "vertices"),
                    new_normals = to_gpurt_array<float>(normals, 3, "normals");
  call([&] {
    return gpurt_scene_set_vertices(scene.handle.get(), geometry, &new_vertices,
                                    normals.is_none() ? nullptr : &new_normals);
  });
}

uint32_t add_patches(Scene &scene, const py::object &control_points, uint32_t material)
{
  gpurt_patches_desc desc = GPURT_PATCHES_DESC_INIT;
  desc.material = material;
  desc.control_points = to_gpurt_array<float>(control_points, 3, "control_points");
  uint32_t geometry = 0;
  call([&] { return gpurt_scene_add_patches(scene.handle.get(), &desc, &geometry); });
  return geometry;
}

uint32_t add_subdivision(Scene &scene, const py::object &vertices, const py::object &face_counts,
                         const py::object &indices, int scheme, uint32_t material)
{
  gpurt_subdivision_desc desc = GPURT_SUBDIVISION_DESC_INIT;
  desc.material = material;
  desc.scheme = static_cast<gpurt_subdivision_scheme>(scheme);
  desc.vertices = to_gpurt_array<float>(vertices, 3, "vertices");
  desc.face_counts = to_gpurt_array<uint32_t>(face_counts, 1, "face_counts");
  desc.indices = to_gpurt_array<uint32_t>(indices, 1, "indices");
  uint32_t geometry = 0;
  call([&] { return gpurt_scene_add_subdivision(scene.handle.get(), &desc, &geometry); });
  return geometry;
}

uint32_t add_instance(Scene &scene, uint32_t geometry, const Transform &transform)
{
  gpurt_instance_desc desc = GPURT_INSTANCE_DESC_INIT;
  desc.geometry = geometry;
  copy_floats(transform, desc.transform);
  uint32_t instance = 0;
  call([&] { return gpurt_scene_add_instance(scene.handle.get(), &desc, &instance); });
  return instance;
}

uint32_t add_light(Scene &scene, int type, const Vec3 &intensity, const Vec3 &position, const Vec3 &direction,
                   float inner_cone_angle, float outer_cone_angle)
{
  gpurt_light_desc desc = GPURT_LIGHT_DESC_INIT;
  desc.type = static_cast<gpurt_light_type>(type);
  copy_floats(intensity, desc.intensity);
  copy_floats(position, desc.position);
  copy_floats(direction, desc.direction);
  desc.inner_cone_angle_rad = inner_cone_angle;
  desc.outer_cone_angle_rad = outer_cone_angle;
  uint32_t light = 0;
  call([&] { return gpurt_scene_add_light(scene.handle.get(), &desc, &light); });
  return light;
}

void set_environment(Scene &scene, const Vec3 &radiance, uint32_t texture)
{
  gpurt_environment_desc desc = GPURT_ENVIRONMENT_DESC_INIT;
  desc.texture = texture;
  copy_floats(radiance, desc.radiance);
  call([&] { return gpurt_scene_set_environment(scene.handle.get(), &desc); });
}

uint32_t add_camera(Scene &scene, int type, const Transform &transform, float yfov, uint32_t width,
                    uint32_t height)
{
  gpurt_camera_desc desc = GPURT_CAMERA_DESC_INIT;
  desc.type = static_cast<gpurt_camera_type>(type);
  copy_floats(transform, desc.transform);
  desc.yfov_rad = yfov;
  desc.width = width;
  desc.height = height;
  uint32_t camera = 0;
  call([&] { return gpurt_scene_add_camera(scene.handle.get(), &desc, &camera); });
  return camera;
}

py::dict get_camera(const Scene &scene, uint32_t camera)
{
  using namespace py::literals;
  gpurt_camera_desc desc = GPURT_CAMERA_DESC_INIT;
  call([&] { return gpurt_scene_get_camera(scene.handle.get(), camera, &desc); });
  return py::dict("type"_a = static_cast<int>(desc.type), "transform"_a = to_tuple(desc.transform),
                  "yfov"_a = desc.yfov_rad, "width"_a = desc.width, "height"_a = desc.height);
}

void commit(Scene &scene, int accel, int triangle_test, uint32_t max_depth, float traversal_cost,
            float empty_bonus, float patch_tolerance, const std::optional<py::bytes> &tree_cache, int quality,
            float patch_pixels, uint32_t patch_camera, uint32_t patch_width, uint32_t patch_height)
{
  gpurt_build_desc desc = GPURT_BUILD_DESC_INIT;
  desc.accel = static_cast<gpurt_accel>(accel);
  desc.triangle_test = static_cast<gpurt_triangle_test>(triangle_test);
  desc.max_depth = max_depth;
  desc.traversal_cost = traversal_cost;
  desc.empty_bonus = empty_bonus;
  desc.patch_tolerance = patch_tolerance;
  desc.patch_pixels = patch_pixels;
  desc.patch_camera = patch_camera;
  desc.patch_width = patch_width;
  desc.patch_height = patch_height;
  desc.quality = static_cast<gpurt_build_quality>(quality);
  std::string path;
  if (tree_cache) {
    path = to_path(*tree_cache);
    desc.tree_cache_path = path.c_str();
  }
  call([&] { return gpurt_scene_commit(scene.handle.get(), &desc); });
}

py::dict get_facts(const Scene &scene)
{
  using namespace py::literals;
  gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
  call([&] { return gpurt_scene_get_facts(scene.handle.get(), &facts); });
  return py::dict(
      "num_geometries"_a = facts.num_geometries, "num_instances"_a = facts.num_instances,
      "num_materials"_a = facts.num_materials, "num_textures"_a = facts.num_textures,
      "num_cameras"_a = facts.num_cameras, "num_point_lights"_a = facts.num_point_lights,
      "num_distant_lights"_a = facts.num_distant_lights, "num_patches"_a = facts.num_patches,
      "num_triangles"_a = facts.num_triangles, "num_world_triangles"_a = facts.num_world_triangles,
      "num_emissive_triangles"_a = facts.num_emissive_triangles, "bounds_min"_a = to_tuple(facts.bounds_min),
      "bounds_max"_a = to_tuple(facts.bounds_max), "has_environment"_a = facts.has_environment != 0,
      "has_glass"_a = facts.has_glass != 0, "has_alpha_masks"_a = facts.has_alpha_masks != 0,
      "is_committed"_a = facts.is_committed != 0, "accel"_a = static_cast<int>(facts.accel),
      "triangle_test"_a = static_cast<int>(facts.triangle_test), "accel_bytes"_a = facts.accel_bytes,
      "scene_bytes"_a = facts.scene_bytes, "num_nodes"_a = facts.num_nodes,
      "num_references"_a = facts.num_references, "tree_depth"_a = facts.tree_depth,
      "tree_from_cache"_a = facts.tree_from_cache != 0, "build_seconds"_a = facts.build_seconds,
      "sah_cost"_a = facts.sah_cost, "accel_build_seconds"_a = facts.accel_build_seconds,
      "build_peak_bytes"_a = facts.build_peak_bytes, "tree_refitted"_a = facts.tree_refitted != 0,
      "has_blending"_a = facts.has_blending != 0, "patch_error"_a = facts.patch_error,
      "patch_error_pixels"_a = facts.patch_error_pixels);
}

// With nodes and references None it tells the sizes, else it fills the arrays.
py::dict export_tree(const Scene &scene, uint32_t tree, const py::object &nodes, const py::object &references)
{
  using namespace py::literals;
  gpurt_kdtree desc = GPURT_KDTREE_INIT;
  desc.tree = tree;
  if (!nodes.is_none() && !references.is_none()) {
    desc.num_nodes = static_cast<uint64_t>(py::len(nodes));
    desc.num_references = static_cast<uint64_t>(py::len(references));
    desc.nodes = static_cast<gpurt_kdtree_node *>(
        packed_output(nodes, desc.num_nodes * sizeof(gpurt_kdtree_node), "nodes"));
    desc.references = static_cast<uint32_t *>(
        packed_output(references, desc.num_references * sizeof(uint32_t), "references"));
  }
  call([&] { return gpurt_scene_export_tree(scene.handle.get(), &desc); });
  return py::dict("num_nodes"_a = desc.num_nodes, "num_references"_a = desc.num_references,
                  "num_triangles"_a = desc.num_triangles, "bounds_min"_a = to_tuple(desc.bounds_min),
                  "bounds_max"_a = to_tuple(desc.bounds_max));
}

void import_tree(Scene &scene, uint32_t tree, uint64_t num_triangles, const Vec3 &bounds_min,
                 const Vec3 &bounds_max, const py::object &nodes, const py::object &references)
{
  gpurt_kdtree desc = GPURT_KDTREE_INIT;
  desc.tree = tree;
  desc.num_triangles = num_triangles;
  copy_floats(bounds_min, desc.bounds_min);
  copy_floats(bounds_max, desc.bounds_max);
  desc.num_nodes = static_cast<uint64_t>(py::len(nodes));
  desc.num_references = static_cast<uint64_t>(py::len(references));
  // Read only, though the descriptor, which also serves the export, does not say so.
  desc.nodes = static_cast<gpurt_kdtree_node *>(
      const_cast<void *>(packed_data(nodes, desc.num_nodes * sizeof(gpurt_kdtree_node), "nodes")));
  desc.references = static_cast<uint32_t *>(
      const_cast<void *>(packed_data(references, desc.num_references * sizeof(uint32_t), "references")));
  call([&] { return gpurt_scene_import_tree(scene.handle.get(), &desc); });
}

}  // namespace

void bind_scene(py::module_ &module)
{
  py::class_<Scene> scene(module, "Scene");
  scene.def(py::init(&create), py::arg("device"))
      .def_static("load", load, py::arg("device"), py::arg("path"))
      .def("add_texture", add_texture, py::arg("format"), py::arg("width"), py::arg("height"),
           py::arg("wrap_u"), py::arg("wrap_v"), py::arg("filter"), py::arg("texels"))
      .def("add_material", add_material, py::arg("type"), py::arg("base_color"), py::arg("roughness"),
           py::arg("ior"), py::arg("alpha"), py::arg("alpha_cutoff"), py::arg("emission"),
           py::arg("base_color_texture"), py::arg("two_sided_emission"), py::arg("blends"),
           py::arg("emission_texture"), py::arg("attenuation_color"), py::arg("attenuation_distance"))
      .def("add_mesh", add_mesh, py::arg("vertices"), py::arg("indices"), py::arg("normals"), py::arg("uvs"),
           py::arg("material"))
      .def("set_vertices", set_vertices, py::arg("geometry"), py::arg("vertices"), py::arg("normals"))
      .def("add_patches", add_patches, py::arg("control_points"), py::arg("material"))
      .def("add_subdivision", add_subdivision, py::arg("vertices"), py::arg("face_counts"),
           py::arg("indices"), py::arg("scheme"), py::arg("material"))
      .def("add_instance", add_instance, py::arg("geometry"), py::arg("transform"))
      .def("add_light", add_light, py::arg("type"), py::arg("intensity"), py::arg("position"),
           py::arg("direction"), py::arg("inner_cone_angle"), py::arg("outer_cone_angle"))
      .def("set_environment", set_environment, py::arg("radiance"), py::arg("texture"))
      .def("add_camera", add_camera, py::arg("type"), py::arg("transform"), py::arg("yfov"), py::arg("width"),
           py::arg("height"))
      .def("camera", get_camera, py::arg("camera"))
      .def("commit", commit, py::arg("accel"), py::arg("triangle_test"), py::arg("max_depth"),
           py::arg("traversal_cost"), py::arg("empty_bonus"), py::arg("patch_tolerance"),
           py::arg("tree_cache"), py::arg("quality"), py::arg("patch_pixels"), py::arg("patch_camera"),
           py::arg("patch_width"), py::arg("patch_height"))
      .def("facts", get_facts)
      .def("export_tree", export_tree, py::arg("tree"), py::arg("nodes"), py::arg("references"))
      .def("import_tree", import_tree, py::arg("tree"), py::arg("num_triangles"), py::arg("bounds_min"),
           py::arg("bounds_max"), py::arg("nodes"), py::arg("references"));
  bind_trace(scene);
}

}  // namespace gpurt_python
