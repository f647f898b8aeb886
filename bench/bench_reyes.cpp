// REYES frames: time of every stage on the device, micropolygons a second. One JSON line a case.
//
//   bench_reyes [--device cpu|cuda] [--scene FILE]... [--size WxH]... [--spp N] [--rate AREA] [--shadows 0|1]
//               [--shading samples|micropolygons|blocks] [--repeats N] [--threads N]
//               [--split levels|queues|rounds] [--places pushed|blocks|pyramid|naive|library]
//               [--stages separate|uber|fused] [--schedules 0|1] [--flatness PIXELS]...
//               [--alpha A] [--rough-metal ROUGHNESS] [--copies K] [--slots N] [--memory-limit MIB] [--memory-share S]
//
// Without a scene: a dented ball of 2,400 patches on a floor of one patch, made here; with an alpha below 1 the ball blends.
// Of a scene, alpha and rough-metal change all materials, and copies places every model of more than one patch K times
// (scene_variant.h). Each frame is a new one; the first of a case is not counted. Times of stages are medians of what the device
// spent; "visible_ms" is their sum up to what every sample sees, "device_ms" that of all stages but the film's; "wall_ms" is a
// whole frame from its creation to the last pixel of its colour on the host: "create_ms", "render_ms" and "read_ms".
// Micropolygons are told for a second of "visible_ms" and of "device_ms".
//
// "working_bytes" is what REYES takes for samples and lists. A memory share below 1 repeats each case on a device that is limited to
// all that the case took but for the rest of these: "time_ratio" says how much longer that takes.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "check.h"
#include "gpurt.h"
#include "scene_variant.h"

