// REYES: no cracks, what path tracing sees, and an image that depends on nothing but the scene and the settings; on the CPU
// and on a CUDA device.
#include "../support/reyes_renders.h"

namespace {

using namespace gpurt_test;

class Reyes : public ::testing::TestWithParam<gpurt_device_type> {
 protected:
  void SetUp() override
  {
    if (GetParam() == GPURT_DEVICE_CUDA && !has_cuda()) GTEST_SKIP() << "no CUDA device";
  }
};

// Catalogue row 37: whatever stands within a closed surface sees it in every direction. Eyes lie anywhere inside, also so
// close to the surface that pieces cross the eye plane.
TEST_P(Reyes, SeesNoBackgroundFromWithinAClosedSurface)
{
  Device device = make_device(GetParam());
  std::mt19937_64 rng(1);
  int num_cameras = 0;
  for (const auto &[nets, largest] : {std::pair{closed_patches(1, 0.0, 1), 0.75},
                                      {closed_patches(2, 0.3, 2), 0.5},
                                      {closed_patches(3, 0.15, 3), 0.7},
                                      {poles(3), 0.6},
                                      {poles(5), 0.7}}) {
    SCOPED_TRACE(nets.size());
    Scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
    add_patches(scene, nets);
    constexpr uint32_t num = 24;
    for (uint32_t i = 0; i < num; ++i) {
      std::array<double, 3> eye;
      double length = 0;
      for (double &c : eye) {
        c = uniform(rng, -1, 1);
        length += c * c;
      }
      // Half of them far out, where the surface is near.
      const double r = i % 2 ? largest : largest * uniform(rng);
      for (double &c : eye) c *= r / std::sqrt(length);
      add_turned_camera(scene, eye, rng, float(uniform(rng, 0.3, 2.5)));
    }
    coarse_commit(scene);
    for (uint32_t i = 0; i < num; ++i, ++num_cameras) {
      const float rates[] = {0.25f, 1.0f, 3.0f, 40.0f};
      RenderOptions o = reyes_options(24, 9, rates[i % 4]);
      o.seed = i;
      const std::vector<int> covered = covered_samples(scene, o, i);
      for (size_t p = 0; p < covered.size(); ++p)
        ASSERT_EQ(covered[p], 9) << "camera " << i << ", pixel " << p % 24 << ", " << p / 24;
    }
  }
  std::printf("%d cameras\n", num_cameras);
}

// Outlines are those of the surface within one sample: path tracing of a fine tessellation takes the same eye rays.
TEST_P(Reyes, CoversWhatPathTracingOfAFineTessellationHits)
{
  Device device = make_device(GetParam());
  std::mt19937_64 rng(2);
  uint64_t num_edge = 0, num_off = 0;
  for (const auto &nets : {closed_patches(1, 0.2, 4), closed_patches(2, 0.3, 5), poles(4)}) {
    SCOPED_TRACE(nets.size());
    Scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
    add_patches(scene, nets);
    constexpr uint32_t num = 6;
    for (uint32_t i = 0; i < num; ++i) {
      std::array<double, 3> eye;
      for (double &c : eye) c = uniform(rng, -2.5, 2.5);
      add_turned_camera(scene, eye, rng, 2.0f);
    }
    gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
    build.accel = GPURT_ACCEL_BVH;
    build.patch_tolerance = 4e-4f;
    GPURT_ASSERT_OK(gpurt_scene_commit(scene, &build));
    for (uint32_t i = 0; i < num; ++i) {
      const RenderOptions o = reyes_options(64, 9);
      const std::vector<int> ours = covered_samples(scene, o, i),
                             theirs = covered_samples(scene, path_options(o), i);
      for (size_t p = 0; p < ours.size(); ++p) {
        ASSERT_LE(std::abs(ours[p] - theirs[p]), 1)
            << "camera " << i << ", pixel " << p % 64 << ", " << p / 64;
        num_edge += theirs[p] != 0 && theirs[p] != 9;
        num_off += ours[p] != theirs[p];
      }
    }
  }
  std::printf("%llu pixels at outlines, %llu of them a sample off\n",
              static_cast<unsigned long long>(num_edge), static_cast<unsigned long long>(num_off));
  // An edge of half a pixel leaves a curve of radius 10 pixels by 0.5^2 / 80 of a pixel, and 9 samples see 9 times that.
  EXPECT_LE(double(num_off), 0.06 * double(num_edge));
}

// The image is that of path tracing with the same light: patches, meshes, instances, lamps, masks.
TEST_P(Reyes, ShadesAsPathTracingDoes)
{
  Device device = make_device(GetParam());
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  const uint32_t red = add_material(scene, GPURT_MATERIAL_LAMBERT, {0.8f, 0.2f, 0.1f});
  add_patches(scene, closed_patches(1, 0.1, 7), red,
              {{0.5f, 0, 0, -0.6f, 0, 0.5f, 0, 0, 0, 0, 0.5f, 0},
               {-0.4f, 0, 0, 0.7f, 0, 0.4f, 0, 0, 0, 0, 0.4f, 0.3f}});
  add_mesh(scene, icosphere(2), add_material(scene, GPURT_MATERIAL_METAL, {0.9f, 0.8f, 0.3f}));
  add_mesh(scene, quad({-4, -1, -4}, {-4, -1, 4}, {4, -1, 4}, {4, -1, -4}), 0);
  set_environment(scene, 0.3f);
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  for (float &c : light.intensity) c = 20;
  light.position[0] = 2;
  light.position[1] = 3;
  light.position[2] = 3;
  uint32_t id;
  GPURT_ASSERT_OK(gpurt_scene_add_light(scene, &light, &id));
  add_camera(scene, {0, 0.3f, 4.5f}, 0.8f);
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_BVH;
  build.patch_tolerance = 1e-4f;
  GPURT_ASSERT_OK(gpurt_scene_commit(scene, &build));
  RenderOptions o = reyes_options(48, 16);
  o.reyes.no_shadows = 0;
  const uint32_t outputs = 1u << GPURT_OUTPUT_DEPTH | 1u << GPURT_OUTPUT_INSTANCE | 1u << GPURT_OUTPUT_NORMAL;
  Frame ours = make_frame(scene, o, outputs), theirs = make_frame(scene, o, outputs);
  render(ours, o);
  render(theirs, path_options(o));
  // The same samples and random numbers: they differ where a sample falls on either side of an outline.
  const std::vector<float> a = read_color(ours, o), b = read_color(theirs, o);
  EXPECT_NEAR(mean(a), mean(b), 0.002 * mean(b));
  size_t num_close = 0;
  for (size_t i = 0; i < a.size(); ++i) num_close += std::abs(a[i] - b[i]) <= 0.02f * (0.1f + b[i]);
  EXPECT_GE(double(num_close), 0.97 * double(a.size()));
  const auto da = read_output<float>(ours, o, GPURT_OUTPUT_DEPTH, 1),
             db = read_output<float>(theirs, o, GPURT_OUTPUT_DEPTH, 1);
  const auto ia = read_output<uint32_t>(ours, o, GPURT_OUTPUT_INSTANCE, 1),
             ib = read_output<uint32_t>(theirs, o, GPURT_OUTPUT_INSTANCE, 1);
  size_t num_same = 0;
  for (size_t i = 0; i < ia.size(); ++i) {
    if (ia[i] != ib[i]) continue;
    ++num_same;
    if (std::isinf(db[i])) EXPECT_TRUE(std::isinf(da[i]));
    else EXPECT_NEAR(da[i], db[i], 0.05f);
  }
  EXPECT_GE(double(num_same), 0.995 * double(ia.size()));
}

// Catalogue rows 40, 49 and 47: tiles, threads and memory change no bit, nor do surfaces in the same place.
TEST_P(Reyes, HasTheSameBitsForAnyTilesThreadsAndMemory)
{
  std::vector<float> first;
  std::vector<uint32_t> first_ids;
  // What a tile of the whole image needs at least; a CUDA device keeps its film and a wave of paths beside it.
  const uint64_t little_memory = uint64_t(GetParam() == GPURT_DEVICE_CUDA ? 20 : 12) << 20;
  for (const auto &[threads, tile, limit] : {std::tuple{1u, 64u, uint64_t(0)},
                                             {2u, 16u, uint64_t(0)},
                                             {2u, 7u, uint64_t(0)},
                                             {1u, 256u, little_memory}}) {
    Device device = make_device(GetParam(), threads, limit);
    Scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
    // Every patch twice, in one geometry and in another: ties everywhere.
    std::vector<PatchNet> nets = closed_patches(2, 0.2, 9);
    const std::vector<PatchNet> once = nets;
    nets.insert(nets.end(), once.begin(), once.end());
    add_patches(scene, nets, add_material(scene, GPURT_MATERIAL_LAMBERT, {0.9f, 0.5f, 0.1f}));
    add_patches(scene, once, add_material(scene, GPURT_MATERIAL_LAMBERT, {0.1f, 0.5f, 0.9f}));
    set_environment(scene, 1);
    add_camera(scene, {0.3f, 0.1f, 2}, 1.0f);
    coarse_commit(scene);
    for (const gpurt_reyes_filter filter :
         {GPURT_REYES_FILTER_BOX, GPURT_REYES_FILTER_GAUSSIAN, GPURT_REYES_FILTER_MITCHELL}) {
      RenderOptions o = reyes_options(100, 9);
      o.reyes.filter = filter;
      o.tile_size = tile;
      Frame frame = make_frame(scene, o, 1u << GPURT_OUTPUT_PRIMITIVE);
      render(frame, o);
      const std::vector<float> color = read_color(frame, o);
      const auto ids = read_output<uint32_t>(frame, o, GPURT_OUTPUT_PRIMITIVE, 1);
      const size_t at = size_t(filter) - 1;
      if (first.size() <= at * color.size()) {
        first.insert(first.end(), color.begin(), color.end());
        first_ids.insert(first_ids.end(), ids.begin(), ids.end());
      }
      ASSERT_EQ(std::memcmp(first.data() + at * color.size(), color.data(), color.size() * sizeof(float)), 0)
          << threads << " threads, tiles of " << tile;
      ASSERT_EQ(std::memcmp(first_ids.data() + at * ids.size(), ids.data(), ids.size() * sizeof(uint32_t)),
                0);
    }
  }
}

// A job in parts is the job at once; other settings in one frame are refused.
TEST_P(Reyes, GoesOnWhereItWas)
{
  Device device = make_device(GetParam());
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_patches(scene, closed_patches(1, 0.1, 3));
  set_environment(scene, 1);
  add_camera(scene, {0, 0, 3}, 0.8f);
  commit(scene, GPURT_ACCEL_BVH);
  RenderOptions o = reyes_options(32, 20, 1.0f);
  Frame once = make_frame(scene, o), parts = make_frame(scene, o);
  render(once, o);
  RenderOptions part = o;
  part.spp = 7;
  render(parts, part);
  o.reyes.shading_rate = 0;  // what the frame was begun with
  render(parts, o);
  EXPECT_EQ(read_color(once, o), read_color(parts, o));
  gpurt_render_desc other = GPURT_RENDER_DESC_INIT;
  other.pipeline = GPURT_PIPELINE_REYES;
  other.samples_per_pixel = 30;
  other.max_depth = 2;
  other.reyes.shading_rate = 2.0f;
  Job job;
  EXPECT_EQ(gpurt_frame_submit(parts, &other, nullptr, 0, job.out()), GPURT_ERROR_INVALID_ARGUMENT);
}

// Catalogue row 38: surfaces through the eye and around it, and time that does not run away.
TEST_P(Reyes, SurvivesPatchesThroughTheEye)
{
  Device device = make_device(GetParam());
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  // A floor just below, a wall that the eye nearly touches, and a ceiling closer still.
  add_patches(scene, {flat_patch({-50, -0.001f, -50}, {100, 0, 0}, {0, 0, 100}),
                      flat_patch({1e-4f, -1, -1}, {0, 2, 0}, {0, 0, 2}),
                      flat_patch({-1, 1e-6f, -3}, {2, 0, 0}, {0, 0, 6})});
  set_environment(scene, 1);
  add_camera(scene, {0, 0, 0}, 1.2f);
  commit(scene, GPURT_ACCEL_BVH);
  const RenderOptions o = reyes_options(64, 9);
  Frame frame = make_frame(scene, o);
  render(frame, o);
  const gpurt_statistics s = statistics_of(frame);
  EXPECT_EQ(s.num_nonfinite, 0u);
  EXPECT_LE(s.reyes_counters.num_splits, 200000u);
  const std::vector<int> ours = covered_samples(scene, o, 0),
                         theirs = covered_samples(scene, path_options(o), 0);
  for (size_t p = 0; p < ours.size(); ++p) {
    ASSERT_LE(std::abs(ours[p] - theirs[p]), 1) << "pixel " << p % 64 << ", " << p / 64;
  }
}

// Catalogue rows 43 and 44.
TEST_P(Reyes, TakesDegenerateAndNeedlePatches)
{
  Device device = make_device(GetParam());
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  PatchNet point{}, line = flat_patch({-1, 0.5f, 0}, {2, 0, 0}, {0, 0, 0});
  PatchNet triangle = flat_patch({-1, -1, 0}, {2, 0, 0}, {0, 2, 0});
  for (size_t c = 0; c < 4; ++c) triangle[c] = triangle[0];
  add_patches(scene, {point, line, triangle});
  set_environment(scene, 1);
  add_camera(scene, {0, 0, 3}, 1.0f);
  add_camera(scene, {0, 10, 3}, 1.0f);
  commit(scene, GPURT_ACCEL_BVH);
  const RenderOptions o = reyes_options(64, 9);
  Frame frame = make_frame(scene, o);
  render(frame, o);
  EXPECT_EQ(statistics_of(frame).num_nonfinite, 0u);
  for (float c : read_color(frame, o)) ASSERT_TRUE(std::isfinite(c));

  Scene needles;
  GPURT_ASSERT_OK(gpurt_scene_create(device, needles.out()));
  add_patches(needles, {flat_patch({-1, -0.0005f, 0}, {2, 0, 0}, {0, 0.001f, 0})});
  add_camera(needles, {0, 0, 3}, 0.8f);
  commit(needles, GPURT_ACCEL_BVH);
  RenderOptions large = reyes_options(512, 4);
  large.tile_size = 256;
  Frame needle = make_frame(needles, large);
  render(needle, large);
  const gpurt_reyes_counters c = statistics_of(needle).reyes_counters;
  const double pixels = 2 * 512 / (2 * std::tan(0.4) * 3), area = pixels * pixels * 0.0005;
  // Four tiles dice what they share.
  EXPECT_LE(double(c.num_micropolygons), 4 * (4 * area / 0.25 + 4 * pixels / 0.5));
  EXPECT_GE(double(c.num_micropolygons), pixels);
}

// Catalogue row 41: the outline of a curved surface is the better the smaller micropolygons are.
TEST_P(Reyes, OutlinesImproveWithTheShadingRate)
{
  Device device = make_device(GetParam());
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_patches(scene, closed_patches(1, 0.0, 1));
  add_camera(scene, {0, 0, 3}, 0.9f);
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_BVH;
  build.patch_tolerance = 1e-4f;
  GPURT_ASSERT_OK(gpurt_scene_commit(scene, &build));
  double last = 0;
  for (const float rate : {0.25f, 4.0f, 64.0f, 256.0f}) {
    const RenderOptions o = reyes_options(96, 16, rate);
    const std::vector<int> ours = covered_samples(scene, o, 0),
                           theirs = covered_samples(scene, path_options(o), 0);
    double error = 0;
    for (size_t p = 0; p < ours.size(); ++p) error += std::abs(ours[p] - theirs[p]);
    std::printf("shading rate %g: %g samples differ\n", double(rate), error);
    EXPECT_GE(error, last);
    last = error;
  }
  EXPECT_GT(last, 0);
}

// A surface that lets half of the sky through and is nowhere behind itself: every sample sees it once, whatever cuts it, also
// where micropolygons meet that have different sizes.
TEST_P(Reyes, BlendsASurfaceOnce)
{
  Device device = make_device(GetParam());
  std::mt19937_64 rng(8);
  constexpr int n = 4, side = 3 * n + 1;
  std::vector<Point> points;
  for (int i = 0; i < side * side; ++i) {
    const auto off = [&] { return float(uniform(rng, -0.05, 0.05)); };
    points.push_back({-2 + 4.0f * float(i % side) / (side - 1) + off(),
                      -2 + 4.0f * float(i / side) / (side - 1) + off(), 4 * off()});
  }
  std::vector<PatchNet> nets;
  for (int p = 0; p < n * n; ++p) {
    PatchNet net;
    for (int k = 0; k < 16; ++k)
      net[size_t(k)] = points[size_t((3 * (p / n) + k / 4) * side + 3 * (p % n) + k % 4)];
    nets.push_back(net);
  }
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  gpurt_material_desc half = GPURT_MATERIAL_DESC_INIT;
  for (float &c : half.base_color) c = 0;
  half.alpha = 0.5f;
  half.blends = 1;
  uint32_t material;
  GPURT_ASSERT_OK(gpurt_scene_add_material(scene, &half, &material));
  add_patches(scene, nets, material);
  set_environment(scene, 1);
  add_camera(scene, {0.1f, 0.2f, 3}, 0.9f);
  coarse_commit(scene);
  for (const float rate : {0.25f, 1.7f, 12.0f, 90.0f}) {
    for (const float flatness : {0.0f, 0.5f}) {
      RenderOptions o = reyes_options(64, 16, rate);
      o.max_depth = 1;
      o.reyes.flatness = flatness;
      Frame frame = make_frame(scene, o);
      render(frame, o);
      size_t num_off = 0;
      for (const float c : read_color(frame, o)) num_off += std::abs(c - 0.5f) > 1e-6f;
      EXPECT_EQ(num_off, 0u) << "shading rate " << rate << ", flatness " << flatness;
      // What is kept at a time is a part of all of them.
      const gpurt_reyes_counters c = statistics_of(frame).reyes_counters;
      EXPECT_GT(c.largest_fragments, 0u);
      EXPECT_LE(c.largest_fragments, c.num_fragments);
    }
  }
}

// What lies behind a wall leaves no trace in the image, and CPU devices do not dice it, in whatever order it was added. As near as
// the wall it counts.
TEST_P(Reyes, LeavesOutWhatIsHidden)
{
  const bool is_cpu = GetParam() == GPURT_DEVICE_CPU;
  const PatchNet wall = flat_patch({-3, -3, 0}, {6, 0, 0}, {0, 6, 0});
  std::vector<PatchNet> behind = closed_patches(2, 0.2, 4), same = {wall};
  for (PatchNet &net : behind) {
    for (Point &p : net) p[2] -= 2;
  }
  RenderOptions o = reyes_options(64, 9);
  std::vector<float> wall_alone;
  uint64_t num_alone = 0;
  for (const auto &nets : {std::vector<PatchNet>{}, behind, same}) {
    for (const bool wall_first : {true, false}) {
      Device device = make_device(GetParam(), 1);
      Scene scene;
      GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
      const uint32_t red = add_material(scene, GPURT_MATERIAL_LAMBERT, {0.9f, 0.1f, 0.1f}),
                     blue = add_material(scene, GPURT_MATERIAL_LAMBERT, {0.1f, 0.1f, 0.9f});
      if (wall_first) add_patches(scene, {wall}, red);
      if (!nets.empty()) add_patches(scene, nets, blue);
      if (!wall_first) add_patches(scene, {wall}, red);
      set_environment(scene, 1);
      add_camera(scene, {0, 0, 3}, 0.8f);
      coarse_commit(scene);
      Frame frame = make_frame(scene, o);
      render(frame, o);
      const std::vector<float> color = read_color(frame, o);
      const uint64_t num = statistics_of(frame).reyes_counters.num_micropolygons;
      if (nets.empty()) {
        wall_alone = color;
        num_alone = num;
        EXPECT_GT(num_alone, 10000u);
      } else if (nets.size() > 1) {
        EXPECT_EQ(color, wall_alone);
        if (is_cpu) EXPECT_EQ(num, num_alone);
        else EXPECT_GT(num, num_alone);
      } else {
        // Of two walls in one place both are looked at, and the one that was added first is seen.
        EXPECT_EQ(num, 2 * num_alone);
        EXPECT_EQ(color == wall_alone, wall_first);
      }
    }
  }
}

// Isolines turn back at outlines, where they are short on the image: segments of the length that is aimed for elsewhere would
// cut the turns off, here by a sixth of a pixel.
TEST_P(Reyes, CoversTheTurnsAtOutlines)
{
  Device device = make_device(GetParam());
  constexpr uint32_t size = 48, spp = 64;
  for (const int around : {16, 24, 32}) {
    // A tube along y, whose outlines lie amid patches: arcs of a circle of radius 1.
    const double half = 3.14159265 / around, handle = 4.0 / 3 * std::tan(half / 2);
    std::vector<PatchNet> nets;
    for (int m = 0; m < around; ++m) {
      PatchNet net;
      for (int k = 0; k < 16; ++k) {
        const double side = k % 4 < 2 ? -1 : 1, off = k % 4 == 1 || k % 4 == 2 ? handle : 0;
        const double angle = 2 * half * m + side * half, x = std::cos(angle), z = std::sin(angle);
        net[size_t(k)] = {float(x + side * off * z), float(k / 4) - 1.5f, float(z - side * off * x)};
      }
      nets.push_back(net);
    }
    Scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
    // From far away: next to no perspective.
    add_patches(scene, nets, 0, {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -100}});
    add_camera(scene, {0, 0, 0}, 0.026f);
    gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
    build.accel = GPURT_ACCEL_BVH;
    build.patch_tolerance = 1e-4f;
    GPURT_ASSERT_OK(gpurt_scene_commit(scene, &build));
    const RenderOptions o = reyes_options(size, spp);
    const std::vector<int> ours = covered_samples(scene, o, 0),
                           theirs = covered_samples(scene, path_options(o), 0);
    int most = 0, num_edge = 0;
    for (size_t p = 0; p < ours.size(); ++p) {
      most = std::max(most, std::abs(ours[p] - theirs[p]));
      num_edge += theirs[p] != 0 && theirs[p] != int(spp);
    }
    std::printf("%d patches around: %d pixels at outlines, at most %d of 64 samples off\n", around, num_edge,
                most);
    EXPECT_GT(num_edge, 50);
    // 1/32 of half a pixel, and 1/256 for the rounding of vertices, are worth two samples.
    EXPECT_LE(most, 2);
  }
}

