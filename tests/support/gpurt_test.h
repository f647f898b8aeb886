// What tests share: handles that release themselves, meshes made by code, rendering in one call. All through the C ABI.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "gpurt.h"

#define GPURT_EXPECT_OK(call) \
  do { \
    const gpurt_result gpurt_test_result = (call); \
    EXPECT_EQ(gpurt_test_result, GPURT_OK) << #call << ": " << gpurt_last_error(); \
  } while (0)
#define GPURT_ASSERT_OK(call) \
  do { \
    const gpurt_result gpurt_test_result = (call); \
    ASSERT_EQ(gpurt_test_result, GPURT_OK) << #call << ": " << gpurt_last_error(); \
  } while (0)

namespace gpurt_test {

template <class H, gpurt_result (*Release)(H)>
class Owned {
 public:
  Owned() = default;
  explicit Owned(H handle) : handle_(handle) {}
  Owned(Owned &&other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
  Owned &operator=(Owned &&other) noexcept
  {
    std::swap(handle_, other.handle_);
    return *this;
  }
  ~Owned()
  {
    if (handle_ != nullptr) Release(handle_);
  }
  operator H() const { return handle_; }
  H *out() { return &handle_; }

 private:
  H handle_ = nullptr;
};
using Device = Owned<gpurt_device, gpurt_device_release>;
using Scene = Owned<gpurt_scene, gpurt_scene_release>;
using Frame = Owned<gpurt_frame, gpurt_frame_release>;
using Job = Owned<gpurt_job, gpurt_job_release>;

inline Device make_device(gpurt_device_type type = GPURT_DEVICE_CPU, uint32_t threads = 0, uint64_t limit = 0)
{
  gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
  desc.type = type;
  desc.num_threads = threads;
  desc.memory_limit_bytes = limit;
  Device device;
  GPURT_EXPECT_OK(gpurt_device_create(&desc, device.out()));
  return device;
}

inline uint32_t num_cuda_devices()
{
  uint32_t count = 0, num_cuda = 0;
  if (gpurt_device_enumerate(nullptr, 0, &count) != GPURT_OK) return 0;
  std::vector<gpurt_device_properties> all(count, gpurt_device_properties GPURT_DEVICE_PROPERTIES_INIT);
  if (gpurt_device_enumerate(all.data(), count, &count) != GPURT_OK) return 0;
  for (const auto &p : all) num_cuda += p.type == GPURT_DEVICE_CUDA;
  return num_cuda;
}
inline bool has_cuda() { return num_cuda_devices() != 0; }

/// Several CUDA devices that work as one.
inline Device make_cuda_devices(const std::vector<uint32_t> &ordinals, uint64_t limit = 0)
{
  gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
  desc.type = GPURT_DEVICE_CUDA;
  desc.ordinals = ordinals.data();
  desc.num_ordinals = uint32_t(ordinals.size());
  desc.memory_limit_bytes = limit;
  Device device;
  GPURT_EXPECT_OK(gpurt_device_create(&desc, device.out()));
  return device;
}

struct Mesh {
  std::vector<std::array<float, 3>> vertices;
  std::vector<std::array<uint32_t, 3>> triangles;

