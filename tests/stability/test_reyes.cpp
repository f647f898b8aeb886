// Rows 37 to 52: what REYES does where it is known to fail.
#include <chrono>

#include "../support/reyes_renders.h"
#include "catalogue.h"

namespace {

using namespace gpurt_test;

class ReyesRows : public Stability {
 protected:
  // Turned at random about the origin, at most so far from it.
  static void add_camera_within(gpurt_scene scene, std::mt19937_64 &rng, double radius)
  {
    std::array<double, 3> eye;
    double length2 = 0;
    for (double &c : eye) {
      c = uniform(rng, -1, 1);
      length2 += c * c;
    }
    const double r = radius * std::cbrt(uniform(rng)) / std::sqrt(length2);
    for (double &c : eye) c *= r;
    add_turned_camera(scene, eye, rng, float(uniform(rng, 0.3, 2.5)));
  }

  // A device with another memory limit or number of threads, and the same scene on it.
  template <class Fill>
  Scene scene_on(Device &device, uint32_t threads, uint64_t limit, const Fill &fill)
  {
    device = make_device(method().device, threads, limit);
    Scene scene;
    GPURT_EXPECT_OK(gpurt_scene_create(device, scene.out()));
    fill(scene);
    coarse_commit(scene);
    return scene;
  }

