// Path-traced images against references that an independent renderer made, under the noise model of
// reference_image.h. Skipped where the scenes are not there. GPURT_TEST_SPP raises the samples.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "../support/gpurt_test.h"
#include "../support/reference_image.h"

namespace {

using namespace gpurt_test;
namespace fs = std::filesystem;

fs::path scenes_folder() { return fs::path(GPURT_SOURCE_DIR).parent_path() / "shared" / "scenes"; }

struct Case {
  const char *scene;      // file
  const char *reference;  // key of references.json and name of the .exr
  uint32_t spp;
  // Light through glass or a slit, lamps in rough metal: at few samples most tiles have not seen the rare bright paths,
  // so their variance is underestimated and the tiles' 4 sigma mean nothing. balloon_simple: smooth normals at
  // silhouettes leave renderers some freedom; so do patches, up to 0.09 pixels. eye_split: at 32 samples its own noise
  // is below what is known of the reference's from place to place. There the mean alone is asserted, and the tiles are printed.
  bool mean_alone = false;
};

// Samples that keep each case to a second or two; scenes with rare bright paths get more, since the noise model needs
// the rare paths to have been seen.
const Case cases[] = {
    {"cornell.glb", "cornell", 64},
    {"degenerate_triangles.glb", "cornell", 64},
    {"degenerate_scale_1e-6.glb", "cornell", 64},
    {"degenerate_scale_1e6.glb", "cornell", 64},
    {"degenerate_offset_1e6.glb", "cornell", 64},
    {"cornell_spheres.glb", "cornell_spheres", 64, true},
    {"caustic_glass.glb", "caustic_glass", 64, true},
    {"veach_mis.glb", "veach_mis", 64, true},
    {"interior_slit.glb", "interior_slit", 64, true},
    {"interior_classroom.glb", "interior_classroom", 64},
    {"city_munich.glb", "city_munich", 32},
    {"balloon_simple.glb", "balloon_simple", 32, true},
    {"teapot_tess.glb", "teapot", 32},
    {"teapot_patches.glb", "teapot", 32},
    {"teapot_tess.glb", "teapot_direct", 32},
    {"killeroo_tess.glb", "killeroo", 32},
    {"killeroo_patches.glb", "killeroo", 32},
    {"killeroo_tess.glb", "killeroo_direct", 32},
    {"bigguy_tess.glb", "bigguy", 32},
    {"bigguy_patches.glb", "bigguy", 32, true},
    {"bigguy_tess.glb", "bigguy_direct", 32},
    {"eye_split_tess.glb", "eye_split", 32},
    {"eye_split_patches.glb", "eye_split", 32},
    {"eye_split_tunnel_tess.glb", "eye_split_tunnel", 32},
    {"eye_split_tunnel_patches.glb", "eye_split_tunnel", 32},
    {"eye_split_tunnel_tess.glb", "eye_split_tunnel_direct", 32},
    {"lights_punctual.glb", "lights_punctual", 32, true},
    {"lights_punctual.glb", "lights_punctual_direct", 32, true},
    {"env_latlong.glb", "env_latlong", 64, true},
    {"degenerate_edges.glb", "degenerate_edges", 64},
};

class References : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Scenes, References, testing::ValuesIn(cases), [](const auto &info) {
  std::string name = std::string(info.param.scene) + "_" + info.param.reference;
  for (char &c : name) {
    if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
  }
  return name;
});

TEST_P(References, ImageAgreesWithinItsNoise)
{
  const Case &test = GetParam();
  const fs::path scene_path = scenes_folder() / test.scene;
  if (!fs::exists(scene_path)) GTEST_SKIP() << scene_path << " is not there";
  const nlohmann::json all =
      nlohmann::json::parse(std::ifstream(scenes_folder() / "reference" / "references.json"));
  const nlohmann::json &facts = all[test.reference];
  const RgbImage reference =
      read_rgb_exr((scenes_folder() / "reference" / (std::string(test.reference) + ".exr")).string());

  Device device = make_device();
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_load(device, scene_path.c_str(), scene.out()));
  const char *accel = std::getenv("GPURT_TEST_ACCEL");
  commit(scene, accel != nullptr && std::string(accel) == "kdtree" ? GPURT_ACCEL_KDTREE : GPURT_ACCEL_AUTO);
  RenderOptions o;
  o.width = facts["width"];
  o.height = facts["height"];
  o.max_depth = facts["max_depth"];
  const char *spp = std::getenv("GPURT_TEST_SPP");
  o.spp = spp != nullptr ? uint32_t(std::atoi(spp)) : test.spp;
  ASSERT_EQ(reference.width, o.width);
  ASSERT_EQ(reference.height, o.height);
  Frame frame = make_frame(scene, o, 1u << GPURT_OUTPUT_VARIANCE);
  render(frame, o);
  const std::vector<float> color = read_color(frame, o);
  std::vector<float> variance(color.size());
  GPURT_ASSERT_OK(
      gpurt_frame_read(frame, GPURT_OUTPUT_VARIANCE, variance.data(), variance.size() * sizeof(float)));

  const ImageComparison result = compare_images(color, variance, reference, facts["relmse"]);
  std::printf(
      "%s against %s, %u spp: relMSE %.3g, trimmed %.3g, mean %+.3f %%, %.3f %% of tiles within 4 sigma, "
      "worst %.1f\n",
      test.scene, test.reference, o.spp, result.relmse, result.trimmed, 100 * (result.mean_ratio - 1),
      100 * result.tiles_within_4_sigma, result.worst_sigma);
  if (!test.mean_alone) {
    EXPECT_GE(result.tiles_within_4_sigma, 0.999);
  }
  // The mean's own noise at these samples is well below the 0.5 % of the promise, but for the caustics of glass.
  double sum = 0, sum_variance = 0;
  for (size_t i = 0; i < color.size(); ++i) {
    sum += reference.rgb[i];
    sum_variance += variance[i];
  }
  EXPECT_NEAR(result.mean_ratio, 1.0, 0.005 + 4 * std::sqrt(sum_variance) / sum);
}

}  // namespace
