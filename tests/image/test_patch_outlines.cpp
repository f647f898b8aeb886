// Models of patches from random cameras, half of them within the model's bounds: REYES shows no background within an outline,
// and nothing outside of it. Skipped where the scenes are not there.
//
// Within an outline: rays meet the model in all samples of a pixel and of its eight neighbours; outside: in none of them. The
// model stands alone, so that a hole anywhere shows as background.
//
// Neighbours share an edge where its four control points are the same. Killeroo and bigguy have edges that they do not share:
// boundaries that were computed twice and differ by rounding, which are welded here, and edges that meet two shorter ones, along
// which no two patches are known to be neighbours. Rays find gaps there too. Pixels at these are counted on their own.
//
// Environment variables: GPURT_TEST_CAMERAS sets the cameras of each model (default 40; 1000 for the promise of docs/reyes.md),
// GPURT_TEST_DEVICE=cuda the device, GPURT_TEST_SCENES the folder of the scenes.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>

#include "../support/reyes_renders.h"
#include "../support/scenes_folder.h"

namespace {

using namespace gpurt_test;
namespace fs = std::filesystem;

// Control points of the first mesh of a binary glTF file, which is the model; others are the floor it stands on.
std::vector<PatchNet> patches_of(const fs::path &path)
{
  std::ifstream file(path, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(file), {}};
  uint32_t json_size = 0;
  std::memcpy(&json_size, bytes.data() + 12, 4);
  const nlohmann::json gltf = nlohmann::json::parse(bytes.substr(20, json_size));
  const nlohmann::json &primitive = gltf["meshes"][0]["primitives"][0];
  const size_t index = primitive["extensions"]["GPURT_bezier_patches"]["controlPoints"].get<size_t>();
  const nlohmann::json &accessor = gltf["accessors"][index];
  const nlohmann::json &view = gltf["bufferViews"][accessor["bufferView"].get<size_t>()];
  const size_t offset = view.value("byteOffset", size_t(0)) + accessor.value("byteOffset", size_t(0));
  std::vector<PatchNet> nets(accessor["count"].get<size_t>() / 16);
  std::memcpy(nets.data(), bytes.data() + 28 + json_size + offset, nets.size() * sizeof(PatchNet));
  return nets;
}

struct Bounds {
  double lo[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, hi[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};

  explicit Bounds(const std::vector<PatchNet> &nets)
  {
    for (const PatchNet &net : nets) {
      for (const Point &p : net) {
        for (size_t k = 0; k < 3; ++k) {
          lo[k] = std::min(lo[k], double(p[k]));
          hi[k] = std::max(hi[k], double(p[k]));
        }
      }
    }
  }
  double diagonal() const { return std::hypot(hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2]); }
};

// Points of boundaries that lie within a distance of an earlier one take its place.
void weld(std::vector<PatchNet> &nets, double distance)
{
  std::map<std::array<int64_t, 3>, std::vector<Point>> cells;
  const auto cell_of = [&](const Point &p, size_t k) { return int64_t(std::floor(double(p[k]) / distance)); };
  for (PatchNet &net : nets) {
    for (size_t i = 0; i < 16; ++i) {
      if (i % 4 % 3 != 0 && i / 4 % 3 != 0) continue;
      Point &p = net[i];
      const Point *earlier = nullptr;
      for (int64_t n = 0; n < 27 && earlier == nullptr; ++n) {
        const auto found =
            cells.find({cell_of(p, 0) + n % 3 - 1, cell_of(p, 1) + n / 3 % 3 - 1, cell_of(p, 2) + n / 9 - 1});
        if (found == cells.end()) continue;
        for (const Point &q : found->second) {
          if (std::hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]) <= distance) earlier = &q;
        }
      }
      if (earlier != nullptr) p = *earlier;
      else cells[{cell_of(p, 0), cell_of(p, 1), cell_of(p, 2)}].push_back(p);
    }
  }
}

using Edge = std::array<Point, 4>;

