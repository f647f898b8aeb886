// Handles of every wrong kind, given to every function that takes one: a result and a text, never a crash.
#include <algorithm>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>

#include "abi_test.h"
#include "gpurt_cuda.h"

namespace {

using namespace gpurt_test;

template <class H>
struct Call {
  std::string function;
  std::function<gpurt_result(H)> call;
};

gpurt_trace_desc trace_desc(const gpurt_ray &ray, gpurt_hit &hit)
{
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.num_rays = 1;
  desc.rays = &ray;
  desc.hits = &hit;
  return desc;
}

// Arguments beside the handle are valid, so that it alone is what is wrong.
std::vector<Call<gpurt_device>> device_calls()
{
  return {
      {"gpurt_device_retain", gpurt_device_retain},
      {"gpurt_device_release", gpurt_device_release},
      {"gpurt_device_get_properties",
       [](gpurt_device h) {
         gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
         return gpurt_device_get_properties(h, &p);
       }},
      {"gpurt_buffer_create",
       [](gpurt_device h) {
         gpurt_buffer_desc d = GPURT_BUFFER_DESC_INIT;
         d.size_bytes = 16;
         gpurt_buffer out;
         return gpurt_buffer_create(h, &d, &out);
       }},
      {"gpurt_scene_create",
       [](gpurt_device h) {
         gpurt_scene out;
         return gpurt_scene_create(h, &out);
       }},
      {"gpurt_scene_load",
       [](gpurt_device h) {
         gpurt_scene out;
         return gpurt_scene_load(h, "no such file.glb", &out);
       }},
      {"gpurt_cuda_order", [](gpurt_device h) { return gpurt_cuda_order(h, 0, nullptr, nullptr); }},
      {"gpurt_cuda_get_kernels",
       [](gpurt_device h) {
         uint32_t count;
         return gpurt_cuda_get_kernels(h, nullptr, 0, &count);
       }},
      {"gpurt_photon_map_create",
       [](gpurt_device h) {
         const gpurt_photon_map_desc d = GPURT_PHOTON_MAP_DESC_INIT;
         gpurt_photon_map out;
         return gpurt_photon_map_create(h, &d, &out);
       }},
      {"gpurt_photon_map_load",
       [](gpurt_device h) {
         gpurt_photon_map out;
         return gpurt_photon_map_load(h, "none.gpurt", &out);
       }},
      {"gpurt_cuda_wait", [](gpurt_device h) { return gpurt_cuda_wait(h, 0, nullptr); }},
  };
}

std::vector<Call<gpurt_buffer>> buffer_calls()
{
  return {
      {"gpurt_buffer_retain", gpurt_buffer_retain},
      {"gpurt_buffer_release", gpurt_buffer_release},
      {"gpurt_buffer_get_data",
       [](gpurt_buffer h) {
         void *data;
         uint64_t size;
         return gpurt_buffer_get_data(h, &data, &size);
       }},
      {"gpurt_buffer_write",
       [](gpurt_buffer h) {
         const char data = 1;
         return gpurt_buffer_write(h, 0, &data, 1);
       }},
      {"gpurt_buffer_read",
       [](gpurt_buffer h) {
         char data;
         return gpurt_buffer_read(h, 0, &data, 1);
       }},
  };
}

gpurt_photon_map make_map(gpurt_device device)
{
  const gpurt_photon_map_desc d = GPURT_PHOTON_MAP_DESC_INIT;
  gpurt_photon_map map = nullptr;
  GPURT_EXPECT_OK(gpurt_photon_map_create(device, &d, &map));
  return map;
}

std::vector<Call<gpurt_photon_map>> photon_map_calls()
{
  return {
      {"gpurt_photon_map_retain", gpurt_photon_map_retain},
      {"gpurt_photon_map_release", gpurt_photon_map_release},
      {"gpurt_photon_map_get_info",
       [](gpurt_photon_map h) {
         gpurt_photon_map_info info = GPURT_PHOTON_MAP_INFO_INIT;
         return gpurt_photon_map_get_info(h, &info);
       }},
      {"gpurt_photon_map_read",
       [](gpurt_photon_map h) {
         float value;
         return gpurt_photon_map_read(h, GPURT_PHOTON_ATTRIBUTE_POSITION, &value, sizeof value);
       }},
      {"gpurt_photon_map_save", [](gpurt_photon_map h) { return gpurt_photon_map_save(h, "none.gpurt"); }},
      {"gpurt_photon_map_query",
       [](gpurt_photon_map h) {
         gpurt_photon_query_desc d = GPURT_PHOTON_QUERY_DESC_INIT;
         d.radius = 1;
         return gpurt_photon_map_query(h, &d);
       }},
      {"gpurt_cuda_query_photons",
       [](gpurt_photon_map h) {
         const gpurt_photon_query_desc d = GPURT_PHOTON_QUERY_DESC_INIT;
         return gpurt_cuda_query_photons(h, &d, nullptr, nullptr, nullptr);
       }},
  };
}

template <class Desc>
Call<gpurt_scene> adding(std::string function, gpurt_result (*add)(gpurt_scene, const Desc *, uint32_t *),
                         Desc desc)
{
  return {std::move(function), [=](gpurt_scene h) {
            uint32_t id;
            return add(h, &desc, &id);
          }};
}

std::vector<Call<gpurt_scene>> scene_calls()
{
  static const float texel[4] = {1, 1, 1, 1};
  gpurt_texture_desc texture = GPURT_TEXTURE_DESC_INIT;
  texture.format = GPURT_TEXTURE_RGBA32F;
  texture.width = texture.height = 1;
  texture.texels = texel;
  return {
      {"gpurt_scene_retain", gpurt_scene_retain},
      {"gpurt_scene_release", gpurt_scene_release},
      {"gpurt_photon_map_trace",
       [](gpurt_scene h) {
         gpurt_photon_map out;
         return gpurt_photon_map_trace(h, nullptr, &out);
       }},
      adding<gpurt_texture_desc>("gpurt_scene_add_texture", gpurt_scene_add_texture, texture),
      adding<gpurt_material_desc>("gpurt_scene_add_material", gpurt_scene_add_material,
                                  GPURT_MATERIAL_DESC_INIT),
      adding<gpurt_mesh_desc>("gpurt_scene_add_mesh", gpurt_scene_add_mesh, GPURT_MESH_DESC_INIT),
      adding<gpurt_patches_desc>("gpurt_scene_add_patches", gpurt_scene_add_patches, GPURT_PATCHES_DESC_INIT),
      adding<gpurt_subdivision_desc>("gpurt_scene_add_subdivision", gpurt_scene_add_subdivision,
                                     GPURT_SUBDIVISION_DESC_INIT),
      adding<gpurt_instance_desc>("gpurt_scene_add_instance", gpurt_scene_add_instance,
                                  GPURT_INSTANCE_DESC_INIT),
      adding<gpurt_light_desc>("gpurt_scene_add_light", gpurt_scene_add_light, GPURT_LIGHT_DESC_INIT),
      adding<gpurt_camera_desc>("gpurt_scene_add_camera", gpurt_scene_add_camera, GPURT_CAMERA_DESC_INIT),
      {"gpurt_scene_set_vertices",
       [](gpurt_scene h) {
         const gpurt_array none{};
         return gpurt_scene_set_vertices(h, 0, &none, nullptr);
       }},
      {"gpurt_scene_set_environment",
       [](gpurt_scene h) {
         const gpurt_environment_desc d = GPURT_ENVIRONMENT_DESC_INIT;
         return gpurt_scene_set_environment(h, &d);
       }},
      {"gpurt_scene_get_camera",
       [](gpurt_scene h) {
         gpurt_camera_desc d = GPURT_CAMERA_DESC_INIT;
         return gpurt_scene_get_camera(h, 0, &d);
       }},
      {"gpurt_scene_commit", [](gpurt_scene h) { return gpurt_scene_commit(h, nullptr); }},
      {"gpurt_scene_get_facts",
       [](gpurt_scene h) {
         gpurt_scene_facts f = GPURT_SCENE_FACTS_INIT;
         return gpurt_scene_get_facts(h, &f);
       }},
      {"gpurt_scene_export_tree",
       [](gpurt_scene h) {
         gpurt_kdtree t = GPURT_KDTREE_INIT;
         return gpurt_scene_export_tree(h, &t);
       }},
      {"gpurt_scene_import_tree",
       [](gpurt_scene h) {
         const gpurt_kdtree t = GPURT_KDTREE_INIT;
         return gpurt_scene_import_tree(h, &t);
       }},
      {"gpurt_scene_trace",
       [](gpurt_scene h) {
         const gpurt_ray ray = ray_at_triangle();
         gpurt_hit hit;
         const gpurt_trace_desc d = trace_desc(ray, hit);
         return gpurt_scene_trace(h, &d);
       }},
      {"gpurt_scene_locate",
       [](gpurt_scene h) {
         const gpurt_locate_desc d = GPURT_LOCATE_DESC_INIT;
         return gpurt_scene_locate(h, &d);
       }},
      {"gpurt_cuda_trace",
       [](gpurt_scene h) {
         const gpurt_ray ray = ray_at_triangle();
         gpurt_hit hit;
         const gpurt_trace_desc d = trace_desc(ray, hit);
         return gpurt_cuda_trace(h, &d, nullptr, nullptr, nullptr);
       }},
      {"gpurt_frame_create",
       [](gpurt_scene h) {
         gpurt_frame out;
         return gpurt_frame_create(h, nullptr, &out);
       }},
  };
}

std::vector<Call<gpurt_frame>> frame_calls(gpurt_frame valid)
{
  return {
      {"gpurt_frame_retain", gpurt_frame_retain},
      {"gpurt_frame_release", gpurt_frame_release},
      {"gpurt_frame_submit",
       [](gpurt_frame h) {
         gpurt_job out;
         return gpurt_frame_submit(h, nullptr, nullptr, 0, &out);
       }},
      {"gpurt_frame_read",
       [](gpurt_frame h) {
         float alpha[64];
         return gpurt_frame_read(h, GPURT_OUTPUT_ALPHA, alpha, sizeof alpha);
       }},
      {"gpurt_frame_save", [](gpurt_frame h) { return gpurt_frame_save(h, "/nowhere/x.exr"); }},
      {"gpurt_frame_merge", [valid](gpurt_frame h) { return gpurt_frame_merge(h, valid); }},
      {"gpurt_frame_merge", [valid](gpurt_frame h) { return gpurt_frame_merge(valid, h); }},
      {"gpurt_frame_load_state", [](gpurt_frame h) { return gpurt_frame_load_state(h, "/nowhere/x.gpurt"); }},
      {"gpurt_frame_get_statistics",
       [](gpurt_frame h) {
         gpurt_statistics s = GPURT_STATISTICS_INIT;
         return gpurt_frame_get_statistics(h, &s);
       }},
  };
}

std::vector<Call<gpurt_job>> job_calls()
{
  return {
      {"gpurt_job_wait", [](gpurt_job h) { return gpurt_job_wait(h, 0); }},
      {"gpurt_job_cancel", gpurt_job_cancel},
      {"gpurt_job_get_progress",
       [](gpurt_job h) {
         double share;
         return gpurt_job_get_progress(h, &share);
       }},
      {"gpurt_job_retain", gpurt_job_retain},
      {"gpurt_job_release", gpurt_job_release},
  };
}

// Values that are no handle: bit patterns and addresses.
std::vector<uintptr_t> foreign_values()
{
  static const int on_heap_and_stack = 0;
  std::vector<uintptr_t> values = {1,
                                   7,
                                   0xdeadbeef,
                                   UINTPTR_MAX,
                                   UINTPTR_MAX - 1,
                                   uintptr_t(1) << 63,
                                   reinterpret_cast<uintptr_t>(&on_heap_and_stack),
                                   reinterpret_cast<uintptr_t>(&values)};
  std::mt19937_64 random(1);
  for (int i = 0; i < 1000; ++i) values.push_back(random());
  return values;
}

// Bit flips of a live handle: other generations, slots, kinds and marks. None may be a live handle of the kind.
std::vector<uintptr_t> neighbours(uintptr_t live)
{
  std::vector<uintptr_t> values;
  for (int bit = 28; bit < 64; ++bit) values.push_back(live ^ uintptr_t(1) << bit);
  return values;
}

template <class H>
void expect_all_refuse(const std::vector<Call<H>> &calls, uintptr_t live, H stale,
                       const std::vector<std::pair<const char *, uintptr_t>> &others, const char *kind)
{
  for (const Call<H> &c : calls) {
    const auto with = [&](uintptr_t value) {
      return [&c, value] { return c.call(reinterpret_cast<H>(value)); };
    };
    expect_invalid("is NULL", c.function, with(0));
    expect_invalid(std::string("the ") + kind + " handle was released", c.function,
                   with(reinterpret_cast<uintptr_t>(stale)));
    for (const auto &[other_kind, value] : others) {
      expect_invalid(std::string("this is a ") + other_kind + " handle, a " + kind + " is needed", c.function,
                     with(value));
    }
    for (uintptr_t value : foreign_values()) expect_invalid("not a handle", c.function, with(value));
    for (uintptr_t value : neighbours(live)) expect_invalid("", c.function, with(value));
  }
}

class Handles : public testing::Test {
 protected:
  template <class H>
  static uintptr_t bits(H handle)
  {
    return reinterpret_cast<uintptr_t>(handle);
  }
  std::vector<std::pair<const char *, uintptr_t>> others(const std::string &kind)
  {
    std::vector<std::pair<const char *, uintptr_t>> all = {{"device", bits(gpurt_device(world.device))},
                                                           {"scene", bits(gpurt_scene(world.scene))},
                                                           {"frame", bits(gpurt_frame(world.frame))},
                                                           {"buffer", bits(gpurt_buffer(world.buffer))},
                                                           {"job", bits(gpurt_job(world.job))}};
    std::erase_if(all, [&](const auto &entry) { return entry.first == kind; });
    return all;
  }
  World world;
};

TEST_F(Handles, OfDevices)
{
  gpurt_device stale;
  {
    const Device d = make_device();
    stale = d;
  }
  expect_all_refuse(device_calls(), bits(gpurt_device(world.device)), stale, others("device"), "device");
}

TEST_F(Handles, OfBuffers)
{
  gpurt_buffer stale;
  {
    const Buffer b = World::make_buffer(world.device, 8);
    stale = b;
  }
  expect_all_refuse(buffer_calls(), bits(gpurt_buffer(world.buffer)), stale, others("buffer"), "buffer");
}

TEST_F(Handles, OfPhotonMaps)
{
  const gpurt_photon_map stale = make_map(world.device), live = make_map(world.device);
  GPURT_EXPECT_OK(gpurt_photon_map_release(stale));
  expect_all_refuse(photon_map_calls(), bits(live), stale, others("photon map"), "photon map");
  GPURT_EXPECT_OK(gpurt_photon_map_release(live));
}

TEST_F(Handles, OfScenes)
{
  gpurt_scene stale;
  {
    const Scene s = make_scene(world.device);
    stale = s;
  }
  expect_all_refuse(scene_calls(), bits(gpurt_scene(world.scene)), stale, others("scene"), "scene");
}

TEST_F(Handles, OfFrames)
{
  gpurt_frame stale;
  {
    const Frame f = make_frame(world.scene, {8, 8, 1});
    stale = f;
  }
  expect_all_refuse(frame_calls(world.frame), bits(gpurt_frame(world.frame)), stale, others("frame"),
                    "frame");
}

TEST_F(Handles, OfJobs)
{
  gpurt_job stale;
  {
    const Job j = World::submit(world.frame);
    stale = j;
  }
  expect_all_refuse(job_calls(), bits(gpurt_job(world.job)), stale, others("job"), "job");
}

// What the tables above leave out takes no handle.
TEST_F(Handles, EveryFunctionIsTested)
{
  std::set<std::string> tested = {"gpurt_version",          "gpurt_result_name",   "gpurt_last_error",
                                  "gpurt_device_enumerate", "gpurt_device_create", "gpurt_state_read_info"};
  const auto add = [&](const auto &calls) {
    for (const auto &c : calls) tested.insert(c.function);
  };
  add(device_calls());
  add(buffer_calls());
  add(photon_map_calls());
  add(scene_calls());
  add(frame_calls(world.frame));
  add(job_calls());
  for (const char *header : {"include/gpurt.h", "include/gpurt_cuda.h"}) {
    std::ifstream file(header);
    ASSERT_TRUE(file) << header;
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    const std::regex declaration(R"(\nGPURT_API [^;(]*?(gpurt_\w+)\()");
    size_t num_found = 0;
    for (std::sregex_iterator it(text.begin(), text.end(), declaration), end; it != end; ++it, ++num_found) {
      EXPECT_TRUE(tested.count((*it)[1])) << (*it)[1] << " has no test with wrong handles";
    }
    EXPECT_GT(num_found, 0u) << header;
  }
}

TEST(StateFiles, AreRefusedByName)
{
  gpurt_state_info info = GPURT_STATE_INFO_INIT;
  EXPECT_EQ(gpurt_state_read_info(nullptr, &info), GPURT_ERROR_INVALID_ARGUMENT);
  EXPECT_EQ(gpurt_state_read_info("include/gpurt.h", nullptr), GPURT_ERROR_INVALID_ARGUMENT);
  for (const char *path : {"no/such/file.gpurt", "include/gpurt.h"}) {
    EXPECT_EQ(gpurt_state_read_info(path, &info), GPURT_ERROR_IO);
    EXPECT_NE(std::string(gpurt_last_error()).find(path), std::string::npos) << gpurt_last_error();
  }
}

TEST(HandleReferences, ReleaseAsOftenAsRetain)
{
  gpurt_device device = nullptr;
  {
    gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
    desc.type = GPURT_DEVICE_CPU;
    GPURT_ASSERT_OK(gpurt_device_create(&desc, &device));
  }
  gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
  GPURT_EXPECT_OK(gpurt_device_retain(device));
  GPURT_EXPECT_OK(gpurt_device_retain(device));
  GPURT_EXPECT_OK(gpurt_device_release(device));
  GPURT_EXPECT_OK(gpurt_device_release(device));
  GPURT_EXPECT_OK(gpurt_device_get_properties(device, &p));
  GPURT_EXPECT_OK(gpurt_device_release(device));
  expect_invalid("was released", "properties", [&] { return gpurt_device_get_properties(device, &p); });
  expect_invalid("was released", "second release", [&] { return gpurt_device_release(device); });
  expect_invalid("was released", "retain", [&] { return gpurt_device_retain(device); });
}

// A slot is used again at once; its old handles stay stale all the same.
TEST(HandleReferences, StaleHandlesStayStale)
{
  const Device device = make_device();
  std::set<gpurt_scene> seen;
  for (int i = 0; i < 5000; ++i) {
    gpurt_scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(device, &scene));
    ASSERT_TRUE(seen.insert(scene).second) << "a handle was given out twice";
    GPURT_ASSERT_OK(gpurt_scene_release(scene));
  }
  for (gpurt_scene scene : seen) ASSERT_EQ(gpurt_scene_retain(scene), GPURT_ERROR_INVALID_ARGUMENT);
}

}  // namespace
