// Arguments that are wrong, function by function: NULL, enums and ids out of range, NaN, counts that overflow. Every one
// gives a result and a text that names the culprit, and leaves the scene as it was.
#include <limits>

#include "abi_test.h"

namespace {

using namespace gpurt_test;

constexpr float nan_value = std::numeric_limits<float>::quiet_NaN();
constexpr float inf_value = std::numeric_limits<float>::infinity();

class Arguments : public testing::Test {
 protected:
  World world;
  const gpurt_scene scene = world.scene;
  const gpurt_device device = world.device;
  const gpurt_frame frame = world.frame;
  uint32_t id = 0;
  const float corners[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  gpurt_ray ray = ray_at_triangle();
  gpurt_hit hit{};

  gpurt_mesh_desc mesh_desc() const
  {
    gpurt_mesh_desc d = GPURT_MESH_DESC_INIT;
    d.vertices.data = corners;
    d.vertices.count = 3;
    return d;
  }
  gpurt_trace_desc trace_desc()
  {
    gpurt_trace_desc d = GPURT_TRACE_DESC_INIT;
    d.num_rays = 1;
    d.rays = &ray;
    d.hits = &hit;
    return d;
  }
  gpurt_scene_facts facts() const
  {
    gpurt_scene_facts f = GPURT_SCENE_FACTS_INIT;
    GPURT_EXPECT_OK(gpurt_scene_get_facts(scene, &f));
    return f;
  }

  // A descriptor with one field changed.
  template <class Desc, class Change>
  void refuse(gpurt_result (*add)(gpurt_scene, const Desc *, uint32_t *), Desc desc, const std::string &part,
              Change &&change, gpurt_result wanted = GPURT_ERROR_INVALID_ARGUMENT)
  {
    change(desc);
    expect_failure(wanted, part, part, [&] { return add(scene, &desc, &id); });
  }
};

TEST_F(Arguments, NullPointers)
{
  gpurt_buffer_desc buffer_desc = GPURT_BUFFER_DESC_INIT;
  buffer_desc.size_bytes = 8;
  gpurt_buffer buffer;
  gpurt_scene new_scene;
  void *data;
  uint64_t size;
  expect_invalid("out_device is NULL", "device_create",
                 [&] { return gpurt_device_create(nullptr, nullptr); });
  expect_invalid("desc is NULL", "buffer_create",
                 [&] { return gpurt_buffer_create(device, nullptr, &buffer); });
  expect_invalid("out_buffer is NULL", "buffer_create",
                 [&] { return gpurt_buffer_create(device, &buffer_desc, nullptr); });
  expect_invalid("out_data is NULL", "get_data",
                 [&] { return gpurt_buffer_get_data(world.buffer, nullptr, &size); });
  expect_invalid("out_size_bytes is NULL", "get_data",
                 [&] { return gpurt_buffer_get_data(world.buffer, &data, nullptr); });
  expect_invalid("data is NULL", "write", [&] { return gpurt_buffer_write(world.buffer, 0, nullptr, 1); });
  expect_invalid("data is NULL", "read", [&] { return gpurt_buffer_read(world.buffer, 0, nullptr, 1); });
  expect_invalid("out_scene is NULL", "scene_create", [&] { return gpurt_scene_create(device, nullptr); });
  expect_invalid("path is NULL", "scene_load", [&] { return gpurt_scene_load(device, nullptr, &new_scene); });
  expect_invalid("out_scene is NULL", "scene_load",
                 [&] { return gpurt_scene_load(device, "x.glb", nullptr); });

  const auto both = [&](const char *what, auto add, auto desc) {
    expect_invalid("desc is NULL", what, [&] { return add(scene, nullptr, &id); });
    expect_invalid("is NULL", what, [&] { return add(scene, &desc, nullptr); });
  };
  gpurt_texture_desc texture = GPURT_TEXTURE_DESC_INIT;
  texture.width = texture.height = 1;
  texture.texels = corners;
  both("add_texture", gpurt_scene_add_texture, texture);
  both("add_material", gpurt_scene_add_material, gpurt_material_desc GPURT_MATERIAL_DESC_INIT);
  both("add_mesh", gpurt_scene_add_mesh, mesh_desc());
  both("add_patches", gpurt_scene_add_patches, gpurt_patches_desc GPURT_PATCHES_DESC_INIT);
  both("add_subdivision", gpurt_scene_add_subdivision, gpurt_subdivision_desc GPURT_SUBDIVISION_DESC_INIT);
  both("add_instance", gpurt_scene_add_instance, gpurt_instance_desc GPURT_INSTANCE_DESC_INIT);
  both("add_light", gpurt_scene_add_light, gpurt_light_desc GPURT_LIGHT_DESC_INIT);
  both("add_camera", gpurt_scene_add_camera, gpurt_camera_desc GPURT_CAMERA_DESC_INIT);
  expect_invalid("desc is NULL", "set_environment",
                 [&] { return gpurt_scene_set_environment(scene, nullptr); });
  expect_invalid("tree is NULL", "export_tree", [&] { return gpurt_scene_export_tree(scene, nullptr); });
  expect_invalid("tree is NULL", "import_tree", [&] { return gpurt_scene_import_tree(scene, nullptr); });
  expect_invalid("desc is NULL", "trace", [&] { return gpurt_scene_trace(scene, nullptr); });
  expect_invalid("desc is NULL", "locate", [&] { return gpurt_scene_locate(scene, nullptr); });

  expect_invalid("out_frame is NULL", "frame_create",
                 [&] { return gpurt_frame_create(scene, nullptr, nullptr); });
  expect_invalid("out_job is NULL", "submit",
                 [&] { return gpurt_frame_submit(frame, nullptr, nullptr, 0, nullptr); });
  gpurt_job job;
  expect_invalid("tiles is NULL", "submit",
                 [&] { return gpurt_frame_submit(frame, nullptr, nullptr, 3, &job); });
  const gpurt_tile tile{0, 0, 4, 4};
  expect_invalid("num_tiles is 0", "submit",
                 [&] { return gpurt_frame_submit(frame, nullptr, &tile, 0, &job); });
  expect_invalid("out_share is NULL", "progress", [&] { return gpurt_job_get_progress(world.job, nullptr); });
  expect_invalid("data is NULL", "read",
                 [&] { return gpurt_frame_read(frame, GPURT_OUTPUT_ALPHA, nullptr, 256); });
  expect_invalid("path is NULL", "save", [&] { return gpurt_frame_save(frame, nullptr); });
  expect_invalid("path is NULL", "load_state", [&] { return gpurt_frame_load_state(frame, nullptr); });

  const gpurt_scene_facts f = facts();
  EXPECT_EQ(f.num_geometries, 1u);
  EXPECT_EQ(f.num_materials, 0u);
  EXPECT_EQ(f.num_cameras, 1u);
}

TEST_F(Arguments, Devices)
{
  Device out;
  const auto refuse_device = [&](gpurt_result wanted, const std::string &part, auto change) {
    gpurt_device_desc d = GPURT_DEVICE_DESC_INIT;
    d.type = GPURT_DEVICE_CPU;
    change(d);
    expect_failure(wanted, part, part, [&] { return gpurt_device_create(&d, out.out()); });
  };
  refuse_device(GPURT_ERROR_INVALID_ARGUMENT, "type is 3", [](auto &d) { d.type = gpurt_device_type(3); });
  refuse_device(GPURT_ERROR_INVALID_ARGUMENT, "type is 2147483647",
                [](auto &d) { d.type = GPURT_DEVICE_TYPE_FORCE32; });
  refuse_device(GPURT_ERROR_DEVICE, "no CPU device 1", [](auto &d) { d.ordinal = 1; });
  refuse_device(GPURT_ERROR_INVALID_ARGUMENT, "num_threads", [](auto &d) { d.num_threads = 4000000000u; });
  refuse_device(GPURT_ERROR_INVALID_ARGUMENT, "ordinal", [](auto &d) {
    d.type = GPURT_DEVICE_AUTO;
    d.ordinal = 3;
  });
  const uint32_t ordinals[] = {0, 0};
  const auto with_ordinals = [&](auto &d, uint32_t count) {
    d.ordinals = ordinals;
    d.num_ordinals = count;
  };
  refuse_device(GPURT_ERROR_INVALID_ARGUMENT, "ordinals[1] is 0", [&](auto &d) { with_ordinals(d, 2); });
  refuse_device(GPURT_ERROR_INVALID_ARGUMENT, "num_ordinals is 0", [&](auto &d) { with_ordinals(d, 0); });
  refuse_device(GPURT_ERROR_INVALID_ARGUMENT, "num_ordinals is 4294967295",
                [&](auto &d) { with_ordinals(d, UINT32_MAX); });
  refuse_device(GPURT_ERROR_INVALID_ARGUMENT, "ordinals is NULL", [](auto &d) { d.num_ordinals = 2; });
  refuse_device(GPURT_ERROR_INVALID_ARGUMENT, "ordinal is 3, but ordinals", [&](auto &d) {
    with_ordinals(d, 1);
    d.ordinal = 3;
  });
  refuse_device(GPURT_ERROR_INVALID_ARGUMENT, "type is GPURT_DEVICE_AUTO", [&](auto &d) {
    with_ordinals(d, 1);
    d.type = GPURT_DEVICE_AUTO;
  });
  refuse_device(GPURT_ERROR_INVALID_ARGUMENT, "reserved is 1", [](auto &d) { d.reserved = 1; });
  EXPECT_EQ(gpurt_device(out), nullptr) << "a failed call wrote its output";
  {
    gpurt_device_desc d = GPURT_DEVICE_DESC_INIT;
    d.type = GPURT_DEVICE_CPU;
    with_ordinals(d, 1);
    Device one;
    GPURT_EXPECT_OK(gpurt_device_create(&d, one.out()));
  }
  if (!has_cuda()) {
    gpurt_device_desc d = GPURT_DEVICE_DESC_INIT;
    d.type = GPURT_DEVICE_CUDA;
    const gpurt_result result = gpurt_device_create(&d, out.out());
    EXPECT_TRUE(result == GPURT_ERROR_UNSUPPORTED || result == GPURT_ERROR_DEVICE) << gpurt_last_error();
    d.type = GPURT_DEVICE_AUTO;
    GPURT_EXPECT_OK(gpurt_device_create(&d, out.out()));
    gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
    GPURT_EXPECT_OK(gpurt_device_get_properties(out, &p));
    EXPECT_EQ(p.type, GPURT_DEVICE_CPU);
  }
}

TEST_F(Arguments, Textures)
{
  gpurt_texture_desc d = GPURT_TEXTURE_DESC_INIT;
  d.width = d.height = 1;
  d.texels = corners;
  const auto add = gpurt_scene_add_texture;
  refuse(add, d, "format is 3", [](auto &x) { x.format = gpurt_texture_format(3); });
  refuse(add, d, "wrap_u is 9", [](auto &x) { x.wrap_u = gpurt_wrap(9); });
  refuse(add, d, "wrap_v is 3", [](auto &x) { x.wrap_v = gpurt_wrap(3); });
  refuse(add, d, "filter is 2", [](auto &x) { x.filter = gpurt_filter(2); });
  refuse(add, d, "reserved is 1", [](auto &x) { x.reserved = 1; });
  refuse(add, d, "texels is NULL", [](auto &x) { x.texels = nullptr; });
  refuse(add, d, "0 x 1", [](auto &x) { x.width = 0; });
  refuse(add, d, "1 x 4294967295", [](auto &x) { x.height = 0xffffffffu; });
  const float bad[4] = {1, nan_value, 1, 1};
  refuse(add, d, "nan", [&](auto &x) {
    x.format = GPURT_TEXTURE_RGBA32F;
    x.texels = bad;
  });
  EXPECT_EQ(facts().num_textures, 0u);
}

TEST_F(Arguments, Materials)
{
  const gpurt_material_desc d = GPURT_MATERIAL_DESC_INIT;
  const auto add = gpurt_scene_add_material;
  refuse(add, d, "type is 4", [](auto &x) { x.type = gpurt_material_type(4); });
  refuse(add, d, "base colour", [](auto &x) { x.base_color[1] = nan_value; });
  refuse(add, d, "base colour", [](auto &x) { x.base_color[2] = 1.5f; });
  refuse(add, d, "roughness", [](auto &x) {
    x.type = GPURT_MATERIAL_METAL;
    x.roughness = 0;
  });
  refuse(add, d, "refraction", [](auto &x) {
    x.type = GPURT_MATERIAL_GLASS;
    x.ior = -1;
  });
  refuse(add, d, "alpha", [](auto &x) { x.alpha = 2; });
  refuse(add, d, "alpha_cutoff", [](auto &x) { x.alpha_cutoff = inf_value; });
  refuse(add, d, "emission", [](auto &x) { x.emission[0] = inf_value; });
  refuse(add, d, "emission", [](auto &x) { x.emission[0] = -1; });
  refuse(add, d, "base_color_texture is 1", [](auto &x) { x.base_color_texture = 1; });
  refuse(add, d, "base_color_texture is 4294967295",
         [](auto &x) { x.base_color_texture = GPURT_INVALID_ID; });
  refuse(add, d, "two_sided_emission is 2", [](auto &x) { x.two_sided_emission = 2; });
  refuse(add, d, "blends is 2", [](auto &x) { x.blends = 2; });
  refuse(add, d, "blends", [](auto &x) {
    x.blends = 1;
    x.alpha_cutoff = 0.5f;
  });
  refuse(add, d, "emission_texture is 1", [](auto &x) { x.emission_texture = 1; });
  refuse(add, d, "attenuation_color", [](auto &x) { x.attenuation_color[2] = 1.5f; });
  refuse(add, d, "attenuation_color", [](auto &x) { x.attenuation_color[0] = nan_value; });
  refuse(add, d, "attenuation_distance", [](auto &x) { x.attenuation_distance = -1; });
  refuse(add, d, "attenuation_distance", [](auto &x) { x.attenuation_distance = inf_value; });
  EXPECT_EQ(facts().num_materials, 0u);
}

TEST_F(Arguments, Meshes)
{
  const gpurt_mesh_desc d = mesh_desc();
  const auto add = gpurt_scene_add_mesh;
  const float not_finite[9] = {0, 0, 0, 1, 0, 0, 0, inf_value, 0};
  const uint32_t indices[6] = {0, 1, 2, 0, 1, 3};
  refuse(add, d, "material is 1", [](auto &x) { x.material = 1; });
  refuse(add, d, "vertex 2", [&](auto &x) { x.vertices.data = not_finite; });
  refuse(add, d, "vertices", [](auto &x) { x.vertices.count = 2; });
  refuse(add, d, "3", [&](auto &x) {
    x.indices.data = indices;
    x.indices.count = 2;
  });
  refuse(add, d, "normals", [&](auto &x) {
    x.normals.data = corners;
    x.normals.count = 2;
  });
  refuse(add, d, "normal 2", [&](auto &x) {
    x.normals.data = not_finite;
    x.normals.count = 3;
  });
  refuse(add, d, "texture coordinate", [&](auto &x) {
    x.uvs.data = not_finite;
    x.uvs.stride_bytes = 12;
    x.uvs.offset_bytes = 4;
    x.uvs.count = 3;
  });
  EXPECT_EQ(facts().num_geometries, 1u);
}

// A scene with one mesh of three vertices and no normals.
TEST_F(Arguments, Vertices)
{
  const float not_finite[9] = {0, 0, 0, 1, 0, 0, 0, inf_value, 0};
  const auto array = [](const void *data, uint64_t count) {
    gpurt_array a{};
    a.data = data;
    a.count = count;
    return a;
  };
  const gpurt_array good = array(corners, 3), few = array(corners, 2), bad = array(not_finite, 3);
  const auto set = [&](uint32_t geometry, const gpurt_array *vertices, const gpurt_array *normals) {
    return [=, this] { return gpurt_scene_set_vertices(scene, geometry, vertices, normals); };
  };
  expect_invalid("vertices", "vertices is NULL", set(0, nullptr, nullptr));
  expect_invalid("geometry is 1", "no such geometry", set(1, &good, nullptr));
  expect_invalid("2 vertices for a mesh of 3", "fewer", set(0, &few, nullptr));
  expect_invalid("vertex 2", "not finite", set(0, &bad, nullptr));
  expect_invalid("3 normals for a mesh with 0", "normals where there are none", set(0, &good, &good));
  EXPECT_EQ(gpurt_scene_set_vertices(scene, 0, &good, nullptr), GPURT_OK) << gpurt_last_error();
}

TEST_F(Arguments, Arrays)
{
  const gpurt_mesh_desc d = mesh_desc();
  const auto add = gpurt_scene_add_mesh;
  const uint64_t most = std::numeric_limits<uint64_t>::max();
  refuse(add, d, "vertices: count is 3, but neither", [](auto &x) { x.vertices.data = nullptr; });
  refuse(add, d, "vertices: both", [&](auto &x) { x.vertices.buffer = world.buffer; });
  refuse(add, d, "vertices: stride_bytes is 8", [](auto &x) { x.vertices.stride_bytes = 8; });
  refuse(add, d, "vertices: count is", [&](auto &x) { x.vertices.count = most; });
  refuse(add, d, "vertices: count is", [&](auto &x) { x.vertices.count = uint64_t(1) << 32; });
  refuse(add, d, "vertices: 3 elements", [&](auto &x) { x.vertices.stride_bytes = most / 2; });
  refuse(add, d, "vertices: 3 elements", [&](auto &x) { x.vertices.stride_bytes = most - 3; });
  refuse(add, d, "vertices: offset_bytes", [&](auto &x) { x.vertices.offset_bytes = most - 8; });

  // The world's buffer has 64 bytes: room for five vertices, one byte less after an offset of 5.
  const auto in_buffer = [&](uint64_t count, uint64_t offset, uint64_t stride) {
    return [=, this](gpurt_mesh_desc &x) { x.vertices = {nullptr, world.buffer, offset, stride, count}; };
  };
  refuse(add, d, "the buffer has only 64", in_buffer(6, 0, 0));
  refuse(add, d, "the buffer has only 27", in_buffer(3, 37, 0));
  refuse(add, d, "the buffer has only 0", in_buffer(3, 65, 0));
  refuse(add, d, "the buffer has only 0", in_buffer(3, most, 0));
  refuse(add, d, "need 68 bytes", in_buffer(3, 0, 28));
  refuse(add, d, "3 elements", in_buffer(3, 0, most));
  gpurt_mesh_desc fits = d;
  in_buffer(3, 0, 26)(fits);  // to the last byte: 26 + 26 + 12
  GPURT_EXPECT_OK(add(scene, &fits, &id));
  in_buffer(0, 64, 0)(fits);
  GPURT_EXPECT_OK(add(scene, &fits, &id));

  const Device other = make_device();
  const Buffer foreign = World::make_buffer(other, 64);
  refuse(add, d, "another device", [&](auto &x) { x.vertices = {nullptr, foreign, 0, 0, 3}; });
  refuse(add, d, "vertices: this is a scene handle, a buffer is needed",
         [&](auto &x) { x.vertices = {nullptr, reinterpret_cast<gpurt_buffer>(scene), 0, 0, 3}; });
  EXPECT_EQ(facts().num_geometries, 3u);
}

TEST_F(Arguments, PatchesAndSubdivision)
{
  gpurt_patches_desc d = GPURT_PATCHES_DESC_INIT;
  std::vector<float> points(32 * 3);
  d.control_points.data = points.data();
  d.control_points.count = 16;
  const auto add = gpurt_scene_add_patches;
  refuse(add, d, "17", [](auto &x) { x.control_points.count = 17; });
  refuse(add, d, "material is 7", [](auto &x) { x.material = 7; });
  points[3 * 5] = nan_value;
  refuse(add, d, "5", [](auto &) {});

  const gpurt_subdivision_desc s = GPURT_SUBDIVISION_DESC_INIT;
  refuse(gpurt_scene_add_subdivision, s, "gpurt_scene_add_mesh", [](auto &) {}, GPURT_ERROR_UNSUPPORTED);
  refuse(gpurt_scene_add_subdivision, s, "scheme is 2",
         [](auto &x) { x.scheme = gpurt_subdivision_scheme(2); });
  refuse(gpurt_scene_add_subdivision, s, "reserved", [](auto &x) { x.reserved = 1; });
  EXPECT_EQ(facts().num_geometries, 1u);
}

TEST_F(Arguments, Instances)
{
  const gpurt_instance_desc d = GPURT_INSTANCE_DESC_INIT;
  const auto add = gpurt_scene_add_instance;
  refuse(add, d, "geometry is 1, but the scene has 1", [](auto &x) { x.geometry = 1; });
  refuse(add, d, "geometry is 4294967295", [](auto &x) { x.geometry = GPURT_INVALID_ID; });
  refuse(add, d, "", [](auto &x) { x.transform[0] = 0; });
  refuse(add, d, "", [](auto &x) { x.transform[7] = nan_value; });
  EXPECT_EQ(facts().num_instances, 1u);
}

TEST_F(Arguments, Lights)
{
  gpurt_light_desc d = GPURT_LIGHT_DESC_INIT;
  d.direction[2] = -1;
  const auto add = gpurt_scene_add_light;
  refuse(add, d, "type is 3", [](auto &x) { x.type = gpurt_light_type(3); });
  refuse(add, d, "", [](auto &x) { x.intensity[0] = nan_value; });
  refuse(add, d, "", [](auto &x) { x.intensity[0] = -1; });
  refuse(add, d, "", [](auto &x) { x.position[0] = inf_value; });
  refuse(add, d, "", [](auto &x) {
    x.type = GPURT_LIGHT_DISTANT;
    x.direction[2] = 0;
  });
  refuse(add, d, "", [](auto &x) {
    x.type = GPURT_LIGHT_SPOT;
    x.inner_cone_angle_rad = 1;
    x.outer_cone_angle_rad = 0.5f;
  });
  const gpurt_scene_facts f = facts();
  EXPECT_EQ(f.num_point_lights + f.num_distant_lights, 0u);
}

TEST_F(Arguments, Environment)
{
  const auto refuse_environment = [&](const std::string &part, auto change) {
    gpurt_environment_desc d = GPURT_ENVIRONMENT_DESC_INIT;
    change(d);
    expect_invalid(part, part, [&] { return gpurt_scene_set_environment(scene, &d); });
  };
  refuse_environment("texture is 1", [](auto &d) { d.texture = 1; });
  refuse_environment("", [](auto &d) { d.radiance[1] = nan_value; });
  refuse_environment("", [](auto &d) { d.radiance[1] = -1; });
  EXPECT_EQ(facts().has_environment, 1u);
}

TEST_F(Arguments, Cameras)
{
  const gpurt_camera_desc d = GPURT_CAMERA_DESC_INIT;
  const auto add = gpurt_scene_add_camera;
  refuse(add, d, "type is 2", [](auto &x) { x.type = gpurt_camera_type(2); });
  refuse(
      add, d, "GPURT_CAMERA_PERSPECTIVE", [](auto &x) { x.type = GPURT_CAMERA_ORTHOGRAPHIC; },
      GPURT_ERROR_UNSUPPORTED);
  refuse(add, d, "lens_radius", [](auto &x) { x.lens_radius = 0.1f; }, GPURT_ERROR_UNSUPPORTED);
  refuse(add, d, "focus_distance", [](auto &x) { x.focus_distance = nan_value; }, GPURT_ERROR_UNSUPPORTED);
  refuse(add, d, "shutter_close", [](auto &x) { x.shutter_close = 1; }, GPURT_ERROR_UNSUPPORTED);
  refuse(add, d, "", [](auto &x) { x.yfov_rad = 4; });
  refuse(add, d, "", [](auto &x) { x.yfov_rad = nan_value; });
  refuse(add, d, "", [](auto &x) { x.transform[3] = nan_value; });
  gpurt_camera_desc out = GPURT_CAMERA_DESC_INIT;
  expect_invalid("camera is 1", "get_camera", [&] { return gpurt_scene_get_camera(scene, 1, &out); });
  expect_invalid("camera is 4294967295", "get_camera",
                 [&] { return gpurt_scene_get_camera(scene, ~0u, &out); });
  EXPECT_EQ(facts().num_cameras, 1u);
}

TEST_F(Arguments, Commits)
{
  const auto refuse_commit = [&](const std::string &part, auto change,
                                 gpurt_result wanted = GPURT_ERROR_INVALID_ARGUMENT) {
    gpurt_build_desc d = GPURT_BUILD_DESC_INIT;
    change(d);
    expect_failure(wanted, part, part, [&] { return gpurt_scene_commit(scene, &d); });
  };
  refuse_commit("accel is 4", [](auto &d) { d.accel = gpurt_accel(4); });
  refuse_commit("triangle_test is 3", [](auto &d) { d.triangle_test = gpurt_triangle_test(3); });
  refuse_commit("max_depth is 49", [](auto &d) { d.max_depth = 49; });
  refuse_commit("traversal_cost", [](auto &d) { d.traversal_cost = nan_value; });
  refuse_commit("traversal_cost", [](auto &d) { d.traversal_cost = -1; });
  refuse_commit("empty_bonus", [](auto &d) { d.empty_bonus = inf_value; });
  refuse_commit("patch_tolerance", [](auto &d) { d.patch_tolerance = -1; });
  refuse_commit("patch_pixels", [](auto &d) { d.patch_pixels = -1; });
  refuse_commit("patch_pixels", [](auto &d) { d.patch_pixels = inf_value; });
  refuse_commit("patch_camera is 1, but the scene has 1 cameras", [](auto &d) {
    d.patch_pixels = 1;
    d.patch_camera = 1;
  });
  refuse_commit("patch_camera is 1, but patch_pixels is 0", [](auto &d) { d.patch_camera = 1; });
  refuse_commit("patch_width is 2, but patch_pixels is 0", [](auto &d) { d.patch_width = 2; });
  refuse_commit("patch_height is 3, but patch_pixels is 0", [](auto &d) { d.patch_height = 3; });
  refuse_commit("quality", [](auto &d) { d.quality = gpurt_build_quality(7); });
  refuse_commit(
      "GPURT_ACCEL_KDTREE",
      [](auto &d) {
        d.accel = GPURT_ACCEL_EMBREE;
        d.triangle_test = GPURT_TRIANGLE_DOUBLE;
      },
      GPURT_ERROR_UNSUPPORTED);
  // The commit of before is still in force.
  GPURT_EXPECT_OK(gpurt_scene_trace(scene, std::array{trace_desc()}.data()));
  EXPECT_EQ(hit.primitive, 0u);
}

TEST_F(Arguments, Traces)
{
  const auto refuse_trace = [&](const std::string &part, auto change) {
    gpurt_trace_desc d = trace_desc();
    change(d);
    expect_invalid(part, part, [&] { return gpurt_scene_trace(scene, &d); });
  };
  uint8_t occluded = 0;
  uint64_t offsets[2] = {};
  const uint64_t most = std::numeric_limits<uint64_t>::max();
  refuse_trace("query is 3", [](auto &d) { d.query = gpurt_query(3); });
  refuse_trace("format is 2", [](auto &d) { d.format = gpurt_hit_format(2); });
  refuse_trace("storage is 2", [](auto &d) { d.storage = gpurt_storage(2); });
  refuse_trace("rays is NULL", [](auto &d) { d.rays = nullptr; });
  refuse_trace("count_lanes is 2", [](auto &d) { d.count_lanes = 2; });
  refuse_trace("out_counters is NULL", [](auto &d) { d.count_lanes = 1; });
  refuse_trace("reserved is 1", [](auto &d) { d.reserved = 1; });
  refuse_trace("hits is NULL", [](auto &d) { d.hits = nullptr; });
  refuse_trace("occluded must be NULL", [&](auto &d) { d.occluded = &occluded; });
  refuse_trace("offsets must be NULL", [&](auto &d) { d.offsets = offsets; });
  refuse_trace("hits must be NULL", [&](auto &d) { d.query = GPURT_QUERY_ANY; });
  refuse_trace("occluded is NULL", [&](auto &d) {
    d.query = GPURT_QUERY_ANY;
    d.hits = nullptr;
  });
  refuse_trace("offsets is NULL", [&](auto &d) { d.query = GPURT_QUERY_ALL; });
  refuse_trace("rays", [&](auto &d) { d.num_rays = most; });
  refuse_trace("rays", [&](auto &d) { d.num_rays = most / sizeof(gpurt_ray); });
  refuse_trace("rays", [&](auto &d) {
    d.num_rays = most;
    d.query = GPURT_QUERY_ALL;
    d.offsets = offsets;
  });
  refuse_trace("hits", [&](auto &d) {
    d.query = GPURT_QUERY_ALL;
    d.offsets = offsets;
    d.hit_capacity = most;
  });
  refuse_trace("aligned", [&](auto &d) {
    d.rays = reinterpret_cast<const gpurt_ray *>(reinterpret_cast<const char *>(&ray) + 1);
  });
  refuse_trace("aligned", [&](auto &d) {
    d.query = GPURT_QUERY_ALL;
    d.hits = nullptr;
    d.offsets = reinterpret_cast<uint64_t *>(reinterpret_cast<char *>(offsets) + 4);
  });
  refuse_trace("rays and hits overlap", [&](auto &d) { d.hits = &ray; });

  const Scene never_committed = make_scene(device);
  const gpurt_trace_desc d = trace_desc();
  expect_invalid("never committed", "trace", [&] { return gpurt_scene_trace(never_committed, &d); });
  gpurt_frame out;
  expect_invalid("never committed", "frame_create",
                 [&] { return gpurt_frame_create(never_committed, nullptr, &out); });
}

TEST_F(Arguments, NoRaysAreLegal)
{
  gpurt_trace_desc d = GPURT_TRACE_DESC_INIT;
  GPURT_EXPECT_OK(gpurt_scene_trace(scene, &d));
  d.query = GPURT_QUERY_ANY;
  GPURT_EXPECT_OK(gpurt_scene_trace(scene, &d));
  d.query = GPURT_QUERY_ALL;
  uint64_t offset = 7;
  d.offsets = &offset;
  GPURT_EXPECT_OK(gpurt_scene_trace(scene, &d));
  EXPECT_EQ(offset, 0u);
}

TEST_F(Arguments, TooSmallHits)
{
  gpurt_ray rays[2] = {ray, ray};
  uint64_t offsets[3] = {};
  gpurt_trace_desc d = GPURT_TRACE_DESC_INIT;
  d.query = GPURT_QUERY_ALL;
  d.num_rays = 2;
  d.rays = rays;
  d.offsets = offsets;
  GPURT_EXPECT_OK(gpurt_scene_trace(scene, &d));  // counts
  EXPECT_EQ(offsets[2], 2u);
  offsets[2] = 0;
  gpurt_hit hits[2];
  d.hits = hits;
  d.hit_capacity = 1;
  expect_invalid("hit_capacity", "trace", [&] { return gpurt_scene_trace(scene, &d); });
  EXPECT_EQ(offsets[2], 2u) << "offsets are written also where hits are too small";
  d.hit_capacity = 2;
  GPURT_EXPECT_OK(gpurt_scene_trace(scene, &d));
  EXPECT_EQ(hits[1].primitive, 0u);
}

TEST_F(Arguments, Frames)
{
  Frame out;
  const auto refuse_frame = [&](const std::string &part, auto change,
                                gpurt_result wanted = GPURT_ERROR_INVALID_ARGUMENT) {
    gpurt_frame_desc d = GPURT_FRAME_DESC_INIT;
    change(d);
    expect_failure(wanted, part, part, [&] { return gpurt_frame_create(scene, &d, out.out()); });
  };
  refuse_frame("camera is 1", [](auto &d) { d.camera = 1; });
  refuse_frame("outputs", [](auto &d) { d.outputs = 1u << GPURT_OUTPUT_COUNT; });
  refuse_frame("outputs", [](auto &d) { d.outputs = ~0u; });
  refuse_frame(
      "GPURT_OUTPUT_TIME", [](auto &d) { d.outputs = 1u << GPURT_OUTPUT_TIME; }, GPURT_ERROR_UNSUPPORTED);
  refuse_frame("width", [](auto &d) { d.width = ~0u; });
  refuse_frame("height", [](auto &d) { d.height = ~0u; });
}

TEST_F(Arguments, Submissions)
{
  const auto refuse_render = [&](const std::string &part, auto change,
                                 gpurt_result wanted = GPURT_ERROR_INVALID_ARGUMENT) {
    gpurt_render_desc d = GPURT_RENDER_DESC_INIT;
    d.samples_per_pixel = 1;
    change(d);
    Job job;
    expect_failure(wanted, part, part, [&] { return gpurt_frame_submit(frame, &d, nullptr, 0, job.out()); });
  };
  refuse_render("pipeline is 5", [](auto &d) { d.pipeline = gpurt_pipeline(5); });
  refuse_render(
      "GPURT_PIPELINE_PATH", [](auto &d) { d.pipeline = GPURT_PIPELINE_HYBRID; }, GPURT_ERROR_UNSUPPORTED);
  // Photon mapping's settings belong to its pipeline.
  refuse_render("GPURT_PIPELINE_PHOTON", [](auto &d) { d.photon.photons_per_pass = 1; });
  gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
  frame_desc.width = frame_desc.height = 8;
  Frame empty;  // another pipeline's samples would be refused first
  ASSERT_EQ(gpurt_frame_create(scene, &frame_desc, empty.out()), GPURT_OK);
  const auto refuse_photons = [&](const std::string &part, auto change,
                                  gpurt_result wanted = GPURT_ERROR_INVALID_ARGUMENT) {
    gpurt_render_desc d = GPURT_RENDER_DESC_INIT;
    d.samples_per_pixel = 1;
    d.pipeline = GPURT_PIPELINE_PHOTON;
    change(d);
    Job job;
    expect_failure(wanted, part, part, [&] { return gpurt_frame_submit(empty, &d, nullptr, 0, job.out()); });
  };
  refuse_photons("photon.estimator is 4", [](auto &d) { d.photon.estimator = gpurt_photon_estimator(4); });
  refuse_photons("photon.kernel is 3", [](auto &d) { d.photon.kernel = gpurt_photon_kernel(3); });
  refuse_photons("photon.remedies is 0x40", [](auto &d) { d.photon.remedies = 64; });
  refuse_photons("NONE stands alone", [](auto &d) {
    d.photon.remedies = uint32_t(GPURT_PHOTON_REMEDY_NONE) | GPURT_PHOTON_REMEDY_SIDE;
  });
  refuse_photons("photon.initial_radius", [](auto &d) { d.photon.initial_radius = nan_value; });
  refuse_photons("photon.initial_radius", [](auto &d) { d.photon.initial_radius = -1; });
  refuse_photons("photon.reserved", [](auto &d) { d.photon.reserved = 1; });
  refuse_photons("max_depth is 256", [](auto &d) { d.max_depth = 256; });
  refuse_photons(
      "GPURT_PHOTON_ESTIMATOR_PER_PIXEL",
      [](auto &d) {
        d.photon.estimator = GPURT_PHOTON_ESTIMATOR_PER_PIXEL;
        d.photon.kernel = GPURT_PHOTON_KERNEL_CONE;
      },
      GPURT_ERROR_UNSUPPORTED);
  const auto refuse_reyes = [&](const std::string &part, auto change,
                                gpurt_result wanted = GPURT_ERROR_INVALID_ARGUMENT) {
    refuse_render(
        part,
        [=](auto &d) {
          d.pipeline = GPURT_PIPELINE_REYES;
          change(d);
        },
        wanted);
  };
  refuse_reyes("max_depth is 3", [](auto &d) { d.max_depth = 3; }, GPURT_ERROR_UNSUPPORTED);
  refuse_reyes("reyes.shading_rate is -1", [](auto &d) { d.reyes.shading_rate = -1; });
  refuse_reyes("reyes.shading_rate is 1000", [](auto &d) { d.reyes.shading_rate = 1000; });
  refuse_reyes("reyes.shading_rate is nan", [](auto &d) { d.reyes.shading_rate = std::nanf(""); });
  refuse_reyes("reyes.filter is 4", [](auto &d) { d.reyes.filter = gpurt_reyes_filter(4); });
  refuse_reyes("reyes.shading is 4", [](auto &d) { d.reyes.shading = gpurt_reyes_shading(4); });
  refuse_reyes("reyes.no_shadows is 2", [](auto &d) { d.reyes.no_shadows = 2; });
  refuse_reyes("reyes.flatness is -1", [](auto &d) { d.reyes.flatness = -1; });
  refuse_reyes("reyes.flatness is nan", [](auto &d) { d.reyes.flatness = std::nanf(""); });
  refuse_reyes("reyes.fragment_slots is 65", [](auto &d) { d.reyes.fragment_slots = 65; });
  refuse_render("reyes.shading_rate is 1, but", [](auto &d) { d.reyes.shading_rate = 1; });
  refuse_render("target_error", [](auto &d) { d.target_error = nan_value; });
  refuse_render("target_error", [](auto &d) { d.target_error = -1; });
  refuse_render("tile_size is 257; it is at most 256", [](auto &d) { d.tile_size = 257; });
  refuse_render("time_limit_s", [](auto &d) { d.time_limit_s = std::numeric_limits<double>::quiet_NaN(); });

  const gpurt_render_desc d = GPURT_RENDER_DESC_INIT;
  for (const gpurt_tile tile : {gpurt_tile{0, 0, 9, 8}, gpurt_tile{4, 0, 4, 8}, gpurt_tile{5, 0, 4, 8},
                                gpurt_tile{0, ~0u, 8, 8}, gpurt_tile{0, 0, ~0u, ~0u}}) {
    Job job;
    expect_invalid("tile", "tile", [&] { return gpurt_frame_submit(frame, &d, &tile, 1, job.out()); });
  }
}

TEST_F(Arguments, ReadingAndFiles)
{
  float alpha[64];
  expect_invalid("output is 13", "read",
                 [&] { return gpurt_frame_read(frame, GPURT_OUTPUT_COUNT, alpha, 256); });
  expect_invalid("", "read", [&] { return gpurt_frame_read(frame, GPURT_OUTPUT_DEPTH, alpha, 256); });
  expect_invalid("size_bytes", "read",
                 [&] { return gpurt_frame_read(frame, GPURT_OUTPUT_ALPHA, alpha, 255); });
  expect_invalid("size_bytes", "read", [&] { return gpurt_frame_read(frame, GPURT_OUTPUT_ALPHA, alpha, 0); });
  expect_invalid("", "save", [&] { return gpurt_frame_save(frame, "x.jpg"); });
  expect_invalid("", "save", [&] { return gpurt_frame_save(frame, ""); });
  expect_failure(GPURT_ERROR_IO, "/nowhere/x.exr", "save",
                 [&] { return gpurt_frame_save(frame, "/nowhere/x.exr"); });
  expect_failure(GPURT_ERROR_IO, "/nowhere/x", "load",
                 [&] { return gpurt_frame_load_state(frame, "/nowhere/x.gpurt"); });
  expect_invalid("itself", "merge", [&] { return gpurt_frame_merge(frame, frame); });
  gpurt_scene out;
  expect_failure(GPURT_ERROR_IO, "no such file.glb", "load",
                 [&] { return gpurt_scene_load(device, "no such file.glb", &out); });
}

TEST(ResultNames, AreThoseOfTheHeader)
{
  EXPECT_STREQ(gpurt_result_name(GPURT_OK), "GPURT_OK");
  EXPECT_STREQ(gpurt_result_name(GPURT_ERROR_INTERNAL), "GPURT_ERROR_INTERNAL");
  EXPECT_STREQ(gpurt_result_name(gpurt_result(9)), "unknown result");
  EXPECT_STREQ(gpurt_result_name(GPURT_RESULT_FORCE32), "unknown result");
}

}  // namespace