// Edges that only one patch has, from either end; poles are none.
std::vector<Edge> unshared_edges(const std::vector<PatchNet> &nets)
{
  std::map<Edge, int> uses;
  for (const PatchNet &n : nets) {
    for (const Edge &e : {Edge{n[0], n[1], n[2], n[3]}, Edge{n[12], n[13], n[14], n[15]},
                          Edge{n[0], n[4], n[8], n[12]}, Edge{n[3], n[7], n[11], n[15]}}) {
      const Edge turned{e[3], e[2], e[1], e[0]};
      uses[std::min(e, turned)]++;
    }
  }
  std::vector<Edge> edges;
  for (const auto &[edge, count] : uses) {
    if (count == 1 && edge[0] != edge[3]) edges.push_back(edge);
  }
  return edges;
}

// Pixels of a square image that lie within a pixel of one of the edges.
std::vector<bool> pixels_at(const std::vector<Edge> &edges, const gpurt_camera_desc &camera, uint32_t size)
{
  std::vector<bool> marked(size_t(size) * size);
  const double scale = size / (2 * std::tan(0.5 * double(camera.yfov_rad)));
  constexpr int steps = 400;
  for (const Edge &e : edges) {
    for (int i = 0; i <= steps; ++i) {
      const double t = double(i) / steps, s = 1 - t;
      const double weight[4] = {s * s * s, 3 * s * s * t, 3 * s * t * t, t * t * t};
      double view[3] = {0, 0, 0};
      for (size_t k = 0; k < 3; ++k) {
        double p = -double(camera.transform[4 * k + 3]);
        for (size_t c = 0; c < 4; ++c) p += weight[c] * double(e[c][k]);
        for (size_t axis = 0; axis < 3; ++axis) view[axis] += double(camera.transform[4 * k + axis]) * p;
      }
      if (view[2] >= 0) continue;
      const double x = size / 2.0 - scale * view[0] / view[2], y = size / 2.0 + scale * view[1] / view[2];
      if (!(x > -2 && y > -2 && x < size + 2.0 && y < size + 2.0)) continue;
      for (int row = int(std::floor(y - 1)); row <= int(std::floor(y + 1)); ++row) {
        for (int column = int(std::floor(x - 1)); column <= int(std::floor(x + 1)); ++column) {
          if (row >= 0 && column >= 0 && row < int(size) && column < int(size))
            marked[size_t(row) * size + size_t(column)] = true;
        }
      }
    }
  }
  return marked;
}

using Direction = std::array<double, 3>;

