// Building bvhs on a CUDA device: milliseconds and memory, and how fast rays go through the tree, beside the tree that the
// host builds for the same triangles. One JSON line a scene and builder.
//
//   bench_cuda_build [--rays N] [--repeats N] [--only SUBSTRING] [--tris FILE] [--limit BYTES]
//
// FILE: float32 [n][3][3], native byte order.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
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

void add_grid(Mesh &m, uint32_t columns, uint32_t rows, const std::function<Vec(float u, float v)> &point)
{
  const uint32_t first = uint32_t(m.vertices.size());
  for (uint32_t j = 0; j <= rows; ++j) {
    for (uint32_t i = 0; i <= columns; ++i)
      m.vertices.push_back(point(float(i) / float(columns), float(j) / float(rows)));
  }
  for (uint32_t j = 0; j < rows; ++j) {
    for (uint32_t i = 0; i < columns; ++i) {
      const uint32_t a = first + j * (columns + 1) + i, b = a + 1, c = a + columns + 1, d = c + 1;
      m.triangles.push_back({a, c, d});
      m.triangles.push_back({a, d, b});
    }
  }
}

void add_sphere(Mesh &m, uint32_t n, Vec center, float radius, float bumps)
{
  add_grid(m, n, n, [=](float u, float v) {
    const float phi = 6.2831853f * u, theta = 3.1415927f * v;
    const float r = radius * (1 + bumps * std::sin(40 * phi) * std::sin(40 * theta) +
                              0.1f * bumps * std::sin(300 * phi) * std::sin(250 * theta));
    return Vec{center[0] + r * std::sin(theta) * std::cos(phi), center[1] + r * std::cos(theta),
               center[2] + r * std::sin(theta) * std::sin(phi)};
  });
}

float height(float x, float z)
{
  float y = 0, a = 0.25f, f = 0.4f;
  for (int octave = 0; octave < 8; ++octave, a *= 0.5f, f *= 2.1f)
    y += a * std::sin(f * x * 6.3f + 1.7f * f) * std::cos(f * z * 5.9f - f);
  return y;
}

// Seven bumpy spheres on a terrain; `cells` of each sphere's grid along each side.
Mesh landscape(uint32_t cells)
{
  Mesh m;
  add_grid(m, cells * 2 / 3, cells * 2 / 3, [](float u, float v) {
    const float x = 8 * (u - 0.5f), z = 8 * (v - 0.5f);
    return Vec{x, height(x, z), z};
  });
  Random random(4);
  for (int i = 0; i < 7; ++i) {
    const float x = random.between(-3, 3), z = random.between(-3, 3);
    add_sphere(m, cells, {x, height(x, z) + 0.7f, z}, random.between(0.4f, 0.9f), 0.03f);
  }
  return m;
}

// Houses of few large triangles, cables across the streets, and fine detail: what splits in space are for.
Mesh city(uint32_t blocks)
{
  Mesh m;
  Random random(5);
  const auto quad = [&](Vec a, Vec b, Vec c, Vec d) {
    const uint32_t n = uint32_t(m.vertices.size());
    m.vertices.insert(m.vertices.end(), {a, b, c, d});
    m.triangles.push_back({n, n + 1, n + 2});
    m.triangles.push_back({n, n + 2, n + 3});
  };
  const float size = float(blocks);
  quad({0, 0, 0}, {0, 0, size}, {size, 0, size}, {size, 0, 0});
  for (uint32_t z = 0; z < blocks; ++z) {
    for (uint32_t x = 0; x < blocks; ++x) {
      const float angle = random.between(0, 1.57f), w = random.between(0.2f, 0.45f),
                  h = random.between(0.3f, 3);
      const float s = w * std::sin(angle), c = w * std::cos(angle), cx = float(x) + 0.5f,
                  cz = float(z) + 0.5f;
      const Vec p[4] = {{cx + c, 0, cz + s}, {cx - s, 0, cz + c}, {cx - c, 0, cz - s}, {cx + s, 0, cz - c}};
      const auto up = [&](Vec v, float y) { return Vec{v[0], y, v[2]}; };
      for (int i = 0; i < 4; ++i) {
        const Vec a = p[i], b = p[(i + 1) % 4];
        quad(a, b, up(b, h), up(a, h));
        for (int floor = 0; floor < 4; ++floor) {  // ledges: long and thin
          const float y = h * float(floor + 1) / 5;
          quad(up(a, y), up(b, y), up(b, y + 0.01f), up(a, y + 0.01f));
        }
      }
      quad(up(p[0], h), up(p[1], h), up(p[2], h), up(p[3], h));
      const Vec far{cx + random.between(-4, 4), random.between(0.5f, 3), cz + random.between(-4, 4)};
      quad(up(p[0], h), far, {far[0], far[1] + 0.005f, far[2]}, up(p[0], h + 0.005f));
    }
  }
  return m;
}

