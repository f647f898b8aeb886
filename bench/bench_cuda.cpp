// Speed of a CUDA device: ray queries on rays that lie in its memory, and path tracing. One JSON line a case.
//
//   bench_cuda [--rays N] [--repeats N] [--only SUBSTRING]
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <string>
#include <vector>

#include "cuda_check.h"
#include "gpurt.h"
#include "random.h"

namespace {

struct Mesh {
  std::vector<Vec> vertices;
  std::vector<std::array<uint32_t, 3>> triangles;
};

/// A grid of n x n cells whose points a function places.
Mesh grid(uint32_t n, const std::function<Vec(float u, float v)> &point)
{
  Mesh m;
  for (uint32_t j = 0; j <= n; ++j) {
    for (uint32_t i = 0; i <= n; ++i) m.vertices.push_back(point(float(i) / float(n), float(j) / float(n)));
  }
  for (uint32_t j = 0; j < n; ++j) {
    for (uint32_t i = 0; i < n; ++i) {
      const uint32_t a = j * (n + 1) + i, b = a + 1, c = a + n + 1, d = c + 1;
      m.triangles.push_back({a, c, d});
      m.triangles.push_back({a, d, b});
    }
  }
  return m;
}

Mesh sphere(uint32_t n, Vec center, float radius, float bumps)
{
  return grid(n, [=](float u, float v) {
    const float phi = 6.2831853f * u, theta = 3.1415927f * v;
    const float r = radius * (1 + bumps * std::sin(40 * phi) * std::sin(40 * theta));
    return Vec{center[0] + r * std::sin(theta) * std::cos(phi), center[1] + r * std::cos(theta),
               center[2] + r * std::sin(theta) * std::sin(phi)};
  });
}

Mesh terrain(uint32_t n)
{
  return grid(n, [](float u, float v) {
    float y = 0, a = 0.25f, f = 3;
    for (int octave = 0; octave < 8; ++octave, a *= 0.5f, f *= 2.1f)
      y += a * std::sin(f * u * 6.3f + 1.7f * f) * std::cos(f * v * 5.9f - f);
    return Vec{8 * (u - 0.5f), y, 8 * (v - 0.5f)};
  });
}

void add_mesh(gpurt_scene scene, const Mesh &mesh, uint32_t material,
              const std::vector<std::array<float, 12>> &places)
{
  gpurt_mesh_desc desc = GPURT_MESH_DESC_INIT;
  desc.material = material;
  desc.vertices.data = mesh.vertices.data();
  desc.vertices.count = mesh.vertices.size();
  desc.indices.data = mesh.triangles.data();
  desc.indices.count = mesh.triangles.size();
  uint32_t id;
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  check(gpurt_scene_add_mesh(scene, &desc, &instance.geometry), "gpurt_scene_add_mesh");
  for (const auto &t : places) {
    std::memcpy(instance.transform, t.data(), sizeof instance.transform);
    check(gpurt_scene_add_instance(scene, &instance, &id), "gpurt_scene_add_instance");
  }
}

constexpr std::array<float, 12> identity{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

uint32_t add_material(gpurt_scene scene, gpurt_material_type type, Vec color, Vec emission, float roughness)
{
  gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
  desc.type = type;
  desc.roughness = roughness;
  std::copy(color.begin(), color.end(), desc.base_color);
  std::copy(emission.begin(), emission.end(), desc.emission);
  uint32_t id;
  check(gpurt_scene_add_material(scene, &desc, &id), "gpurt_scene_add_material");
  return id;
}

struct Case {
  const char *name;
  void (*fill)(gpurt_scene);
};

// 1.0 million triangles of even size.
void fill_sphere(gpurt_scene scene) { add_mesh(scene, sphere(720, {0, 0, 0}, 1, 0.02f), 0, {identity}); }
// 2.0 million triangles with much in the way of slanting rays.
void fill_terrain(gpurt_scene scene) { add_mesh(scene, terrain(1000), 0, {identity}); }
// Instances: 400 times 20,000 triangles on a plane.
void fill_instances(gpurt_scene scene)
{
  std::vector<std::array<float, 12>> places;
  Random random(1);
  for (int i = 0; i < 400; ++i) {
    const float s = random.between(0.1f, 0.3f);
    places.push_back({s, 0, 0, random.between(-4, 4), 0, s, 0, s, 0, 0, s, random.between(-4, 4)});
  }
  add_mesh(scene, sphere(100, {0, 0, 0}, 1, 0.05f), 0, places);
  add_mesh(scene, grid(2, [](float u, float v) { return Vec{10 * (u - 0.5f), 0, 10 * (v - 0.5f)}; }), 0,
           {identity});
}
// A closed room with spheres of each material and one lamp.
void fill_room(gpurt_scene scene)
{
  const uint32_t white = add_material(scene, GPURT_MATERIAL_LAMBERT, {0.7f, 0.7f, 0.7f}, {0, 0, 0}, 1);
  const uint32_t lamp = add_material(scene, GPURT_MATERIAL_LAMBERT, {0, 0, 0}, {15, 15, 15}, 1);
  const uint32_t others[] = {white,
                             add_material(scene, GPURT_MATERIAL_MIRROR, {0.9f, 0.9f, 0.9f}, {0, 0, 0}, 1),
                             add_material(scene, GPURT_MATERIAL_GLASS, {1, 1, 1}, {0, 0, 0}, 1),
                             add_material(scene, GPURT_MATERIAL_METAL, {1, 0.7f, 0.3f}, {0, 0, 0}, 0.3f)};
  const auto wall = [&](Vec o, Vec u, Vec v, uint32_t material) {
    add_mesh(scene,
             grid(1,
                  [=](float s, float t) {
                    return Vec{o[0] + s * u[0] + t * v[0], o[1] + s * u[1] + t * v[1],
                               o[2] + s * u[2] + t * v[2]};
                  }),
             material, {identity});
  };
  wall({-2, 0, -2}, {4, 0, 0}, {0, 0, 4}, white);
  wall({-2, 3, -2}, {0, 0, 4}, {4, 0, 0}, white);
  wall({-2, 0, -2}, {0, 3, 0}, {4, 0, 0}, white);
  wall({-2, 0, 2}, {4, 0, 0}, {0, 3, 0}, white);
  wall({-2, 0, -2}, {0, 0, 4}, {0, 3, 0}, white);
  wall({2, 0, -2}, {0, 3, 0}, {0, 0, 4}, white);
  wall({-0.4f, 2.98f, -0.4f}, {0, 0, 0.8f}, {0.8f, 0, 0}, lamp);
  for (int i = 0; i < 4; ++i)
    add_mesh(scene, sphere(150, {-1.2f + 0.8f * float(i), 0.4f, -0.4f * float(i % 2)}, 0.38f, 0), others[i],
             {identity});
  gpurt_camera_desc camera = GPURT_CAMERA_DESC_INIT;
  camera.yfov_rad = 0.9f;
  camera.transform[7] = 1.3f;
  camera.transform[11] = 1.9f;
  uint32_t id;
  check(gpurt_scene_add_camera(scene, &camera, &id), "gpurt_scene_add_camera");
}

// Rays of a camera, from points in the scene in all directions, and towards a lamp.
enum class Rays { Eye, Diffuse, Shadow };
const char *const ray_names[] = {"eye", "diffuse", "shadow"};

std::vector<gpurt_ray> make_rays(gpurt_scene scene, Rays kind, uint64_t count)
{
  gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
  check(gpurt_scene_get_facts(scene, &facts), "gpurt_scene_get_facts");
  const float *lo = facts.bounds_min, *hi = facts.bounds_max;
  const Vec size{hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2]};
  const Vec center{lo[0] + size[0] / 2, lo[1] + size[1] / 2, lo[2] + size[2] / 2};
  const Vec eye{center[0] + 0.4f * size[0], center[1] + 0.7f * std::max(size[0], size[1]),
                center[2] + 0.7f * size[2]};
  std::vector<gpurt_ray> rays(count);
  const uint64_t width = uint64_t(std::sqrt(double(count)));
  for (uint64_t i = 0; i < count; ++i) {
    const float x = float(i % width) / float(width) - 0.5f,
                y = float(i / width % width) / float(width) - 0.5f;
    const Vec target{center[0] + x * size[0], center[1], center[2] + y * size[2]};
    rays[i] = {
        {eye[0], eye[1], eye[2]}, 0, {target[0] - eye[0], target[1] - eye[1], target[2] - eye[2]}, INFINITY};
  }
  if (kind == Rays::Eye) return rays;
  // From what the eye sees, just off the surface.
  std::vector<gpurt_hit_compact> hits(count);
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.format = GPURT_HIT_COMPACT;
  desc.num_rays = count;
  desc.rays = rays.data();
  desc.hits = hits.data();
  check(gpurt_scene_trace(scene, &desc), "gpurt_scene_trace");
  Random random(9);
  for (uint64_t i = 0; i < count; ++i) {
    gpurt_ray &r = rays[i];
    const float t = (hits[i].primitive != GPURT_INVALID_ID ? hits[i].t : 1.0f) * 0.9999f;
    for (int k = 0; k < 3; ++k) r.origin[k] += t * r.direction[k];
    const Vec d = random.direction();
    const Vec lamp{center[0] - size[0], center[1] + size[0], center[2]};
    for (int k = 0; k < 3; ++k)
      r.direction[k] = kind == Rays::Diffuse ? d[k] : lamp[k] + 0.1f * d[k] - r.origin[k];
    if (kind == Rays::Shadow) r.tmax = 1;
  }
  return rays;
}

double seconds_of(const std::function<void()> &work)
{
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

struct Options {
  uint64_t num_rays = uint64_t(1) << 23;
  int repeats = 7;
  std::string only;
};

struct AccelCase {
  const char *name;
  gpurt_accel accel;
};
constexpr AccelCase accels[] = {{"kdtree", GPURT_ACCEL_KDTREE}, {"bvh", GPURT_ACCEL_BVH}};

void commit(gpurt_scene scene, gpurt_accel accel)
{
  gpurt_build_desc desc = GPURT_BUILD_DESC_INIT;
  desc.accel = accel;
  check(gpurt_scene_commit(scene, &desc), "gpurt_scene_commit");
}

void bench_queries(gpurt_device device, const std::string &device_name, const Case &content,
                   const AccelCase &accel, const Options &options)
{
  gpurt_scene scene;
  check(gpurt_scene_create(device, &scene), "gpurt_scene_create");
  content.fill(scene);
  const double commit_seconds = seconds_of([&] { commit(scene, accel.accel); });
  gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
  check(gpurt_scene_get_facts(scene, &facts), "gpurt_scene_get_facts");
  void *d_rays, *d_hits;
  check(cudaMalloc(&d_rays, options.num_rays * sizeof(gpurt_ray)), "cudaMalloc");
  check(cudaMalloc(&d_hits, options.num_rays * sizeof(gpurt_hit_compact)), "cudaMalloc");
  for (Rays kind : {Rays::Eye, Rays::Diffuse, Rays::Shadow}) {
    const std::vector<gpurt_ray> rays = make_rays(scene, kind, options.num_rays);
    check(cudaMemcpy(d_rays, rays.data(), rays.size() * sizeof(gpurt_ray), cudaMemcpyHostToDevice),
          "cudaMemcpy");
    std::vector<gpurt_hit_compact> hits(rays.size());
    for (bool on_device : {true, false}) {
      if (!on_device && kind != Rays::Eye) continue;
      gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
      desc.query = kind == Rays::Shadow ? GPURT_QUERY_ANY : GPURT_QUERY_CLOSEST;
      desc.format = GPURT_HIT_COMPACT;
      desc.storage = on_device ? GPURT_STORAGE_DEVICE : GPURT_STORAGE_HOST;
      desc.num_rays = rays.size();
      desc.rays = on_device ? static_cast<const gpurt_ray *>(d_rays) : rays.data();
      if (kind == Rays::Shadow) desc.occluded = static_cast<uint8_t *>(d_hits);
      else desc.hits = on_device ? d_hits : hits.data();
      const auto trace = [&] { check(gpurt_scene_trace(scene, &desc), "gpurt_scene_trace"); };
      for (int i = 0; i < 3; ++i) trace();  // warms up, and lets the size of launches settle
      std::vector<double> times;
      for (int i = 0; i < options.repeats; ++i) times.push_back(seconds_of(trace));
      const double m = median(times), fastest = *std::min_element(times.begin(), times.end());
      std::printf(
          "{\"bench\": \"cuda_trace\", \"device\": \"%s\", \"scene\": \"%s\", \"accel\": \"%s\", "
          "\"triangles\": %llu, \"rays\": \"%s\", "
          "\"query\": \"%s\", \"memory\": \"%s\", \"num_rays\": %llu, \"mrays_per_s\": %.1f, "
          "\"best_mrays_per_s\": %.1f, "
          "\"commit_s\": %.3f, \"accel_bytes\": %llu}\n",
          device_name.c_str(), content.name, accel.name, (unsigned long long)facts.num_world_triangles,
          ray_names[int(kind)], kind == Rays::Shadow ? "any" : "closest", on_device ? "device" : "host",
          (unsigned long long)rays.size(), double(rays.size()) / m * 1e-6,
          double(rays.size()) / fastest * 1e-6, commit_seconds, (unsigned long long)facts.accel_bytes);
      std::fflush(stdout);
    }
  }
  check(cudaFree(d_rays), "cudaFree");
  check(cudaFree(d_hits), "cudaFree");
  check(gpurt_scene_release(scene), "gpurt_scene_release");
}

void bench_paths(gpurt_device device, const std::string &device_name, uint32_t width, uint32_t height,
                 uint32_t spp, const AccelCase &accel, const Options &options)
{
  gpurt_scene scene;
  check(gpurt_scene_create(device, &scene), "gpurt_scene_create");
  fill_room(scene);
  commit(scene, accel.accel);
  std::vector<double> times;
  gpurt_statistics s = GPURT_STATISTICS_INIT;
  for (int i = 0; i <= options.repeats / 2; ++i) {
    gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
    frame_desc.width = width;
    frame_desc.height = height;
    gpurt_frame frame;
    check(gpurt_frame_create(scene, &frame_desc, &frame), "gpurt_frame_create");
    gpurt_render_desc render = GPURT_RENDER_DESC_INIT;
    render.samples_per_pixel = spp;
    const double seconds = seconds_of([&] {
      gpurt_job job;
      check(gpurt_frame_submit(frame, &render, nullptr, 0, &job), "gpurt_frame_submit");
      check(gpurt_job_wait(job, GPURT_WAIT_FOREVER), "gpurt_job_wait");
      check(gpurt_job_release(job), "gpurt_job_release");
    });
    if (i > 0) times.push_back(seconds);  // the first one warms up
    check(gpurt_frame_get_statistics(frame, &s), "gpurt_frame_get_statistics");
    check(gpurt_frame_release(frame), "gpurt_frame_release");
  }
  const double m = median(times);
  const double num_rays = double(s.num_camera_rays + s.num_bounce_rays + s.num_shadow_rays);
  std::printf(
      "{\"bench\": \"cuda_path\", \"device\": \"%s\", \"scene\": \"room\", \"accel\": \"%s\", "
      "\"width\": %u, \"height\": %u, "
      "\"spp\": %u, "
      "\"seconds\": %.4f, \"msamples_per_s\": %.2f, \"mrays_per_s\": %.1f, \"rays_per_sample\": %.2f, "
      "\"generate_s\": %.4f, "
      "\"trace_s\": %.4f, \"shade_s\": %.4f, \"shadow_s\": %.4f, \"film_s\": %.4f, \"memory_peak_bytes\": "
      "%llu}\n",
      device_name.c_str(), accel.name, width, height, spp, m, double(s.num_samples) / m * 1e-6,
      num_rays / m * 1e-6, num_rays / double(s.num_samples), s.generate_seconds, s.trace_seconds,
      s.shade_seconds, s.shadow_seconds, s.film_seconds, (unsigned long long)s.memory_peak_bytes);
  std::fflush(stdout);
  check(gpurt_scene_release(scene), "gpurt_scene_release");
}

}  // namespace

int main(int argc, char **argv)
{
  Options options;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string name = argv[i];
    if (name == "--rays") options.num_rays = std::strtoull(argv[i + 1], nullptr, 10);
    else if (name == "--repeats") options.repeats = std::max(2, std::atoi(argv[i + 1]));
    else if (name == "--only") options.only = argv[i + 1];
    else {
      std::fprintf(stderr, "usage: bench_cuda [--rays N] [--repeats N] [--only SUBSTRING]\n");
      return 2;
    }
  }
  if (!is_cuda_there()) return 0;
  const gpurt_device device = create_cuda_device();
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  check(gpurt_device_get_properties(device, &properties), "gpurt_device_get_properties");
  const auto wanted = [&](const std::string &name) { return name.find(options.only) != std::string::npos; };
  const Case cases[] = {
      {"sphere", fill_sphere}, {"terrain", fill_terrain}, {"instances", fill_instances}, {"room", fill_room}};
  for (const AccelCase &accel : accels) {
    for (const Case &c : cases) {
      if (wanted(c.name)) bench_queries(device, properties.name, c, accel, options);
    }
    if (wanted("path")) {
      bench_paths(device, properties.name, 512, 512, 64, accel, options);
      bench_paths(device, properties.name, 1920, 1080, 64, accel, options);
      bench_paths(device, properties.name, 1920, 1080, 4, accel, options);
    }
  }
  check(gpurt_device_release(device), "gpurt_device_release");
  return 0;
}
