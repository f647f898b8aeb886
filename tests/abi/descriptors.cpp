// Descriptors of other sizes than the library's own, and results written into structs of other sizes.
#include "abi_test.h"
#include "gpurt_cuda.h"

namespace {

using namespace gpurt_test;

// A struct followed by room for fields of the future, all zero.
template <class T>
struct Larger {
  explicit Larger(const T &t) : ours(t) { ours.struct_size = sizeof(Larger); }
  T ours;
  unsigned char future[64] = {};
};

struct Case {
  std::string name;
  std::string struct_name;
  std::string init_macro;
  uint32_t size;
  std::vector<unsigned char> bytes;  // a valid descriptor
  std::function<gpurt_result(const void *)> call;
};

class Descriptors : public testing::Test {
 protected:
  template <class T>
  Case make(std::string name, std::string struct_name, std::string init_macro, const T &valid,
            std::function<gpurt_result(const T *)> call)
  {
    Case c{std::move(name), std::move(struct_name), std::move(init_macro), sizeof(T), {}, {}};
    c.bytes.resize(sizeof(T));
    std::memcpy(c.bytes.data(), &valid, sizeof(T));
    c.call = [call](const void *desc) { return call(static_cast<const T *>(desc)); };
    return c;
  }
#define CASE(function, T, INIT, valid, call) make<T>(#function, #T, #INIT, valid, call)