Mesh read_triangles(const std::string &path)
{
  std::ifstream file(path, std::ios::binary);
  Mesh m;
  for (Vec v; file.read(reinterpret_cast<char *>(&v), sizeof v);) m.vertices.push_back(v);
  for (uint32_t i = 0; i + 2 < m.vertices.size(); i += 3) m.triangles.push_back({i, i + 1, i + 2});
  if (m.triangles.empty()) {
    std::fprintf(stderr, "error: no triangles in %s\n", path.c_str());
    std::exit(1);
  }
  return m;
}

struct Options {
  uint64_t num_rays = uint64_t(1) << 22;
  int repeats = 7;
  std::string only, triangles;
  uint64_t limit = 0;
};

constexpr const char *ray_names[] = {"primary", "diffuse", "ao", "random"};
struct RaySets {
  std::vector<gpurt_ray> rays[4];
};

Vec at(const gpurt_ray &r, float t)
{
  return {r.origin[0] + t * r.direction[0], r.origin[1] + t * r.direction[1],
          r.origin[2] + t * r.direction[2]};
}

RaySets make_rays(gpurt_scene scene, uint64_t count)
{
  gpurt_scene_facts f = GPURT_SCENE_FACTS_INIT;
  check(gpurt_scene_get_facts(scene, &f), "gpurt_scene_get_facts");
  Vec center, size;
  float diagonal = 0;
  for (int k = 0; k < 3; ++k) {
    center[k] = 0.5f * (f.bounds_min[k] + f.bounds_max[k]);
    size[k] = f.bounds_max[k] - f.bounds_min[k];
    diagonal += size[k] * size[k];
  }
  diagonal = std::sqrt(diagonal);
  RaySets sets;
  Random random(1);
  const Vec eye{center[0] + 0.3f * diagonal, center[1] + 0.2f * diagonal, center[2] + 0.35f * diagonal};
  const uint64_t width = uint64_t(std::sqrt(double(count)));
  for (uint64_t i = 0; i < count; ++i) {
    const float x = (float(i % width) / float(width) - 0.5f) * 0.8f * diagonal,
                y = (float(i / width) / float(width) - 0.5f) * 0.5f * diagonal;
    const Vec target{center[0] + 0.75f * x, center[1] + y, center[2] - 0.65f * x};
    sets.rays[0].push_back(
        {{eye[0], eye[1], eye[2]}, 0, {target[0] - eye[0], target[1] - eye[1], target[2] - eye[2]}, 1e30f});
  }
  std::vector<gpurt_hit_compact> hits(count);
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.format = GPURT_HIT_COMPACT;
  desc.num_rays = count;
  desc.rays = sets.rays[0].data();
  desc.hits = hits.data();
  check(gpurt_scene_trace(scene, &desc), "gpurt_scene_trace");
  std::vector<Vec> points;
  for (uint64_t i = 0; i < count; ++i) {
    if (hits[i].primitive != GPURT_INVALID_ID) points.push_back(at(sets.rays[0][i], hits[i].t * 0.9999f));
  }
  for (uint64_t i = 0; i < count; ++i) {
    const Vec p = points.empty() ? center : points[i % points.size()], d = random.direction(),
              e = random.direction();
    sets.rays[1].push_back({{p[0], p[1], p[2]}, 0, {d[0], d[1], d[2]}, 1e30f});
    sets.rays[2].push_back({{p[0], p[1], p[2]}, 0, {d[0], d[1], d[2]}, 0.2f * diagonal});
    Vec o;
    for (int k = 0; k < 3; ++k) o[k] = f.bounds_min[k] + size[k] * random.unit();
    sets.rays[3].push_back({{o[0], o[1], o[2]}, 0, {e[0], e[1], e[2]}, 1e30f});
  }
  return sets;
}