Direction unit(Direction d)
{
  const double length = std::hypot(d[0], d[1], d[2]);
  return {d[0] / length, d[1] / length, d[2] / length};
}
Direction cross(const Direction &a, const Direction &b)
{
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
Direction random_direction(std::mt19937_64 &rng)
{
  Direction d{uniform(rng, -1, 1), uniform(rng, -1, 1), uniform(rng, -1, 1)};
  return unit(d);
}

// Within the bounds it looks anywhere, from outside at a point within them.
gpurt_camera_desc add_random_camera(gpurt_scene scene, const Bounds &bounds, bool is_within,
                                    std::mt19937_64 &rng)
{
  Direction eye, at;
  for (size_t k = 0; k < 3; ++k) {
    eye[k] = uniform(rng, bounds.lo[k], bounds.hi[k]);
    at[k] = uniform(rng, bounds.lo[k], bounds.hi[k]);
  }
  if (!is_within) {
    const Direction away = random_direction(rng);
    const double distance = uniform(rng, 0.5, 1.5) * bounds.diagonal();
    for (size_t k = 0; k < 3; ++k) eye[k] = (bounds.lo[k] + bounds.hi[k]) / 2 + distance * away[k];
  }
  const Direction z = unit({eye[0] - at[0], eye[1] - at[1], eye[2] - at[2]});
  const Direction x = unit(cross(random_direction(rng), z)), y = cross(z, x);
  gpurt_camera_desc desc = GPURT_CAMERA_DESC_INIT;
  for (size_t k = 0; k < 3; ++k) {
    desc.transform[4 * k] = float(x[k]);
    desc.transform[4 * k + 1] = float(y[k]);
    desc.transform[4 * k + 2] = float(z[k]);
    desc.transform[4 * k + 3] = float(eye[k]);
  }
  desc.yfov_rad = float(is_within ? uniform(rng, 0.5, 2) : uniform(rng, 0.2, 1));
  uint32_t id;
  GPURT_EXPECT_OK(gpurt_scene_add_camera(scene, &desc, &id));
  return desc;
}

class PatchOutlines : public testing::TestWithParam<const char *> {};
INSTANTIATE_TEST_SUITE_P(Models, PatchOutlines,
                         testing::Values("teapot", "killeroo", "bigguy", "eye_split_tunnel"),
                         [](const auto &info) { return std::string(info.param); });

TEST_P(PatchOutlines, HoldNoBackground)
{
  const fs::path path = scenes_folder() / (std::string(GetParam()) + "_patches.glb");
  if (!fs::exists(path)) GTEST_SKIP() << path << " is not there";
  const char *wanted = std::getenv("GPURT_TEST_CAMERAS");
  const uint32_t num_cameras = wanted != nullptr ? uint32_t(std::atoi(wanted)) : 40;
  constexpr uint32_t size = 32, spp = 9;

  std::vector<PatchNet> nets = patches_of(path);
  const Bounds bounds(nets);
  weld(nets, 1e-5 * bounds.diagonal());
  const std::vector<Edge> unshared = unshared_edges(nets);
  Device device = make_device(image_device_type());
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_patches(scene, nets);
  std::mt19937_64 rng(11);
  std::vector<gpurt_camera_desc> cameras;
  for (uint32_t i = 0; i < num_cameras; ++i)
    cameras.push_back(add_random_camera(scene, bounds, i % 2 != 0, rng));
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_BVH;
  // Of eyes within the model surfaces are near.
  build.patch_tolerance = float(5e-5 * bounds.diagonal());
  GPURT_ASSERT_OK(gpurt_scene_commit(scene, &build));

  uint64_t num_within = 0, num_holes = 0, num_outside = 0, num_strays = 0, num_edge = 0, num_far_off = 0;
  uint64_t num_unshared = 0, num_gaps = 0;
  for (uint32_t i = 0; i < num_cameras; ++i) {
    RenderOptions o = reyes_options(size, spp, std::array{0.25f, 1.0f, 4.0f}[i / 2 % 3]);
    o.seed = i;
    const std::vector<int> ours = covered_samples(scene, o, i),
                           theirs = covered_samples(scene, path_options(o), i);
    const std::vector<bool> is_unshared = pixels_at(unshared, cameras[i], size);
    for (uint32_t y = 1; y + 1 < size; ++y) {
      for (uint32_t x = 1; x + 1 < size; ++x) {
        int least = int(spp), most = 0;
        for (uint32_t k = 0; k < 9; ++k) {
          const int covered = theirs[(y + k / 3 - 1) * size + x + k % 3 - 1];
          least = std::min(least, covered);
          most = std::max(most, covered);
        }
        const int covered = ours[y * size + x];
        if (least == int(spp) && is_unshared[y * size + x]) {
          num_unshared += spp;
          num_gaps += uint64_t(int(spp) - covered);
        } else if (least == int(spp)) {
          num_within += spp;
          num_holes += uint64_t(int(spp) - covered);
          EXPECT_EQ(covered, int(spp)) << "hole: camera " << i << ", pixel " << x << ", " << y;
        } else if (most == 0) {
          num_outside += spp;
          num_strays += uint64_t(covered);
          EXPECT_EQ(covered, 0) << "stray: camera " << i << ", pixel " << x << ", " << y;
        } else {
          num_edge += 1;
          num_far_off += std::abs(covered - theirs[y * size + x]) > 1;
        }
      }
    }
  }
  const auto number = [](uint64_t n) { return static_cast<unsigned long long>(n); };
  std::printf(
      "%s, %u cameras: %llu background samples of %llu within outlines, %llu samples of the model of %llu "
      "outside; "
      "at %zu edges that no neighbours share %llu of %llu; at outlines %llu of %llu pixels more than a "
      "sample off\n",
      GetParam(), num_cameras, number(num_holes), number(num_within), number(num_strays), number(num_outside),
      unshared.size(), number(num_gaps), number(num_unshared), number(num_far_off), number(num_edge));
  // Enough was seen of the model, and past it.
  EXPECT_GT(num_within, uint64_t(num_cameras) * 100);
  EXPECT_GT(num_outside + num_edge, 0u);
}

}  // namespace