  // Every function that reads a descriptor, with one that it accepts.
  std::vector<Case> input_cases()
  {
    std::vector<Case> cases;
    const gpurt_scene scene = world.scene;
    const gpurt_device device = world.device;
    const gpurt_frame frame = world.frame;

    gpurt_device_desc device_desc = GPURT_DEVICE_DESC_INIT;
    device_desc.type = GPURT_DEVICE_CPU;
    cases.push_back(
        CASE(gpurt_device_create, gpurt_device_desc, GPURT_DEVICE_DESC_INIT, device_desc, [](auto *d) {
          Device out;
          return gpurt_device_create(d, out.out());
        }));

    gpurt_buffer_desc buffer_desc = GPURT_BUFFER_DESC_INIT;
    buffer_desc.size_bytes = 16;
    cases.push_back(
        CASE(gpurt_buffer_create, gpurt_buffer_desc, GPURT_BUFFER_DESC_INIT, buffer_desc, [=](auto *d) {
          Buffer out;
          return gpurt_buffer_create(device, d, out.out());
        }));

    gpurt_texture_desc texture = GPURT_TEXTURE_DESC_INIT;
    texture.width = texture.height = 1;
    texture.texels = texel;
    cases.push_back(
        CASE(gpurt_scene_add_texture, gpurt_texture_desc, GPURT_TEXTURE_DESC_INIT, texture, [=](auto *d) {
          uint32_t id;
          return gpurt_scene_add_texture(scene, d, &id);
        }));

    const gpurt_material_desc material = GPURT_MATERIAL_DESC_INIT;
    cases.push_back(
        CASE(gpurt_scene_add_material, gpurt_material_desc, GPURT_MATERIAL_DESC_INIT, material, [=](auto *d) {
          uint32_t id;
          return gpurt_scene_add_material(scene, d, &id);
        }));

    gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
    mesh.vertices.data = corners;
    mesh.vertices.count = 3;
    cases.push_back(CASE(gpurt_scene_add_mesh, gpurt_mesh_desc, GPURT_MESH_DESC_INIT, mesh, [=](auto *d) {
      uint32_t id;
      return gpurt_scene_add_mesh(scene, d, &id);
    }));

    gpurt_patches_desc patches = GPURT_PATCHES_DESC_INIT;
    patches.control_points.data = control_points;
    patches.control_points.count = 16;
    cases.push_back(
        CASE(gpurt_scene_add_patches, gpurt_patches_desc, GPURT_PATCHES_DESC_INIT, patches, [=](auto *d) {
          uint32_t id;
          return gpurt_scene_add_patches(scene, d, &id);
        }));

    const gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
    cases.push_back(
        CASE(gpurt_scene_add_instance, gpurt_instance_desc, GPURT_INSTANCE_DESC_INIT, instance, [=](auto *d) {
          uint32_t id;
          return gpurt_scene_add_instance(scene, d, &id);
        }));

    gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
    light.intensity[0] = 1;
    cases.push_back(CASE(gpurt_scene_add_light, gpurt_light_desc, GPURT_LIGHT_DESC_INIT, light, [=](auto *d) {
      uint32_t id;
      return gpurt_scene_add_light(scene, d, &id);
    }));

    const gpurt_environment_desc environment = GPURT_ENVIRONMENT_DESC_INIT;
    cases.push_back(CASE(gpurt_scene_set_environment, gpurt_environment_desc, GPURT_ENVIRONMENT_DESC_INIT,
                         environment, [=](auto *d) { return gpurt_scene_set_environment(scene, d); }));

    const gpurt_camera_desc camera = GPURT_CAMERA_DESC_INIT;
    cases.push_back(
        CASE(gpurt_scene_add_camera, gpurt_camera_desc, GPURT_CAMERA_DESC_INIT, camera, [=](auto *d) {
          uint32_t id;
          return gpurt_scene_add_camera(scene, d, &id);
        }));

    const gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
    cases.push_back(CASE(gpurt_scene_commit, gpurt_build_desc, GPURT_BUILD_DESC_INIT, build,
                         [=](auto *d) { return gpurt_scene_commit(scene, d); }));

    gpurt_trace_desc trace = GPURT_TRACE_DESC_INIT;
    trace.num_rays = 1;
    trace.rays = &ray;
    trace.hits = &hit;
    cases.push_back(CASE(gpurt_scene_trace, gpurt_trace_desc, GPURT_TRACE_DESC_INIT, trace,
                         [=](auto *d) { return gpurt_scene_trace(scene, d); }));

    const gpurt_locate_desc locate = GPURT_LOCATE_DESC_INIT;
    cases.push_back(CASE(gpurt_scene_locate, gpurt_locate_desc, GPURT_LOCATE_DESC_INIT, locate,
                         [=](auto *d) { return gpurt_scene_locate(scene, d); }));

    gpurt_photon_map_desc map_desc = GPURT_PHOTON_MAP_DESC_INIT;
    map_desc.num_points = 3;
    map_desc.positions = corners;
    map_desc.radius = 1;
    cases.push_back(CASE(gpurt_photon_map_create, gpurt_photon_map_desc, GPURT_PHOTON_MAP_DESC_INIT, map_desc,
                         [=](auto *d) {
                           gpurt_photon_map out = nullptr;
                           const gpurt_result result = gpurt_photon_map_create(device, d, &out);
                           if (out != nullptr) gpurt_photon_map_release(out);
                           return result;
                         }));

    gpurt_light_desc lamp = GPURT_LIGHT_DESC_INIT;
    lamp.intensity[0] = 1;
    uint32_t lamp_id;
    GPURT_EXPECT_OK(gpurt_scene_add_light(scene, &lamp, &lamp_id));
    GPURT_EXPECT_OK(gpurt_scene_commit(scene, nullptr));
    gpurt_photon_trace_desc photon_trace = GPURT_PHOTON_TRACE_DESC_INIT;
    photon_trace.num_paths = 64;
    cases.push_back(CASE(gpurt_photon_map_trace, gpurt_photon_trace_desc, GPURT_PHOTON_TRACE_DESC_INIT,
                         photon_trace, [=](auto *d) {
                           gpurt_photon_map out = nullptr;
                           const gpurt_result result = gpurt_photon_map_trace(scene, d, &out);
                           if (out != nullptr) gpurt_photon_map_release(out);
                           return result;
                         }));

    gpurt_photon_query_desc photons = GPURT_PHOTON_QUERY_DESC_INIT;
    photons.num_queries = 1;
    photons.positions = corners;
    photons.radius = 1;
    photons.counts = &count;
    cases.push_back(CASE(gpurt_photon_map_query, gpurt_photon_query_desc, GPURT_PHOTON_QUERY_DESC_INIT,
                         photons, [=](auto *d) {
                           gpurt_photon_map_desc of = GPURT_PHOTON_MAP_DESC_INIT;
                           gpurt_photon_map map = nullptr;
                           GPURT_EXPECT_OK(gpurt_photon_map_create(device, &of, &map));
                           const gpurt_result result = gpurt_photon_map_query(map, d);
                           gpurt_photon_map_release(map);  // which leaves the last error as it is
                           return result;
                         }));

    gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
    frame_desc.width = frame_desc.height = 8;
    cases.push_back(
        CASE(gpurt_frame_create, gpurt_frame_desc, GPURT_FRAME_DESC_INIT, frame_desc, [=](auto *d) {
          Frame out;
          return gpurt_frame_create(scene, d, out.out());
        }));

    gpurt_render_desc render = GPURT_RENDER_DESC_INIT;
    render.samples_per_pixel = 1;
    cases.push_back(CASE(gpurt_frame_submit, gpurt_render_desc, GPURT_RENDER_DESC_INIT, render, [=](auto *d) {
      Job out;
      return gpurt_frame_submit(frame, d, nullptr, 0, out.out());
    }));
    return cases;
  }