double seconds_of(const std::function<void()> &work)
{
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void commit(gpurt_scene scene, gpurt_build_quality quality)
{
  gpurt_build_desc desc = GPURT_BUILD_DESC_INIT;
  desc.accel = GPURT_ACCEL_BVH;
  desc.quality = quality;
  check(gpurt_scene_commit(scene, &desc), "gpurt_scene_commit");
}

// Of rays in device memory.
double mrays_per_s(gpurt_scene scene, int kind, uint64_t num_rays, const void *d_rays, void *d_hits,
                   int repeats)
{
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = kind == 2 ? GPURT_QUERY_ANY : GPURT_QUERY_CLOSEST;
  desc.format = GPURT_HIT_COMPACT;
  desc.storage = GPURT_STORAGE_DEVICE;
  desc.num_rays = num_rays;
  desc.rays = static_cast<const gpurt_ray *>(d_rays);
  if (kind == 2) desc.occluded = static_cast<uint8_t *>(d_hits);
  else desc.hits = d_hits;
  const auto trace = [&] { check(gpurt_scene_trace(scene, &desc), "gpurt_scene_trace"); };
  for (int i = 0; i < 3; ++i) trace();
  std::vector<double> times;
  for (int i = 0; i < repeats; ++i) times.push_back(seconds_of(trace));
  return double(num_rays) / median(times) * 1e-6;
}

void bench(gpurt_device device, const char *device_name, const std::string &name, const Mesh &mesh,
           const Options &options)
{
  gpurt_scene scene;
  check(gpurt_scene_create(device, &scene), "gpurt_scene_create");
  gpurt_mesh_desc desc = GPURT_MESH_DESC_INIT;
  desc.vertices.data = mesh.vertices.data();
  desc.vertices.count = mesh.vertices.size();
  desc.indices.data = mesh.triangles.data();
  desc.indices.count = mesh.triangles.size();
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  uint32_t id;
  check(gpurt_scene_add_mesh(scene, &desc, &instance.geometry), "gpurt_scene_add_mesh");
  check(gpurt_scene_add_instance(scene, &instance, &id), "gpurt_scene_add_instance");

  double rate[2][4] = {};
  gpurt_scene_facts facts[2] = {GPURT_SCENE_FACTS_INIT, GPURT_SCENE_FACTS_INIT};
  double first_build = 0;
  RaySets sets;
  void *d_rays, *d_hits;
  check(cudaMalloc(&d_rays, options.num_rays * sizeof(gpurt_ray)), "cudaMalloc");
  check(cudaMalloc(&d_hits, options.num_rays * sizeof(gpurt_hit_compact)), "cudaMalloc");
  for (int high = 0; high < 2; ++high) {
    const gpurt_build_quality quality = high ? GPURT_BUILD_QUALITY_HIGH : GPURT_BUILD_QUALITY_FAST;
    // The first build on a device also pays for its memory; the second does not.
    for (int i = 0; i < (high ? 1 : 3); ++i) {
      commit(scene, quality);
      check(gpurt_scene_get_facts(scene, &facts[high]), "gpurt_scene_get_facts");
      if (!high && i == 0) first_build = facts[0].accel_build_seconds;
    }
    if (!high) sets = make_rays(scene, options.num_rays);
    for (int kind = 0; kind < 4; ++kind) {
      const auto &rays = sets.rays[kind];
      check(cudaMemcpy(d_rays, rays.data(), rays.size() * sizeof(gpurt_ray), cudaMemcpyHostToDevice),
            "cudaMemcpy");
      rate[high][kind] = mrays_per_s(scene, kind, rays.size(), d_rays, d_hits, options.repeats);
    }
  }
  for (int high = 0; high < 2; ++high) {
    const gpurt_scene_facts &f = facts[high];
    std::printf(
        "{\"bench\": \"cuda_build\", \"device\": \"%s\", \"scene\": \"%s\", \"triangles\": %zu, \"builder\": "
        "\"%s\", \"build_ms\": %.3f, ",
        device_name, name.c_str(), mesh.triangles.size(), high ? "host" : "device",
        f.accel_build_seconds * 1e3);
    if (!high)
      std::printf("\"first_build_ms\": %.3f, \"build_peak_bytes\": %llu, ", first_build * 1e3,
                  (unsigned long long)f.build_peak_bytes);
    std::printf(
        "\"commit_s\": %.3f, \"accel_bytes\": %llu, \"nodes\": %llu, \"references\": %llu, \"depth\": %u, "
        "\"sah_cost\": %.4f",
        f.build_seconds, (unsigned long long)f.accel_bytes, (unsigned long long)f.num_nodes,
        (unsigned long long)f.num_references, f.tree_depth, f.sah_cost);
    for (int kind = 0; kind < 4; ++kind) {
      std::printf(", \"%s_mrays_per_s\": %.1f", ray_names[kind], rate[high][kind]);
      if (!high) std::printf(", \"%s_of_host\": %.4f", ray_names[kind], rate[0][kind] / rate[1][kind]);
    }
    std::printf("}\n");
  }
  std::fflush(stdout);
  check(cudaFree(d_rays), "cudaFree");
  check(cudaFree(d_hits), "cudaFree");
  check(gpurt_scene_release(scene), "gpurt_scene_release");
}

void print_log(void *, gpurt_log_level, const char *message) { std::fprintf(stderr, "%s\n", message); }

}  // namespace

