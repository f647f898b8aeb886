// Rows 22 to 36: what photon mapping does where it is known to fail.
//
// Most rooms here are furnaces: closed, with emission 1 - a on surfaces of albedo a, so that radiance is 1 everywhere,
// whatever the shape; all but the first two bounces of it are photons.
#include "catalogue.h"
#include "correlation.h"

namespace {

using namespace gpurt_test;

struct PhotonOptions : RenderOptions {
  gpurt_pipeline pipeline = GPURT_PIPELINE_PHOTON;
  gpurt_photon_settings photon = GPURT_PHOTON_SETTINGS_INIT;
  uint64_t first_sample = 0;
  uint32_t frame_index = 0;
  float target_error = 0;
  uint32_t outputs = 1u << GPURT_OUTPUT_COLOR;
};

class Photons : public Stability {
 protected:
  struct Result {
    std::vector<float> color;
    gpurt_statistics statistics;
    std::vector<float> bias, variance;  // where they are outputs

    float red(const RenderOptions &o, uint32_t x, uint32_t y) const
    {
      return color[3 * (size_t(y) * o.width + x)];
    }
  };

  Result render_with(gpurt_scene scene, const PhotonOptions &o)
  {
    gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
    frame_desc.width = o.width;
    frame_desc.height = o.height;
    frame_desc.seed = o.seed;
    frame_desc.outputs = o.outputs;
    frame_desc.first_sample = o.first_sample;
    frame_desc.frame_index = o.frame_index;
    Frame frame;
    GPURT_EXPECT_OK(gpurt_frame_create(scene, &frame_desc, frame.out()));
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.pipeline = o.pipeline;
    desc.samples_per_pixel = o.target_error > 0 ? 0 : o.spp;
    desc.target_error = o.target_error;
    desc.max_depth = o.max_depth;
    desc.tile_size = o.tile_size;
    desc.photon = o.photon;
    Job job;
    GPURT_EXPECT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
    GPURT_EXPECT_OK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
    Result result{read_color(frame, o), GPURT_STATISTICS_INIT, {}, {}};
    GPURT_EXPECT_OK(gpurt_frame_get_statistics(frame, &result.statistics));
    const auto read = [&](gpurt_output output, std::vector<float> &to, size_t channels) {
      if (!(o.outputs >> output & 1)) return;
      to.resize(size_t(o.width) * o.height * channels);
      GPURT_EXPECT_OK(gpurt_frame_read(frame, output, to.data(), to.size() * sizeof(float)));
    };
    read(GPURT_OUTPUT_BIAS, result.bias, 3);
    read(GPURT_OUTPUT_VARIANCE, result.variance, 3);
    return result;
  }

