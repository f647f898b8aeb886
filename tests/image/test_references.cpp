// Images against references that an independent renderer made, under the noise model of
// reference_image.h. Skipped where the scenes are not there.
//
// Environment variables: GPURT_TEST_SPP sets the samples (at least those that a case's tiles need), GPURT_TEST_DEVICE=cuda the device, GPURT_TEST_ACCEL=kdtree the
// CPU's accelerator, GPURT_TEST_SCENES the folder of the scenes.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "../support/gpurt_test.h"
#include "../support/reference_image.h"

namespace {

using namespace gpurt_test;
namespace fs = std::filesystem;

fs::path scenes_folder()
{
  const char *folder = std::getenv("GPURT_TEST_SCENES");
  if (folder != nullptr) return folder;
  return fs::path(GPURT_SOURCE_DIR).parent_path() / "shared" / "scenes";
}

gpurt_device_type device_type()
{
  const char *device = std::getenv("GPURT_TEST_DEVICE");
  if (device == nullptr || std::string(device) == "cpu") return GPURT_DEVICE_CPU;
  EXPECT_EQ(std::string(device), "cuda") << "GPURT_TEST_DEVICE is neither cpu nor cuda";
  return GPURT_DEVICE_CUDA;
}

struct Case {
  const char *scene;      // file
  const char *reference;  // key of references.json and name of the .exr
  uint32_t spp;
  // Tiles are asserted beside the mean from `tiles_from` to `tiles_to` samples. From: light through glass or a slit, and
  // lamps in rough metal; with fewer samples most tiles have not seen the rare bright paths, so that their variance is
  // underestimated and 4 sigma mean nothing. To: with more, what the scene leaves open shows, as said at each case.
  uint32_t tiles_from = 0, tiles_to = UINT32_MAX;
  gpurt_pipeline pipeline = GPURT_PIPELINE_PATH;
};
constexpr gpurt_pipeline reyes = GPURT_PIPELINE_REYES, photon = GPURT_PIPELINE_PHOTON;

// Samples that keep each case to a second or two.
const Case cases[] = {
    {"cornell.glb", "cornell", 64},
    {"degenerate_triangles.glb", "cornell", 64},
    {"degenerate_scale_1e-6.glb", "cornell", 64},
    {"degenerate_scale_1e6.glb", "cornell", 64},
    // Coordinates of 1e6 have steps of 1/16, so that edges lie elsewhere.
    {"degenerate_offset_1e6.glb", "cornell", 64, 0, 512},
    {"cornell_spheres.glb", "cornell_spheres", 64, 4096},
    {"caustic_glass.glb", "caustic_glass", 64, 65536},
    {"veach_mis.glb", "veach_mis", 64, 65536},
    {"interior_slit.glb", "interior_slit", 64, 4096},
    {"interior_classroom.glb", "interior_classroom", 64},
    {"city_munich.glb", "city_munich", 32},
    // Smooth normals leave renderers some freedom at silhouettes.
    {"balloon_simple.glb", "balloon_simple", 32, 0, 0},
    {"teapot_tess.glb", "teapot", 32},
    // The reference's triangles leave the patches by up to 0.09 pixels, which shows at silhouettes. So it does in the
    // other cases of patches.
    {"teapot_patches.glb", "teapot", 32, 0, 512},
    {"teapot_tess.glb", "teapot_direct", 32},
    {"killeroo_tess.glb", "killeroo", 32},
    {"killeroo_patches.glb", "killeroo", 32, 0, 512},
    {"killeroo_tess.glb", "killeroo_direct", 32},
    {"bigguy_tess.glb", "bigguy", 32},
    {"bigguy_patches.glb", "bigguy", 32, 0, 0},
    {"bigguy_tess.glb", "bigguy_direct", 32},
    {"eye_split_tess.glb", "eye_split", 32},
    {"eye_split_patches.glb", "eye_split", 32},
    {"eye_split_tunnel_tess.glb", "eye_split_tunnel", 32},
    {"eye_split_tunnel_patches.glb", "eye_split_tunnel", 32},
    {"eye_split_tunnel_tess.glb", "eye_split_tunnel_direct", 32},
    // The reference's noise is known on average over the image alone; with less own noise its darker half decides.
    {"lights_punctual.glb", "lights_punctual", 32, 0, 512},
    {"lights_punctual.glb", "lights_punctual_direct", 32, 0, 512},
    {"env_latlong.glb", "env_latlong", 128},
    {"degenerate_edges.glb", "degenerate_edges", 64},
    // Micropolygons of the patches themselves: with less noise what the references' triangles leave shows, in the same
    // tiles and by the same amount as where the patches are path traced.
    {"teapot_patches.glb", "teapot_direct", 64, 0, 64, reyes},
    {"killeroo_patches.glb", "killeroo_direct", 32, 0, 32, reyes},
    {"bigguy_patches.glb", "bigguy_direct", 64, 0, 0, reyes},
    {"eye_split_patches.glb", "eye_split", 64, 0, UINT32_MAX, reyes},
    {"eye_split_tunnel_patches.glb", "eye_split_tunnel_direct", 64, 0, UINT32_MAX, reyes},
    // Meshes: flat and smooth triangles, textures, lamps seen directly.
    {"killeroo_tess.glb", "killeroo_direct", 64, 0, UINT32_MAX, reyes},
    {"lights_punctual.glb", "lights_punctual_direct", 64, 0, 512, reyes},
    // Passes of photons: their blur is no noise, so that the mean is asserted alone.
    {"cornell.glb", "cornell", 4, 0, 0, photon},
    {"cornell_spheres.glb", "cornell_spheres", 4, 0, 0, photon},
    {"caustic_glass.glb", "caustic_glass", 4, 0, 0, photon},
    {"env_latlong.glb", "env_latlong", 4, 0, 0, photon},
};

class References : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Scenes, References, testing::ValuesIn(cases), [](const auto &info) {
  std::string name = std::string(info.param.scene) + "_" + info.param.reference;
  if (info.param.pipeline == reyes) name += "_reyes";
  if (info.param.pipeline == photon) name += "_photon";
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