  std::array<float, 3> corner(size_t triangle, int k) const { return vertices[triangles[triangle][k]]; }
  void append(const Mesh &other)
  {
    const uint32_t base = uint32_t(vertices.size());
    vertices.insert(vertices.end(), other.vertices.begin(), other.vertices.end());
    for (auto t : other.triangles) triangles.push_back({t[0] + base, t[1] + base, t[2] + base});
  }
  template <class F>
  Mesh &map(F &&f)
  {
    for (auto &v : vertices) v = f(v);
    return *this;
  }
};

/// Corners in order: counter-clockwise seen from the front.
inline Mesh quad(std::array<float, 3> a, std::array<float, 3> b, std::array<float, 3> c,
                 std::array<float, 3> d)
{
  return {{a, b, c, d}, {{0, 1, 2}, {0, 2, 3}}};
}

/// A closed sphere: an icosahedron divided `levels` times, vertices on the unit sphere, fronts outside.
inline Mesh icosphere(int levels)
{
  const float p = 1.6180339887f;
  Mesh m{{{-1, p, 0},
          {1, p, 0},
          {-1, -p, 0},
          {1, -p, 0},
          {0, -1, p},
          {0, 1, p},
          {0, -1, -p},
          {0, 1, -p},
          {p, 0, -1},
          {p, 0, 1},
          {-p, 0, -1},
          {-p, 0, 1}},
         {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
          {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
          {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}}};
  const auto unit = [](std::array<float, 3> v) {
    const double l = std::sqrt(double(v[0]) * v[0] + double(v[1]) * v[1] + double(v[2]) * v[2]);
    return std::array<float, 3>{float(v[0] / l), float(v[1] / l), float(v[2] / l)};
  };
  m.map(unit);
  for (int level = 0; level < levels; ++level) {
    std::map<std::pair<uint32_t, uint32_t>, uint32_t> middle;
    const auto split = [&](uint32_t a, uint32_t b) {
      const auto key = std::minmax(a, b);
      const auto [it, is_new] = middle.try_emplace({key.first, key.second}, uint32_t(m.vertices.size()));
      if (is_new) {
        const auto &u = m.vertices[a], &v = m.vertices[b];
        m.vertices.push_back(unit({(u[0] + v[0]) / 2, (u[1] + v[1]) / 2, (u[2] + v[2]) / 2}));
      }
      return it->second;
    };
    std::vector<std::array<uint32_t, 3>> next;
    for (const auto &t : m.triangles) {
      const uint32_t a = split(t[0], t[1]), b = split(t[1], t[2]), c = split(t[2], t[0]);
      next.push_back({t[0], a, c});
      next.push_back({t[1], b, a});
      next.push_back({t[2], c, b});
      next.push_back({a, b, c});
    }
    m.triangles = std::move(next);
  }
  return m;
}

inline uint32_t add_material(gpurt_scene scene, gpurt_material_type type, std::array<float, 3> color,
                             std::array<float, 3> emission = {0, 0, 0}, float roughness = 1)
{
  gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
  desc.type = type;
  desc.roughness = roughness;
  std::memcpy(desc.base_color, color.data(), sizeof desc.base_color);
  std::memcpy(desc.emission, emission.data(), sizeof desc.emission);
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &desc, &id));
  return id;
}

/// Adds the mesh and one instance of it; returns the geometry.
inline uint32_t add_mesh(gpurt_scene scene, const Mesh &mesh, uint32_t material = 0,
                         bool with_instance = true)
{
  gpurt_mesh_desc desc = GPURT_MESH_DESC_INIT;
  desc.material = material;
  desc.vertices.data = mesh.vertices.data();
  desc.vertices.count = mesh.vertices.size();
  desc.indices.data = mesh.triangles.data();
  desc.indices.count = mesh.triangles.size();
  uint32_t geometry = GPURT_INVALID_ID;
  GPURT_EXPECT_OK(gpurt_scene_add_mesh(scene, &desc, &geometry));
  if (with_instance) {
    gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
    instance.geometry = geometry;
    uint32_t id;
    GPURT_EXPECT_OK(gpurt_scene_add_instance(scene, &instance, &id));
  }
  return geometry;
}

inline void set_environment(gpurt_scene scene, float radiance)
{
  gpurt_environment_desc desc = GPURT_ENVIRONMENT_DESC_INIT;
  for (float &c : desc.radiance) c = radiance;
  GPURT_EXPECT_OK(gpurt_scene_set_environment(scene, &desc));
}

/// A camera at `eye` that looks along -z.
inline void add_camera(gpurt_scene scene, std::array<float, 3> eye, float yfov_rad)
{
  gpurt_camera_desc desc = GPURT_CAMERA_DESC_INIT;
  desc.yfov_rad = yfov_rad;
  for (int i = 0; i < 3; ++i) desc.transform[4 * i + 3] = eye[i];
  uint32_t id;
  GPURT_EXPECT_OK(gpurt_scene_add_camera(scene, &desc, &id));
}

inline void commit(gpurt_scene scene, gpurt_accel accel = GPURT_ACCEL_KDTREE,
                   gpurt_triangle_test test = GPURT_TRIANGLE_WATERTIGHT)
{
  gpurt_build_desc desc = GPURT_BUILD_DESC_INIT;
  desc.accel = accel;
  desc.triangle_test = test;
  GPURT_EXPECT_OK(gpurt_scene_commit(scene, &desc));
}

inline std::vector<gpurt_hit> trace_closest(gpurt_scene scene, const std::vector<gpurt_ray> &rays,
                                            gpurt_coherence coherence = GPURT_COHERENCE_AUTO)
{
  std::vector<gpurt_hit> hits(rays.size());
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.coherence = coherence;
  desc.num_rays = rays.size();
  desc.rays = rays.data();
  desc.hits = hits.data();
  GPURT_EXPECT_OK(gpurt_scene_trace(scene, &desc));
  return hits;
}

/// 1 for each ray that hits something, 0 for others; 2 stays where nothing was written.
inline std::vector<uint8_t> trace_any(gpurt_scene scene, const std::vector<gpurt_ray> &rays,
                                      gpurt_coherence coherence = GPURT_COHERENCE_AUTO)
{
  std::vector<uint8_t> occluded(rays.size(), 2);
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = GPURT_QUERY_ANY;
  desc.coherence = coherence;
  desc.num_rays = rays.size();
  desc.rays = rays.data();
  desc.occluded = occluded.data();
  GPURT_EXPECT_OK(gpurt_scene_trace(scene, &desc));
  return occluded;
}

struct RenderOptions {
  uint32_t width = 32, height = 32, spp = 64, max_depth = 0, tile_size = 0;
  uint64_t seed = 0;
  std::vector<gpurt_tile> tiles = {};
  gpurt_pipeline pipeline = GPURT_PIPELINE_PATH;
  gpurt_reyes_settings reyes = GPURT_REYES_SETTINGS_INIT;
};

inline Frame make_frame(gpurt_scene scene, const RenderOptions &o, uint32_t outputs = 0)
{
  gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
  desc.width = o.width;
  desc.height = o.height;
  desc.seed = o.seed;
  desc.outputs = outputs;
  Frame frame;
  GPURT_EXPECT_OK(gpurt_frame_create(scene, &desc, frame.out()));
  return frame;
}

inline void render(gpurt_frame frame, const RenderOptions &o)
{
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.pipeline = o.pipeline;
  desc.reyes = o.reyes;
  desc.samples_per_pixel = o.spp;
  desc.max_depth = o.max_depth;
  desc.tile_size = o.tile_size;
  Job job;
  GPURT_EXPECT_OK(gpurt_frame_submit(frame, &desc, o.tiles.empty() ? nullptr : o.tiles.data(), o.tiles.size(),
                                     job.out()));
  GPURT_EXPECT_OK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
}

inline std::vector<float> read_color(gpurt_frame frame, const RenderOptions &o)
{
  std::vector<float> color(size_t(o.width) * o.height * 3);
  GPURT_EXPECT_OK(gpurt_frame_read(frame, GPURT_OUTPUT_COLOR, color.data(), color.size() * sizeof(float)));
  return color;
}

inline double mean(const std::vector<float> &values)
{
  double sum = 0;
  for (float v : values) sum += v;
  return sum / double(values.size());
}

}  // namespace gpurt_test