  World world;
  const unsigned char texel[4] = {255, 255, 255, 255};
  const float corners[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  const float control_points[48] = {};
  gpurt_ray ray = ray_at_triangle();
  gpurt_hit hit{};
  uint32_t count = 0;
};

void set_size(std::vector<unsigned char> &bytes, uint32_t size)
{
  std::memcpy(bytes.data(), &size, sizeof size);
}

TEST_F(Descriptors, OfTheLibrarysSizeAreRead)
{
  for (const Case &c : input_cases())
    EXPECT_EQ(c.call(c.bytes.data()), GPURT_OK) << c.name << ": " << gpurt_last_error();
}

TEST_F(Descriptors, MayBeAtAnyAddress)
{
  for (const Case &c : input_cases()) {
    std::vector<unsigned char> shifted(c.size + 1);
    std::memcpy(shifted.data() + 1, c.bytes.data(), c.size);
    EXPECT_EQ(c.call(shifted.data() + 1), GPURT_OK) << c.name << ": " << gpurt_last_error();
  }
}

// A newer caller that leaves its new fields alone.
TEST_F(Descriptors, LargerOnesWithAZeroTailAreRead)
{
  for (const Case &c : input_cases()) {
    for (const uint32_t extra : {4u, 8u, 200u}) {
      std::vector<unsigned char> bytes = c.bytes;
      bytes.resize(c.size + extra);
      set_size(bytes, c.size + extra);
      EXPECT_EQ(c.call(bytes.data()), GPURT_OK) << c.name << " + " << extra << ": " << gpurt_last_error();
    }
  }
}

TEST_F(Descriptors, LargerOnesThatUseUnknownFieldsAreRefused)
{
  for (const Case &c : input_cases()) {
    for (const uint32_t at : {0u, 7u, 15u}) {
      std::vector<unsigned char> bytes = c.bytes;
      bytes.resize(c.size + 16);
      set_size(bytes, c.size + 16);
      bytes[c.size + at] = 1;
      expect_invalid(c.struct_name, c.name, [&] { return c.call(bytes.data()); });
      const std::string text = gpurt_last_error();
      EXPECT_NE(text.find(std::to_string(c.size)), std::string::npos) << text;
      EXPECT_NE(text.find(std::to_string(c.size + 16)), std::string::npos) << text;
    }
  }
}

TEST_F(Descriptors, SizesThatNoVersionHasAreRefused)
{
  for (const Case &c : input_cases()) {
    for (const uint32_t size :
         {0u, 1u, 2u, 3u, 5u, c.size - 1, c.size + 1, 5000u, 0x7fffffffu, 0xfffffffcu, 0xffffffffu}) {
      std::vector<unsigned char> bytes = c.bytes;
      set_size(bytes, size);
      expect_invalid(c.init_macro, c.name + " with struct_size " + std::to_string(size),
                     [&] { return c.call(bytes.data()); });
    }
  }
}

// An older caller knows fewer fields. Its struct lies at the very end of its memory: a sanitizer sees what is read beyond.
// Whatever the outcome, it is a result; where only defaults are missing it is success.
TEST_F(Descriptors, SmallerOnesAreCompletedWithDefaults)
{
  for (const Case &c : input_cases()) {
    for (uint32_t size = 4; size < c.size; size += 4) {
      std::vector<unsigned char> bytes(c.bytes.begin(), c.bytes.begin() + size);
      bytes.shrink_to_fit();
      set_size(bytes, size);
      const gpurt_result result = c.call(bytes.data());
      EXPECT_TRUE(result == GPURT_OK || result == GPURT_ERROR_INVALID_ARGUMENT)
          << c.name << " " << size << ": " << gpurt_result_name(result) << ": " << gpurt_last_error();
    }
  }
}

TEST_F(Descriptors, SmallerOnesGiveTheSameAsDefaults)
{
  // Only type and base colour, as the first version of a caller might have known.
  gpurt_material_desc material = GPURT_MATERIAL_DESC_INIT;
  material.struct_size = offsetof(gpurt_material_desc, roughness);
  material.alpha_cutoff = -1;  // beyond the caller's size: not read
  material.base_color_texture = 99;
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(world.scene, &material, &id));

  gpurt_trace_desc trace = GPURT_TRACE_DESC_INIT;
  trace.struct_size = offsetof(gpurt_trace_desc, occluded);
  trace.num_rays = 1;
  trace.rays = &ray;
  trace.hits = &hit;
  trace.occluded = reinterpret_cast<uint8_t *>(1);
  GPURT_EXPECT_OK(gpurt_scene_trace(world.scene, &trace));
  EXPECT_EQ(hit.primitive, 0u);

