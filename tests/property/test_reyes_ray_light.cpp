// Micropolygons' own light by rays: shadows, lamps, environments, meshes and alpha masks beside patches.
#include <tuple>

#include "../support/reyes_renders.h"

namespace {

using namespace gpurt_test;

constexpr uint32_t kept_outputs = 1u << GPURT_OUTPUT_COLOR | 1u << GPURT_OUTPUT_ALPHA |
                                  1u << GPURT_OUTPUT_SAMPLE_COUNT | 1u << GPURT_OUTPUT_VARIANCE;

RenderOptions options(gpurt_reyes_shading shading, uint32_t spp, uint64_t seed = 3)
{
  RenderOptions o;
  o.width = o.height = 64;
  o.spp = spp;
  o.seed = seed;
  o.pipeline = GPURT_PIPELINE_REYES;
  o.reyes.shading = shading;
  return o;
}

// A sheet whose texture has holes.
void add_mask(gpurt_scene scene)
{
  std::vector<float> texels(16 * 16 * 4, 0.8f);
  for (size_t k = 0; k < 16 * 16; ++k) texels[4 * k + 3] = (k / 4 + k / 64) % 2 != 0 ? 1.0f : 0.0f;
  gpurt_texture_desc texture = GPURT_TEXTURE_DESC_INIT;
  texture.format = GPURT_TEXTURE_RGBA32F;
  texture.width = texture.height = 16;
  texture.filter = GPURT_FILTER_NEAREST;
  texture.texels = texels.data();
  uint32_t id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_texture(scene, &texture, &id));
  gpurt_material_desc material = GPURT_MATERIAL_DESC_INIT;
  material.base_color_texture = id;
  material.alpha_cutoff = 0.5f;
  uint32_t material_id = 0;
  GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &material, &material_id));
  add_patches(scene, {flat_patch({-1, -1, 0.8f}, {1.5f, 0, 0}, {0, 1.5f, 0})}, material_id);
}

enum class Kind { Shadows, Sampled };

// Balls before a wall of a mesh, one of metal, and a sheet with holes. Shadows: of a point, a spot and a distant light. Sampled: of
// a lamp of patches, one of triangles and an environment besides.
Scene make_scene(gpurt_device device, Kind kind, gpurt_accel accel = GPURT_ACCEL_AUTO)
{
  Scene scene;
  GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
  const std::vector<PatchNet> nets = closed_patches(2, 0.2, 9);
  add_patches(scene, nets, add_material(scene, GPURT_MATERIAL_LAMBERT, {0.9f, 0.5f, 0.1f}),
              {{0.6f, 0, 0, -0.4f, 0, 0.6f, 0, 0, 0, 0, 0.6f, 0}});
  add_patches(scene, nets, add_material(scene, GPURT_MATERIAL_METAL, {0.9f, 0.8f, 0.7f}, {0, 0, 0}, 0.5f),
              {{0.4f, 0, 0, 0.8f, 0, -0.4f, 0, 0.3f, 0, 0, 0.4f, 0.4f},
               {0.2f, 0, 0, 0.8f, 0, 0.2f, 0, -0.6f, 0, 0, 0.2f, 0.4f}});
  add_mesh(scene, quad({-3, -3, -1}, {3, -3, -1}, {3, 3, -1}, {-3, 3, -1}),
           add_material(scene, GPURT_MATERIAL_LAMBERT, {0.5f, 0.6f, 0.7f}));
  add_mask(scene);
  add_light(scene, GPURT_LIGHT_POINT, 12);
  add_light(scene, GPURT_LIGHT_SPOT, 9);
  add_light(scene, GPURT_LIGHT_DISTANT, 0.5f);
  if (kind == Kind::Sampled) {
    add_mesh(scene, quad({-2, 2, 0}, {-1, 2, 0}, {-1, 2, 1}, {-2, 2, 1}),
             add_material(scene, GPURT_MATERIAL_LAMBERT, {0, 0, 0}, {7, 6, 5}));
    add_patches(scene, nets, add_material(scene, GPURT_MATERIAL_LAMBERT, {0.1f, 0.1f, 0.1f}, {2, 2, 3}),
                {{0.2f, 0, 0, -1.1f, 0, 0.2f, 0, -0.9f, 0, 0, 0.2f, 0.5f}});
    set_environment(scene, 0.2f);
  }
  add_camera(scene, {0.1f, 0.1f, 3}, 0.8f);
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = accel;
  build.patch_tolerance = 0.01f;
  GPURT_EXPECT_OK(gpurt_scene_commit(scene, &build));
  return scene;
}

