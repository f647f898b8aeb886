// The fixed A-buffer: samples keep their nearest fragments, as many as they have slots; the others are lost, and counted. And
// samples with more fragments than memory holds, which are peeled.
#include <cmath>

#include "../support/reyes_renders.h"

namespace {

using namespace gpurt_test;

class ReyesSlots : public ::testing::TestWithParam<gpurt_device_type> {
 protected:
  void SetUp() override
  {
    if (GetParam() == GPURT_DEVICE_CUDA && !has_cuda()) GTEST_SKIP() << "no CUDA device";
  }
};

// Sheets at -i / 1000 in no order, of patches and of meshes, that glow red, green, blue, red .. before a white sky.
struct Sheets {
  uint32_t num;
  float alpha;

  void operator()(gpurt_scene scene) const
  {
    const std::array<uint32_t, 3> materials = add_layer_materials(scene, alpha);
    std::array<Mesh, 3> meshes;
    for (const uint32_t i : shuffled_layers(num)) {
      const float z = -0.001f * float(i);
      if (i % 5 == 0) add_patches(scene, {flat_patch({-6, -6, z}, {12, 0, 0}, {0, 12, 0})}, materials[i % 3]);
      else meshes[i % 3].append(quad({-6, -6, z}, {6, -6, z}, {6, 6, z}, {-6, 6, z}));
    }
    for (size_t k = 0; k < 3; ++k) add_mesh(scene, meshes[k], materials[k]);
    set_environment(scene, 1);
    add_camera(scene, {0, 0, 3}, 0.8f);
  }
};

// Dented balls within each other that let light through, some twice in the same place, and one that does not.
void fill_balls(gpurt_scene scene)
{
  const std::vector<PatchNet> nets = closed_patches(2, 0.3, 5);
  const std::array<float, 12> whole = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                              half = {0.5f, 0, 0, 0.1f, 0, 0.5f, 0, 0, 0, 0, 0.5f, 0.1f};
  add_patches(scene, nets, add_glow(scene, {0.3f, 0, 0.2f}, 0.4f), {whole, whole, half});
  add_patches(scene, nets, add_glow(scene, {0, 0.5f, 0}, 0.6f), {half, half});
  add_patches(scene, nets, 0, {{0.3f, 0, 0, 0, 0, 0.3f, 0, 0.2f, 0, 0, 0.3f, 0}});
  set_environment(scene, 1);
  add_camera(scene, {0.2f, 0.3f, 3}, 0.8f);
}

template <class Fill>
Scene scene_on(gpurt_device device, const Fill &fill)
{
  Scene scene;
  GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
  fill(scene);
  coarse_commit(scene);
  return scene;
}

std::vector<float> picture(gpurt_scene scene, const RenderOptions &o, gpurt_reyes_counters &counters)
{
  const Frame frame = make_frame(scene, o);
  render(frame, o);
  counters = statistics_of(frame).reyes_counters;
  return read_color(frame, o);
}

// Little more memory than a commit takes.
template <class Fill>
uint64_t little_memory(gpurt_device_type type, const Fill &fill)
{
  const Device device = make_device(type, type == GPURT_DEVICE_CPU ? 1 : 0);
  const Scene scene = scene_on(device, fill);
  gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
  GPURT_EXPECT_OK(gpurt_device_get_properties(device, &p));
  return p.memory_peak_bytes + (uint64_t(type == GPURT_DEVICE_CPU ? 3 : 9) << 19);
}

bool has_same_bits(const std::vector<float> &a, const std::vector<float> &b)
{
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

TEST_P(ReyesSlots, KeepTheNearestAndCountTheOthers)
{
  const Device device = make_device(GetParam());
  const Sheets sheets{40, 0.05f};
  const Scene scene = scene_on(device, sheets);
  RenderOptions o = reyes_options(12, 9, 4.0f);
  o.max_depth = 1;
  const uint64_t num_samples = 12 * 12 * 9;
  for (const uint32_t slots : {1u, 3u, 16u, 39u, 40u, 64u}) {
    SCOPED_TRACE(slots);
    o.reyes.fragment_slots = slots;
    gpurt_reyes_counters c;
    const std::vector<float> color = picture(scene, o, c);
    const std::array<double, 3> expected = color_of_layers(std::min(slots, 40u), sheets.alpha);
    double worst = 0;
    for (size_t i = 0; i < color.size(); ++i)
      worst = std::max(worst, std::abs(double(color[i]) - expected[i % 3]));
    EXPECT_LE(worst, 1e-5);
    EXPECT_EQ(c.num_lost_fragments, num_samples * (40 - std::min(slots, 40u)));
    EXPECT_EQ(c.num_fragments, num_samples * 40);
    EXPECT_LE(c.largest_fragments, num_samples * std::min(slots, 40u));
  }
}

TEST_P(ReyesSlots, HaveTheBitsOfAllFragmentsWhereTheyAreEnough)
{
  const Device device = make_device(GetParam());
  const Scene scene = scene_on(device, fill_balls);
  RenderOptions o = reyes_options(60, 9);
  o.reyes.no_shadows = 0;
  gpurt_reyes_counters all, some;
  const std::vector<float> exact = picture(scene, o, all);
  EXPECT_EQ(all.num_lost_fragments, 0u);
  uint64_t last = UINT64_MAX;
  for (const uint32_t slots : {1u, 2u, 4u, 64u}) {
    SCOPED_TRACE(slots);
    o.reyes.fragment_slots = slots;
    const std::vector<float> color = picture(scene, o, some);
    EXPECT_LT(some.num_lost_fragments, last);
    EXPECT_EQ(some.num_lost_fragments != 0, slots != 64);
    EXPECT_EQ(has_same_bits(color, exact), slots == 64);
    last = some.num_lost_fragments;
  }
}

// Nor does the loss depend on how the image is cut, or on memory.
TEST_P(ReyesSlots, HaveTheSameBitsForAnyTilesThreadsAndMemory)
{
  const Device device = make_device(GetParam());
  RenderOptions o = reyes_options(70, 9);
  o.reyes.fragment_slots = 3;
  gpurt_reyes_counters whole, part;
  const std::vector<float> expected = picture(scene_on(device, fill_balls), o, whole);
  EXPECT_GT(whole.num_lost_fragments, 0u);
  const bool is_cuda = GetParam() == GPURT_DEVICE_CUDA;
  for (const auto &[threads, tile, limit] : {std::tuple{1u, 0u, uint64_t(0)},
                                             {2u, 19u, uint64_t(0)},
                                             {1u, 33u, little_memory(GetParam(), fill_balls)}}) {
    SCOPED_TRACE(testing::Message() << threads << " threads, tiles of " << tile << ", " << limit << " bytes");
    const Device other = make_device(GetParam(), is_cuda ? 0 : threads, limit);
    o.tile_size = tile;
    EXPECT_TRUE(has_same_bits(picture(scene_on(other, fill_balls), o, part), expected));
    EXPECT_EQ(part.num_lost_fragments, whole.num_lost_fragments);
    if (limit != 0) {
      EXPECT_LT(part.working_bytes, whole.working_bytes);
    }
  }
}

TEST_P(ReyesSlots, ChangeNothingWhereNothingBlends)
{
  const Device device = make_device(GetParam());
  const Scene scene = scene_on(device, [](gpurt_scene s) {
    add_patches(s, closed_patches(2, 0.3, 5));
    set_environment(s, 1);
    add_camera(s, {0.2f, 0.3f, 3}, 0.8f);
  });
  for (const auto shading : {GPURT_REYES_SHADING_SAMPLES, GPURT_REYES_SHADING_MICROPOLYGONS}) {
    if (shading != GPURT_REYES_SHADING_SAMPLES && GetParam() == GPURT_DEVICE_CUDA) continue;  // lit by a sky
    RenderOptions o = reyes_options(40, 4);
    o.reyes.shading = shading;
    gpurt_reyes_counters without, with;
    const std::vector<float> expected = picture(scene, o, without);
    o.reyes.fragment_slots = 1;
    EXPECT_TRUE(has_same_bits(picture(scene, o, with), expected));
    EXPECT_EQ(with.num_lost_fragments, 0u);
    EXPECT_EQ(with.num_fragments, without.num_fragments);
    EXPECT_EQ(with.working_bytes, without.working_bytes);
  }
}

// Samples see thousands of layers where memory is for some of them at a time.
TEST_P(ReyesSlots, AreNotNeededForThousandsOfLayersInLittleMemory)
{
  constexpr uint32_t num_layers = 2000, num_samples = 7 * 7 * 2;
  const Sheets sheets{num_layers, 0.001f};
  RenderOptions o = reyes_options(7, 2, 4.0f);
  o.max_depth = 1;
  const std::array<double, 3> expected = color_of_layers(num_layers, sheets.alpha);
  gpurt_reyes_counters roomy, tight;
  const Device device = make_device(GetParam());
  const std::vector<float> color = picture(scene_on(device, sheets), o, roomy);
  for (size_t i = 0; i < color.size(); ++i) EXPECT_NEAR(color[i], expected[i % 3], 1e-4);
  EXPECT_EQ(roomy.num_fragments, uint64_t(num_samples) * num_layers);
  EXPECT_EQ(roomy.num_lost_fragments, 0u);
  const Device small =
      make_device(GetParam(), GetParam() == GPURT_DEVICE_CPU ? 1 : 0, little_memory(GetParam(), sheets));
  EXPECT_TRUE(has_same_bits(picture(scene_on(small, sheets), o, tight), color));
  EXPECT_LT(tight.largest_fragments, uint64_t(num_samples) * num_layers);
}

INSTANTIATE_TEST_SUITE_P(Devices, ReyesSlots, ::testing::Values(GPURT_DEVICE_CPU, GPURT_DEVICE_CUDA),
                         [](const auto &info) { return info.param == GPURT_DEVICE_CPU ? "cpu" : "cuda"; });

}  // namespace
