// Counts leaks: rays from inside closed meshes at their edges and vertices, which must all hit something.
//
//   count_leaks [--rays N] [--method NAME]     10^8 rays over five meshes by default, kdtree_watertight
//
// Prints one JSON line per mesh and one for the sum; fails if a method that promises no leak has one.
#include <chrono>
#include <cinttypes>
#include <cstdio>
#include <cstdlib>

#include "catalogue.h"

namespace {

using namespace gpurt_test;

struct ClosedMesh {
  const char *name;
  Mesh mesh;
  std::vector<Point> inside;  // points within it
};

// `inside` makes a point within the mesh as it was made; both are moved alike.
template <class F>
ClosedMesh closed_mesh(const char *name, Mesh mesh, bool is_moved, F &&inside)
{
  std::mt19937_64 rng(99);
  Mesh points;
  for (int i = 0; i < 4096; ++i) points.vertices.push_back(inside(rng));
  if (is_moved) {
    mesh = moved(mesh);
    points = moved(points);
  }
  return {name, std::move(mesh), std::move(points.vertices)};
}

std::vector<ClosedMesh> closed_meshes()
{
  std::vector<ClosedMesh> all;
  all.push_back(closed_mesh("icosphere", icosphere(5), false, [](std::mt19937_64 &rng) {
    const Point d = uniform_direction(rng);
    const float r = float(0.9 * uniform(rng));
    return Point{r * d[0], r * d[1], r * d[2]};
  }));
  all.push_back(closed_mesh("slab of 1e-5", slab(60, 1e-5f), true, [](std::mt19937_64 &rng) {
    return Point{float(uniform(rng, -0.9, 0.9)), float(uniform(rng, -0.9, 0.9)), 5e-6f};
  }));
  all.push_back(closed_mesh("spindle of needles", spindle(600, {{0.02, -9}, {0.03, 0}, {0.01, 9}}, -30, 30),
                            true,
                            [](std::mt19937_64 &rng) { return Point{0, 0, float(uniform(rng, -8, 8))}; }));
  const int n = 24;
  all.push_back(closed_mesh("cubes", voxel_ball(n), false, [n](std::mt19937_64 &rng) {
    for (;;) {
      const int c[3] = {int(pick(rng, n)), int(pick(rng, n)), int(pick(rng, n))};
      const int x = 2 * c[0] + 1 - n, y = 2 * c[1] + 1 - n, z = 2 * c[2] + 1 - n;
      const bool tunnel = (c[0] % 5 == 2 && c[1] % 4 == 1) || (c[2] % 6 == 3 && c[0] % 7 == 3);
      if (x * x + y * y + z * z > n * n || tunnel) continue;
      return Point{c[0] + 0.5f, c[1] + 0.5f, c[2] + 0.5f};
    }
  }));
  all.push_back(closed_mesh("torus at 1e6", moved(torus(192, 96, 100, 30), 1, {1e6, 1e6, -1e6}, false), false,
                            [](std::mt19937_64 &rng) {
                              const double u = uniform(rng, 0, 6.28), r = uniform(rng, 80, 120);
                              return Point{float(1e6 + r * std::cos(u)), float(1e6 + r * std::sin(u)),
                                           float(-1e6 + uniform(rng, -10, 10))};
                            }));
  return all;
}

int run(uint64_t num_rays, const Method &method)
{
  const Device device = make_device(method.device);
  uint64_t sum_leaks = 0, sum_rays = 0;
  double sum_seconds = 0;
  const std::vector<ClosedMesh> meshes = closed_meshes();
  for (const ClosedMesh &m : meshes) {
    if (!is_closed(m.mesh)) {
      std::fprintf(stderr, "error: %s is not closed\n", m.name);
      return 1;
    }
    Scene scene;
    GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
    add_mesh(scene, m.mesh);
    commit(scene, method.accel, method.test);
    const std::vector<Edge> edges = edges_of(m.mesh);
    std::mt19937_64 rng(1);
    double seconds = 0;
    uint64_t leaks = 0;
    const uint64_t rays_of_mesh = num_rays / meshes.size();
    std::vector<gpurt_ray> rays;
    std::vector<gpurt_hit_compact> hits;
    for (uint64_t done = 0; done < rays_of_mesh; done += rays.size()) {
      rays.resize(std::min<uint64_t>(rays_of_mesh - done, 1 << 20));
      hits.resize(rays.size());
      for (size_t i = 0; i < rays.size(); ++i) {
        // A third each at edge midpoints, at other points of edges, and at vertices.
        const Point from = m.inside[pick(rng, m.inside.size())];
        const Edge e = edges[pick(rng, edges.size())];
        const Point a = m.mesh.vertices[e[0]], b = m.mesh.vertices[e[1]];
        const Point to = i % 3 == 0 ? between(a, b, 0.5) : i % 3 == 1 ? between(a, b, uniform(rng)) : a;
        rays[i] = ray_towards(from, to);
      }
      gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
      desc.format = GPURT_HIT_COMPACT;
      desc.num_rays = rays.size();
      desc.rays = rays.data();
      desc.hits = hits.data();
      const auto start = std::chrono::steady_clock::now();
      if (gpurt_scene_trace(scene, &desc) != GPURT_OK) {
        std::fprintf(stderr, "error: %s\n", gpurt_last_error());
        return 1;
      }
      seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      for (const gpurt_hit_compact &h : hits) leaks += h.primitive == GPURT_INVALID_ID;
    }
    std::printf(
        "{\"bench\": \"leaks\", \"method\": \"%s\", \"mesh\": \"%s\", \"triangles\": %zu, \"rays\": %" PRIu64
        ", \"leaks\": %" PRIu64 ", \"trace_seconds\": %.3f}\n",
        method.name, m.name, m.mesh.triangles.size(), rays_of_mesh, leaks, seconds);
    std::fflush(stdout);
    sum_leaks += leaks;
    sum_rays += rays_of_mesh;
    sum_seconds += seconds;
  }
  std::printf("{\"bench\": \"leaks\", \"method\": \"%s\", \"mesh\": \"all\", \"rays\": %" PRIu64
              ", \"leaks\": %" PRIu64 ", \"trace_seconds\": %.3f}\n",
              method.name, sum_rays, sum_leaks, sum_seconds);
  return sum_leaks != 0 && method.is_exact() ? 1 : 0;
}

}  // namespace

int main(int argc, char **argv)
{
  uint64_t num_rays = 100000000;
  std::string name = "kdtree_watertight";
  for (int i = 1; i < argc; ++i) {
    const std::string arg = argv[i];
    if (arg == "--rays" && i + 1 < argc) num_rays = uint64_t(std::strtod(argv[++i], nullptr));
    else if (arg == "--method" && i + 1 < argc) name = argv[++i];
    else {
      std::fprintf(stderr, "usage: count_leaks [--rays N] [--method NAME]\n");
      return 2;
    }
  }
  for (const Method &m : methods()) {
    if (name == m.name) return run(num_rays, m);
  }
  std::fprintf(stderr, "error: no method %s; there are:", name.c_str());
  for (const Method &m : methods()) std::fprintf(stderr, " %s", m.name);
  std::fprintf(stderr, "\n");
  return 2;
}