std::vector<float> image(gpurt_scene scene, const RenderOptions &o)
{
  const Frame frame = make_frame(scene, o, kept_outputs);
  render(frame, o);
  return read_color(frame, o);
}

// Means of blocks of 8 x 8 pixels.
std::vector<double> blocks_of(const std::vector<float> &color)
{
  std::vector<double> sums(8 * 8 * 3);
  for (size_t k = 0; k < color.size(); ++k) {
    const size_t pixel = k / 3, x = pixel % 64, y = pixel / 64;
    sums[(y / 8 * 8 + x / 8) * 3 + k % 3] += double(color[k]) / 64;
  }
  return sums;
}

// The image is that of light at samples. Of 8 x 8 pixels, means over seeds differ by what both are known to: their deviation
// over the seeds, and what light in the middle of a micropolygon differs by from light at its samples, which is 2 % of
// the brightest where edges of shadows or of highlights cross a block.
TEST(ReyesRayLight, IsThatOfSamples)
{
  const Device device = make_device();
  for (const Kind kind : {Kind::Shadows, Kind::Sampled}) {
    const Scene scene = make_scene(device, kind);
    constexpr int num_seeds = 5;
    std::vector<double> sum[2], sum2[2];
    const auto take_means = [&](gpurt_reyes_shading shading, int which) {
      sum[which].assign(192, 0);
      sum2[which].assign(192, 0);
      for (int seed = 0; seed < num_seeds; ++seed) {
        const std::vector<double> blocks =
            blocks_of(image(scene, options(shading, 16, uint64_t(10 * which + seed))));
        for (size_t k = 0; k < blocks.size(); ++k) {
          sum[which][k] += blocks[k] / num_seeds;
          sum2[which][k] += blocks[k] * blocks[k] / num_seeds;
        }
      }
    };
    take_means(GPURT_REYES_SHADING_SAMPLES, 0);
    for (const gpurt_reyes_shading shading :
         {GPURT_REYES_SHADING_MICROPOLYGONS, GPURT_REYES_SHADING_BLOCKS}) {
      take_means(shading, 1);
      double largest = 0, worst = 0, total[2] = {0, 0};
      for (size_t k = 0; k < 192; ++k) largest = std::max(largest, sum[0][k]);
      for (size_t k = 0; k < 192; ++k) {
        double variance = 0;
        for (int which = 0; which < 2; ++which) {
          variance += (sum2[which][k] - sum[which][k] * sum[which][k]) / (num_seeds - 1);
          total[which] += sum[which][k];
        }
        // Of four degrees of freedom each, seven deviations are exceeded once in 10^4.
        const double allowed = 7 * std::sqrt(std::max(variance, 0.0)) + 0.02 * largest;
        worst = std::max(worst, std::abs(sum[1][k] - sum[0][k]) / allowed);
      }
      std::printf("%s, shading %d: means %.5f and %.5f, worst block %.2f of what is allowed\n",
                  kind == Kind::Shadows ? "shadows" : "sampled", int(shading), total[0] / 192, total[1] / 192,
                  worst);
      EXPECT_LE(worst, 1);
      EXPECT_NEAR(total[1], total[0], 0.005 * total[0]);
    }
  }
}

// Light that no random number decides is the same for all seeds; of lamps and environments it has less noise with more samples,
// and the halves of the film, from which variance is estimated, have none of it in common.
TEST(ReyesRayLight, ConvergesWithSamples)
{
  const Device device = make_device();
  const Scene scene = make_scene(device, Kind::Sampled);
  const auto difference = [&](uint32_t spp, uint32_t size) {
    RenderOptions o = options(GPURT_REYES_SHADING_MICROPOLYGONS, spp, 1);
    o.width = o.height = size;
    const std::vector<float> a = image(scene, o);
    o.seed = 2;
    const std::vector<float> b = image(scene, o);
    double sum = 0;
    for (size_t k = 0; k < a.size(); ++k) sum += double(a[k] - b[k]) * double(a[k] - b[k]);
    return sum / double(a.size());
  };
  // Four times the samples: a quarter of the variance, and Sobol points do better.
  EXPECT_LT(difference(128, 32), 0.35 * difference(32, 32));
  // Half the difference of two seeds is the variance, which a frame knows from its halves.
  const RenderOptions o = options(GPURT_REYES_SHADING_MICROPOLYGONS, 32, 1);
  const Frame frame = make_frame(scene, o, kept_outputs);
  render(frame, o);
  std::vector<float> variance(64 * 64 * 3);
  GPURT_EXPECT_OK(gpurt_frame_read(frame, GPURT_OUTPUT_VARIANCE, variance.data(), variance.size() * 4));
  const double told = mean(variance), seen = difference(32, 64) / 2;
  std::printf("variance %.3g, of two seeds %.3g\n", told, seen);
  // Means over 12,288 values, of which four or so share a path.
  EXPECT_GT(told, 0.75 * seen);
  EXPECT_LT(told, 1.35 * seen);
}

