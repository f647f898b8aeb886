#include "catalogue.h"

#include <cinttypes>
#include <cstdio>
#include <cstdlib>

namespace gpurt_test {

const std::vector<Method> &methods()
{
  static const std::vector<Method> all = {
      {"kdtree_watertight", GPURT_DEVICE_CPU, GPURT_ACCEL_KDTREE, GPURT_TRIANGLE_WATERTIGHT},
      {"kdtree_double", GPURT_DEVICE_CPU, GPURT_ACCEL_KDTREE, GPURT_TRIANGLE_DOUBLE},
      {"kdtree_moller_trumbore", GPURT_DEVICE_CPU, GPURT_ACCEL_KDTREE, GPURT_TRIANGLE_MOLLER_TRUMBORE},
      {"bvh_watertight", GPURT_DEVICE_CPU, GPURT_ACCEL_BVH, GPURT_TRIANGLE_WATERTIGHT},
      {"bvh_double", GPURT_DEVICE_CPU, GPURT_ACCEL_BVH, GPURT_TRIANGLE_DOUBLE},
      {"bvh_moller_trumbore", GPURT_DEVICE_CPU, GPURT_ACCEL_BVH, GPURT_TRIANGLE_MOLLER_TRUMBORE},
      {"embree_robust", GPURT_DEVICE_CPU, GPURT_ACCEL_EMBREE, GPURT_TRIANGLE_WATERTIGHT},
      {"embree_fast", GPURT_DEVICE_CPU, GPURT_ACCEL_EMBREE, GPURT_TRIANGLE_MOLLER_TRUMBORE},
      {"cuda_kdtree_watertight", GPURT_DEVICE_CUDA, GPURT_ACCEL_KDTREE, GPURT_TRIANGLE_WATERTIGHT},
      {"cuda_kdtree_double", GPURT_DEVICE_CUDA, GPURT_ACCEL_KDTREE, GPURT_TRIANGLE_DOUBLE},
      {"cuda_kdtree_moller_trumbore", GPURT_DEVICE_CUDA, GPURT_ACCEL_KDTREE, GPURT_TRIANGLE_MOLLER_TRUMBORE},
      {"cuda_bvh_watertight", GPURT_DEVICE_CUDA, GPURT_ACCEL_BVH, GPURT_TRIANGLE_WATERTIGHT},
      {"cuda_bvh_double", GPURT_DEVICE_CUDA, GPURT_ACCEL_BVH, GPURT_TRIANGLE_DOUBLE},
      {"cuda_bvh_moller_trumbore", GPURT_DEVICE_CUDA, GPURT_ACCEL_BVH, GPURT_TRIANGLE_MOLLER_TRUMBORE},
  };
  return all;
}

const std::vector<Method> &photon_methods()
{
  static const std::vector<Method> all = {
      {"photon_bvh", GPURT_DEVICE_CPU, GPURT_ACCEL_BVH, GPURT_TRIANGLE_WATERTIGHT},
      {"cuda_photon_kdtree", GPURT_DEVICE_CUDA, GPURT_ACCEL_KDTREE, GPURT_TRIANGLE_WATERTIGHT},
      {"cuda_photon_bvh", GPURT_DEVICE_CUDA, GPURT_ACCEL_BVH, GPURT_TRIANGLE_WATERTIGHT},
  };
  return all;
}

const std::vector<Method> &reyes_methods()
{
  static const std::vector<Method> all = {
      {"reyes", GPURT_DEVICE_CPU, GPURT_ACCEL_BVH, GPURT_TRIANGLE_WATERTIGHT},
      {"cuda_reyes", GPURT_DEVICE_CUDA, GPURT_ACCEL_BVH, GPURT_TRIANGLE_WATERTIGHT},
  };
  return all;
}

const std::vector<CatalogueRow> &catalogue()
{
  static const char *const no_reyes = "REYES has no displacement and motion yet";
  static const char *const no_hybrid = "the hybrid does not exist yet";
  static const std::vector<CatalogueRow> rows = {
      {1, "Edge leak", "closed icosphere, 10^7 rays from inside through edge midpoints", "0 misses", nullptr},
      {2, "Vertex leak", "the same, through vertices", "0 misses", nullptr},
      {3, "Integer-grid mesh, axis-aligned ray grid", "ball of unit cubes, rays -Y at every half integer",
       "none passes the lower of the columns that it touches", nullptr},
      {4, "Axis-parallel ray in a cell face", "cubes, origins in the planes of faces",
       "as exact geometry allows", nullptr},
      {5, "-0 in the direction", "rays with +0 and -0 swapped", "identical bits", nullptr},
      {6, "Origin on a split plane", "planes read back from the tree, rays both ways",
       "as exact geometry allows", nullptr},
      {7, "Infinite tmax, directions of 1e-40 to 1e30", "single quad", "the hit of the normalised ray",
       nullptr},
      {8, "NaN or infinite input", "one NaN vertex among 10^6; NaN and infinite rays",
       "error that names the index; the ray misses", nullptr},
      {9, "Grazing ray, needle", "triangle of 1e5:1 at 0.5 degrees",
       "t within 8 ulp, or a miss where exact geometry allows it", nullptr},
      {10, "Huge offset", "torus of 100 m at 10^6 m", "as exact geometry of the rounded vertices allows",
       nullptr},
      {11, "Tiny and huge scale", "mesh and rays times 2^-20, 2^20, 1e-6, 1e6",
       "powers of two: same ids, t scaled exactly; others: as exact geometry allows", nullptr},
      {12, "Self-intersection",
       "10^7 bounces and shadow rays from a plane and an icosphere, at the origin and far off", "0 self-hits",
       nullptr},
      {13, "Near layers", "spheres of radius 1 and 1 + 4e-5", "the nearer one is hit", nullptr},
      {14, "Coplanar duplicates", "every triangle twice, shuffled", "the lower id, every run", nullptr},
      {15, "Multi-hit", "stacks of cubes, lines through edges and vertices",
       "even count, sorted, each crossing once", nullptr},
      {16, "Flat cells", "10^6 triangles in one plane",
       "builds under the depth cap, in less than 5x the time of a uniform cloud", nullptr},
      {17, "Overlap", "10^5 triangles through one point", "at most 8 references a triangle", nullptr},
      {18, "Deep tree", "triangles of scale 2^-k; imported trees of depth 48 and 49",
       "as exact geometry allows; depth 49 is refused", nullptr},
      {19, "Leaf-list overflow", "ray along 10^4 slats, K = 4", "equals the oracle",
       "there are no K-leaf lists yet"},
      {20, "Empty scene, 1, 2 triangles, all degenerate", "", "hits where there is something, no crash",
       nullptr},
      {21, "Bad index, counts over 2^31 bytes", "", "error that names the culprit", nullptr},
      {22, "SDS caustic", "glass sphere over a pool, small light", "PM relMSE 10x lower for as many rays",
       nullptr},
      {23, "Small light behind glass", "1 mm light in a bulb", "top 0.1 % pixels hold < 20 % of MSE",
       nullptr},
      {24, "Furnace", "white spheres of albedo 1 under a unit sky, outside and inside",
       "1 +- 0.002, and 3 sigma", nullptr},
      {25, "Correlated samples", "2 seeds, 2 frames", "pairwise correlation < 3 sigma", nullptr},
      {26, "Estimator equality", "box with a block and a mirror, path tracing and photon mapping",
       "means within 0.5 %, tiles within the stated blur; Welch's t of path tracers", nullptr},
      {27, "False convergence", "dark room, door ajar 1 mm", "reached error <= 2x requested", nullptr},
      {28, "Thin-wall leak", "wall 0.1 r thick, lit on one side", "dark side < 1e-3 of lit", nullptr},
      {29, "Corner darkening", "inside 90-degree corner", "< 3 % within 0.5 r of the edge", nullptr},
      {30, "Boundary bias", "unit quad in a furnace", "rim within 3 %", nullptr},
      {31, "Caustic blur", "light that a mirror throws, with sharp edges",
       "blur falls with the radius, which falls with the pass as r(i)", nullptr},
      {32, "Energy", "closed box, albedo 0.5", "absorbed = emitted +- 3 sigma, in number and flux", nullptr},
      {33, "Too few photons", "10 photons", "finite, error estimate > 50 %", nullptr},
      {34, "Photon store overflow", "budget 1/10 of need", "same image bits", nullptr},
      {35, "Far-side photons", "two-sided sheet in a furnace", "both sides equal to the closed form",
       nullptr},
      {36, "Radius underflow", "10^6 passes, extent 1e6", "cells clamp, no crash", nullptr},
      {37, "Cracks", "500 random cameras within closed surfaces of patches, shading rates 0.25 to 40",
       "0 background samples", nullptr},
      {38, "Eye split",
       "1000 random cameras about closed surfaces, half of them near or within; planes through the eye",
       "0 background samples within outlines; planes: coverage as rays see it, within a sample of a pixel",
       nullptr},
      {39, "A-buffer overflow", "500 layers, alpha 0.02, with and without room for all of them",
       "within 1e-4 of closed form, the same bits", nullptr},
      {40, "Depth ties", "coincident transparent quads and patches; threads, tiles, memory", "identical bits",
       nullptr},
      {41, "Shading rate", "checker of patches at 0.25, 1, 4, 16, 64", "error monotone in rate", nullptr},
      {42, "Displacement bound", "spike beyond the bound", "warned, bound enlarged, or error", no_reyes},
      {43, "Degenerate patch", "pole, zero-length side, identical points", "finite image", nullptr},
      {44, "Needle patch", "1000:1, curved, in three directions",
       "micropolygons <= 4x covered area / rate + edges", nullptr},
      {45, "Motion past the eye", "patch crossing near during the shutter", "equals ray trace within noise",
       no_reyes},
      {46, "Hybrid mismatch", "displaced plane, low sun", "< 0.1 % of pixels differ over 5 %", no_hybrid},
      {47, "Split-queue bound",
       "1 patch filling 16K pixels; 10^6 patches; each with 1/16 of the memory, or what the smallest lists "
       "take",
       "peak memory <= limit, same image", nullptr},
      {48, "Out of memory", "limit of 256 MB", "error, the last commit stays, the next call works", nullptr},
      {49, "Determinism", "20 runs; 1, 2, 7 threads and tile sizes", "one hash", nullptr},
      {50, "CPU against GPU", "rays of all kinds at the six meshes, and a path-traced image", "same bits",
       nullptr},
      {51, "Long call", "a render of hours, cancelled", "ends within 0.5 s", nullptr},
      {52, "Starved queue", "one heavy corner; 10^4 random cuts into tiles, orders, numbers of jobs",
       "ends, the same bits", nullptr},
  };
  return rows;
}

bool is_full_run()
{
  const char *full = std::getenv("GPURT_STABILITY_FULL");
  return full != nullptr && full[0] == '1';
}

namespace {

void write_result(const CatalogueRow &row, const char *method, uint64_t failures, uint64_t trials,
                  const char *verdict, const std::string &note, const char *reason)
{
  const char *path = std::getenv("GPURT_STABILITY_RESULTS");
  if (path == nullptr) return;
  std::FILE *file = std::fopen(path, "a");
  ASSERT_NE(file, nullptr) << "GPURT_STABILITY_RESULTS: cannot write " << path;
  std::fprintf(file, "%d,\"%s\",\"%s\",\"%s\",%s,%" PRIu64 ",%" PRIu64 ",%s,\"%s\",\"%s\"\n", row.number,
               row.failure, row.input, row.criterion, method, failures, trials, verdict, note.c_str(),
               reason);
  std::fclose(file);
}

}  // namespace

void record(int row, const Method &method, uint64_t failures, uint64_t trials, const std::string &note)
{
  const Expectation e = expectation(row, method);
  const char *verdict =
      failures == 0 ? "pass" : (e.expected == Expected::Pass ? "FAIL" : "fails as expected");
  std::printf("row %d, %s: %" PRIu64 " of %" PRIu64 " fail: %s%s%s\n", row, method.name, failures, trials,
              verdict, note.empty() ? "" : "; ", note.c_str());
  for (const CatalogueRow &r : catalogue()) {
    if (r.number == row)
      write_result(r, method.name, failures, trials, verdict, note,
                   e.expected == Expected::Pass ? "" : e.reason);
  }
  EXPECT_GT(trials, 0u);
  if (e.expected == Expected::Pass) {
    EXPECT_EQ(failures, 0u) << "row " << row << ", " << method.name;
  }
  if (e.expected == Expected::Fails) {
    EXPECT_GT(failures, 0u) << "row " << row << ", " << method.name << " is listed as failing: " << e.reason;
  }
}

TEST(Catalogue, NamesEveryRow)
{
  int number = 0;
  for (const CatalogueRow &row : catalogue()) {
    EXPECT_EQ(row.number, ++number);
    if (row.missing != nullptr) write_result(row, "none", 0, 0, "none", "", row.missing);
  }
}

void Stability::SetUp()
{
  if (method().is_cuda() && !has_cuda()) GTEST_SKIP() << "no CUDA device";
  device_ = make_device(method().device);
}

Scene Stability::make_scene() const
{
  Scene scene;
  GPURT_EXPECT_OK(gpurt_scene_create(device_, scene.out()));
  return scene;
}

Scene Stability::make_scene(const Mesh &mesh) const
{
  Scene scene = make_scene();
  add_mesh(scene, mesh);
  commit_scene(scene);
  return scene;
}

}  // namespace gpurt_test
