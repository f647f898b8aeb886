// REYES on the CPU: micropolygons a second and core, one thread against several, and REYES against rays through the
// tessellated mesh. One JSON line a case.
//
//   bench_reyes_cpu [--scene FILE]... [--size WxH]... [--spp N] [--rate AREA] [--repeats N] [--threads N]
//                   [--tolerance METRES] [--flatness PIXELS]...
//
// Without a scene: a bent sheet of 1,600 patches, made here. All ways take turns, round by round; ratios are medians of the
// rounds' own, so that what else the machine does falls on all alike. Rays see what samples see: path tracing of max_depth 1
// with as many samples, on one thread, on Embree and on the kd-tree. "visibility": REYES of max_depth 1, which does as much;
// "samples" and "micropolygons": with direct light without shadows, at samples and once for each micropolygon.
// Of several values of flatness, all in the same rounds, "times_first_flatness" is how much longer finding takes than with the first.
// "finding" is the part of it that finds what samples see: places, bound, split, dice and sample, or rays and their hits.
// Times of one thread are processor time; "speedup" is of wall time, of the medians and of the shortest times.
#include <time.h>

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

namespace {

struct Size {
  uint32_t width, height;
};

struct Options {
  std::vector<std::string> scenes;
  std::vector<Size> sizes;
  uint32_t spp = 9, repeats = 5, threads = 2;
  float rate = 0.25f, tolerance = 0.0f;
  std::vector<float> flatness;
};

double cpu_seconds()
{
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

void fill(gpurt_scene scene)
{
  constexpr int n = 40;
  std::vector<std::array<float, 3>> points;
  for (int patch = 0; patch < n * n; ++patch) {
    for (int k = 0; k < 16; ++k) {
      const float x = 2.4f * (float(3 * (patch % n) + k % 4) / (3 * n)) - 1.2f,
                  z = 2.4f * (float(3 * (patch / n) + k / 4) / (3 * n)) - 1.2f;
      points.push_back({x, 0.12f * std::sin(9 * x) * std::cos(8 * z), -z});
    }
  }
  uint32_t id = 0;
  gpurt_patches_desc patches = GPURT_PATCHES_DESC_INIT;
  patches.control_points.data = points.data();
  patches.control_points.count = points.size();
  gpurt_instance_desc instance = GPURT_INSTANCE_DESC_INIT;
  check(gpurt_scene_add_patches(scene, &patches, &instance.geometry), "gpurt_scene_add_patches");
  check(gpurt_scene_add_instance(scene, &instance, &id), "gpurt_scene_add_instance");
  gpurt_light_desc light = GPURT_LIGHT_DESC_INIT;
  for (float &c : light.intensity) c = 20;
  light.position[1] = light.position[2] = 3;
  check(gpurt_scene_add_light(scene, &light, &id), "gpurt_scene_add_light");
  // From above at an angle: the sheet fills most of the picture.
  gpurt_camera_desc camera = GPURT_CAMERA_DESC_INIT;
  const float c = std::cos(1.0f), s = std::sin(1.0f);
  const float transform[12] = {1, 0, 0, 0, 0, c, s, 2.6f * s, 0, -s, c, 2.6f * c};
  std::copy(transform, transform + 12, camera.transform);
  camera.yfov_rad = 0.7f;
  check(gpurt_scene_add_camera(scene, &camera, &id), "gpurt_scene_add_camera");
}

// A device of its own with the scene.
class Committed {
 public:
  Committed(const std::string &path, uint32_t num_threads, gpurt_accel accel, float tolerance)
  {
    gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
    desc.type = GPURT_DEVICE_CPU;
    desc.num_threads = num_threads;
    check(gpurt_device_create(&desc, &device_), "gpurt_device_create");
    if (path.empty()) {
      check(gpurt_scene_create(device_, &scene_), "gpurt_scene_create");
      fill(scene_);
    } else {
      check(gpurt_scene_load(device_, path.c_str(), &scene_), "gpurt_scene_load");
    }
    gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
    build.accel = accel;
    build.patch_tolerance = tolerance;
    check(gpurt_scene_commit(scene_, &build), "gpurt_scene_commit");
  }
  Committed(const Committed &) = delete;
  Committed &operator=(const Committed &) = delete;
  ~Committed()
  {
    gpurt_scene_release(scene_);
    gpurt_device_release(device_);
  }
  gpurt_scene scene() const { return scene_; }
  gpurt_device device() const { return device_; }

 private:
  gpurt_device device_ = nullptr;
  gpurt_scene scene_ = nullptr;
};

// A way to render, and what each round took.
struct Way {
  const char *name;
  const Committed *committed;
  gpurt_render_desc desc;
  std::vector<double> wall, cpu, finding;
  gpurt_statistics statistics;
};

// From patches to what samples see of them.
double cut_to_sampled_seconds(const gpurt_reyes_counters &c)
{
  return c.bound_seconds + c.split_seconds + c.dice_seconds + c.sample_seconds;
}

// What a way's last round took to find what samples see. Stages are timed by the wall: their shares are applied to the
// processor's time.
double finding_seconds(const Way &way)
{
  const gpurt_statistics &s = way.statistics;
  const double found =
      way.desc.pipeline == GPURT_PIPELINE_PATH ? s.trace_seconds : cut_to_sampled_seconds(s.reyes_counters);
  const double wall = s.generate_seconds + found;
  return wall * way.cpu.back() / s.render_seconds;
}

void render(Way &way, const Size &size)
{
  gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
  frame_desc.width = size.width;
  frame_desc.height = size.height;
  frame_desc.outputs = 1u << GPURT_OUTPUT_COLOR;
  gpurt_frame frame = nullptr;
  check(gpurt_frame_create(way.committed->scene(), &frame_desc, &frame), "gpurt_frame_create");
  const double wall = now(), cpu = cpu_seconds();
  gpurt_job job = nullptr;
  check(gpurt_frame_submit(frame, &way.desc, nullptr, 0, &job), "gpurt_frame_submit");
  check(gpurt_job_wait(job, GPURT_WAIT_FOREVER), "gpurt_job_wait");
  gpurt_job_release(job);
  way.wall.push_back(now() - wall);
  way.cpu.push_back(cpu_seconds() - cpu);
  way.statistics = GPURT_STATISTICS_INIT;
  check(gpurt_frame_get_statistics(frame, &way.statistics), "gpurt_frame_get_statistics");
  way.finding.push_back(finding_seconds(way));
  gpurt_frame_release(frame);
}

double median_ratio(const std::vector<double> &above, const std::vector<double> &below)
{
  std::vector<double> ratios;
  for (size_t i = 0; i < above.size(); ++i) ratios.push_back(above[i] / below[i]);
  return median(ratios);
}

void run(const std::string &path, const Size &size, const Options &o, const Committed &embree,
         const Committed &kdtree, const Committed &parallel)
{
  gpurt_render_desc rays = GPURT_RENDER_DESC_INIT;
  rays.pipeline = GPURT_PIPELINE_PATH;
  rays.samples_per_pixel = o.spp;
  rays.max_depth = 1;
  std::vector<Way> ways = {{"rays, Embree", &embree, rays, {}, {}, {}, {}},
                           {"rays, kd-tree", &kdtree, rays, {}, {}, {}, {}}};
  for (const float flatness : o.flatness) {
    gpurt_render_desc reyes = GPURT_RENDER_DESC_INIT;
    reyes.pipeline = GPURT_PIPELINE_REYES;
    reyes.samples_per_pixel = o.spp;
    reyes.reyes.shading_rate = o.rate;
    reyes.reyes.flatness = flatness;
    reyes.reyes.no_shadows = 1;
    gpurt_render_desc visibility = reyes, micropolygons = reyes;
    visibility.max_depth = 1;
    micropolygons.reyes.shading = GPURT_REYES_SHADING_MICROPOLYGONS;
    for (const Committed *committed : {&embree, &parallel}) {
      ways.push_back({"visibility", committed, visibility, {}, {}, {}, {}});
      ways.push_back({"samples", committed, reyes, {}, {}, {}, {}});
      ways.push_back({"micropolygons", committed, micropolygons, {}, {}, {}, {}});
    }
  }
  for (uint32_t i = 0; i <= o.repeats; ++i) {
    for (Way &way : ways) {
      render(way, size);
      // The first round is not counted.
      if (i == 0) {
        way.wall.clear();
        way.cpu.clear();
        way.finding.clear();
      }
    }
  }
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  check(gpurt_device_get_properties(parallel.device(), &properties), "gpurt_device_get_properties");
  const std::string name = path.empty() ? "sheet" : path.substr(path.find_last_of('/') + 1);
  for (size_t k = 2; k < ways.size(); ++k) {
    if (ways[k].committed != &embree) continue;
    const Way &one = ways[k], &several = ways[k + 3], &first = ways[2 + (k - 2) % 6];
    const gpurt_statistics &s = one.statistics;
    const gpurt_reyes_counters &c = s.reyes_counters;
    const double cpu = median(one.cpu);
    const double visible = cut_to_sampled_seconds(c) * cpu / s.render_seconds;
    const double num = double(c.num_micropolygons);
    std::printf(
        "{\"bench\":\"reyes_cpu\",\"device\":\"%s\",\"scene\":\"%s\",\"width\":%u,\"height\":%u,\"spp\":%u,"
        "\"shading_rate\":%g,\"flatness\":%g,\"light\":\"%s\",\"micropolygons\":%.0f,\"cpu_ms\":%.2f,"
        "\"visible_mmp_per_s_core\":%.2f,\"frame_mmp_per_s_core\":%.2f,"
        "\"bound_ms\":%.2f,\"split_ms\":%.2f,\"dice_ms\":%.2f,\"sample_ms\":%.2f,\"places_ms\":%.2f,"
        "\"shade_ms\":%.2f,\"film_ms\":%.2f,\"threads\":%u,\"wall_ms\":%.2f,\"wall_ms_threads\":%.2f,\"cpu_"
        "ms_threads\":%.2f,"
        "\"speedup\":%.3f,\"speedup_of_shortest\":%.3f,\"finding_cpu_ms\":%.2f,\"rays_embree_finding_cpu_"
        "ms\":%.2f,\"finding_times_faster_than_embree\":%.2f,"
        "\"finding_times_faster_than_kdtree\":%.2f,\"rays_embree_cpu_ms\":%.2f,\"rays_kdtree_cpu_ms\":%."
        "2f,"
        "\"times_faster_than_embree\":%.2f,\"times_faster_than_kdtree\":%.2f,\"times_first_flatness\":%.3f}"
        "\n",
        properties.name, name.c_str(), size.width, size.height, o.spp, double(o.rate),
        double(one.desc.reyes.flatness), one.name, num, 1e3 * cpu, 1e-6 * num / visible, 1e-6 * num / cpu,
        1e3 * c.bound_seconds, 1e3 * c.split_seconds, 1e3 * c.dice_seconds, 1e3 * c.sample_seconds,
        1e3 * s.generate_seconds, 1e3 * s.shade_seconds, 1e3 * s.film_seconds, o.threads,
        1e3 * median(one.wall), 1e3 * median(several.wall), 1e3 * median(several.cpu),
        median_ratio(one.wall, several.wall),
        *std::min_element(one.wall.begin(), one.wall.end()) /
            *std::min_element(several.wall.begin(), several.wall.end()),
        1e3 * median(one.finding), 1e3 * median(ways[0].finding), median_ratio(ways[0].finding, one.finding),
        median_ratio(ways[1].finding, one.finding), 1e3 * median(ways[0].cpu), 1e3 * median(ways[1].cpu),
        median_ratio(ways[0].cpu, one.cpu), median_ratio(ways[1].cpu, one.cpu),
        median_ratio(one.finding, first.finding));
  }
  std::fflush(stdout);
}

Options parse(int argc, char **argv)
{
  Options o;
  for (int i = 1; i < argc; i += 2) {
    const std::string name = argv[i], value = i + 1 < argc ? argv[i + 1] : "";
    Size size{};
    if (name == "--scene") o.scenes.push_back(value);
    else if (name == "--size" && std::sscanf(value.c_str(), "%ux%u", &size.width, &size.height) == 2)
      o.sizes.push_back(size);
    else if (name == "--spp") o.spp = uint32_t(std::max(1, std::atoi(value.c_str())));
    else if (name == "--rate") o.rate = float(std::atof(value.c_str()));
    else if (name == "--repeats") o.repeats = uint32_t(std::max(1, std::atoi(value.c_str())));
    else if (name == "--threads") o.threads = uint32_t(std::max(1, std::atoi(value.c_str())));
    else if (name == "--tolerance") o.tolerance = float(std::atof(value.c_str()));
    else if (name == "--flatness") o.flatness.push_back(float(std::atof(value.c_str())));
    else {
      std::fprintf(stderr, "error: unknown option %s %s\n", name.c_str(), value.c_str());
      std::exit(2);
    }
  }
  if (o.sizes.empty()) o.sizes = {{512, 512}, {1920, 1080}};
  if (o.scenes.empty()) o.scenes.push_back("");
  if (o.flatness.empty()) o.flatness = {0};
  return o;
}

}  // namespace

int main(int argc, char **argv)
{
  const Options o = parse(argc, argv);
  for (const std::string &path : o.scenes) {
    const Committed embree(path, 1, GPURT_ACCEL_EMBREE, o.tolerance),
        kdtree(path, 1, GPURT_ACCEL_KDTREE, o.tolerance),
        parallel(path, o.threads, GPURT_ACCEL_EMBREE, o.tolerance);
    for (const Size &size : o.sizes) run(path, size, o, embree, kdtree, parallel);
  }
}
