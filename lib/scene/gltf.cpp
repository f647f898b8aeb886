#include "scene/gltf.h"

#include <cmath>
#include <new>
#include <set>

#include "scene/gltf_document.h"
#include "scene/gltf_environment.h"
#include "scene/gltf_images.h"
#include "scene/gltf_materials.h"
#include "scene/gltf_meshes.h"
#include "scene/gltf_nodes.h"
#include "scene/trigonometry.h"
#include "scene/validate.h"

namespace gpurt {
namespace {

Vec3d axis(const AffineDouble &t, int j) { return {t[j], t[4 + j], t[8 + j]}; }

class Loader {
 public:
  Loader(const std::string &path, const std::function<void(const std::string &)> &warn)
      : document_(path, warn),
        images_(document_, scene_),
        materials_(document_, images_, scene_),
        meshes_(document_, materials_, scene_)
  {}

  SceneData run()
  {
    const tinygltf::Model &model = document_.model();
    const std::vector<GltfPlacedNode> placed = place_gltf_nodes(document_);
    std::set<int> used;
    for (const GltfPlacedNode &p : placed) {
      if (model.nodes[size_t(p.node)].mesh >= 0) used.insert(model.nodes[size_t(p.node)].mesh);
    }
    for (int mesh : used) meshes_.load(mesh);
    meshes_.report_losses();
    for (const GltfPlacedNode &p : placed) {
      const tinygltf::Node &node = model.nodes[size_t(p.node)];
      const std::string label = gltf_label("node", size_t(p.node), node.name);
      if (node.mesh >= 0) add_mesh_node(node.mesh, p.to_world, label);
      if (node.camera >= 0) add_camera_node(node.camera, p.to_world, label);
      if (const tinygltf::Value *light = gltf_extension(node.extensions, "KHR_lights_punctual")) {
        add_light_node(int(gltf_number(*light, "light", 0)), p.to_world, label);
      }
    }
    const int scene = default_gltf_scene(document_);
    if (scene >= 0) load_gltf_environment(document_, model.scenes[size_t(scene)].extras, scene_);
    return std::move(scene_);
  }

 private:
  void add_mesh_node(int mesh, const AffineDouble &to_world, const std::string &label)
  {
    if (meshes_.geometries(mesh).empty()) return;
    if (determinant(to_world) == 0) {
      document_.warn("{}: its transform flattens mesh {}, which is left out", label, mesh);
      return;
    }
    for (uint32_t geometry : meshes_.geometries(mesh)) {
      document_.checked(label, [&] { return add_instance(scene_, geometry, to_world); });
    }
  }

  void add_camera_node(int index, const AffineDouble &to_world, const std::string &label)
  {
    const tinygltf::Camera &camera = document_.model().cameras[size_t(index)];
    if (camera.type != "perspective") {
      document_.warn("{}: camera {} is orthographic, which this version does not render: left out", label,
                     index);
      return;
    }
    const auto size = [&](const char *key) { return uint32_t(gltf_number(camera.extras, key, 0)); };
    // A field of view of 0 would mean the default to add_camera.
    if (!(camera.perspective.yfov > 0))
      document_.fail("camera {}: its yfov is {}; it must be positive", index, camera.perspective.yfov);
    document_.checked(label, [&] {
      return add_camera(scene_, to_world, float(camera.perspective.yfov), size("width"), size("height"));
    });
  }

  void add_light_node(int index, const AffineDouble &to_world, const std::string &label)
  {
    const tinygltf::Light &light = document_.model().lights[size_t(index)];
    const std::string what = label + ", " + gltf_label("light", size_t(index), light.name);
    PointLightData data{};
    data.type = light.type == "point"  ? LightType::Point
                : light.type == "spot" ? LightType::Spot
                                       : LightType::Distant;
    const double default_color[3] = {1, 1, 1};
    const double *color = light.color.size() == 3 ? light.color.data() : default_color;
    data.color = {float(color[0] * light.intensity), float(color[1] * light.intensity),
                  float(color[2] * light.intensity)};
    data.position = to_float(Vec3d{to_world[3], to_world[7], to_world[11]});
    // Lights shine along their node's -Z.
    const Vec3d backward = axis(to_world, 2);
    if (data.type != LightType::Point && is_zero(backward))
      document_.fail("{}: its transform leaves it no direction", what);
    if (!is_zero(backward)) data.direction = to_float(normalize(backward) * -1);
    if (data.type == LightType::Spot) {
      data.inner_cone_angle_rad = float(light.spot.innerConeAngle);
      data.outer_cone_angle_rad = float(light.spot.outerConeAngle);
      // An angle of 0 would mean the default to add_light.
      if (!(data.outer_cone_angle_rad > 0))
        document_.fail("{}: its outer cone angle is {}; it must be positive", what,
                       light.spot.outerConeAngle);
    }
    if (light.range > 0) document_.warn("{}: its range is left out: it shines as far as light does", what);
    document_.checked(what, [&] { return add_light(scene_, data); });
  }

  GltfDocument document_;
  SceneData scene_;
  GltfImages images_;
  GltfMaterials materials_;
  GltfMeshes meshes_;
};

}  // namespace

SceneData load_gltf(const std::string &path, const std::function<void(const std::string &)> &warn)
{
  try {
    return Loader(path, warn).run();
  } catch (const std::bad_alloc &) {
    fail(GPURT_ERROR_OUT_OF_MEMORY, "{}: no memory for the scene", path);
  }
}

}  // namespace gpurt
