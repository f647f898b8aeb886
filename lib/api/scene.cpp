// gpurt_scene_*: create, load, commit, facts.

#include "api/array.h"
#include "api/descriptor.h"
#include "api/guard.h"
#include "planner/plan.h"
#include "scene/gltf.h"
#include "scene/validate.h"
#include "steady_seconds.h"

namespace gpurt::api {
namespace {

// What a file brought.
uint64_t description_bytes(const SceneData &data)
{
  uint64_t sum = 0;
  for (const TextureData &texture : data.textures) sum += texture.texels->size();
  for (const GeometryData &g : data.geometries) {
    sum += (g.mesh.vertices.size() + g.mesh.indices.size() + g.mesh.normals.size()) * sizeof(Vec3f) +
           g.mesh.uvs.size() * sizeof(Vec2f) + g.patches.control_points.size() * sizeof(Vec3f);
  }
  return sum;
}

// Of a commit, without the textures: it shares them with the description, which has reserved them.
uint64_t own_bytes(const CompiledScene &compiled)
{
  uint64_t shared = 0;
  for (const auto &texels : compiled.texture_data) shared += texels->size();
  return compiled.bytes() - shared;
}

// A lower bound of that, known before anything is allocated: what meshes in use take. Patches and lights come on top.
uint64_t own_bytes_at_least(const SceneData &data)
{
  std::vector<bool> is_used(data.geometries.size());
  for (const InstanceData &instance : data.instances) is_used[instance.geometry] = true;
  uint64_t sum = 0;
  for (size_t g = 0; g < data.geometries.size(); ++g) {
    if (!is_used[g]) continue;
    const MeshData &mesh = data.geometries[g].mesh;
    sum += (mesh.vertices.size() + mesh.normals.size()) * sizeof(Vec3f) + mesh.uvs.size() * sizeof(Vec2f) +
           mesh.indices.size() * (sizeof(UInt3) + sizeof(uint32_t));
  }
  return sum;
}

// Memory of the caller can change behind our back: what lies in it obeys the rules only as long as it is left alone.
void recheck_shared_geometries(const Scene &scene)
{
  for (const uint32_t id : scene.shared_geometries) {
    const GeometryData &g = scene.data.geometries[id];
    SceneData scratch;
    try {
      if (g.kind == GeometryKind::Mesh) add_mesh(scratch, g.mesh, 0);
      else add_patches(scratch, g.patches, 0);
    } catch (const Error &e) {
      fail_invalid("geometry {}: the contents of its buffers have changed and are no longer valid: {}", id,
                   e.what());
    }
  }
}

std::shared_ptr<const Commit> build_commit(const Scene &scene, const gpurt_build_desc &desc)
{
  const double start = steady_seconds();
  Device &device = *scene.device;
  BuildPlan plan = plan_build(desc, device.info(), !scene.imported_trees.empty());
  for (const std::string &warning : plan.warnings) (*device.log)(GPURT_LOG_WARNING, warning);
  recheck_shared_geometries(scene);

  const auto commit = std::make_shared<Commit>();
  commit->device = scene.device;
  commit->accel_reason = plan.reason;
  commit->reservation = Reservation(device.memory(), own_bytes_at_least(scene.data), "the committed scene");
  PatchLimits patch_limits = desc.patch_tolerance;
  patch_limits.pixels = desc.patch_pixels;
  patch_limits.camera = desc.patch_camera;
  patch_limits.width = desc.patch_width;
  patch_limits.height = desc.patch_height;
  auto compiled = std::make_shared<CompiledScene>(
      compile_scene(scene.data, patch_limits, [&](uint64_t bytes, uint64_t patch_triangles) {
        if (patch_triangles == 0) {
          commit->reservation.resize(bytes, "the committed scene");
          return;
        }
        const std::string what = fmt::format(
            "the committed scene with the {} triangles of its patches, of which a larger {} takes fewer",
            patch_triangles, desc.patch_pixels != 0 ? "patch_pixels" : "patch_tolerance");
        commit->reservation.resize(bytes, what.c_str());
      }));
  commit->reservation.resize(own_bytes(*compiled), "the committed scene");
  if (plan.options.accel == Accel::KdTree) {
    plan.options.imported.assign(scene.imported_trees.begin(), scene.imported_trees.end());
  }
  commit->compiled = std::move(compiled);
  commit->shape_version = scene.shape_version;
  commit->patch_limits = patch_limits;
  // The same triangles, in the same order.
  if (const auto last = scene.last_commit();
      last && last->shape_version == commit->shape_version && last->patch_limits == commit->patch_limits)
    plan.options.previous = last->committed;
  const double compiled_at = steady_seconds();
  commit->committed = device.backend->commit(commit->compiled, plan.options);
  // What the device chose by itself is news; what the plan says is in the statistics.
  if (const AccelFacts &facts = commit->committed->accel_facts(); !facts.reason.empty()) {
    commit->accel_reason = fmt::format("accel {}: {}", accel_name(facts.accel), facts.reason);
    (*device.log)(GPURT_LOG_INFO, commit->accel_reason);
  }
  commit->backend_seconds = steady_seconds() - compiled_at;
  commit->build_seconds = steady_seconds() - start;
  return commit;
}

uint64_t num_world_triangles(const CompiledScene &compiled)
{
  uint64_t sum = compiled.groups.empty() ? 0 : compiled.groups[0].num_triangles;
  for (const Placement &p : compiled.placements) sum += compiled.groups[p.group].num_triangles;
  return sum;
}

void describe(const SceneData &data, gpurt_scene_facts &facts)
{
  facts.num_geometries = uint32_t(data.geometries.size());
  facts.num_instances = uint32_t(data.instances.size());
  facts.num_materials = uint32_t(data.materials.size() - 1);  // without the default
  facts.num_textures = uint32_t(data.textures.size());
  facts.num_cameras = uint32_t(data.cameras.size());
  for (const PointLightData &light : data.lights) {
    (light.type == LightType::Distant ? facts.num_distant_lights : facts.num_point_lights)++;
  }
  const EnvironmentData &environment = data.environment;
  facts.has_environment = max_component(environment.radiance) > 0;
  for (const Material &material : data.materials) {
    if (material.type == MaterialType::Glass) facts.has_glass = 1;
    if (material.alpha_cutoff > 0) facts.has_alpha_masks = 1;
    if (material.blends != 0) facts.has_blending = 1;
  }
  const Box empty = empty_box();
  for (int axis = 0; axis < 3; ++axis) {
    facts.bounds_min[axis] = at(empty.lo, axis);
    facts.bounds_max[axis] = at(empty.hi, axis);
  }
}

void describe(const Commit &commit, gpurt_scene_facts &facts)
{
  const CompiledScene &compiled = *commit.compiled;
  facts.num_patches = compiled.num_patches;
  facts.patch_error = compiled.patch_error;
  facts.patch_error_pixels = compiled.patch_error_pixels;
  facts.num_triangles = compiled.indices.size();
  facts.num_world_triangles = num_world_triangles(compiled);
  for (const Light &light : compiled.lights)
    facts.num_emissive_triangles += light.type == LightType::Triangle;
  for (int axis = 0; axis < 3; ++axis) {
    facts.bounds_min[axis] = at(compiled.bounds.lo, axis);
    facts.bounds_max[axis] = at(compiled.bounds.hi, axis);
  }
  const AccelFacts &accel = commit.committed->accel_facts();
  facts.is_committed = 1;
  facts.accel = gpurt_accel(accel.accel);
  facts.triangle_test = gpurt_triangle_test(accel.triangle_test);
  facts.accel_bytes = accel.accel_bytes;
  facts.scene_bytes = compiled.bytes() + accel.accel_bytes;
  facts.num_nodes = accel.num_nodes;
  facts.num_references = accel.num_references;
  facts.tree_depth = accel.tree_depth;
  facts.tree_from_cache = accel.from_cache ? 1 : 0;
  facts.build_seconds = commit.build_seconds;
  facts.sah_cost = accel.sah_cost;
  // On the CPU the backend does nothing else.
  facts.accel_build_seconds = accel.build_seconds != 0 ? accel.build_seconds : commit.backend_seconds;
  facts.build_peak_bytes = accel.build_peak_bytes;
  facts.tree_refitted = accel.is_refitted ? 1 : 0;
}

}  // namespace
}  // namespace gpurt::api