  uint32_t furnace_material(gpurt_scene scene, float albedo)
  {
    gpurt_material_desc lamp = GPURT_MATERIAL_DESC_INIT;
    for (int k = 0; k < 3; ++k) lamp.base_color[k] = albedo, lamp.emission[k] = 1 - albedo;
    lamp.two_sided_emission = 1;
    uint32_t id = 0;
    GPURT_EXPECT_OK(gpurt_scene_add_material(scene, &lamp, &id));
    return id;
  }
};
INSTANTIATE_TEST_SUITE_P(Methods, Photons, ::testing::ValuesIn(photon_methods()),
                         [](const auto &info) { return std::string(info.param.name); });

// The cube [-1, 1]^3; which side is the front does not matter here.
Mesh cube(float half = 1)
{
  const float h = half;
  Mesh m = quad({-h, -h, -h}, {h, -h, -h}, {h, h, -h}, {-h, h, -h});
  m.append(quad({-h, -h, h}, {h, -h, h}, {h, h, h}, {-h, h, h}));
  m.append(quad({-h, -h, -h}, {h, -h, -h}, {h, -h, h}, {-h, -h, h}));
  m.append(quad({-h, h, -h}, {h, h, -h}, {h, h, h}, {-h, h, h}));
  m.append(quad({-h, -h, -h}, {-h, h, -h}, {-h, h, h}, {-h, -h, h}));
  m.append(quad({h, -h, -h}, {h, h, -h}, {h, h, h}, {h, -h, h}));
  return m;
}

// A lamp that shines along -z.
Mesh lamp_at(float x, float y, float z, float half)
{
  return quad({x - half, y + half, z}, {x + half, y + half, z}, {x + half, y - half, z},
              {x - half, y - half, z});
}

double relmse(const std::vector<float> &image, const std::vector<float> &reference)
{
  double sum = 0;
  for (size_t i = 0; i < image.size(); ++i) {
    const double d = double(image[i]) - reference[i];
    sum += d * d / (double(reference[i]) * reference[i] + 0.01);
  }
  return sum / double(image.size());
}

TEST_P(Photons, Row22Caustic)
{
  // A pool under a glass sphere; the lamp has a hundredth of the pool's width, and the camera looks at the pool alone.
  const Scene scene = make_scene();
  add_mesh(scene, quad({-2, -2, -4}, {2, -2, -4}, {2, 2, -4}, {-2, 2, -4}),
           add_material(scene, GPURT_MATERIAL_LAMBERT, {0.6f, 0.6f, 0.6f}));
  Mesh glass = icosphere(4);
  glass.map(
      [](std::array<float, 3> v) { return std::array<float, 3>{v[0] * 0.6f, v[1] * 0.6f, v[2] * 0.6f - 3}; });
  gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
  desc.type = GPURT_MATERIAL_GLASS;
  desc.ior = 1.5f;
  uint32_t glass_id;
  GPURT_ASSERT_OK(gpurt_scene_add_material(scene, &desc, &glass_id));
  add_mesh(scene, glass, glass_id);
  add_mesh(scene, lamp_at(1.2f, 0, -0.5f, 0.02f),
           add_material(scene, GPURT_MATERIAL_LAMBERT, {0, 0, 0}, {2000, 2000, 2000}));
  // Below the sphere: a lamp that is seen in glass would be noise of both methods.
  add_camera(scene, {0, 0, -3.65f}, 2.2f);
  commit_scene(scene);
  PhotonOptions o;
  o.width = o.height = 48;
  o.photon.photons_per_pass = 16384;
  o.photon.initial_radius = 0.03f;
  o.spp = uint32_t(count(128, 2048));
  o.seed = 7;
  const Result reference = render_with(scene, o);
  o.spp = 16;
  o.seed = 1;
  const Result photon = render_with(scene, o);
  // The path tracer gets as many rays: time would depend on what else runs.
  PhotonOptions path = o;
  path.pipeline = GPURT_PIPELINE_PATH;
  path.photon = GPURT_PHOTON_SETTINGS_INIT;
  const auto rays_of = [](const gpurt_statistics &t) {
    return double(t.num_camera_rays + t.num_bounce_rays + t.num_shadow_rays + t.photon_counters.num_rays);
  };
  path.spp = uint32_t(16 * rays_of(photon.statistics) / rays_of(render_with(scene, path).statistics)) + 1;
  const Result traced = render_with(scene, path);
  const double ratio = relmse(traced.color, reference.color) / relmse(photon.color, reference.color);
  const double means = mean(photon.color) / mean(reference.color);
  record(22, method(), (ratio < 10) + (std::abs(means - 1) > 0.02), 2,
         text_of("path tracing's relMSE is %.0f times as large; mean %.4f of the reference's", ratio, means));
}

TEST_P(Photons, Row23SmallLightBehindGlass)
{
  const Scene scene = make_scene();
  add_mesh(scene, quad({-2, -2, -4}, {2, -2, -4}, {2, 2, -4}, {-2, 2, -4}),
           add_material(scene, GPURT_MATERIAL_LAMBERT, {0.6f, 0.6f, 0.6f}));
  gpurt_material_desc desc = GPURT_MATERIAL_DESC_INIT;
  desc.type = GPURT_MATERIAL_GLASS;
  desc.ior = 1.5f;
  uint32_t glass;
  GPURT_ASSERT_OK(gpurt_scene_add_material(scene, &desc, &glass));
  for (const float radius : {0.05f, 0.045f}) {
    Mesh bulb = icosphere(3);
    bulb.map([&](std::array<float, 3> v) {
      return std::array<float, 3>{v[0] * radius, v[1] * radius, v[2] * radius + 1};
    });
    // The inner side of the glass faces inwards.
    if (radius < 0.05f) {
      for (auto &t : bulb.triangles) std::swap(t[1], t[2]);
    }
    add_mesh(scene, bulb, glass);
  }
  add_mesh(scene, lamp_at(0, 0, 1, 0.0005f),
           add_material(scene, GPURT_MATERIAL_LAMBERT, {0, 0, 0}, {3e7f, 3e7f, 3e7f}));
  add_camera(scene, {0, 0, 0}, 0.8f);
  commit_scene(scene);
  PhotonOptions o;
  o.width = o.height = 64;
  o.photon.photons_per_pass = 16384;
  o.spp = uint32_t(count(24, 1024));
  o.seed = 7;
  const Result reference = render_with(scene, o);
  o.spp = 8;
  o.seed = 1;
  const Result image = render_with(scene, o);
  std::vector<double> errors;
  double sum = 0;
  for (size_t i = 0; i < image.color.size(); i += 3) {
    const double d = double(image.color[i]) - reference.color[i];
    errors.push_back(d * d);
    sum += d * d;
  }
  std::sort(errors.rbegin(), errors.rend());
  double top = 0;
  for (size_t i = 0; i < errors.size() / 1000; ++i) top += errors[i];
  EXPECT_GT(mean(image.color), 0);
  record(23, method(), !(top < 0.2 * sum), 1,
         text_of("the worst 0.1 %% of the pixels hold %.1f %%", 100 * top / sum));
}

TEST_P(Photons, Row24Furnace)
{
  uint64_t bad = 0;
  std::string note;
  // Discs reach over the edges of a sphere's triangles, which is blur: within a cube there is none, and 3 sigma are asked.
  for (const char *where : {"outside", "in a sphere", "in a cube"}) {
    const Scene scene = make_scene();
    const bool is_outside = where[0] == 'o', is_cube = where[5] == 'c';
    if (is_outside) {
      add_mesh(scene, icosphere(4), add_material(scene, GPURT_MATERIAL_LAMBERT, {1, 1, 1}));
      set_environment(scene, 1);
    } else {
      add_mesh(scene, is_cube ? cube() : icosphere(3), furnace_material(scene, 0.5f));
    }
    add_camera(scene, {0, 0, is_outside ? 4.0f : 0.1f}, is_outside ? 0.4f : 2.2f);
    commit_scene(scene);
    PhotonOptions o;
    o.spp = 1;
    o.max_depth = 100;
    o.photon.photons_per_pass = 65536;
    o.photon.initial_radius = is_cube ? 0.1f : 0.03f;
    // Passes are independent: their means tell their own noise.
    const uint64_t num_passes = count(16, 512);
    double sum = 0, sum2 = 0;
    for (o.first_sample = 0; o.first_sample < num_passes; ++o.first_sample) {
      const double off = mean(render_with(scene, o).color) - 1;
      sum += off;
      sum2 += off * off;
    }
    const double n = double(num_passes), off = sum / n;
    const double sigma = std::sqrt(std::max(sum2 / n - off * off, 0.0) / (n - 1));
    bad += !(std::abs(off) <= 0.002);
    // Of 16 passes 3.6 of their own deviations are as rare as 3 of many. Passes of the convex body are equal but for rounding.
    if (is_cube || is_outside) bad += !(std::abs(off) <= (n < 100 ? 3.6 : 3.0) * sigma + 1e-5);
    note += std::string(note.empty() ? "" : ", ") + where + text_of(" %.5f +- %.5f", 1 + off, sigma);
  }
  record(24, method(), bad, 5, note);
}

// The wall of a furnace, where all pixels have the same expectation. Discs are smaller than pixels: neighbours share few
// photons, so that pixels are about as many independent values.
TEST_P(Photons, Row25CorrelatedSamples)
{
  const Scene scene = make_scene();
  add_mesh(scene, cube(), furnace_material(scene, 0.8f));
  add_camera(scene, {0, 0, 0}, 2 * std::atan(0.9f));
  commit_scene(scene);
  PhotonOptions o;
  o.width = o.height = uint32_t(count(64, 192));
  o.spp = 4;
  o.photon.photons_per_pass = 65536;
  o.photon.initial_radius = 0.3f * 1.8f / float(o.width);
  std::vector<std::vector<double>> noise;
  for (const uint64_t seed : {0, 1}) {
    for (const uint32_t frame_index : {0u, 1u}) {
      o.seed = seed;
      o.frame_index = frame_index;
      noise.push_back(unit_noise(render_with(scene, o).color));
    }
  }
  const Correlations c = correlate(noise);
  record(25, method(), c.num_bad, c.num_pairs,
         text_of("largest of %.0f pairs: %.2f sigma", double(c.num_pairs), c.worst_sigma));
}

TEST_P(Photons, Row26EstimatorEquality)
{
  // A box with a block and a mirror, lit by a lamp: path tracing and photon mapping.
  const Scene scene = make_scene();
  add_mesh(scene, cube(), add_material(scene, GPURT_MATERIAL_LAMBERT, {0.7f, 0.6f, 0.5f}));
  Mesh block = cube(0.3f);
  block.map(
      [](std::array<float, 3> v) { return std::array<float, 3>{v[0] - 0.4f, v[1] - 0.7f, v[2] - 0.3f}; });
  add_mesh(scene, block, add_material(scene, GPURT_MATERIAL_LAMBERT, {0.3f, 0.7f, 0.3f}));
  add_mesh(scene, quad({0.2f, -0.9f, -0.8f}, {0.8f, -0.9f, -0.5f}, {0.8f, 0, -0.5f}, {0.2f, 0, -0.8f}),
           add_material(scene, GPURT_MATERIAL_MIRROR, {0.9f, 0.9f, 0.9f}));
  add_mesh(scene,
           quad({-0.3f, 0.99f, -0.3f}, {0.3f, 0.99f, -0.3f}, {0.3f, 0.99f, 0.3f}, {-0.3f, 0.99f, 0.3f}),
           add_material(scene, GPURT_MATERIAL_LAMBERT, {0, 0, 0}, {8, 8, 8}));
  add_camera(scene, {0, 0, 0.9f}, 1.2f);
  commit_scene(scene);
  PhotonOptions o;
  o.spp = uint32_t(count(64, 1024));
  o.photon.photons_per_pass = 8192;
  o.outputs = 1u << GPURT_OUTPUT_COLOR | 1u << GPURT_OUTPUT_BIAS | 1u << GPURT_OUTPUT_VARIANCE;
  const Result photons = render_with(scene, o);
  const double photon = mean(photons.color);
  o.pipeline = GPURT_PIPELINE_PATH;
  o.photon = GPURT_PHOTON_SETTINGS_INIT;
  o.outputs = 1u << GPURT_OUTPUT_COLOR | 1u << GPURT_OUTPUT_VARIANCE;
  o.spp = uint32_t(count(256, 8192));
  const Result paths[2] = {render_with(scene, o), (o.seed = 1, render_with(scene, o))};
  const double path = 0.5 * (mean(paths[0].color) + mean(paths[1].color));

  // Two path tracers: the squares of Welch's t of tiles of 8 x 8 pixels are 1 in the mean.
  const auto tile_sum = [&](const std::vector<float> &values, uint32_t tile) {
    double sum = 0;
    const uint32_t tiles_x = o.width / 8, x0 = tile % tiles_x * 8, y0 = tile / tiles_x * 8;
    for (uint32_t y = y0; y < y0 + 8; ++y) {
      for (uint32_t x = x0; x < x0 + 8; ++x) sum += double(values[3 * (size_t(y) * o.width + x)]);
    }
    return sum;
  };
  const uint32_t num_tiles = o.width / 8 * (o.height / 8);
  double t2 = 0, stated = 0, off = 0;
  for (uint32_t tile = 0; tile < num_tiles; ++tile) {
    const double d = tile_sum(paths[0].color, tile) - tile_sum(paths[1].color, tile);
    t2 += d * d / (tile_sum(paths[0].variance, tile) + tile_sum(paths[1].variance, tile));
    // The same of the photons' tiles, whose blur is stated.
    const double path_tile = 0.5 * (tile_sum(paths[0].color, tile) + tile_sum(paths[1].color, tile));
    const double noise2 = tile_sum(photons.variance, tile) +
                          0.25 * (tile_sum(paths[0].variance, tile) + tile_sum(paths[1].variance, tile));
    const double blur = std::abs(tile_sum(photons.bias, tile));
    off += std::abs(tile_sum(photons.color, tile) - path_tile) > blur + 3 * std::sqrt(noise2);
    stated += blur / 64;
  }
  t2 /= num_tiles;
  stated /= num_tiles * path;
  const double spread = std::sqrt(2.0 / num_tiles);
  uint64_t bad = !(std::abs(photon / path - 1) <= 0.005);
  bad += !(std::abs(t2 - 1) <= 4 * spread);
  bad += !(off <= 0.05 * num_tiles);
  record(26, method(), bad, 3,
         text_of("mean %.5f, path tracing's %.5f", photon, path) +
             text_of("; blur stated %.2g, tiles beyond it %.0f", stated, off) +
             text_of("; Welch t^2 of path tracers %.2f", t2));
}

TEST_P(Photons, Row27FalseConvergence)
{
  // A dark room of 0.2 m, and a door that is ajar by 1 mm: most photons see nothing of it, and many pixels no photon.
  const float half = 0.1f;
  const Scene scene = make_scene();
  const uint32_t grey = add_material(scene, GPURT_MATERIAL_LAMBERT, {0.5f, 0.5f, 0.5f});
  add_mesh(scene, cube(half), grey);
  const float edge = half - 0.001f;
  add_mesh(scene, quad({-half, -half, 0}, {edge, -half, 0}, {edge, half, 0}, {-half, half, 0}), grey);
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  light.type = GPURT_LIGHT_POINT;
  light.position[0] = 0.5f * half;
  light.position[2] = -0.5f * half;
  for (float &c : light.intensity) c = 2;
  uint32_t id;
  GPURT_ASSERT_OK(gpurt_scene_add_light(scene, &light, &id));
  add_camera(scene, {-0.3f * half, 0, 0.95f * half}, 1.2f);  // sees the dark side
  commit_scene(scene);
  PhotonOptions o;
  o.width = o.height = 8;
  o.max_depth = 8;
  o.photon.photons_per_pass = 2048;
  o.photon.initial_radius = 0.2f * half;
  o.seed = 9;
  o.spp = uint32_t(count(1000, 20000));
  const Result reference = render_with(scene, o);
  o.outputs = 1u << GPURT_OUTPUT_COLOR | 1u << GPURT_OUTPUT_BIAS | 1u << GPURT_OUTPUT_ERROR;
  o.target_error = is_full_run() ? 0.1f : 0.5f;
  uint64_t bad = 0;
  double worst = 0, passes = 0;
  const uint64_t num_seeds = count(2, 8);
  for (o.seed = 0; o.seed < num_seeds; ++o.seed) {
    const Result image = render_with(scene, o);
    const double reached = relmse(image.color, reference.color);
    bad += !(reached <= 2 * double(o.target_error));
    worst = std::max(worst, reached);
    passes += double(image.statistics.samples_per_pixel) / double(num_seeds);
  }
  EXPECT_GT(mean(reference.color), 0.01);
  record(27, method(), bad, num_seeds,
         text_of("relMSE asked %.1f, reached at worst %.3f", double(o.target_error), worst) +
             text_of(" after %.0f passes; mean %.3f", passes, mean(reference.color)));
}

TEST_P(Photons, Row28ThinWall)
{
  // A closed box, halved by a wall of a tenth of the radius; the lamp and the camera are on different sides.
  const float radius = 0.1f, thick = 0.1f * radius;
  const Scene scene = make_scene();
  const uint32_t white = add_material(scene, GPURT_MATERIAL_LAMBERT, {0.8f, 0.8f, 0.8f});
  add_mesh(scene, cube(), white);
  for (const float z : {0.0f, thick})
    add_mesh(scene, quad({-1, -1, z}, {1, -1, z}, {1, 1, z}, {-1, 1, z}), white);
  add_mesh(scene,
           quad({-0.5f, 0.99f, -0.9f}, {0.5f, 0.99f, -0.9f}, {0.5f, 0.99f, -0.1f}, {-0.5f, 0.99f, -0.1f}),
           add_material(scene, GPURT_MATERIAL_LAMBERT, {0, 0, 0}, {10, 10, 10}));
  add_camera(scene, {0, 0, 0.9f}, 0.8f);  // sees the dark side
  commit_scene(scene);
  PhotonOptions o;
  o.spp = 16;
  o.photon.photons_per_pass = 16384;
  o.photon.initial_radius = radius;
  const double dark = mean(render_with(scene, o).color);
  o.photon.remedies = GPURT_PHOTON_REMEDY_NONE;
  const double leaky = mean(render_with(scene, o).color);
  EXPECT_GT(leaky, 1e-3) << "without remedies this test should leak";
  // The lit side has radiance of the order of 1.
  record(28, method(), !(dark < 1e-3), 1, text_of("dark side %.2g, without remedies %.2g", dark, leaky));
}

TEST_P(Photons, Row29CornerDarkening)
{
  const float radius = 0.2f, albedo = 0.9f;
  const Scene scene = make_scene();
  add_mesh(scene, cube(), furnace_material(scene, albedo));
  // Looks at the wall z = -1 from the middle: one pixel is 2 / 40 wide there.
  add_camera(scene, {0, 0, 0}, 2 * std::atan(1.0f));
  commit_scene(scene);
  PhotonOptions o;
  o.width = o.height = 40;
  o.spp = uint32_t(count(24, 256));
  o.max_depth = 200;
  o.photon.photons_per_pass = 8192;
  o.photon.initial_radius = radius;
  const auto edge_of = [&](uint32_t remedies) {
    o.photon.remedies = remedies;
    const Result image = render_with(scene, o);
    // 0.5 r from the edge is pixel 1 and 2 from the border.
    double sum = 0;
    for (uint32_t x = 10; x < 30; ++x)
      sum += image.red(o, x, 1) + image.red(o, x, 38) + image.red(o, 1, x) + image.red(o, 38, x);
    return sum / 80;
  };
  const double with = edge_of(0);
  const double without =
      edge_of(uint32_t(GPURT_PHOTON_REMEDY_NORMAL) | GPURT_PHOTON_REMEDY_PLANE | GPURT_PHOTON_REMEDY_SIDE);
  EXPECT_LT(without, 0.95) << "without the boundary remedy this corner should be dark";
  record(29, method(), !(std::abs(with - 1) < 0.03), 1,
         text_of("radiance at 0.35 r from the edge %.4f, without the area %.4f", with, without));
}

// Rows 30 and 35: a sheet that floats in a furnace shows its albedo on both sides, to its rim.
TEST_P(Photons, Row30Boundary)
{
  const float albedo = 0.9f;
  uint64_t bad_rim = 0, bad_side = 0;
  std::string rim_note, side_note;
  for (const bool from_below : {false, true}) {
    const Scene scene = make_scene();
    add_mesh(scene, cube(3), furnace_material(scene, albedo));
    Mesh sheet = quad({-0.5f, -0.5f, -1}, {0.5f, -0.5f, -1}, {0.5f, 0.5f, -1}, {-0.5f, 0.5f, -1});
    if (from_below) {
      for (auto &t : sheet.triangles) std::swap(t[1], t[2]);
    }
    add_mesh(scene, sheet, add_material(scene, GPURT_MATERIAL_LAMBERT, {albedo, albedo, albedo}));
    add_camera(scene, {0, 0, 0}, 2 * std::atan(0.5f));  // the sheet fills the image
    commit_scene(scene);
    PhotonOptions o;
    o.width = o.height = 20;
    o.spp = uint32_t(count(24, 512));
    o.max_depth = 200;
    o.photon.photons_per_pass = 16384;
    o.photon.initial_radius = 0.1f;
    const Result image = render_with(scene, o);
    double rim = 0, all = mean(image.color) / albedo;
    for (uint32_t i = 0; i < 20; ++i)
      rim += image.red(o, i, 0) + image.red(o, i, 19) + image.red(o, 0, i) + image.red(o, 19, i);
    rim /= 80 * albedo;
    bad_rim += !(std::abs(rim - 1) < 0.03);
    bad_side += !(std::abs(all - 1) < 0.02);
    rim_note += text_of(from_below ? ", back %.4f" : "rim over closed form: front %.4f", rim);
    side_note += text_of(from_below ? ", back %.4f" : "mean over closed form: front %.4f", all);
  }
  record(30, method(), bad_rim, 2, rim_note);
  record(35, method(), bad_side, 2, side_note);
}

TEST_P(Photons, Row31CausticBlur)
{
  // A mirror throws distant light on the floor as a square with sharp edges: what lies outside is blur, as wide as the radius.
  const Scene scene = make_scene();
  add_mesh(scene, quad({-2, -2, -2}, {2, -2, -2}, {2, 2, -2}, {-2, 2, -2}),
           add_material(scene, GPURT_MATERIAL_LAMBERT, {0.5f, 0.5f, 0.5f}));
  // The mirror is above the camera, and the spot on the floor shines up at it.
  add_mesh(scene, quad({-0.4f, -0.4f, 1}, {0.4f, -0.4f, 1}, {0.4f, 0.4f, 1}, {-0.4f, 0.4f, 1}),
           add_material(scene, GPURT_MATERIAL_MIRROR, {1, 1, 1}));
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  light.type = GPURT_LIGHT_SPOT;
  light.position[2] = -1.9f;
  light.direction[2] = 1;
  light.inner_cone_angle_rad = 0.3f;
  light.outer_cone_angle_rad = 0.31f;
  for (float &c : light.intensity) c = 10;
  uint32_t id;
  GPURT_ASSERT_OK(gpurt_scene_add_light(scene, &light, &id));
  add_camera(scene, {0, 0, 0}, 2 * std::atan(1.0f));
  commit_scene(scene);
  PhotonOptions o;
  o.width = o.height = 64;
  o.spp = 4;
  o.max_depth = 3;
  o.photon.photons_per_pass = 65536;
  // The mirror ends at 0.4 in a height of 2.9 over the spot, so the square ends at 0.4 * 5.9 / 2.9 = 0.814.
  const auto outside = [&](float radius, gpurt_statistics &statistics) {
    o.photon.initial_radius = radius;
    const Result image = render_with(scene, o);
    statistics = image.statistics;
    double sum = 0;
    for (uint32_t y = 0; y < 64; ++y) {
      for (uint32_t x = 0; x < 64; ++x) {
        const double px = (x + 0.5) / 32 * 2 - 2, py = (y + 0.5) / 32 * 2 - 2;
        if (std::max(std::abs(px), std::abs(py)) > 0.83) sum += double(image.red(o, x, y));
      }
    }
    return sum;
  };
  gpurt_statistics wide, narrow;
  const double w = outside(0.4f, wide), n = outside(0.2f, narrow);
  const double expected = std::sqrt((5.0 / 6) * (8.0 / 9) * (11.0 / 12));  // of pass 3
  const double share = wide.photon_counters.smallest_radius / 0.4;
  // By passes: the radius has fallen to a half, as r(i) does, after some 87.
  gpurt_statistics late;
  o.first_sample = 87;
  const double l = outside(0.4f, late);
  double share2 = 1;
  for (int i = 1; i <= 90; ++i) share2 *= (i + 2.0 / 3) / (i + 1.0);
  const double late_share = late.photon_counters.smallest_radius / 0.4;
  // Cells of 1/16 and a border of 0.03 take from the narrow ones: the ratio is 2 to 3. Passes 0 to 3 have radii of 1 to 0.8.
  uint64_t bad = !(w / n > 1.6 && w / n < 3.2) + !(std::abs(share / expected - 1) < 1e-5);
  bad += !(w / l > 1.4 && w / l < 3.2) + !(std::abs(late_share / std::sqrt(share2) - 1) < 1e-5);
  record(31, method(), bad, 4,
         text_of("half the radius leaves 1 / %.2f of the blur; r(3) / r(0) = %.5f", w / n, share) +
             text_of("; passes 87 to 90 leave 1 / %.2f, r(90) / r(0) = %.5f", w / l, late_share));
}

TEST_P(Photons, Row32Energy)
{
  // In a closed box of albedo 0.5 a photon meets 2 surfaces on average, with variance 2: as much is absorbed as emitted.
  const Scene scene = make_scene();
  add_mesh(scene, cube(), add_material(scene, GPURT_MATERIAL_LAMBERT, {0.5f, 0.5f, 0.5f}));
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  light.type = GPURT_LIGHT_POINT;
  for (float &c : light.intensity) c = 1;
  uint32_t id;
  GPURT_ASSERT_OK(gpurt_scene_add_light(scene, &light, &id));
  add_camera(scene, {0, 0, 0.5f}, 1);
  commit_scene(scene);
  PhotonOptions o;
  o.width = o.height = 4;
  o.spp = uint32_t(count(8, 128));
  o.max_depth = 200;
  o.photon.photons_per_pass = 65536;
  const gpurt_photon_counters c = render_with(scene, o).statistics.photon_counters;
  const double n = double(c.num_emitted), mean_hits = double(c.num_rays) / n, sigma = std::sqrt(2 / n);
  const double stored = double(c.num_stored) / n;
  // Their flux: from the second surface on as much arrives as the light emits, 4 pi watts.
  gpurt_photon_trace_desc trace = GPURT_PHOTON_TRACE_DESC_INIT;
  trace.num_paths = uint32_t(count(1 << 19, 1 << 23));
  trace.seed = 5;
  trace.max_depth = 200;
  gpurt_photon_map map = nullptr;
  GPURT_ASSERT_OK(gpurt_photon_map_trace(scene, &trace, &map));
  const Owned<gpurt_photon_map, gpurt_photon_map_release> owned(map);
  gpurt_photon_map_info info = GPURT_PHOTON_MAP_INFO_INIT;
  GPURT_ASSERT_OK(gpurt_photon_map_get_info(map, &info));
  std::vector<float> fluxes(3 * info.num_points);
  GPURT_ASSERT_OK(
      gpurt_photon_map_read(map, GPURT_PHOTON_ATTRIBUTE_FLUX, fluxes.data(), fluxes.size() * sizeof(float)));
  double flux = 0;
  for (const float f : fluxes) flux += double(f) / 3;
  flux /= 4 * 3.14159265358979323846;
  const double flux_sigma = std::sqrt(2.0 / trace.num_paths);
  uint64_t bad = !(std::abs(mean_hits - 2) < 3 * sigma) + !(std::abs(stored - 1) < 3 * sigma);
  bad += !(std::abs(flux - 1) < 3 * flux_sigma);
  record(32, method(), bad, 3,
         text_of("surfaces a photon %.5f, of 2; off by %.2f sigma", mean_hits, (mean_hits - 2) / sigma) +
             text_of("; flux %.5f of the light's, off by %.2f sigma", flux, (flux - 1) / flux_sigma));
}

TEST_P(Photons, Row33TooFewPhotons)
{
  const Scene scene = make_scene();
  add_mesh(scene, cube(), furnace_material(scene, 0.9f));
  add_camera(scene, {0, 0, 0}, 1);
  commit_scene(scene);
  PhotonOptions o;
  o.spp = 2;
  o.photon.photons_per_pass = 10;
  o.photon.initial_radius = 0.2f;
  const Result image = render_with(scene, o);
  uint64_t bad = 0;
  for (const float v : image.color) bad += !std::isfinite(v);
  const double error = image.statistics.estimated_error;
  bad += !(std::sqrt(error) > 0.5);
  record(33, method(), bad, image.color.size() + 1, text_of("estimated relMSE %.2f", error));
}

TEST_P(Photons, Row34StoreOverflow)
{
  PhotonOptions o;
  o.width = o.height = 24;
  o.spp = 2;
  o.photon.photons_per_pass = 100000;
  std::vector<std::vector<float>> images;
  std::string note;
  uint64_t bad = 0;
  for (const uint64_t limit : {uint64_t(0), uint64_t(4) << 20}) {
    device_ = make_device(method().device, method().is_cuda() ? 0 : 1, limit);
    const Scene scene = make_scene();
    add_mesh(scene, cube(), furnace_material(scene, 0.7f));
    add_camera(scene, {0, 0, 0}, 1);
    commit_scene(scene);
    const Result image = render_with(scene, o);
    images.push_back(image.color);
    const uint64_t maps = image.statistics.photon_counters.num_sub_passes;
    bad += limit == 0 ? maps != 2 : maps < 20;
    bad += limit != 0 && image.statistics.memory_peak_bytes > limit;
    note += text_of(limit == 0 ? "%.0f maps" : ", %.0f maps within 4 MiB", double(maps));
  }
  bad += std::memcmp(images[0].data(), images[1].data(), images[0].size() * sizeof(float)) != 0;
  record(34, method(), bad, 4, note);
}

TEST_P(Photons, Row36RadiusUnderflow)
{
  const Scene scene = make_scene();
  add_mesh(scene, cube(5e5f), furnace_material(scene, 0.5f));
  add_camera(scene, {0, 0, 0}, 1);
  commit_scene(scene);
  PhotonOptions o;
  o.spp = 1;
  o.photon.photons_per_pass = 4096;
  uint64_t bad = 0;
  double smallest = 0;
  for (const float radius : {0.0f, 1e-30f}) {
    for (const uint64_t pass : {uint64_t(1000000), uint64_t(1) << 40}) {
      o.photon.initial_radius = radius;
      o.first_sample = pass;
      const Result image = render_with(scene, o);
      for (const float v : image.color) bad += !std::isfinite(v);
      smallest = image.statistics.photon_counters.smallest_radius;
      bad += !(smallest > 0);
      // Emission and direct light are there, whatever the radius is.
      bad += !(mean(image.color) > 0.5);
    }
  }
  record(36, method(), bad, 4 * 2, text_of("radius of the last pass %.3g", smallest));
}

}  // namespace
