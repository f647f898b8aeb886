// Photons of a scene in a map: the power of the lights, the estimates of renders, and the same points everywhere.
#include <cstdio>
#include <fstream>
#include <functional>
#include <numbers>

#include "../support/photon_map.h"

namespace {

using namespace gpurt_test;
using std::numbers::pi;

class ScenePhotons : public testing::TestWithParam<gpurt_device_type> {
 protected:
  void SetUp() override
  {
    if (GetParam() == GPURT_DEVICE_CUDA && !has_cuda()) GTEST_SKIP() << "no CUDA device";
  }
  /// Only what the test asks for is changed.
  static gpurt_photon_trace_desc asked(const std::function<void(gpurt_photon_trace_desc &)> &change)
  {
    gpurt_photon_trace_desc desc = GPURT_PHOTON_TRACE_DESC_INIT;
    change(desc);
    return desc;
  }
};
INSTANTIATE_TEST_SUITE_P(Cpu, ScenePhotons, testing::Values(GPURT_DEVICE_CPU));
INSTANTIATE_TEST_SUITE_P(Cuda, ScenePhotons, testing::Values(GPURT_DEVICE_CUDA));

PhotonMap trace(gpurt_scene scene, const gpurt_photon_trace_desc &desc)
{
  PhotonMap map;
  GPURT_EXPECT_OK(gpurt_photon_map_trace(scene, &desc, map.out()));
  return map;
}

gpurt_photon_map_info info_of(gpurt_photon_map map)
{
  gpurt_photon_map_info info = GPURT_PHOTON_MAP_INFO_INIT;
  GPURT_EXPECT_OK(gpurt_photon_map_get_info(map, &info));
  return info;
}

std::vector<Point> read(gpurt_photon_map map, gpurt_photon_attribute attribute)
{
  std::vector<Point> values(info_of(map).num_points);
  GPURT_EXPECT_OK(gpurt_photon_map_read(map, attribute, values.data(), values.size() * sizeof(Point)));
  return values;
}

// The cube [-1, 1]^3 of one albedo, with a point light in it of intensity (1, 0.5, 0.25).
Scene make_box(gpurt_device device, float albedo, bool has_light = true)
{
  Scene scene;
  GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
  Mesh m;
  for (int axis = 0; axis < 3; ++axis) {
    for (const float side : {-1.0f, 1.0f}) {
      Mesh wall = quad({-1, -1, side}, {1, -1, side}, {1, 1, side}, {-1, 1, side});
      wall.map([&](Point v) {
        return Point{v[size_t(2 + axis) % 3], v[size_t(axis) % 3], v[size_t(1 + axis) % 3]};
      });
      m.append(wall);
    }
  }
  add_mesh(scene, m, add_material(scene, GPURT_MATERIAL_LAMBERT, {albedo, albedo, albedo}));
  if (has_light) {
    gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
    light.type = GPURT_LIGHT_POINT;
    const float intensity[3] = {1, 0.5f, 0.25f};
    std::memcpy(light.intensity, intensity, sizeof intensity);
    uint32_t id;
    GPURT_EXPECT_OK(gpurt_scene_add_light(scene, &light, &id));
  }
  add_camera(scene, {0.1f, 0.2f, 0.5f}, 1.2f);
  commit(scene);
  return scene;
}

TEST_P(ScenePhotons, HoldTheFluxOfTheLights)
{
  const Device device = make_device(GetParam());
  const Scene scene = make_box(device, 0.5f);
  const uint32_t num_paths = 200000;
  const PhotonMap map = trace(scene, asked([&](auto &d) { d.num_paths = num_paths, d.max_depth = 60; }));
  const gpurt_photon_map_info info = info_of(map);
  EXPECT_EQ(info.num_paths, num_paths);
  EXPECT_TRUE(info.has_fluxes && info.has_normals && info.has_directions);

  // Half of the light comes to a second surface, a quarter to a third, and so on: all of it in sum. The number of those
  // surfaces has variance 2.
  const double sigma = std::sqrt(2.0 / num_paths);
  const std::vector<Point> fluxes = read(map, GPURT_PHOTON_ATTRIBUTE_FLUX);
  double sums[3] = {};
  for (const Point &flux : fluxes) {
    for (size_t k = 0; k < 3; ++k) sums[k] += double(flux[k]);
  }
  for (size_t k = 0; k < 3; ++k)
    EXPECT_NEAR(sums[k] / (4 * pi * std::pow(0.5, double(k))), 1, 3 * sigma) << k;
  // All of them lie within the radius; sums of a million floats are good for four digits.
  const std::vector<Point> center = {{0, 0, 0}};
  const Answers all = ask(map, query_desc(GPURT_PHOTON_QUERY_SUM, center, 4));
  EXPECT_EQ(all.counts[0], info.num_points);
  for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(double(all.sums[0][k]) / sums[k], 1, 1e-3);
}

TEST_P(ScenePhotons, LieOnSurfacesThatTheyFlyTo)
{
  const Device device = make_device(GetParam());
  const PhotonMap map = trace(make_box(device, 0.5f), asked([](auto &d) { d.num_paths = 5000; }));
  const std::vector<Point> positions = read(map, GPURT_PHOTON_ATTRIBUTE_POSITION),
                           normals = read(map, GPURT_PHOTON_ATTRIBUTE_NORMAL),
                           directions = read(map, GPURT_PHOTON_ATTRIBUTE_DIRECTION);
  ASSERT_GT(positions.size(), 4000u);
  size_t num_bad = 0;
  for (size_t i = 0; i < positions.size(); ++i) {
    size_t axis = 0;
    for (size_t k = 1; k < 3; ++k) axis = std::abs(normals[i][k]) > std::abs(normals[i][axis]) ? k : axis;
    const float cosine = normals[i][axis] * directions[i][axis];
    num_bad += !(std::abs(normals[i][axis] + positions[i][axis]) < 1e-6f) || !(cosine < 0);
    num_bad += std::abs(exact_distance(directions[i], {0, 0, 0}) - 1) > 1e-6;
  }
  EXPECT_EQ(num_bad, 0u);
}

// What a render gathers at the first surface of its paths is what its photons give by hand.
TEST_P(ScenePhotons, GiveTheEstimatesOfRenders)
{
  const Device device = make_device(GetParam());
  const float albedo = 0.5f;
  const Scene scene = make_box(device, albedo);
  for (const uint64_t pass : {0, 3}) {
    uint64_t num_stored = 0;
    gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
    frame_desc.width = frame_desc.height = 16;
    frame_desc.seed = 9;
    frame_desc.frame_index = 2;
    frame_desc.first_sample = pass;
    frame_desc.outputs = 1u << GPURT_OUTPUT_COLOR | 1u << GPURT_OUTPUT_POSITION;
    const size_t num_pixels = 256;
    std::vector<Point> color[2], position(num_pixels);
    double radius = 0;
    // Of depth 2 there is direct light alone.
    for (const uint32_t depth : {2, 6}) {
      Frame frame;
      GPURT_ASSERT_OK(gpurt_frame_create(scene, &frame_desc, frame.out()));
      gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
      desc.pipeline = GPURT_PIPELINE_PHOTON;
      desc.samples_per_pixel = 1;
      desc.max_depth = depth;
      desc.photon.photons_per_pass = 20000;
      desc.photon.initial_radius = 0.2f;
      desc.photon.remedies = GPURT_PHOTON_REMEDY_NONE;
      Job job;
      GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
      GPURT_ASSERT_OK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
      std::vector<Point> &to = color[depth == 6];
      to.resize(num_pixels);
      GPURT_ASSERT_OK(gpurt_frame_read(frame, GPURT_OUTPUT_COLOR, to.data(), num_pixels * sizeof(Point)));
      GPURT_ASSERT_OK(
          gpurt_frame_read(frame, GPURT_OUTPUT_POSITION, position.data(), num_pixels * sizeof(Point)));
      gpurt_statistics statistics = GPURT_STATISTICS_INIT;
      GPURT_ASSERT_OK(gpurt_frame_get_statistics(frame, &statistics));
      radius = statistics.photon_counters.smallest_radius;
      num_stored = statistics.photon_counters.num_stored;
    }
    const PhotonMap map = trace(scene, asked([&](auto &d) {
                                  d.num_paths = 20000, d.seed = 9, d.frame_index = 2, d.pass = pass,
                                  d.max_depth = 6;
                                }));
    EXPECT_EQ(info_of(map).num_points, num_stored);
    if (pass != 0) continue;  // frames have the positions of sample 0
    const Answers answers = ask(map, query_desc(GPURT_PHOTON_QUERY_SUM, position, float(radius)));
    double worst = 0;
    for (size_t i = 0; i < num_pixels; ++i) {
      ASSERT_GT(answers.counts[i], 10u);
      for (size_t k = 0; k < 3; ++k) {
        const double gathered = double(color[1][i][k]) - double(color[0][i][k]);
        const double by_hand = double(answers.sums[i][k]) / (pi * radius * radius) * double(albedo) / pi;
        worst = std::max(worst, std::abs(gathered / by_hand - 1));
      }
    }
    // What is left when direct light is taken off has as many digits.
    EXPECT_LT(worst, 2e-5);
  }
}

TEST_P(ScenePhotons, AreTheSameOnEveryDevice)
{
  const auto photons_of = [](const Device &device) {
    return trace(make_box(device, 0.8f),
                 asked([](auto &d) { d.num_paths = 70001, d.seed = 4, d.num_levels = 2; }));
  };
  const Device one = make_device(GPURT_DEVICE_CPU, 1), device = make_device(GetParam());
  const PhotonMap expected = photons_of(one), map = photons_of(device);
  EXPECT_EQ(info_of(map).radius, info_of(expected).radius);
  for (const gpurt_photon_attribute attribute :
       {GPURT_PHOTON_ATTRIBUTE_POSITION, GPURT_PHOTON_ATTRIBUTE_FLUX, GPURT_PHOTON_ATTRIBUTE_NORMAL,
        GPURT_PHOTON_ATTRIBUTE_DIRECTION}) {
    const std::vector<Point> a = read(map, attribute), b = read(expected, attribute);
    ASSERT_EQ(a.size(), b.size());
    EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(Point)), 0) << attribute;
  }
  const std::vector<Point> places = {{0, 0, -1}, {0.5f, 1, 0.2f}, {-1, -0.9f, 0.9f}};
  for (const gpurt_photon_query query : {GPURT_PHOTON_QUERY_SUM, GPURT_PHOTON_QUERY_LIST})
    EXPECT_EQ(ask(map, query_desc(query, places, 0.3f)), ask(expected, query_desc(query, places, 0.3f)));
}

