// Draws what methods do around an edge and a vertex of a closed icosphere seen from inside, magnified until a pixel is
// half an ulp of the coordinates: rays that leak are bright, the triangles that others hit are dark.
//
//   leak_picture OUT.ppm
//
// Columns: Moeller-Trumbore, Embree's fast mode, watertight. Rows: an edge, a vertex.
#include <cstdio>

#include "catalogue.h"

namespace {

using namespace gpurt_test;

constexpr int size = 192, gap = 6, columns = 3, rows = 2;
constexpr int width = columns * size + (columns - 1) * gap, height = rows * size + (rows - 1) * gap;

struct Image {
  std::vector<unsigned char> pixels = std::vector<unsigned char>(size_t(width) * height * 3, 255);
  void set(int x, int y, const std::array<unsigned char, 3> &c)
  {
    std::copy_n(c.begin(), 3, &pixels[(size_t(y) * width + x) * 3]);
  }
};

}  // namespace

int main(int argc, char **argv)
{
  if (argc != 2) {
    std::fprintf(stderr, "usage: leak_picture OUT.ppm\n");
    return 2;
  }
  const Mesh mesh = icosphere(4);
  const Device device = make_device();
  const std::array<Method, columns> shown = {
      Method{"moller_trumbore", GPURT_DEVICE_CPU, GPURT_ACCEL_KDTREE, GPURT_TRIANGLE_MOLLER_TRUMBORE},
      Method{"embree_fast", GPURT_DEVICE_CPU, GPURT_ACCEL_EMBREE, GPURT_TRIANGLE_MOLLER_TRUMBORE},
      Method{"watertight", GPURT_DEVICE_CPU, GPURT_ACCEL_KDTREE, GPURT_TRIANGLE_WATERTIGHT}};
  std::array<Scene, columns> scenes;
  for (int c = 0; c < columns; ++c) {
    GPURT_EXPECT_OK(gpurt_scene_create(device, scenes[c].out()));
    add_mesh(scenes[c], mesh);
    commit(scenes[c], shown[c].accel, shown[c].test);
  }

  const Point eye = {0.21f, -0.13f, 0.08f};
  // Rays at points of a small square across the view, around `target`; a pixel is half an ulp of 1 wide.
  const auto rays_around = [&](Point target) {
    double forward[3], length = 0;
    for (int k = 0; k < 3; ++k) forward[k] = double(target[k]) - eye[k], length += forward[k] * forward[k];
    for (double &x : forward) x /= std::sqrt(length);
    const double right_length = std::hypot(forward[2], forward[0]);
    const double right[3] = {forward[2] / right_length, 0, -forward[0] / right_length};
    double up[3];
    for (int k = 0; k < 3; ++k)
      up[k] = right[(k + 1) % 3] * forward[(k + 2) % 3] - right[(k + 2) % 3] * forward[(k + 1) % 3];
    std::vector<gpurt_ray> rays;
    for (int y = 0; y < size; ++y) {
      for (int x = 0; x < size; ++x) {
        const double u = (x - size / 2) * 0x1p-25, v = (size / 2 - y) * 0x1p-25;
        Point d;
        // The direction is rounded once, so that neighbours differ where floats do.
        for (int k = 0; k < 3; ++k) d[k] = float(double(target[k]) - eye[k] + u * right[k] + v * up[k]);
        rays.push_back(make_ray(eye, d));
      }
    }
    return rays;
  };
  // Of many edges and vertices, those where the leaky methods leak most.
  Image image;
  uint64_t leaks[rows][columns] = {};
  std::mt19937_64 rng(1);
  const std::vector<Edge> edges = edges_of(mesh);
  for (int row = 0; row < rows; ++row) {
    Point best{};
    uint64_t most = 0;
    for (int attempt = 0; attempt < 60; ++attempt) {
      const Edge e = edges[pick(rng, edges.size())];
      const Point target =
          row == 0 ? between(mesh.vertices[e[0]], mesh.vertices[e[1]], 0.5) : mesh.vertices[e[0]];
      const std::vector<gpurt_ray> rays = rays_around(target);
      const auto misses = [&](int c) {
        return count_hits(scenes[c], rays, [](size_t, const gpurt_hit &h) { return is_miss(h); });
      };
      const uint64_t both = std::min(misses(0), misses(1) + 1) * 1000 + misses(0) + misses(1);
      if (attempt == 0 || both > most) most = both, best = target;
    }
    const std::vector<gpurt_ray> rays = rays_around(best);
    for (int column = 0; column < columns; ++column) {
      const std::vector<gpurt_hit> hits = trace_closest(scenes[column], rays);
      std::map<uint32_t, int> shade;
      for (int i = 0; i < size * size; ++i) {
        const gpurt_hit &h = hits[i];
        std::array<unsigned char, 3> c = {255, 214, 10};
        if (is_miss(h)) ++leaks[row][column];
        else {
          const int s = shade.try_emplace(h.primitive, int(shade.size())).first->second;
          const unsigned char v = static_cast<unsigned char>(24 + 13 * (s * 5 % 7));
          c = {v, static_cast<unsigned char>(v + 6), static_cast<unsigned char>(v + 22)};
        }
        image.set(column * (size + gap) + i % size, row * (size + gap) + i / size, c);
      }
    }
  }
  std::FILE *file = std::fopen(argv[1], "wb");
  if (file == nullptr) {
    std::fprintf(stderr, "error: cannot write %s\n", argv[1]);
    return 1;
  }
  std::fprintf(file, "P6\n%d %d\n255\n", width, height);
  std::fwrite(image.pixels.data(), 1, image.pixels.size(), file);
  std::fclose(file);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      std::printf("%s, %s: %llu of %d rays leak\n", row == 0 ? "edge" : "vertex", shown[column].name,
                  static_cast<unsigned long long>(leaks[row][column]), size * size);
    }
  }
  return 0;
}