// Where the surface allows it, micropolygons are larger, and outlines move by less than was allowed: pixels all of whose
// neighbours are covered, or none, stay so.
TEST_P(Reyes, DicesFlatRegionsCoarser)
{
  Device device = make_device(GetParam());
  std::mt19937_64 rng(6);
  for (const auto &nets : {closed_patches(1, 0.2, 61), closed_patches(3, 0.15, 62), poles(5)}) {
    Scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
    add_patches(scene, nets);
    constexpr uint32_t num = 4, size = 64;
    for (uint32_t i = 0; i < num; ++i) {
      std::array<double, 3> eye;
      for (double &c : eye) c = uniform(rng, -2, 2);
      add_turned_camera(scene, eye, rng, 1.6f);
    }
    coarse_commit(scene);
    uint64_t last = 0;
    for (const float flatness : {0.0f, 0.05f, 0.95f}) {
      uint64_t num_micropolygons = 0, num_seen = 0, num_moved = 0;
      for (uint32_t i = 0; i < num; ++i) {
        RenderOptions o = reyes_options(size, 9);
        const std::vector<int> fine = covered_samples(scene, o, i);
        o.reyes.flatness = flatness;
        Frame frame = camera_frame(scene, o, i);
        render(frame, o);
        num_micropolygons += statistics_of(frame).reyes_counters.num_micropolygons;
        const std::vector<int> coarse = covered_samples(scene, o, i);
        for (uint32_t y = 1; y + 1 < size; ++y) {
          for (uint32_t x = 1; x + 1 < size; ++x) {
            int least = 9, most = 0;
            for (uint32_t k = 0; k < 9; ++k) {
              const int c = fine[(y + k / 3 - 1) * size + x + k % 3 - 1];
              least = std::min(least, c);
              most = std::max(most, c);
            }
            const int c = coarse[y * size + x];
            num_moved += c != fine[y * size + x];
            num_seen += c != 0;
            ASSERT_TRUE((least < 9 || c == 9) && (most > 0 || c == 0))
                << "camera " << i << ", pixel " << x << ", " << y;
          }
        }
      }
      std::printf("flatness %g: %llu micropolygons, %llu of %llu pixels differ\n", double(flatness),
                  static_cast<unsigned long long>(num_micropolygons),
                  static_cast<unsigned long long>(num_moved), static_cast<unsigned long long>(num_seen));
      EXPECT_GT(num_seen, 500u);
      EXPECT_TRUE(flatness == 0 ? num_moved == 0 : num_micropolygons < last);
      last = num_micropolygons;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Cpu, Reyes, ::testing::Values(GPURT_DEVICE_CPU));
INSTANTIATE_TEST_SUITE_P(Cuda, Reyes, ::testing::Values(GPURT_DEVICE_CUDA));

}  // namespace
