// REYES on the CPU has kernels for several instruction sets: all of them make the same image.
#include <cstdlib>
#include <cstring>

#include "../support/reyes_renders.h"

namespace {

using namespace gpurt_test;

constexpr uint32_t compared_outputs =
    1u << GPURT_OUTPUT_COLOR | 1u << GPURT_OUTPUT_DEPTH | 1u << GPURT_OUTPUT_PRIMITIVE;

uint32_t add_cut_out(gpurt_scene scene, uint32_t texture)
{
  gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
  desc.base_color_texture = texture;
  desc.alpha_cutoff = 0.5f;
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &desc, &id));
  return id;
}

uint32_t add_glass_pane(gpurt_scene scene)
{
  gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
  desc.alpha = 0.4f;
  desc.blends = 1;
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &desc, &id));
  return id;
}

uint32_t add_chequers(gpurt_scene scene)
{
  const float texels[16] = {1, 1, 1, 1, 1, 0, 0, 0, 0, 1, 0, 0, 1, 1, 1, 1};
  gpurt_texture_desc texture = GPURT_TEXTURE_DESC_INIT;
  texture.format = GPURT_TEXTURE_RGBA32F;
  texture.width = texture.height = 2;
  texture.filter = GPURT_FILTER_NEAREST;
  texture.texels = texels;
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_texture(scene, &texture, &id));
  return id;
}

// Balls with what a sampler may trip over: everything twice in the same place, patches that are mirrored, folded at poles, degenerate,
// or reach behind the eye. `holes`, `panes`: some surfaces have alpha masks, or blend.
void fill(gpurt_scene scene, bool holes, bool panes)
{
  const std::array<float, 12> whole = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                              mirrored = {-0.5f, 0, 0, 0.7f, 0, 0.5f, 0, 0.6f, 0, 0, 0.5f, 0.5f};
  const std::vector<PatchNet> nets = closed_patches(2, 0.3, 9);
  const uint32_t chalk = add_material(scene, GPURT_MATERIAL_LAMBERT, {0.9f, 0.5f, 0.1f});
  add_patches(scene, nets, chalk, {whole, whole, mirrored});
  add_patches(scene, nets, add_material(scene, GPURT_MATERIAL_LAMBERT, {0.1f, 0.5f, 0.9f}),
              {whole, mirrored});
  add_patches(scene, poles(5), chalk, {{0.3f, 0, 0, -0.9f, 0, 0.3f, 0, 0.8f, 0, 0, 0.3f, 0.3f}});
  add_patches(
      scene,
      {flat_patch({-3, -1.1f, -2}, {6, 0, 0}, {0, 0, 8}), flat_patch({-1, 1, 1}, {2, 0, 0}, {2, 0, 0})},
      chalk);
  const std::array<float, 12> near = {0.3f, 0, 0, -0.4f, 0, 0.3f, 0, -0.5f, 0, 0, 0.3f, 1.2f};
  if (holes) add_patches(scene, nets, add_cut_out(scene, add_chequers(scene)), {near});
  if (panes) add_patches(scene, nets, add_glass_pane(scene), {near, whole});
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  for (float &c : light.intensity) c = 20;
  light.position[1] = light.position[2] = 2;
  uint32_t id;
  GPURT_EXPECT_OK(gpurt_scene_add_light(scene, &light, &id));
  add_camera(scene, {0.3f, 0.1f, 3}, 1.0f);
  coarse_commit(scene);
}

// The variant that images are rendered with from now on; none: the best one.
void choose_variant(const char *isa)
{
  if (isa != nullptr) ::setenv("GPURT_ISA", isa, 1);
  else ::unsetenv("GPURT_ISA");
}

struct Case {
  const char *name;
  bool holes, panes, shadows;
  gpurt_reyes_shading shading;
  gpurt_reyes_filter filter;
  uint32_t spp;
  float rate, flatness;
  uint32_t width = 72, height = 64;
};

