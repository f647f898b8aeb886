// Measures the volume of a closed mesh: along each of many parallel rays, the way between going in and out.
#include <cmath>
#include <cstdio>
#include <gpurt.hpp>
#include <limits>

namespace {

constexpr uint32_t segments = 64;  // around the sphere; half as many from pole to pole
constexpr int grid = 200;          // rays along each side of the square that they start from
constexpr double pi = 3.14159265358979323846;

// A sphere of radius 1 at the origin.
uint32_t add_sphere(const gpurt::Scene &scene)
{
  std::vector<float> positions;
  std::vector<uint32_t> indices;
  for (uint32_t ring = 0; ring <= segments / 2; ++ring) {
    const double theta = pi * ring / (segments / 2);
    for (uint32_t i = 0; i < segments; ++i) {
      const double phi = 2 * pi * i / segments;
      for (double x : {std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)}) {
        positions.push_back(float(x));
      }
      if (ring == segments / 2) continue;
      // At the poles one triangle of each pair is degenerate: it is legal, and never hit.
      const uint32_t a = ring * segments + i, b = ring * segments + (i + 1) % segments;
      indices.insert(indices.end(), {a, b, a + segments, b, b + segments, a + segments});
    }
  }
  return scene.add_mesh(positions, indices);
}

double measure(const gpurt::Scene &scene)
{
  const double spacing = 2.0 / grid;
  std::vector<gpurt_ray> rays;
  for (int y = 0; y < grid; ++y) {
    for (int x = 0; x < grid; ++x) {
      const float px = float(-1 + (x + 0.5) * spacing), py = float(-1 + (y + 0.5) * spacing);
      rays.push_back({{px, py, 2}, 0, {0, 0, -1}, std::numeric_limits<float>::infinity()});
    }
  }
  const gpurt::Scene::AllHits all = scene.trace_all(rays);
  double length = 0;
  for (size_t ray = 0; ray < rays.size(); ++ray) {
    // Sorted by t: in, out, in, out.
    for (uint64_t hit = all.offsets[ray]; hit + 1 < all.offsets[ray + 1]; hit += 2) {
      length += double(all.hits[hit + 1].t) - double(all.hits[hit].t);
    }
  }
  return length * spacing * spacing;
}

}  // namespace

int main()
{
  try {
    const gpurt::Device device(GPURT_DEVICE_AUTO);
    const gpurt::Scene scene = device.scene();
    add_sphere(scene);
    scene.commit();
    const double volume = measure(scene), sphere = 4 * pi / 3;
    std::printf("%s: the mesh has a volume of %.4f; the sphere, of %.4f\n", device.properties().name, volume,
                sphere);
    // The mesh lies inside the sphere: 0.5 % are lost to its flat faces, and the rays sample it.
    return std::abs(volume / sphere - 1) < 0.01 ? 0 : 1;
  } catch (const gpurt::Error &error) {
    std::fprintf(stderr, "%s: %s\n", gpurt_result_name(error.result()), error.what());
    return 1;
  }
}
