// Rows 12, 24, 25, 49, 51: what path-traced images tell.
#include <chrono>
#include <thread>

#include "catalogue.h"
#include "correlation.h"

namespace {

using namespace gpurt_test;

class Render : public Stability {
 protected:
  gpurt_statistics statistics_of(gpurt_frame frame)
  {
    gpurt_statistics s = GPURT_STATISTICS_INIT;
    GPURT_EXPECT_OK(gpurt_frame_get_statistics(frame, &s));
    return s;
  }
};
GPURT_STABILITY_SUITE(Render);

void add_distant_light(gpurt_scene scene, Point direction, float irradiance)
{
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  light.type = GPURT_LIGHT_DISTANT;
  for (int k = 0; k < 3; ++k) light.direction[k] = direction[k], light.intensity[k] = irradiance;
  uint32_t id;
  GPURT_EXPECT_OK(gpurt_scene_add_light(scene, &light, &id));
}

// A plane and a convex body hit nothing that leaves them. So, seen by a camera that sees nothing else, every camera ray
// makes one bounce ray, which escapes, and one shadow ray, which reaches the distant light: of a plane, all pixels have
// one value.
TEST_P(Render, Row12SelfIntersection)
{
  uint64_t bad = 0, total = 0;
  std::string note;
  const uint32_t side = 256, spp = uint32_t(count(4, 32));
  for (const double offset : {0.0, 1000.0}) {
    for (const bool is_plane : {true, false}) {
      const Scene scene = make_scene();
      // The plane is tilted, so that no coordinate is exact.
      const Mesh body =
          is_plane ? quad({-90, -90, -31}, {90, -90, -32}, {90, 90, -29}, {-90, 90, -28}) : icosphere(4);
      add_mesh(scene, moved(body, 1, {offset, -offset, offset}, false),
               add_material(scene, GPURT_MATERIAL_LAMBERT, {0.5f, 0.5f, 0.5f}));
      add_distant_light(scene, {0.3f, 0.2f, -1}, 1);
      add_camera(scene, {float(offset), float(-offset), float(offset) + (is_plane ? 0 : 3)},
                 is_plane ? 1.0f : 0.7f);
      commit_scene(scene);
      RenderOptions o;
      o.width = o.height = side;
      o.spp = spp;
      const Frame frame = make_frame(scene, o);
      render(frame, o);
      const gpurt_statistics s = statistics_of(frame);
      std::vector<float> alpha(size_t(side) * side);
      GPURT_ASSERT_OK(
          gpurt_frame_read(frame, GPURT_OUTPUT_ALPHA, alpha.data(), alpha.size() * sizeof(float)));
      const double hits = mean(alpha) * double(alpha.size()) * spp;
      EXPECT_GT(hits, 0.3 * double(side) * side * spp);
      // Bounce rays beyond one a hit follow a bounce ray that hit something.
      const uint64_t second = s.num_bounce_rays > hits + 0.5 ? uint64_t(s.num_bounce_rays - hits + 0.5) : 0;
      bad += second;
      total += s.num_bounce_rays + s.num_shadow_rays;
      uint64_t shadowed = 0;
      if (is_plane) {
        // One shadow ray that was stopped takes 1/spp of its pixel's light.
        const std::vector<float> color = read_color(frame, o);
        const float brightest = *std::max_element(color.begin(), color.end());
        for (size_t i = 0; i < color.size(); i += 3)
          shadowed += color[i] < brightest * (1 - 0.5f / float(spp));
      }
      bad += shadowed;
      note += (note.empty() ? "" : "; ") + std::string(is_plane ? "plane" : "sphere") +
              (offset == 0 ? "" : " far off") + ": " + std::to_string(second) + " bounces and " +
              std::to_string(shadowed) + " shadow rays";
    }
  }
  record(12, method(), bad, total, note);
}

TEST_P(Render, Row24Furnace)
{
  uint64_t bad = 0;
  std::string note;
  RenderOptions o;
  o.width = o.height = 32;
  o.spp = uint32_t(count(64, 1024));
  o.max_depth = 400;
  for (const bool is_inside : {false, true}) {
    const Scene scene = make_scene();
    // From inside, a lamp of radiance 0.5 and albedo 0.5: 0.5 (1 + 1/2 + 1/4 + ...) = 1. A white sphere there would
    // never end.
    const uint32_t material = is_inside ? add_material(scene, GPURT_MATERIAL_LAMBERT, {0.5f, 0.5f, 0.5f})
                                        : add_material(scene, GPURT_MATERIAL_LAMBERT, {1, 1, 1});
    if (is_inside) {
      gpurt_material_desc lamp = GPURT_MATERIAL_DESC_INIT;
      for (int k = 0; k < 3; ++k) lamp.base_color[k] = lamp.emission[k] = 0.5f;
      lamp.two_sided_emission = 1;
      uint32_t id;
      GPURT_ASSERT_OK(gpurt_scene_add_material(scene, &lamp, &id));
      add_mesh(scene, icosphere(3), id);
    } else {
      add_mesh(scene, icosphere(5), material);
      set_environment(scene, 1);
    }
    add_camera(scene, {0, 0, is_inside ? 0.1f : 4.0f}, 0.6f);
    commit_scene(scene);
    const Frame frame = make_frame(scene, o);
    render(frame, o);
    const double value = mean(read_color(frame, o));
    bad += !(std::abs(value - 1) <= 0.002);
    char text[64];
    std::snprintf(text, sizeof text, "%s%s %.6f", note.empty() ? "" : ", ", is_inside ? "inside" : "outside",
                  value);
    note += text;
  }
  record(24, method(), bad, 2, note);
}

// A flat plane under a sky of random texels: all pixels have the same expectation, so what differs is noise, and noise
// of other seeds and other frames must not resemble it.
TEST_P(Render, Row25CorrelatedSamples)
{
  const Scene scene = make_scene();
  std::mt19937_64 rng(25);
  const uint32_t w = 64, h = 32;
  std::vector<float> sky(size_t(w) * h * 4);
  for (size_t i = 0; i < sky.size(); i += 4) {
    const float v = rng() % 8 == 0 ? 8.0f : 0.1f;
    sky[i] = sky[i + 1] = sky[i + 2] = v;
    sky[i + 3] = 1;
  }
  gpurt_texture_desc texture = GPURT_TEXTURE_DESC_INIT;
  texture.format = GPURT_TEXTURE_RGBA32F;
  texture.width = w;
  texture.height = h;
  texture.texels = sky.data();
  gpurt_environment_desc environment = GPURT_ENVIRONMENT_DESC_INIT;
  GPURT_ASSERT_OK(gpurt_scene_add_texture(scene, &texture, &environment.texture));
  for (float &c : environment.radiance) c = 1;
  GPURT_ASSERT_OK(gpurt_scene_set_environment(scene, &environment));
  add_mesh(scene, quad({-90, -90, -30}, {90, -90, -30}, {90, 90, -30}, {-90, 90, -30}),
           add_material(scene, GPURT_MATERIAL_LAMBERT, {0.8f, 0.8f, 0.8f}));
  add_camera(scene, {0, 0, 0}, 1);
  commit_scene(scene);

  RenderOptions o;
  o.width = o.height = uint32_t(count(96, 256));
  o.spp = 8;
  std::vector<std::vector<double>> noise;
  for (const uint64_t seed : {0, 1}) {
    for (const uint32_t frame_index : {0u, 1u}) {
      gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
      desc.width = o.width;
      desc.height = o.height;
      desc.seed = seed;
      desc.frame_index = frame_index;
      Frame frame;
      GPURT_ASSERT_OK(gpurt_frame_create(scene, &desc, frame.out()));
      render(frame, o);
      noise.push_back(unit_noise(read_color(frame, o)));
    }
  }
  const Correlations c = correlate(noise);
  char text[64];
  std::snprintf(text, sizeof text, "largest of %d pairs: %.2f sigma", int(c.num_pairs), c.worst_sigma);
  record(25, method(), c.num_bad, c.num_pairs, text);
}

uint64_t hash(const void *data, size_t size)
{
  uint64_t h = 1469598103934665603u;  // FNV-1a
  for (size_t i = 0; i < size; ++i) h = (h ^ static_cast<const unsigned char *>(data)[i]) * 1099511628211u;
  return h;
}

TEST_P(Render, Row49Determinism)
{
  std::set<uint64_t> images, hits;
  const int runs = int(count(6, 20));
  const uint32_t ones_to_sevens[] = {1, 2, 7};
  Mesh mesh = voxel_ball(10);
  mesh.append(moved(icosphere(3), 4, {14, 5, 5}));
  RaySource source(mesh, {}, 49);
  std::vector<gpurt_ray> rays;
  for (int i = 0; i < 20000; ++i) rays.push_back(source(RayKind(i % 8)));
  for (int run = 0; run < runs; ++run) {
    device_ = make_device(method().device, method().is_cuda() ? 0 : ones_to_sevens[run % 3]);
    const Scene scene = make_scene();
    add_mesh(scene, mesh, add_material(scene, GPURT_MATERIAL_LAMBERT, {0.7f, 0.6f, 0.5f}));
    set_environment(scene, 0.3f);
    add_distant_light(scene, {0.3f, -0.5f, -1}, 2);
    add_camera(scene, {6, 5, 30}, 0.8f);
    commit_scene(scene);
    const std::vector<gpurt_hit> found = trace_closest(scene, rays);
    hits.insert(hash(found.data(), found.size() * sizeof found[0]));
    RenderOptions o;
    o.width = 61;
    o.height = 47;
    o.spp = 4;
    o.tile_size = std::array{0u, 8u, 16u, 64u}[run / 3 % 4];
    if (run % 3 != 0) {
      // Any rectangles in any order: here strips, from the last to the first.
      const uint32_t strips = ones_to_sevens[run % 3];
      for (uint32_t s = strips; s-- > 0;)
        o.tiles.push_back({0, o.height * s / strips, o.width, o.height * (s + 1) / strips});
    }
    const Frame frame = make_frame(scene, o);
    render(frame, o);
    const std::vector<float> color = read_color(frame, o);
    images.insert(hash(color.data(), color.size() * sizeof(float)));
  }
  record(49, method(), images.size() - 1 + hits.size() - 1, 2 * uint64_t(runs),
         std::to_string(images.size()) + " image hash, " + std::to_string(hits.size()) + " hit hash");
}

TEST_P(Render, Row51LongCall)
{
  const Scene scene = make_scene();
  add_mesh(scene, voxel_ball(16), add_material(scene, GPURT_MATERIAL_LAMBERT, {0.9f, 0.9f, 0.9f}));
  set_environment(scene, 1);
  add_camera(scene, {8, 8, 40}, 0.8f);
  commit_scene(scene);
  uint64_t bad = 0, total = 0;
  double worst = 0;
  for (const uint32_t tile_size : {0u, 128u}) {
    gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
    frame_desc.width = frame_desc.height = 1024;
    Frame frame;
    GPURT_ASSERT_OK(gpurt_frame_create(scene, &frame_desc, frame.out()));
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.pipeline = GPURT_PIPELINE_PATH;
    desc.samples_per_pixel = 100000;
    desc.tile_size = tile_size;
    Job job;
    GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, nullptr, 0, job.out()));
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    EXPECT_EQ(gpurt_job_wait(job, 0), GPURT_ERROR_TIMEOUT) << "the job should still run";
    const auto start = std::chrono::steady_clock::now();
    GPURT_ASSERT_OK(gpurt_job_cancel(job));
    const gpurt_result result = gpurt_job_wait(job, 60'000'000'000);
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    worst = std::max(worst, seconds);
    bad += result != GPURT_ERROR_CANCELLED;
    bad += seconds >= 0.5;
    total += 2;
  }
  char text[64];
  std::snprintf(text, sizeof text, "ended %.3f s after the cancel", worst);
  record(51, method(), bad, total, text);
}

}  // namespace