namespace {

struct Size {
  uint32_t width, height;
};

struct Options {
  bool is_cuda = true;
  std::vector<std::string> scenes;
  std::vector<Size> sizes;
  uint32_t spp = 9, repeats = 9, threads = 0;
  bool has_shadows = false, has_schedules = false;
  float rate = 0.25f;
  std::vector<float> flatness;
  double memory_share = 1;
  uint64_t memory_limit = 0;
  uint32_t slots = 0;
  SceneVariant variant;
  gpurt_reyes_shading shading = GPURT_REYES_SHADING_SAMPLES;
  gpurt_launch split = GPURT_LAUNCH_AUTO;
  gpurt_traversal stages = GPURT_TRAVERSAL_AUTO;
  gpurt_compaction places = GPURT_COMPACTION_AUTO;
};

using Point = std::array<float, 3>;

// Patches on the faces of a cube that is blown up to a ball, with dents.
std::vector<Point> ball(int n)
{
  std::vector<Point> points;
  const int steps = 3 * n;
  for (int axis = 0; axis < 3; ++axis) {
    for (int side = 0; side < 2; ++side) {
      for (int patch = 0; patch < n * n; ++patch) {
        for (int k = 0; k < 16; ++k) {
          double p[3];
          p[axis] = side ? 1 : -1;
          p[(axis + 1) % 3] = 2.0 * (3 * (patch / n) + k / 4) / steps - 1;
          p[(axis + 2) % 3] = 2.0 * (3 * (patch % n) + k % 4) / steps - 1;
          const double length = std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
          const double dent = 1 + 0.08 * std::sin(9 * p[0]) * std::sin(8 * p[1]) * std::sin(7 * p[2]);
          Point q;
          for (int c = 0; c < 3; ++c) q[c] = float(p[c] * dent / length);
          points.push_back(q);
        }
      }
    }
  }
  return points;
}

void add_patches(gpurt_scene scene, const std::vector<Point> &points, uint32_t material)
{
  gpurt_patches_desc patches = GPURT_PATCHES_DESC_INIT;
  patches.material = material;
  patches.control_points.data = points.data();
  patches.control_points.count = points.size();
  uint32_t id = 0;
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  check(gpurt_scene_add_patches(scene, &patches, &instance.geometry), "gpurt_scene_add_patches");
  check(gpurt_scene_add_instance(scene, &instance, &id), "gpurt_scene_add_instance");
}

void fill(gpurt_scene scene, float alpha)
{
  gpurt_material_desc metal = GPURT_MATERIAL_DESC_INIT;
  metal.type = GPURT_MATERIAL_METAL;
  metal.roughness = 0.4f;
  for (float &c : metal.base_color) c = 0.8f;
  metal.alpha = alpha;
  metal.blends = alpha < 1 ? 1 : 0;
  uint32_t material = 0, id = 0;
  check(gpurt_scene_add_material(scene, &metal, &material), "gpurt_scene_add_material");
  add_patches(scene, ball(20), material);
  std::vector<Point> floor;
  for (int k = 0; k < 16; ++k) floor.push_back({float(k % 4) * 8 - 12, -1.0f, 12 - float(k / 4) * 8});
  add_patches(scene, floor, 0);
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  for (float &c : light.intensity) c = 40;
  light.position[0] = 3;
  light.position[1] = light.position[2] = 4;
  check(gpurt_scene_add_light(scene, &light, &id), "gpurt_scene_add_light");
  gpurt_camera_desc camera = GPURT_CAMERA_DESC_INIT;
  camera.yfov_rad = 0.7f;
  camera.transform[7] = 0.2f;
  camera.transform[11] = 4;
  check(gpurt_scene_add_camera(scene, &camera, &id), "gpurt_scene_add_camera");
}

struct Loaded {
  gpurt_device device = nullptr;
  gpurt_scene scene = nullptr;
  std::string name, device_name;
};

gpurt_device_properties properties_of(gpurt_device device)
{
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  check(gpurt_device_get_properties(device, &properties), "gpurt_device_get_properties");
  return properties;
}

// What a case took on the device.
struct Cost {
  double ms;
  uint64_t working_bytes, peak_bytes;
};

// `unlimited_ms`: 0, or what the case took without a limit.
Cost run(const Loaded &loaded, const Size &size, float flatness, const Options &o, double unlimited_ms = 0)
{
  gpurt_scene scene = loaded.scene;
  const struct {
    const char *name;
    double (*seconds)(const gpurt_statistics &);
  } stages[] = {
      {"bound_ms", [](const gpurt_statistics &s) { return s.reyes_counters.bound_seconds; }},
      {"split_ms", [](const gpurt_statistics &s) { return s.reyes_counters.split_seconds; }},
      {"dice_ms", [](const gpurt_statistics &s) { return s.reyes_counters.dice_seconds; }},
      {"sample_ms", [](const gpurt_statistics &s) { return s.reyes_counters.sample_seconds; }},
      {"visible_ms",
       [](const gpurt_statistics &s) {
         const gpurt_reyes_counters &c = s.reyes_counters;
         return c.bound_seconds + c.split_seconds + c.dice_seconds + c.sample_seconds;
       }},
      {"generate_ms", [](const gpurt_statistics &s) { return s.generate_seconds; }},
      {"trace_ms", [](const gpurt_statistics &s) { return s.trace_seconds; }},
      {"shade_ms", [](const gpurt_statistics &s) { return s.shade_seconds; }},
      {"shadow_ms", [](const gpurt_statistics &s) { return s.shadow_seconds; }},
      {"film_ms", [](const gpurt_statistics &s) { return s.film_seconds; }},
      {"job_ms", [](const gpurt_statistics &s) { return s.render_seconds; }},
  };
  std::vector<std::vector<double>> seconds(std::size(stages));
  std::vector<double> wall, create, render, read, release, device_seconds;
  std::vector<float> color(size_t(size.width) * size.height * 3);
  gpurt_statistics s = GPURT_STATISTICS_INIT;
  for (uint32_t i = 0; i <= o.repeats; ++i) {
    const double start = now();
    gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
    frame_desc.width = size.width;
    frame_desc.height = size.height;
    frame_desc.outputs = 1u << GPURT_OUTPUT_COLOR;
    gpurt_frame frame = nullptr;
    check(gpurt_frame_create(scene, &frame_desc, &frame), "gpurt_frame_create");
    const double created = now();
    gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
    desc.pipeline = GPURT_PIPELINE_REYES;
    desc.samples_per_pixel = o.spp;
    desc.reyes.shading_rate = o.rate;
    desc.reyes.flatness = flatness;
    desc.reyes.fragment_slots = o.slots;
    desc.reyes.shading = o.shading;
    desc.schedule.launch = o.split;
    desc.schedule.traversal = o.stages;
    desc.schedule.compaction = o.places;
    desc.reyes.no_shadows = o.has_shadows ? 0 : 1;
    gpurt_job job = nullptr;
    check(gpurt_frame_submit(frame, &desc, nullptr, 0, &job), "gpurt_frame_submit");
    check(gpurt_job_wait(job, GPURT_WAIT_FOREVER), "gpurt_job_wait");
    gpurt_job_release(job);
    const double rendered = now();
    check(gpurt_frame_read(frame, GPURT_OUTPUT_COLOR, color.data(), color.size() * sizeof(float)),
          "gpurt_frame_read");
    const double end = now();
    check(gpurt_frame_get_statistics(frame, &s), "gpurt_frame_get_statistics");
    const double releasing = now();
    gpurt_frame_release(frame);
    if (i == 0) continue;
    wall.push_back(end - start);
    create.push_back(created - start);
    render.push_back(rendered - created);
    read.push_back(end - rendered);
    release.push_back(now() - releasing);
    device_seconds.push_back(s.generate_seconds + stages[4].seconds(s) + s.trace_seconds + s.shade_seconds +
                             s.shadow_seconds);
    for (size_t k = 0; k < std::size(stages); ++k) seconds[k].push_back(stages[k].seconds(s));
  }
  const gpurt_reyes_counters &c = s.reyes_counters;
  std::printf(
      "{\"bench\":\"reyes\",\"device\":\"%s\",\"scene\":\"%s\",\"width\":%u,\"height\":%u,\"spp\":%u,"
      "\"shading\":%d,\"split\":%d,\"places\":%d,\"stages\":%d,\"shading_rate\":%g,\"flatness\":%g,\"alpha\":"
      "%g,"
      "\"rough_metal\":%g,\"copies\":%u,\"slots\":%u,\"shadows\":%d,\"wall_ms\":%.4f,\"create_ms\":%.4f,"
      "\"render_ms\":%.4f,\"read_ms\":%.4f,\"release_ms\":%.4f",
      loaded.device_name.c_str(), loaded.name.c_str(), size.width, size.height, o.spp, int(o.shading),
      int(s.schedule.launch), int(o.places), int(s.schedule.traversal), double(o.rate), double(flatness),
      double(o.variant.alpha), double(o.variant.rough_metal), o.variant.copies, o.slots, int(o.has_shadows),
      median(wall) * 1e3, median(create) * 1e3, median(render) * 1e3, median(read) * 1e3,
      median(release) * 1e3);
  double visible = 0;
  for (size_t k = 0; k < std::size(stages); ++k) {
    const double ms = median(seconds[k]) * 1e3;
    if (std::string(stages[k].name) == "visible_ms") visible = ms;
    std::printf(",\"%s\":%.4f", stages[k].name, ms);
  }
  const double device_ms = median(device_seconds) * 1e3;
  const gpurt_device_properties properties = properties_of(loaded.device);
  const struct {
    const char *name;
    uint64_t value;
  } counts[] = {{"patches", c.num_patches},
                {"triangles", c.num_triangles},
                {"splits", c.num_splits},
                {"culled", c.num_culled},
                {"grids", c.num_grids},
                {"micropolygons", c.num_micropolygons},
                {"fragments", c.num_fragments},
                {"lost_fragments", c.num_lost_fragments},
                {"largest_fragments", c.largest_fragments},
                {"shaded", c.num_shaded},
                {"largest_queue", c.largest_queue},
                {"working_bytes", c.working_bytes},
                {"memory_peak_bytes", properties.memory_peak_bytes},
                {"memory_limit_bytes", properties.memory_limit_bytes},
                {"split_rounds", c.split_rounds},
                {"donated", c.num_donated},
                {"list_rounds", s.schedule_counters.list_rounds},
                {"mode_switches", s.schedule_counters.mode_switches},
                {"compactions", s.schedule_counters.compactions}};
  for (const auto &count : counts) std::printf(",\"%s\":%llu", count.name, (unsigned long long)count.value);
  std::printf(",\"device_ms\":%.4f,\"gmp_per_s\":%.3f,\"gmp_per_s_frame\":%.3f", device_ms,
              double(c.num_micropolygons) / visible * 1e-6, double(c.num_micropolygons) / device_ms * 1e-6);
  if (unlimited_ms > 0)
    std::printf(",\"memory_share\":%g,\"time_ratio\":%.3f", o.memory_share, device_ms / unlimited_ms);
  std::printf("}\n");
  std::fflush(stdout);
  return {device_ms, c.working_bytes, properties.memory_peak_bytes};
}

// The talk's comparisons, with what it gives for a bucket of its own scene on a chip of 2009.
void compare_schedules(const Loaded &loaded, const Size &size, Options o)
{
  std::printf(
      "{\"bench\":\"reyes\",\"device\":\"talk of 2009\",\"split_levels_ms\":110,\"split_persistent_ms\":40,"
      "\"dice_shade_sample_separate_ms\":500,\"dice_shade_sample_uber_ms\":110,\"frame_ms\":150}\n");
  o.shading = GPURT_REYES_SHADING_MICROPOLYGONS;
  const struct {
    gpurt_launch split;
    gpurt_traversal stages;
    gpurt_compaction places = GPURT_COMPACTION_AUTO;
  } choices[] = {{GPURT_LAUNCH_REGULAR, GPURT_TRAVERSAL_LEAF_LISTS},
                 {GPURT_LAUNCH_PERSISTENT, GPURT_TRAVERSAL_STACK},
                 {GPURT_LAUNCH_ROUNDS, GPURT_TRAVERSAL_LEAF_LISTS},
                 {GPURT_LAUNCH_ROUNDS, GPURT_TRAVERSAL_UBER},
                 {GPURT_LAUNCH_ROUNDS, GPURT_TRAVERSAL_STACK},
                 {GPURT_LAUNCH_PERSISTENT, GPURT_TRAVERSAL_UBER},
                 {GPURT_LAUNCH_REGULAR, GPURT_TRAVERSAL_STACK},
                 {GPURT_LAUNCH_REGULAR, GPURT_TRAVERSAL_STACK, GPURT_COMPACTION_BLOCK_SCAN},
                 {GPURT_LAUNCH_REGULAR, GPURT_TRAVERSAL_STACK, GPURT_COMPACTION_PYRAMID},
                 {GPURT_LAUNCH_REGULAR, GPURT_TRAVERSAL_STACK, GPURT_COMPACTION_NAIVE_SCAN},
                 {GPURT_LAUNCH_REGULAR, GPURT_TRAVERSAL_STACK, GPURT_COMPACTION_LIBRARY_SCAN}};
  for (const auto &choice : choices) {
    o.split = choice.split;
    o.stages = choice.stages;
    o.places = choice.places;
    run(loaded, size, o.flatness[0], o);
  }
}

Options parse(int argc, char **argv)
{
  Options o;
  for (int i = 1; i < argc; i += 2) {
    const std::string name = argv[i], value = i + 1 < argc ? argv[i + 1] : "";
    Size size{};
    if (name == "--device") o.is_cuda = value == "cuda";
    else if (name == "--scene") o.scenes.push_back(value);
    else if (name == "--size" && std::sscanf(value.c_str(), "%ux%u", &size.width, &size.height) == 2)
      o.sizes.push_back(size);
    else if (name == "--spp") o.spp = uint32_t(std::max(1, std::atoi(value.c_str())));
    else if (name == "--rate") o.rate = float(std::atof(value.c_str()));
    else if (name == "--flatness") o.flatness.push_back(float(std::atof(value.c_str())));
    else if (name == "--alpha") o.variant.alpha = float(std::atof(value.c_str()));
    else if (name == "--rough-metal") o.variant.rough_metal = float(std::atof(value.c_str()));
    else if (name == "--copies") o.variant.copies = unsigned(std::max(1, std::atoi(value.c_str())));
    else if (name == "--slots") o.slots = uint32_t(std::atoi(value.c_str()));
    else if (name == "--memory-limit")
      o.memory_limit = uint64_t(std::max(0.0, std::atof(value.c_str())) * (1 << 20));
    else if (name == "--memory-share") o.memory_share = std::atof(value.c_str());
    else if (name == "--shadows") o.has_shadows = value == "1";
    else if (name == "--schedules") o.has_schedules = value == "1";
    else if (name == "--shading") {
      o.shading = value == "micropolygons" ? GPURT_REYES_SHADING_MICROPOLYGONS
                  : value == "blocks"      ? GPURT_REYES_SHADING_BLOCKS
                                           : GPURT_REYES_SHADING_SAMPLES;
    } else if (name == "--split") {
      o.split = value == "levels"   ? GPURT_LAUNCH_REGULAR
                : value == "queues" ? GPURT_LAUNCH_PERSISTENT
                : value == "rounds" ? GPURT_LAUNCH_ROUNDS
                                    : GPURT_LAUNCH_AUTO;
    } else if (name == "--places") {
      o.places = value == "blocks"    ? GPURT_COMPACTION_BLOCK_SCAN
                 : value == "pyramid" ? GPURT_COMPACTION_PYRAMID
                 : value == "naive"   ? GPURT_COMPACTION_NAIVE_SCAN
                 : value == "library" ? GPURT_COMPACTION_LIBRARY_SCAN
                                      : GPURT_COMPACTION_AUTO;
    } else if (name == "--stages") {
      o.stages = value == "separate" ? GPURT_TRAVERSAL_LEAF_LISTS
                 : value == "uber"   ? GPURT_TRAVERSAL_UBER
                 : value == "fused"  ? GPURT_TRAVERSAL_STACK
                                     : GPURT_TRAVERSAL_AUTO;
    } else if (name == "--repeats") o.repeats = uint32_t(std::max(1, std::atoi(value.c_str())));
    else if (name == "--threads") o.threads = uint32_t(std::atoi(value.c_str()));
    else {
      std::fprintf(stderr, "error: unknown option %s %s\n", name.c_str(), value.c_str());
      std::exit(2);
    }
  }
  if (o.scenes.empty() && (o.variant.rough_metal > 0 || o.variant.copies > 1)) {
    std::fprintf(stderr, "error: --rough-metal and --copies change a scene; name one with --scene\n");
    std::exit(2);
  }
  if (!(o.memory_share > 0 && o.memory_share <= 1)) {
    std::fprintf(stderr, "error: --memory-share is a part of the memory, above 0 and at most 1\n");
    std::exit(2);
  }
  if (o.sizes.empty()) o.sizes = {{512, 512}, {1920, 1080}};
  if (o.flatness.empty()) o.flatness = {0};
  return o;
}

// Commits the scene of the path, "" for the ball, on a new device with the limit.
Loaded load(const std::string &path, const Options &o, uint64_t limit)
{
  Loaded loaded;
  gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
  desc.type = o.is_cuda ? GPURT_DEVICE_CUDA : GPURT_DEVICE_CPU;
  desc.num_threads = o.threads;
  desc.memory_limit_bytes = limit;
  check(gpurt_device_create(&desc, &loaded.device), "gpurt_device_create");
  loaded.device_name = properties_of(loaded.device).name;
  loaded.name = path.empty() ? "ball" : path.substr(path.find_last_of('/') + 1);
  if (path.empty()) {
    check(gpurt_scene_create(loaded.device, &loaded.scene), "gpurt_scene_create");
    fill(loaded.scene, o.variant.alpha);
  } else {
    const std::string variant = o.variant.is_plain() ? "" : write_variant(path, o.variant);
    check(gpurt_scene_load(loaded.device, (variant.empty() ? path : variant).c_str(), &loaded.scene),
          "gpurt_scene_load");
    if (!variant.empty()) std::remove(variant.c_str());
  }
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_BVH;
  check(gpurt_scene_commit(loaded.scene, &build), "gpurt_scene_commit");
  return loaded;
}

void release(const Loaded &loaded)
{
  gpurt_scene_release(loaded.scene);
  gpurt_device_release(loaded.device);
}

}  // namespace

int main(int argc, char **argv)
{
  const Options options = parse(argc, argv);
  std::vector<std::string> scenes = options.scenes;
  if (scenes.empty()) scenes.push_back("");
  for (const std::string &path : scenes) {
    Loaded loaded = load(path, options, options.memory_limit);
    for (const Size &size : options.sizes) {
      if (options.has_schedules) {
        compare_schedules(loaded, size, options);
        continue;
      }
      for (const float flatness : options.flatness) {
        const Cost cost = run(loaded, size, flatness, options);
        if (options.memory_share == 1) continue;
        const double rest = (1 - options.memory_share) * double(cost.working_bytes);
        const Loaded tight = load(path, options, cost.peak_bytes - uint64_t(rest));
        run(tight, size, flatness, options, cost.ms);
        release(tight);
        // The next case has a peak of its own.
        release(loaded);
        loaded = load(path, options, options.memory_limit);
      }
    }
    release(loaded);
  }
}