TEST(ReyesRayLight, HasTheSameBitsForAnyTilesThreadsAndMemory)
{
  std::vector<std::vector<float>> first;
  for (const auto &[threads, tile, limit] :
       {std::tuple{1u, 64u, uint64_t(0)}, {2u, 7u, uint64_t(0)}, {1u, 256u, uint64_t(14) << 20}}) {
    const Device device = make_device(GPURT_DEVICE_CPU, threads, limit);
    size_t at = 0;
    for (const Kind kind : {Kind::Shadows, Kind::Sampled}) {
      const Scene scene = make_scene(device, kind, GPURT_ACCEL_KDTREE);
      for (const gpurt_reyes_shading shading :
           {GPURT_REYES_SHADING_MICROPOLYGONS, GPURT_REYES_SHADING_BLOCKS}) {
        RenderOptions o = options(shading, 40);
        o.width = o.height = 30;
        o.reyes.filter = at % 2 == 0 ? GPURT_REYES_FILTER_BOX : GPURT_REYES_FILTER_MITCHELL;
        o.tile_size = tile;
        const std::vector<float> color = image(scene, o);
        if (first.size() <= at) first.push_back(color);
        ASSERT_EQ(std::memcmp(first[at].data(), color.data(), color.size() * sizeof(float)), 0)
            << threads << " threads, tiles of " << tile << ", shading " << shading;
        // The same in parts, which end within the samples that share a path.
        const Frame parts = make_frame(scene, o, kept_outputs);
        for (const uint32_t spp : {3u, 33u, 40u}) {
          o.spp = spp;
          render(parts, o);
        }
        ASSERT_EQ(read_color(parts, o), color);
        ++at;
      }
    }
  }
}

// What is looked at: points rather than samples, as many shadow rays as light asks for, none without shadows.
TEST(ReyesRayLight, CountsPointsAndRays)
{
  const Device device = make_device(GPURT_DEVICE_CPU, 1);
  Scene scene;
  GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
  add_patches(scene, closed_patches(2, 0.1, 4));
  add_light(scene, GPURT_LIGHT_POINT, 5);
  add_light(scene, GPURT_LIGHT_DISTANT, 1);
  add_camera(scene, {0, 0, 3}, 1);
  commit(scene, GPURT_ACCEL_AUTO);
  uint64_t num_shaded[2] = {0, 0};
  for (const gpurt_reyes_shading shading : {GPURT_REYES_SHADING_MICROPOLYGONS, GPURT_REYES_SHADING_BLOCKS}) {
    RenderOptions o = options(shading, 32);
    o.tile_size = 64;
    const Frame frame = make_frame(scene, o, kept_outputs);
    render(frame, o);
    const gpurt_statistics s = statistics_of(frame);
    num_shaded[shading - GPURT_REYES_SHADING_MICROPOLYGONS] = s.reyes_counters.num_shaded;
    EXPECT_LE(s.reyes_counters.num_shaded, s.reyes_counters.num_micropolygons);
    EXPECT_LE(s.num_shadow_rays, 2 * s.reyes_counters.num_shaded);
    EXPECT_GT(s.num_shadow_rays, s.reyes_counters.num_shaded / 2);
    EXPECT_EQ(s.num_bounce_rays, 0u);
    std::vector<float> alpha(64 * 64);
    GPURT_EXPECT_OK(gpurt_frame_read(frame, GPURT_OUTPUT_ALPHA, alpha.data(), alpha.size() * 4));
    // About four a pixel at a rate of 0.25, less than half of 32 samples.
    EXPECT_LT(double(s.reyes_counters.num_shaded), 0.5 * 32 * mean(alpha) * 64 * 64);
  }
  EXPECT_LT(num_shaded[1], num_shaded[0] / 2);

  // With a mesh beside it, and without shadows: no ray at all.
  add_mesh(scene, quad({-3, -3, -2}, {3, -3, -2}, {3, 3, -2}, {-3, 3, -2}));
  commit(scene, GPURT_ACCEL_AUTO);
  RenderOptions o = options(GPURT_REYES_SHADING_MICROPOLYGONS, 16);
  o.reyes.no_shadows = 1;
  const Frame frame = make_frame(scene, o, kept_outputs);
  render(frame, o);
  EXPECT_EQ(statistics_of(frame).num_shadow_rays, 0u);
  const double own = mean(read_color(frame, o));
  o.reyes.shading = GPURT_REYES_SHADING_SAMPLES;
  o.spp = 64;
  const double wanted = mean(image(scene, o));
  EXPECT_NEAR(own, wanted, 0.01 * wanted);
}

