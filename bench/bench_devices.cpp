// How much faster several CUDA devices render a frame than one: the same frame on the first device and on all of them,
// taking turns. One JSON line a case.
//
//   bench_devices [--width N] [--height N] [--spp N] [--repeats N] [--spheres N]
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "check.h"
#include "gpurt.h"

namespace {

struct Options {
  uint32_t width = 1920, height = 1080, spp = 512, repeats = 5, spheres = 24;
};

using Vec = std::array<float, 3>;

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

void add_mesh(gpurt_scene scene, const std::vector<Vec> &vertices,
              const std::vector<std::array<uint32_t, 3>> &triangles, uint32_t material)
{
  gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
  mesh.material = material;
  mesh.vertices.data = vertices.data();
  mesh.vertices.count = vertices.size();
  mesh.indices.data = triangles.data();
  mesh.indices.count = triangles.size();
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  uint32_t id;
  check(gpurt_scene_add_mesh(scene, &mesh, &instance.geometry), "gpurt_scene_add_mesh");
  check(gpurt_scene_add_instance(scene, &instance, &id), "gpurt_scene_add_instance");
}

void add_sphere(gpurt_scene scene, Vec center, float radius, uint32_t material)
{
  constexpr uint32_t n = 160;
  std::vector<Vec> vertices;
  std::vector<std::array<uint32_t, 3>> triangles;
  for (uint32_t j = 0; j <= n; ++j) {
    for (uint32_t i = 0; i <= n; ++i) {
      const float phi = 6.2831853f * float(i) / float(n), theta = 3.1415927f * float(j) / float(n);
      const float r = radius * (1 + 0.01f * std::sin(20 * phi) * std::sin(20 * theta));
      vertices.push_back({center[0] + r * std::sin(theta) * std::cos(phi), center[1] + r * std::cos(theta),
                          center[2] + r * std::sin(theta) * std::sin(phi)});
    }
  }
  for (uint32_t j = 0; j < n; ++j) {
    for (uint32_t i = 0; i < n; ++i) {
      const uint32_t a = j * (n + 1) + i, b = a + 1, c = a + n + 1, d = c + 1;
      triangles.push_back({a, d, c});
      triangles.push_back({a, b, d});
    }
  }
  add_mesh(scene, vertices, triangles, material);
}

// A room with spheres of every material in one half: work that is unevenly spread over the picture.
gpurt_scene make_scene(gpurt_device device, uint32_t num_spheres)
{
  gpurt_scene scene;
  check(gpurt_scene_create(device, &scene), "gpurt_scene_create");
  const uint32_t white = add_material(scene, GPURT_MATERIAL_LAMBERT, {0.7f, 0.7f, 0.7f}, {0, 0, 0}, 1);
  const uint32_t lamp = add_material(scene, GPURT_MATERIAL_LAMBERT, {0, 0, 0}, {15, 15, 15}, 1);
  const uint32_t materials[] = {white,
                                add_material(scene, GPURT_MATERIAL_MIRROR, {0.9f, 0.9f, 0.9f}, {0, 0, 0}, 1),
                                add_material(scene, GPURT_MATERIAL_GLASS, {1, 1, 1}, {0, 0, 0}, 1),
                                add_material(scene, GPURT_MATERIAL_METAL, {1, 0.7f, 0.3f}, {0, 0, 0}, 0.3f)};
  const auto wall = [&](Vec o, Vec u, Vec v, uint32_t material) {
    std::vector<Vec> corners(4);
    for (int k = 0; k < 3; ++k) {
      corners[0][k] = o[k];
      corners[1][k] = o[k] + u[k];
      corners[2][k] = o[k] + u[k] + v[k];
      corners[3][k] = o[k] + v[k];
    }
    add_mesh(scene, corners, {{0, 1, 2}, {0, 2, 3}}, material);
  };
  wall({-2, 0, -2}, {0, 0, 4}, {4, 0, 0}, white);
  wall({-2, 3, -2}, {4, 0, 0}, {0, 0, 4}, white);
  wall({-2, 0, -2}, {4, 0, 0}, {0, 3, 0}, white);
  wall({-2, 0, -2}, {0, 3, 0}, {0, 0, 4}, white);
  wall({2, 0, -2}, {0, 0, 4}, {0, 3, 0}, white);
  wall({-0.4f, 2.98f, -0.4f}, {0.8f, 0, 0}, {0, 0, 0.8f}, lamp);
  for (uint32_t i = 0; i < num_spheres; ++i) {
    const float x = -1.6f + 0.35f * float(i % 10), y = 0.25f + 0.4f * float(i / 10),
                z = -0.8f - 0.3f * float(i % 3);
    add_sphere(scene, {x, y, z}, 0.16f, materials[i % 4]);
  }
  gpurt_camera_desc camera = GPURT_CAMERA_DESC_INIT;
  camera.yfov_rad = 0.9f;
  camera.transform[7] = 1.3f;
  camera.transform[11] = 1.9f;
  uint32_t id;
  check(gpurt_scene_add_camera(scene, &camera, &id), "gpurt_scene_add_camera");
  return scene;
}

struct Rendering {
  double seconds;
  std::vector<float> color;
  gpurt_statistics statistics;
};

Rendering render(gpurt_scene scene, const Options &options)
{
  gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
  frame_desc.width = options.width;
  frame_desc.height = options.height;
  gpurt_frame frame;
  check(gpurt_frame_create(scene, &frame_desc, &frame), "gpurt_frame_create");
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.samples_per_pixel = options.spp;
  gpurt_job job;
  const double start = now();
  check(gpurt_frame_submit(frame, &desc, nullptr, 0, &job), "gpurt_frame_submit");
  check(gpurt_job_wait(job, GPURT_WAIT_FOREVER), "gpurt_job_wait");
  Rendering r{now() - start, std::vector<float>(size_t(options.width) * options.height * 3),
              GPURT_STATISTICS_INIT};
  check(gpurt_frame_read(frame, GPURT_OUTPUT_COLOR, r.color.data(), r.color.size() * sizeof(float)),
        "gpurt_frame_read");
  check(gpurt_frame_get_statistics(frame, &r.statistics), "gpurt_frame_get_statistics");
  gpurt_job_release(job);
  gpurt_frame_release(frame);
  return r;
}

}  // namespace