  Device device = make_device(device_type());
  ASSERT_NE(gpurt_device(device), nullptr);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_load(device, scene_path.c_str(), scene.out()));
  const char *accel = std::getenv("GPURT_TEST_ACCEL");
  commit(scene, accel != nullptr && std::string(accel) == "kdtree" ? GPURT_ACCEL_KDTREE : GPURT_ACCEL_AUTO);
  RenderOptions o;
  o.width = facts["width"];
  o.height = facts["height"];
  o.pipeline = test.pipeline;
  o.max_depth = test.pipeline == reyes ? 2 : uint32_t(facts["max_depth"]);
  const char *spp = std::getenv("GPURT_TEST_SPP");
  o.spp = spp != nullptr ? std::max(uint32_t(std::atoi(spp)), test.tiles_from) : test.spp;
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
      "%s against %s, %u spp: relMSE %.3g, expected %.3g, trimmed %.3g, mean %+.3f %%, %.3f %% of tiles "
      "within 4 sigma, "
      "worst %.1f\n",
      test.scene, test.reference, o.spp, result.relmse, result.expected, result.trimmed,
      100 * (result.mean_ratio - 1), 100 * result.tiles_within_4_sigma, result.worst_sigma);
  if (o.spp >= test.tiles_from && o.spp <= test.tiles_to) {
    EXPECT_GE(result.tiles_within_4_sigma, 0.999);
  }
  // Over all tiles: the error is the noise of both images and nothing else. Of some 10^5 values it is known to 2 %; the
  // trimmed measure leaves out silhouettes and what rare paths do to single pixels.
  if (o.spp <= std::max(test.spp, test.tiles_to) && test.pipeline != photon) {
    EXPECT_LE(result.trimmed, 1.1 * result.expected);
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