using namespace gpurt;
using namespace gpurt::api;

gpurt_result gpurt_scene_create(gpurt_device device, gpurt_scene *out_scene)
{
  return guard([&] {
    const auto parent = get(device, "device");
    require(out_scene, "out_scene");
    *out_scene = publish<gpurt_scene>(std::make_shared<Scene>(parent));
  });
}

gpurt_result gpurt_scene_load(gpurt_device device, const char *path, gpurt_scene *out_scene)
{
  return guard([&] {
    const auto parent = get(device, "device");
    require(path, "path");
    require(out_scene, "out_scene");
    const auto scene = std::make_shared<Scene>(parent);
    scene->data =
        load_gltf(path, [&](const std::string &warning) { (*parent->log)(GPURT_LOG_WARNING, warning); });
    scene->loaded_memory = Reservation(parent->memory(), description_bytes(scene->data), "the loaded scene");
    *out_scene = publish<gpurt_scene>(scene);
  });
}

gpurt_result gpurt_scene_retain(gpurt_scene scene)
{
  return guard([&] { retain(scene, "scene"); });
}

gpurt_result gpurt_scene_release(gpurt_scene scene)
{
  return guard([&] { release(scene, "scene"); });
}

gpurt_result gpurt_scene_commit(gpurt_scene scene, const gpurt_build_desc *desc)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    const gpurt_build_desc d = read_optional_descriptor(desc);
    check_enum(d.accel, GPURT_ACCEL_BVH + 1, "accel", "gpurt_accel");
    check_enum(d.triangle_test, GPURT_TRIANGLE_DOUBLE + 1, "triangle_test", "gpurt_triangle_test");
    check_enum(d.quality, GPURT_BUILD_QUALITY_HIGH + 1, "quality", "gpurt_build_quality");
    // The description does not change while this is held; it is read without data_mutex, so that others may read it too.
    const std::scoped_lock lock(s->changing);
    s->set_commit(build_commit(*s, d));
  });
}

gpurt_result gpurt_scene_get_facts(gpurt_scene scene, gpurt_scene_facts *out_facts)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    check_output(out_facts, "out_facts");
    gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
    {
      const std::shared_lock lock(s->data_mutex);
      describe(s->data, facts);
    }
    if (const auto commit = s->last_commit()) describe(*commit, facts);
    write_output(out_facts, facts, "out_facts");
  });
}