// Triangles of a mesh, flat or smooth, and a floor below the eye, diced: the image is path tracing's with direct light, and points
// are as many as the shading rate says, not as many as samples.
TEST(ReyesRayLight, DicesMeshes)
{
  const Device device = make_device();
  for (const bool is_smooth : {false, true}) {
    Scene scene;
    GPURT_ASSERT_OK(gpurt_scene_create(device, scene.out()));
    const Mesh ball = icosphere(1);
    gpurt_mesh_desc mesh = GPURT_MESH_DESC_INIT;
    mesh.material = add_material(scene, GPURT_MATERIAL_LAMBERT, {0.9f, 0.5f, 0.1f});
    mesh.vertices.data = ball.vertices.data();
    mesh.vertices.count = ball.vertices.size();
    mesh.indices.data = ball.triangles.data();
    mesh.indices.count = ball.triangles.size();
    // Of the sphere: its vertices.
    if (is_smooth) mesh.normals = mesh.vertices;
    uint32_t geometry = 0, id = 0;
    GPURT_ASSERT_OK(gpurt_scene_add_mesh(scene, &mesh, &geometry));
    gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
    instance.geometry = geometry;
    GPURT_ASSERT_OK(gpurt_scene_add_instance(scene, &instance, &id));
    add_mesh(scene, quad({-40, -1.2f, 40}, {40, -1.2f, 40}, {40, -1.2f, -40}, {-40, -1.2f, -40}),
             add_material(scene, GPURT_MATERIAL_LAMBERT, {0.5f, 0.6f, 0.7f}));
    add_light(scene, GPURT_LIGHT_POINT, 12);
    add_light(scene, GPURT_LIGHT_DISTANT, 0.5f);
    add_camera(scene, {0, 0, 3}, 0.9f);
    commit(scene, GPURT_ACCEL_BVH);

    RenderOptions path = options(GPURT_REYES_SHADING_AUTO, 256);
    path.pipeline = GPURT_PIPELINE_PATH;
    path.max_depth = 2;
    path.reyes = GPURT_REYES_SETTINGS_INIT;
    const std::vector<float> wanted = image(scene, path);
    double last_error = 0;
    for (const auto &[rate, shading] : {std::tuple{0.25f, GPURT_REYES_SHADING_MICROPOLYGONS},
                                        {0.25f, GPURT_REYES_SHADING_BLOCKS},
                                        {4.0f, GPURT_REYES_SHADING_MICROPOLYGONS},
                                        {64.0f, GPURT_REYES_SHADING_MICROPOLYGONS}}) {
      RenderOptions o = options(shading, 64);
      o.tile_size = 64;
      o.reyes.shading_rate = rate;
      const Frame frame = make_frame(scene, o, kept_outputs);
      render(frame, o);
      const double num_points = double(statistics_of(frame).reyes_counters.num_shaded);
      std::vector<float> alpha(64 * 64);
      GPURT_EXPECT_OK(gpurt_frame_read(frame, GPURT_OUTPUT_ALPHA, alpha.data(), alpha.size() * 4));
      // Areas lie between a half and twice the rate where micropolygons are equilateral on the image; the floor's, seen at an
      // angle, are narrower.
      const double area = double(rate) * (shading == GPURT_REYES_SHADING_BLOCKS ? 4 : 1),
                   expected = mean(alpha) * 64 * 64 / area;
      const std::vector<float> ours = read_color(frame, o);
      double error = 0;
      for (size_t k = 0; k < ours.size(); ++k)
        error += std::abs(double(ours[k]) - double(wanted[k])) / double(ours.size());
      error /= mean(wanted);
      std::printf("%s, rate %g, shading %d: %g points, %g by area; mean %.4f and %.4f, off %.4f of it\n",
                  is_smooth ? "smooth" : "flat", double(rate), int(shading), num_points, expected, mean(ours),
                  mean(wanted), error);
      EXPECT_LT(num_points, 8 * expected);
      EXPECT_GT(num_points, 0.5 * expected);
      EXPECT_NEAR(mean(ours), mean(wanted), 0.01 * mean(wanted));
      EXPECT_GE(error, last_error);
      last_error = error;
    }
  }
}