int main(int argc, char **argv)
{
  Options options;
  for (int i = 1; i < argc; i += 2) {
    const std::string name = argv[i];
    uint32_t *const value = name == "--width"     ? &options.width
                            : name == "--height"  ? &options.height
                            : name == "--spp"     ? &options.spp
                            : name == "--repeats" ? &options.repeats
                            : name == "--spheres" ? &options.spheres
                                                  : nullptr;
    if (value == nullptr || i + 1 == argc) {
      std::fprintf(stderr,
                   "usage: bench_devices [--width N] [--height N] [--spp N] [--repeats N] [--spheres N]\n");
      return 2;
    }
    *value = uint32_t(std::strtoul(argv[i + 1], nullptr, 10));
  }
  options.repeats = std::max(options.repeats, 1u);

  uint32_t count = 0;
  check(gpurt_device_enumerate(nullptr, 0, &count), "gpurt_device_enumerate");
  std::vector<gpurt_device_properties> all(count, gpurt_device_properties GPURT_DEVICE_PROPERTIES_INIT);
  check(gpurt_device_enumerate(all.data(), count, &count), "gpurt_device_enumerate");
  std::vector<uint32_t> ordinals;
  for (const auto &p : all) {
    if (p.type == GPURT_DEVICE_CUDA) ordinals.push_back(p.ordinal);
  }
  if (ordinals.size() < 2) {
    std::fprintf(stderr, "%zu CUDA devices: nothing to compare\n", ordinals.size());
    return 0;
  }

  // Every number of devices that is a power of two, and all of them.
  std::vector<size_t> sizes;
  for (size_t n = 1; n < ordinals.size(); n *= 2) sizes.push_back(n);
  sizes.push_back(ordinals.size());
  std::vector<gpurt_device> devices(sizes.size());
  std::vector<gpurt_scene> scenes(sizes.size());
  std::vector<double> commit_seconds(sizes.size());
  for (size_t k = 0; k < sizes.size(); ++k) {
    gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
    desc.type = GPURT_DEVICE_CUDA;
    desc.ordinals = ordinals.data();
    desc.num_ordinals = uint32_t(sizes[k]);
    check(gpurt_device_create(&desc, &devices[k]), "gpurt_device_create");
    scenes[k] = make_scene(devices[k], options.spheres);
    const double start = now();
    check(gpurt_scene_commit(scenes[k], nullptr), "gpurt_scene_commit");
    commit_seconds[k] = now() - start;
  }
  std::vector<std::vector<double>> seconds(sizes.size());
  std::vector<Rendering> last(sizes.size());
  for (uint32_t round = 0; round <= options.repeats; ++round) {
    for (size_t k = 0; k < sizes.size(); ++k) {
      last[k] = render(scenes[k], options);
      if (round > 0) seconds[k].push_back(last[k].seconds);  // the first round warms up
    }
  }
  bool same = true;
  for (size_t k = 0; k < sizes.size(); ++k) {
    const bool same_bits =
        std::memcmp(last[k].color.data(), last[0].color.data(), last[0].color.size() * sizeof(float)) == 0;
    same = same && same_bits;
    const double m = median(seconds[k]);
    const gpurt_statistics &s = last[k].statistics;
    gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
    check(gpurt_device_get_properties(devices[k], &p), "gpurt_device_get_properties");
    std::printf(
        "{\"bench\": \"devices\", \"device\": \"%s\", \"num_devices\": %zu, \"width\": %u, \"height\": %u, "
        "\"spp\": %u, "
        "\"seconds\": %.4f, \"seconds_min\": %.4f, \"seconds_max\": %.4f, \"speedup\": %.3f, \"same_bits\": "
        "%s, "
        "\"msamples_per_s\": %.1f, \"commit_s\": %.3f, \"memory_peak_bytes\": %llu}\n",
        p.name, sizes[k], options.width, options.height, options.spp, m,
        *std::min_element(seconds[k].begin(), seconds[k].end()),
        *std::max_element(seconds[k].begin(), seconds[k].end()), median(seconds[0]) / m,
        same_bits ? "true" : "false", double(s.num_samples) / m * 1e-6, commit_seconds[k],
        (unsigned long long)p.memory_peak_bytes);
    std::fflush(stdout);
  }
  for (size_t k = 0; k < sizes.size(); ++k) {
    gpurt_scene_release(scenes[k]);
    gpurt_device_release(devices[k]);
  }
  return same ? 0 : 1;
}