TEST(ReyesVariants, MakeTheSameImage)
{
  const char *const wanted = std::getenv("GPURT_ISA");
  const std::string kept = wanted != nullptr ? wanted : "";
  const auto samples = GPURT_REYES_SHADING_SAMPLES;
  const auto micropolygons = GPURT_REYES_SHADING_MICROPOLYGONS;
  const auto box = GPURT_REYES_FILTER_BOX;
  const Case cases[] = {
      {"light of samples", false, false, false, samples, box, 9, 0.25f, 0},
      {"light of samples, odd sizes", false, false, false, samples, box, 9, 0.25f, 0, 75, 61},
      {"many samples under a box", false, false, false, samples, box, 40, 0.25f, 0},
      {"a sample a pixel", false, false, false, samples, box, 1, 0.25f, 0},
      {"many samples", false, false, false, samples, GPURT_REYES_FILTER_MITCHELL, 70, 0.25f, 0},
      {"large micropolygons", false, false, false, samples, box, 9, 9.0f, 0},
      {"micropolygons that vectors just take, and larger ones", false, false, false, samples, box, 9, 30.0f,
       0},
      {"flat regions", false, false, false, samples, box, 9, 0.25f, 0.9f},
      {"alpha masks", true, false, false, samples, box, 9, 0.25f, 0},
      {"surfaces that blend", false, true, false, samples, box, 9, 0.25f, 0},
      {"light of micropolygons", false, false, false, micropolygons, box, 9, 0.25f, 0},
      {"light of micropolygons, many samples", false, false, false, micropolygons,
       GPURT_REYES_FILTER_GAUSSIAN, 33, 0.375f, 0},
      {"light of blocks", false, false, false, GPURT_REYES_SHADING_BLOCKS, box, 9, 0.25f, 0},
      {"light by rays", false, false, true, micropolygons, box, 9, 0.25f, 0},
  };
  // Variants are chosen as images are rendered: one scene is for all of them.
  const Device device = make_device(GPURT_DEVICE_CPU, 1);
  Scene plain, with_holes, with_panes;
  for (Scene *scene : {&plain, &with_holes, &with_panes}) {
    GPURT_ASSERT_OK(gpurt_scene_create(device, scene->out()));
    fill(*scene, scene == &with_holes, scene == &with_panes);
  }
  for (const Case &c : cases) {
    const Scene &scene = c.holes ? with_holes : c.panes ? with_panes : plain;
    RenderOptions o;
    o.width = c.width;
    o.height = c.height;
    o.spp = c.spp;
    o.seed = 3;
    o.max_depth = 2;
    o.pipeline = GPURT_PIPELINE_REYES;
    o.reyes.shading = c.shading;
    o.reyes.filter = c.filter;
    o.reyes.shading_rate = c.rate;
    o.reyes.flatness = c.flatness;
    o.reyes.no_shadows = c.shadows ? 0 : 1;
    std::vector<float> color, depth;
    std::vector<uint32_t> ids;
    uint64_t num_micropolygons = 0;
    for (const char *isa : {"x86_64", "x86_64_v3", static_cast<const char *>(nullptr)}) {
      choose_variant(isa);
      const Frame frame = make_frame(scene, o, c.shading == samples || c.shadows ? compared_outputs : 0);
      render(frame, o);
      gpurt_statistics s = GPURT_STATISTICS_INIT;
      GPURT_ASSERT_OK(gpurt_frame_get_statistics(frame, &s));
      const std::vector<float> its_color = read_color(frame, o);
      std::vector<float> its_depth;
      std::vector<uint32_t> its_ids;
      if (c.shading == samples || c.shadows) {
        its_depth = read_output<float>(frame, o, GPURT_OUTPUT_DEPTH, 1);
        its_ids = read_output<uint32_t>(frame, o, GPURT_OUTPUT_PRIMITIVE, 1);
      }
      if (color.empty()) {
        color = its_color;
        depth = its_depth;
        ids = its_ids;
        num_micropolygons = s.reyes_counters.num_micropolygons;
        EXPECT_GT(num_micropolygons, 0u);
      }
      const char *const name = isa != nullptr ? isa : "the best";
      EXPECT_EQ(std::memcmp(color.data(), its_color.data(), color.size() * sizeof(float)), 0)
          << c.name << ", " << name;
      EXPECT_EQ(std::memcmp(depth.data(), its_depth.data(), depth.size() * sizeof(float)), 0)
          << c.name << ", " << name;
      EXPECT_EQ(ids, its_ids) << c.name << ", " << name;
      EXPECT_EQ(num_micropolygons, s.reyes_counters.num_micropolygons) << c.name << ", " << name;
    }
  }
  choose_variant(wanted != nullptr ? kept.c_str() : nullptr);
}

}  // namespace