  // A size in the middle of a pointer would leave half of it.
  trace.struct_size = offsetof(gpurt_trace_desc, hits) + 4;
  expect_invalid("cuts a field", "trace", [&] { return gpurt_scene_trace(world.scene, &trace); });
}

struct OutputCase {
  std::string name;
  uint32_t size;
  std::function<gpurt_result(void *)> call;
};

class Outputs : public Descriptors {
 protected:
  std::vector<OutputCase> cases()
  {
    return {{"properties", sizeof(gpurt_device_properties),
             [this](void *out) {
               return gpurt_device_get_properties(world.device, static_cast<gpurt_device_properties *>(out));
             }},
            {"facts", sizeof(gpurt_scene_facts),
             [this](void *out) {
               return gpurt_scene_get_facts(world.scene, static_cast<gpurt_scene_facts *>(out));
             }},
            {"camera", sizeof(gpurt_camera_desc),
             [this](void *out) {
               return gpurt_scene_get_camera(world.scene, 0, static_cast<gpurt_camera_desc *>(out));
             }},
            {"statistics", sizeof(gpurt_statistics), [this](void *out) {
               return gpurt_frame_get_statistics(world.frame, static_cast<gpurt_statistics *>(out));
             }}};
  }
};

TEST_F(Outputs, AreWrittenUpToTheCallersSize)
{
  for (const OutputCase &c : cases()) {
    std::vector<unsigned char> whole(c.size, 0xab);
    set_size(whole, c.size);
    GPURT_ASSERT_OK(c.call(whole.data()));
    for (uint32_t size = 4; size < c.size; size += 4) {
      std::vector<unsigned char> bytes(c.size + 16, 0xab);
      set_size(bytes, size);
      GPURT_ASSERT_OK(c.call(bytes.data()));
      uint32_t size_after;
      std::memcpy(&size_after, bytes.data(), 4);
      EXPECT_EQ(size_after, size) << c.name;
      EXPECT_EQ(std::memcmp(bytes.data() + 4, whole.data() + 4, size - 4), 0) << c.name << " " << size;
      for (uint32_t i = size; i < bytes.size(); ++i)
        ASSERT_EQ(bytes[i], 0xab) << c.name << " wrote past " << size;
    }
  }
}

TEST_F(Outputs, AreZeroWhereTheLibraryKnowsNothing)
{
  for (const OutputCase &c : cases()) {
    std::vector<unsigned char> bytes(c.size + 24, 0xab);
    set_size(bytes, c.size + 16);
    GPURT_ASSERT_OK(c.call(bytes.data()));
    for (uint32_t i = c.size; i < c.size + 16; ++i) EXPECT_EQ(bytes[i], 0) << c.name;
    for (uint32_t i = c.size + 16; i < c.size + 24; ++i) EXPECT_EQ(bytes[i], 0xab) << c.name;
  }
}

TEST_F(Outputs, WithoutASizeAreRefused)
{
  for (const OutputCase &c : cases()) {
    for (const uint32_t size : {0u, 3u, 6u, 9999u}) {
      std::vector<unsigned char> bytes(c.size, 0xab);
      set_size(bytes, size);
      expect_invalid("struct_size", c.name, [&] { return c.call(bytes.data()); });
      for (uint32_t i = 4; i < c.size; ++i) ASSERT_EQ(bytes[i], 0xab) << c.name;
    }
    expect_invalid("is NULL", c.name, [&] { return c.call(nullptr); });
  }
}

TEST_F(Outputs, OfEnumerationHaveTheCallersStride)
{
  uint32_t count = 0;
  GPURT_ASSERT_OK(gpurt_device_enumerate(nullptr, 0, &count));
  ASSERT_GE(count, 1u);
  std::vector<Larger<gpurt_device_properties>> devices(
      count, Larger<gpurt_device_properties>(gpurt_device_properties GPURT_DEVICE_PROPERTIES_INIT));
  uint32_t count_again = 0;
  GPURT_ASSERT_OK(gpurt_device_enumerate(&devices[0].ours, count, &count_again));
  EXPECT_EQ(count_again, count);
  EXPECT_EQ(devices[0].ours.type, GPURT_DEVICE_CPU);
  EXPECT_NE(devices[0].ours.name[0], 0);
  EXPECT_GT(devices[0].ours.num_threads, 0u);
  EXPECT_GT(devices[0].ours.memory_bytes, 0u);
  for (const auto &d : devices) EXPECT_EQ(d.ours.struct_size, sizeof d);

  gpurt_device_properties unset{};
  expect_invalid("struct_size", "enumerate", [&] { return gpurt_device_enumerate(&unset, 1, &count); });
  expect_invalid("out_count is NULL", "enumerate",
                 [&] { return gpurt_device_enumerate(nullptr, 0, nullptr); });
}

}  // namespace