  // Of the last render: what it holds is looked at later.
  Device last_device_;
  Scene last_scene_;
  Frame last_frame_;
};
INSTANTIATE_TEST_SUITE_P(Methods, ReyesRows, ::testing::ValuesIn(reyes_methods()),
                         [](const auto &info) { return std::string(info.param.name); });

TEST_P(ReyesRows, Row37Cracks)
{
  std::mt19937_64 rng(37);
  uint64_t bad = 0, total = 0;
  for (const auto &[nets, radius] : {std::pair{closed_patches(1, 0.0, 11), 0.75},
                                     {closed_patches(2, 0.3, 12), 0.5},
                                     {closed_patches(3, 0.15, 13), 0.7},
                                     {poles(3), 0.6},
                                     {poles(7), 0.7}}) {
    const Scene scene = make_scene();
    add_patches(scene, nets);
    const uint32_t num = uint32_t(count(8, 100));
    for (uint32_t i = 0; i < num; ++i) add_camera_within(scene, rng, radius);
    coarse_commit(scene);
    for (uint32_t i = 0; i < num; ++i) {
      // Rates for which neighbours take different numbers of segments.
      RenderOptions o = reyes_options(24, 9, std::array{0.25f, 0.7f, 3.0f, 40.0f}[i % 4]);
      o.seed = i;
      o.reyes.flatness = std::array{0.0f, 0.1f, 0.0f, 2.0f}[i / 4 % 4];
      for (const int covered : covered_samples(scene, o, i)) bad += uint64_t(9 - covered);
      total += 24 * 24 * 9;
    }
  }
  record(37, method(), bad, total);
}

// Within an outline: all of a pixel's neighbours, and it, are covered for rays.
TEST_P(ReyesRows, Row38EyeSplit)
{
  std::mt19937_64 rng(38);
  constexpr uint32_t size = 20, spp = 4;
  const uint32_t num = uint32_t(count(24, 250));
  uint64_t bad = 0, total = 0, num_splits = 0;
  for (const auto &nets : {closed_patches(1, 0.2, 21), closed_patches(2, 0.3, 22), poles(4), poles(5)}) {
    const Scene scene = make_scene();
    add_patches(scene, nets);
    for (uint32_t i = 0; i < num; ++i) add_camera_within(scene, rng, i % 2 ? 1.2 : 3.0);
    gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
    build.accel = GPURT_ACCEL_BVH;
    build.patch_tolerance = 1e-3f;
    GPURT_ASSERT_OK(gpurt_scene_commit(scene, &build));
    for (uint32_t i = 0; i < num; ++i) {
      RenderOptions o = reyes_options(size, spp);
      o.seed = i;
      const std::vector<int> ours = covered_samples(scene, o, i),
                             theirs = covered_samples(scene, path_options(o), i);
      for (uint32_t y = 0; y < size; ++y) {
        for (uint32_t x = 0; x < size; ++x) {
          bool is_within = true;
          for (uint32_t v = y - (y != 0); v <= std::min(y + 1, size - 1); ++v)
            for (uint32_t u = x - (x != 0); u <= std::min(x + 1, size - 1); ++u)
              is_within &= theirs[v * size + u] == int(spp);
          if (!is_within) continue;
          bad += uint64_t(int(spp) - ours[y * size + x]);
          total += spp;
        }
      }
    }
  }
  // Planes through the eye and next to it: what rays see but for a sample, and an end to cutting.
  const Scene scene = make_scene();
  add_patches(scene, {flat_patch({-50, -0.001f, -50}, {100, 0, 0}, {0, 0, 100}),
                      flat_patch({1e-4f, -1, -1}, {0, 2, 0}, {0, 0, 2}),
                      flat_patch({-1, 1e-6f, -3}, {2, 0, 0}, {0, 0, 6}),
                      flat_patch({-1, 0, -2}, {2, 0, 0}, {0, 0, 4})});
  add_camera(scene, {0, 0, 0}, 1.2f);
  coarse_commit(scene);
  const RenderOptions o = reyes_options(32, 9);
  Frame frame = make_frame(scene, o);
  render(frame, o);
  num_splits = statistics_of(frame).reyes_counters.num_splits;
  bad += num_splits > 200000;
  const std::vector<int> ours = covered_samples(scene, o, 0),
                         theirs = covered_samples(scene, path_options(o), 0);
  for (size_t p = 0; p < ours.size(); ++p) bad += std::abs(ours[p] - theirs[p]) > 1;
  total += ours.size() + 1;
  record(38, method(), bad, total,
         text_of("%.0f cameras; %.0f cuts of planes through the eye", 4.0 * num + 1, double(num_splits)));
}

TEST_P(ReyesRows, Row39LayersThatBlend)
{
  constexpr uint32_t num_layers = 500;
  constexpr float alpha = 0.02f;
  const auto fill = [](gpurt_scene scene) {
    const std::array<uint32_t, 3> materials = add_layer_materials(scene, alpha);
    // In no order: layer i lies at -i / 1000.
    for (const uint32_t i : shuffled_layers(num_layers)) {
      const float z = -0.001f * float(i);
      if (i % 5 == 0) add_patches(scene, {flat_patch({-2, -2, z}, {4, 0, 0}, {0, 4, 0})}, materials[i % 3]);
      else add_mesh(scene, quad({-2, -2, z}, {2, -2, z}, {2, 2, z}, {-2, 2, z}), materials[i % 3]);
    }
    set_environment(scene, 1);
    add_camera(scene, {0, 0, 3}, 0.8f);
  };
  const std::array<double, 3> expected = color_of_layers(num_layers, alpha);
  RenderOptions o = reyes_options(12, 16, 4.0f);
  o.max_depth = 1;
  uint64_t bad = 0, total = 0;
  double worst = 0;
  std::vector<float> first;
  // Also with so little memory that there is room for few layers at a time.
  for (const uint64_t limit : {uint64_t(0), uint64_t(method().is_cuda() ? 16 : 8) << 20}) {
    Device device;
    const Scene scene = scene_on(device, 1, limit, fill);
    Frame frame = make_frame(scene, o);
    render(frame, o);
    const std::vector<float> color = read_color(frame, o);
    for (size_t i = 0; i < color.size(); ++i) {
      const double error = std::abs(double(color[i]) - expected[i % 3]);
      worst = std::max(worst, error);
      bad += !(error <= 1e-4);
    }
    if (first.empty()) first = color;
    bad += std::memcmp(first.data(), color.data(), color.size() * sizeof(float)) != 0;
    total += color.size() + 1;
  }
  record(39, method(), bad, total, text_of("off by at most %.2g", worst));
}

TEST_P(ReyesRows, Row40DepthTies)
{
  const auto fill = [](gpurt_scene scene) {
    const std::array<uint32_t, 3> materials = {
        add_glow(scene, {1, 0, 0}, 0.5f), add_glow(scene, {0, 1, 0}, 0.3f), add_glow(scene, {0, 0, 1}, 0.7f)};
    std::vector<PatchNet> nets = closed_patches(1, 0.2, 40);
    const std::vector<PatchNet> once = nets;
    nets.insert(nets.end(), once.begin(), once.end());
    for (const uint32_t m : materials) {
      add_mesh(scene, quad({-1, -1, 1}, {1, -1, 1}, {1, 1, 1}, {-1, 1, 1}), m);
      add_patches(scene, {flat_patch({-1, -1, 1}, {2, 0, 0}, {0, 2, 0})}, m);
      add_patches(scene, nets, m);
    }
    // One that hides what is behind it, in the same place as others.
    add_mesh(scene, quad({-1, -1, 1}, {0, -1, 1}, {0, 1, 1}, {-1, 1, 1}),
             add_material(scene, GPURT_MATERIAL_LAMBERT, {0.5f, 0.5f, 0.5f}));
    add_patches(scene, once, materials[0]);
    set_environment(scene, 1);
    add_camera(scene, {0.3f, 0.1f, 4}, 0.7f);
  };
  std::vector<float> first;
  uint64_t bad = 0, total = 0;
  for (const auto &[threads, tile, limit] : {std::tuple{1u, 0u, uint64_t(0)},
                                             {2u, 16u, uint64_t(0)},
                                             {2u, 7u, uint64_t(0)},
                                             {1u, 64u, uint64_t(20) << 20}}) {
    Device device;
    const Scene scene = scene_on(device, threads, limit, fill);
    RenderOptions o = reyes_options(32, 9);
    o.tile_size = tile;
    Frame frame = make_frame(scene, o);
    render(frame, o);
    const std::vector<float> color = read_color(frame, o);
    if (first.empty()) first = color;
    for (size_t i = 0; i < color.size(); ++i)
      bad += std::memcmp(&first[i], &color[i], sizeof(float)) != 0 || !std::isfinite(color[i]);
    total += color.size();
  }
  record(40, method(), bad, total);
}

TEST_P(ReyesRows, Row41ShadingRate)
{
  // Black and white squares of patches on a ball: what is off is where they and their outline are put.
  const Scene scene = make_scene();
  const uint32_t white = add_material(scene, GPURT_MATERIAL_LAMBERT, {1, 1, 1}),
                 black = add_material(scene, GPURT_MATERIAL_LAMBERT, {0, 0, 0});
  const std::vector<PatchNet> nets = closed_patches(4, 0.1, 41);
  for (size_t i = 0; i < nets.size(); ++i) add_patches(scene, {nets[i]}, (i + i / 4) % 2 ? white : black);
  set_environment(scene, 1);
  add_camera(scene, {0, 0, 3}, 0.8f);
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_BVH;
  build.patch_tolerance = 2e-4f;
  GPURT_ASSERT_OK(gpurt_scene_commit(scene, &build));
  const auto image = [&](float rate) {
    RenderOptions o = reyes_options(64, 16, rate);
    Frame frame = make_frame(scene, o);
    render(frame, o);
    return read_color(frame, o);
  };
  const std::vector<float> reference = image(1.0f / 32);
  uint64_t bad = 0;
  double last = 0;
  std::string note = "RMS error";
  for (const float rate : {0.25f, 1.0f, 4.0f, 16.0f, 64.0f}) {
    const std::vector<float> color = image(rate);
    double sum = 0;
    for (size_t i = 0; i < color.size(); ++i) sum += std::pow(double(color[i]) - double(reference[i]), 2);
    const double error = std::sqrt(sum / double(color.size()));
    bad += !(error >= last);
    last = error;
    note += text_of(" %.2g at %g;", error, double(rate));
  }
  bad += !(last > 0);
  note.pop_back();
  record(41, method(), bad, 6, note);
}

TEST_P(ReyesRows, Row43DegeneratePatches)
{
  PatchNet point{}, line = flat_patch({-1, 0.5f, 0}, {2, 0, 0}, {0, 0, 0});
  PatchNet triangle = flat_patch({-1, -1, 0}, {2, 0, 0}, {0, 2, 0});
  for (size_t c = 0; c < 4; ++c) triangle[c] = triangle[0];
  PatchNet folded = flat_patch({-1, -1, 0.5f}, {2, 0, 0}, {0, 2, 0});
  for (size_t r = 0; r < 4; ++r) folded[4 * r + 3] = folded[4 * r];
  uint64_t bad = 0, total = 0;
  for (const auto &nets :
       {std::vector{point}, std::vector{line}, std::vector{triangle}, std::vector{folded}, poles(3)}) {
    const Scene scene = make_scene();
    add_patches(scene, nets);
    set_environment(scene, 1);
    add_camera(scene, {0, 0, 3}, 1.0f);
    add_camera(scene, {0, 0.5f, 3}, 0.1f);
    add_camera(scene, {0, 0, 0}, 2.0f);
    coarse_commit(scene);
    for (uint32_t camera = 0; camera < 3; ++camera) {
      const RenderOptions o = reyes_options(32, 9);
      Frame frame = camera_frame(scene, o, camera, 1u << GPURT_OUTPUT_NORMAL);
      render(frame, o);
      bad += statistics_of(frame).num_nonfinite;
      for (const float c : read_color(frame, o)) bad += !std::isfinite(c);
      for (const float c : read_output<float>(frame, o, GPURT_OUTPUT_NORMAL, 3)) bad += !std::isfinite(c);
      total += 2 * 3 * 32 * 32;
    }
  }
  record(43, method(), bad, total);
}

TEST_P(ReyesRows, Row44NeedlePatch)
{
  uint64_t bad = 0, total = 0;
  double worst = 0;
  for (const float turn : {0.0f, 0.3f, 1.1f}) {
    for (const float rate : {0.25f, 1.0f, 4.0f}) {
      const Scene scene = make_scene();
      const float c = std::cos(turn), s = std::sin(turn);
      // 1000 : 1, curved so that it is not one cell of anything.
      PatchNet net = flat_patch({-c, -s, 0}, {2 * c, 2 * s, 0}, {-0.002f * s, 0.002f * c, 0});
      for (size_t k = 0; k < 16; ++k) net[k][2] = k % 4 == 1 || k % 4 == 2 ? 0.3f : 0.0f;
      add_patches(scene, {net});
      add_camera(scene, {0, 0, 3}, 0.8f);
      coarse_commit(scene);
      constexpr uint32_t size = 64;  // one part: parts of an image each dice what they share
      RenderOptions o = reyes_options(size, 4, rate);
      o.tile_size = size;
      Frame frame = make_frame(scene, o);
      render(frame, o);
      const gpurt_reyes_counters k = statistics_of(frame).reyes_counters;
      const double covered = mean(read_output<float>(frame, o, GPURT_OUTPUT_ALPHA, 1)) * size * size;
      // Its edges have a segment at least for each sqrt(rate) of a pixel.
      const double length = 2.1 * size / (2 * std::tan(0.4) * 3),
                   edges = 2 * length / std::sqrt(double(rate));
      const double bound = 4 * covered / double(rate) + edges;
      worst = std::max(worst, double(k.num_micropolygons) / bound);
      bad += !(double(k.num_micropolygons) <= bound) || !(covered > 0);
      ++total;
    }
  }
  record(44, method(), bad, total, text_of("%.2f of what is allowed at most", worst));
}

TEST_P(ReyesRows, Row47SplitQueueBound)
{
  struct Case {
    std::vector<PatchNet> nets;
    RenderOptions options;
  };
  std::vector<Case> cases(2);
  // One patch that fills 16,384 pixels; in a full run an image as wide as that.
  PatchNet one = flat_patch({-4, -4, 0}, {8, 0, 0}, {0, 8, 0});
  for (size_t k = 0; k < 16; ++k) one[k][2] = 0.2f * float((k * 7) % 5);
  cases[0] = {{one}, reyes_options(128, 16)};
  if (is_full_run()) cases[0].options.width = 16384, cases[0].options.height = 64;
  // Many small ones.
  const int side = int(count(100, 1000));
  for (int i = 0; i < side * side; ++i) {
    const float step = 4.0f / float(side), x = -2 + step * float(i % side), y = -2 + step * float(i / side);
    cases[1].nets.push_back(flat_patch({x, y, 0.1f * float(i % 3)}, {step, 0, 0}, {0, step, 0}));
  }
  cases[1].options = reyes_options(64, 16);
  uint64_t bad = 0, total = 0;
  std::string note;
  for (const Case &c : cases) {
    const auto fill = [&](gpurt_scene scene) {
      add_patches(scene, c.nets);
      set_environment(scene, 1);
      add_camera(scene, {0, 0, 3}, 0.8f);
    };
    std::vector<float> first;
    uint64_t working = 0, committed = 0;
    for (const bool is_limited : {false, true}) {
      Device device;
      gpurt_device_properties p = GPURT_DEVICE_PROPERTIES_INIT;
      // What the scene and the film hold, and a sixteenth of what REYES took without a limit, or what the smallest lists and
      // a film of one tile take; a commit needs its own.
      uint64_t limit = 0;
      if (is_limited) {
        GPURT_EXPECT_OK(gpurt_device_get_properties(last_device_, &p));
        const uint64_t least = method().is_cuda() ? uint64_t(5) << 19 : uint64_t(9) << 17;
        limit = std::max(committed, p.memory_used_bytes + std::max(working / 16, least));
      }
      Scene scene = scene_on(device, 1, limit, fill);
      GPURT_EXPECT_OK(gpurt_device_get_properties(device, &p));
      committed = p.memory_peak_bytes;
      Frame frame = make_frame(scene, c.options);
      render(frame, c.options);
      const std::vector<float> color = read_color(frame, c.options);
      const gpurt_statistics s = statistics_of(frame);
      // The limit is felt.
      if (is_limited) bad += s.memory_peak_bytes > limit || s.reyes_counters.working_bytes > working / 2;
      else first = color;
      working = s.reyes_counters.working_bytes;
      bad += std::memcmp(first.data(), color.data(), color.size() * sizeof(float)) != 0;
      total += 2;
      note +=
          text_of("%.1f MB, queue of %.0f; ", double(working) / 1e6, double(s.reyes_counters.largest_queue));
      last_frame_ = std::move(frame);
      last_scene_ = std::move(scene);
      last_device_ = std::move(device);
    }
  }
  note.resize(note.size() - 2);
  record(47, method(), bad, total, note);
}

// All work in one corner of the image, tiles of any size in any order from several jobs.
TEST_P(ReyesRows, Row52StarvedQueue)
{
  const Scene scene = make_scene();
  const std::vector<PatchNet> nets = closed_patches(3, 0.2, 52);
  std::vector<std::array<float, 12>> places;
  for (int i = 0; i < 40; ++i) {
    const float s = 0.02f;
    places.push_back({s, 0, 0, -0.9f + 0.002f * float(i), 0, s, 0, 0.9f, 0, 0, s, 0.01f * float(i)});
  }
  add_patches(scene, nets, 0, places);
  set_environment(scene, 1);
  add_camera(scene, {0, 0, 2.4f}, 0.8f);
  coarse_commit(scene);
  RenderOptions o = reyes_options(32, 2, 1.0f);
  Frame whole = make_frame(scene, o);
  render(whole, o);
  const std::vector<float> reference = read_color(whole, o);
  std::mt19937_64 rng(52);
  uint64_t bad = 0;
  const uint64_t num = count(40, 10000);
  double longest = 0;
  for (uint64_t run = 0; run < num; ++run) {
    // Cuts the image into rectangles.
    std::vector<gpurt_tile> tiles = {{0, 0, 32, 32}};
    for (uint64_t cuts = rng() % 12; cuts > 0; --cuts) {
      const size_t i = pick(rng, tiles.size());
      gpurt_tile &t = tiles[i];
      const bool along_x = rng() & 1;
      const uint32_t extent = along_x ? t.x1 - t.x0 : t.y1 - t.y0;
      if (extent < 2) continue;
      const uint32_t at = (along_x ? t.x0 : t.y0) + 1 + uint32_t(rng() % (extent - 1));
      gpurt_tile rest = t;
      (along_x ? t.x1 : t.y1) = at;
      (along_x ? rest.x0 : rest.y0) = at;
      tiles.push_back(rest);
    }
    for (size_t i = tiles.size(); i > 1; --i) std::swap(tiles[i - 1], tiles[pick(rng, i)]);
    const auto start = std::chrono::steady_clock::now();
    Frame frame = make_frame(scene, o);
    std::vector<Job> jobs(1 + rng() % 3);
    const size_t per_job = (tiles.size() + jobs.size() - 1) / jobs.size();
    for (size_t j = 0; j < jobs.size(); ++j) {
      const size_t from = std::min(j * per_job, tiles.size()), to = std::min(from + per_job, tiles.size());
      if (from == to) continue;
      gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
      desc.pipeline = GPURT_PIPELINE_REYES;
      desc.reyes = o.reyes;
      desc.samples_per_pixel = o.spp;
      desc.tile_size = 1 + uint32_t(rng() % 40);
      GPURT_ASSERT_OK(gpurt_frame_submit(frame, &desc, tiles.data() + from, to - from, jobs[j].out()));
    }
    for (const Job &job : jobs) {
      if (job != nullptr) GPURT_ASSERT_OK(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
    }
    const std::vector<float> color = read_color(frame, o);
    bad += std::memcmp(reference.data(), color.data(), color.size() * sizeof(float)) != 0;
    longest =
        std::max(longest, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  bad += longest > 60;
  record(52, method(), bad, num, text_of("the longest took %.2f s", longest));
}

}  // namespace