TEST_P(ScenePhotons, SurviveAFile)
{
  const Device device = make_device(GetParam());
  const PhotonMap map = trace(make_box(device, 0.5f), asked([](auto &d) { d.num_paths = 3000; }));
  const std::string path = testing::TempDir() + "/scene_photons.gpurt";
  GPURT_ASSERT_OK(gpurt_photon_map_save(map, path.c_str()));
  PhotonMap loaded;
  GPURT_ASSERT_OK(gpurt_photon_map_load(device, path.c_str(), loaded.out()));
  std::remove(path.c_str());
  EXPECT_EQ(info_of(loaded).num_paths, 3000u);
  EXPECT_EQ(read(loaded, GPURT_PHOTON_ATTRIBUTE_FLUX), read(map, GPURT_PHOTON_ATTRIBUTE_FLUX));
  EXPECT_EQ(read(loaded, GPURT_PHOTON_ATTRIBUTE_DIRECTION), read(map, GPURT_PHOTON_ATTRIBUTE_DIRECTION));
  const std::vector<Point> places = {{0, 0, -1}};
  const gpurt_photon_query_desc sums = query_desc(GPURT_PHOTON_QUERY_SUM, places, 0.5f);
  EXPECT_EQ(ask(loaded, sums), ask(map, sums));
}