int main(int argc, char **argv)
{
  Options options;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string name = argv[i];
    if (name == "--rays") options.num_rays = std::strtoull(argv[i + 1], nullptr, 10);
    else if (name == "--repeats") options.repeats = std::max(2, std::atoi(argv[i + 1]));
    else if (name == "--only") options.only = argv[i + 1];
    else if (name == "--tris") options.triangles = argv[i + 1];
    else if (name == "--limit") options.limit = std::strtoull(argv[i + 1], nullptr, 10);
    else {
      std::fprintf(stderr,
                   "usage: bench_cuda_build [--rays N] [--repeats N] [--only SUBSTRING] [--tris FILE] "
                   "[--limit BYTES]\n");
      return 2;
    }
  }
  if (!is_cuda_there()) return 0;
  const gpurt_device device = create_cuda_device(print_log, options.limit);
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  check(gpurt_device_get_properties(device, &properties), "gpurt_device_get_properties");
  const auto run = [&](const std::string &name, const std::function<Mesh()> &make) {
    if (name.find(options.only) != std::string::npos) bench(device, properties.name, name, make(), options);
  };
  if (!options.triangles.empty()) {
    run(options.triangles, [&] { return read_triangles(options.triangles); });
  } else {
    run("sphere", [] {
      Mesh m;
      add_sphere(m, 720, {0, 0, 0}, 1, 0.02f);
      return m;
    });
    run("city", [] { return city(100); });
    run("landscape", [] { return landscape(748); });
    // By name alone: 50 million triangles.
    if (options.only == "wide") run("wide", [] { return landscape(1836); });
  }
  check(gpurt_device_release(device), "gpurt_device_release");
  return 0;
}