// Outputs beside light: ids are those that light at samples finds, depths too but for rounding, normals those of the middles of
// micropolygons, which are a quarter of a pixel apart.
TEST(ReyesRayLight, HasTheOtherOutputs)
{
  const Device device = make_device();
  const Scene scene = make_scene(device, Kind::Shadows);
  std::vector<float> depth[2], normal[2], color[2];
  std::vector<uint32_t> instance[2];
  for (int which = 0; which < 2; ++which) {
    RenderOptions o =
        options(which == 0 ? GPURT_REYES_SHADING_SAMPLES : GPURT_REYES_SHADING_MICROPOLYGONS, 8);
    const Frame frame = make_frame(
        scene, o,
        kept_outputs | 1u << GPURT_OUTPUT_DEPTH | 1u << GPURT_OUTPUT_NORMAL | 1u << GPURT_OUTPUT_INSTANCE);
    render(frame, o);
    depth[which].resize(64 * 64);
    normal[which].resize(64 * 64 * 3);
    instance[which].resize(64 * 64);
    GPURT_EXPECT_OK(gpurt_frame_read(frame, GPURT_OUTPUT_DEPTH, depth[which].data(), 64 * 64 * 4));
    GPURT_EXPECT_OK(gpurt_frame_read(frame, GPURT_OUTPUT_NORMAL, normal[which].data(), 64 * 64 * 12));
    GPURT_EXPECT_OK(gpurt_frame_read(frame, GPURT_OUTPUT_INSTANCE, instance[which].data(), 64 * 64 * 4));
    color[which] = read_color(frame, o);
  }
  EXPECT_EQ(instance[0], instance[1]);
  EXPECT_EQ(depth[0], depth[1]);
  double difference = 0;
  for (size_t k = 0; k < normal[0].size(); ++k) difference += std::abs(double(normal[0][k] - normal[1][k]));
  // The ball of 0.2 has about 9 pixels of radius: a quarter of a pixel turns its normal by 0.03, and it is one of few surfaces
  // that turn at all.
  EXPECT_LT(difference / double(normal[0].size()), 0.01);
  EXPECT_GT(difference, 0);
  // Light is the same whatever else is asked for.
  EXPECT_EQ(color[1], image(scene, options(GPURT_REYES_SHADING_MICROPOLYGONS, 8)));
}

TEST(ReyesRayLight, RefusesWhatItDoesNotHave)
{
  const Device device = make_device();
  const Scene scene = make_scene(device, Kind::Shadows);
  const auto refuse = [&](gpurt_scene of, const char *text, uint32_t outputs) {
    const RenderOptions o = options(GPURT_REYES_SHADING_MICROPOLYGONS, 1);
    const Frame frame = make_frame(of, o, outputs);
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.pipeline = GPURT_PIPELINE_REYES;
    desc.reyes = o.reyes;
    Job job;
    EXPECT_EQ(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()), GPURT_ERROR_UNSUPPORTED) << text;
    EXPECT_NE(std::string(gpurt_last_error()).find(text), std::string::npos) << gpurt_last_error();
  };
  gpurt_material_desc veil = GPURT_MATERIAL_DESC_INIT;
  veil.blends = 1;
  veil.alpha = 0.5f;
  uint32_t id = 0;
  GPURT_ASSERT_OK(gpurt_scene_add_material(scene, &veil, &id));
  add_mesh(scene, quad({-3, -3, 1}, {3, -3, 1}, {3, 3, 1}, {-3, 3, 1}), id);
  commit(scene, GPURT_ACCEL_AUTO);
  refuse(scene, "surfaces that blend", kept_outputs);
}

}  // namespace