TEST_P(ScenePhotons, AreNoneWithoutIndirectLight)
{
  const Device device = make_device(GetParam());
  const PhotonMap map =
      trace(make_box(device, 0.5f), asked([](auto &d) { d.max_depth = 2, d.num_paths = 100; }));
  EXPECT_EQ(info_of(map).num_points, 0u);
  const std::vector<Point> places = {{0, 0, -1}};
  EXPECT_EQ(ask(map, query_desc(GPURT_PHOTON_QUERY_SUM, places, 1)).counts[0], 0u);
  GPURT_EXPECT_OK(gpurt_photon_map_read(map, GPURT_PHOTON_ATTRIBUTE_FLUX, nullptr, 0));
}

TEST_P(ScenePhotons, KeepToTheMemoryLimit)
{
  const uint64_t limit = uint64_t(GetParam() == GPURT_DEVICE_CUDA ? 64 : 16) << 20;
  const Device device = make_device(GetParam(), 1, limit);
  const Scene scene = make_box(device, 0.8f);
  const auto memory = [&] {
    gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
    GPURT_EXPECT_OK(gpurt_device_get_properties(device, &p));
    return p;
  };
  const uint64_t before = memory().memory_used_bytes;
  // 4 photons of 32 bytes each.
  gpurt_photon_trace_desc desc = asked([](auto &d) { d.num_paths = 1000000; });
  gpurt_photon_map out = nullptr;
  EXPECT_EQ(gpurt_photon_map_trace(scene, &desc, &out), GPURT_ERROR_OUT_OF_MEMORY);
  EXPECT_EQ(out, nullptr);
  EXPECT_NE(std::string(gpurt_last_error()).find("num_paths"), std::string::npos) << gpurt_last_error();
  EXPECT_EQ(memory().memory_used_bytes, before);
  desc.num_paths = 20000;
  const PhotonMap map = trace(scene, desc);
  EXPECT_GT(info_of(map).num_points, 60000u);
  EXPECT_LE(memory().memory_peak_bytes, limit);
}

// Memory of this process in bytes: at most so far, or since it was cleared.
uint64_t most_resident_bytes()
{
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind("VmHWM:", 0) == 0) return std::stoull(line.substr(6)) * 1024;
  }
  return 0;
}

// The photons of the pilot that chooses a radius would take 40 MiB here, and those of a pass as much.
TEST(PilotPhotons, TakeNoMoreMemoryThanTheLimit)
{
  const uint64_t limit = uint64_t(12) << 20;
  const Device device = make_device(GPURT_DEVICE_CPU, 1, limit);
  const Scene scene = make_box(device, 0.95f);
  gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
  frame_desc.width = frame_desc.height = 8;
  Frame frame;
  GPURT_ASSERT_OK(gpurt_frame_create(scene, &frame_desc, frame.out()));
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.pipeline = GPURT_PIPELINE_PHOTON;
  desc.samples_per_pixel = 1;
  desc.max_depth = 100;
  desc.photon.photons_per_pass = 65536;
  std::ofstream("/proc/self/clear_refs") << 5;
  const uint64_t before = most_resident_bytes();
  ASSERT_GT(before, 0u);
  Job job;
  GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
  GPURT_ASSERT_OK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
  gpurt_statistics statistics = GPURT_STATISTICS_INIT;
  GPURT_ASSERT_OK(gpurt_frame_get_statistics(frame, &statistics));
  EXPECT_GT(statistics.photon_counters.num_stored * 32, uint64_t(30) << 20);
  // Code and the allocator's own needs come on top.
  EXPECT_LT(most_resident_bytes() - before, limit + (uint64_t(8) << 20));
}

TEST_P(ScenePhotons, RefuseWhatIsNotAllowed)
{
  const Device device = make_device(GetParam());
  const auto refuses = [&](gpurt_scene scene, const gpurt_photon_trace_desc &desc, const char *text) {
    gpurt_photon_map out = nullptr;
    EXPECT_EQ(gpurt_photon_map_trace(scene, &desc, &out), GPURT_ERROR_INVALID_ARGUMENT) << text;
    EXPECT_NE(std::string(gpurt_last_error()).find(text), std::string::npos) << gpurt_last_error();
  };
  const gpurt_photon_trace_desc defaults = GPURT_PHOTON_TRACE_DESC_INIT;
  Scene empty;
  GPURT_ASSERT_OK(gpurt_scene_create(device, empty.out()));
  refuses(empty, defaults, "never committed");
  refuses(make_box(device, 0.5f, false), defaults, "no light");
  const Scene scene = make_box(device, 0.5f);
  refuses(scene, asked([](auto &d) { d.num_paths = 0x80000000u; }), "num_paths");
  refuses(scene, asked([](auto &d) { d.max_depth = 256; }), "max_depth");
  refuses(scene, asked([](auto &d) { d.pass = UINT64_MAX; }), "pass");
  refuses(scene, asked([](auto &d) { d.radius = -1; }), "radius");
  refuses(scene, asked([](auto &d) { d.num_levels = 9; }), "num_levels");
  EXPECT_EQ(gpurt_photon_map_trace(scene, nullptr, nullptr), GPURT_ERROR_INVALID_ARGUMENT);

  const PhotonMap points = make_map(device, {{{0, 0, 0}, {1, 0, 0}}, {}, {}}, 1);
  float values[6];
  const auto refuses_reading = [&](int attribute, uint64_t size, const char *text) {
    EXPECT_EQ(gpurt_photon_map_read(points, gpurt_photon_attribute(attribute), values, size),
              GPURT_ERROR_INVALID_ARGUMENT);
    EXPECT_NE(std::string(gpurt_last_error()).find(text), std::string::npos) << gpurt_last_error();
  };
  refuses_reading(GPURT_PHOTON_ATTRIBUTE_FLUX, sizeof values, "without fluxes");
  refuses_reading(GPURT_PHOTON_ATTRIBUTE_NORMAL, sizeof values, "without normals");
  refuses_reading(GPURT_PHOTON_ATTRIBUTE_DIRECTION, sizeof values, "gpurt_photon_map_trace");
  refuses_reading(GPURT_PHOTON_ATTRIBUTE_POSITION, sizeof values - 1, "24");
  refuses_reading(4, sizeof values, "attribute");
  GPURT_EXPECT_OK(gpurt_photon_map_read(points, GPURT_PHOTON_ATTRIBUTE_POSITION, values, sizeof values));
  EXPECT_EQ(values[3], 1);
}

}  // namespace
