// Photon mapping of whole frames on a CUDA device: photons stored a second, and what every stage takes. One JSON line a scene.
//
//   bench_photon_passes --scene FILE... [--size WxH] [--photons N] [--passes N] [--repeats N]
//
// By default 1024 x 1024 pixels and passes of 10 million photons, as many as 64. Each frame is a new one; the first of a scene
// is not counted. Rates are those of whole frames, from submission to the last pixel on the host: photons from the lights to
// where they end, sorted into a grid, paths from the eye, gathers. The pilot that finds the radius is left out: the first frame
// tells the others. Two passes run side by side there, and stages wait for each other's kernels: "ms" of stages are of another
// frame, whose jobs have one pass each, for a pass.
//
// "bytes" is what a stage moves to or from the arrays of rays and photons, at least: what it reads of the scene, and of the grid
// where it gathers, comes from caches or not. "share_of_copy" is that over "ms", of the rate at which the device copies memory:
//   emit     a photon, its ray and what it leaves out are written
//   rays     a ray is read, a hit written
//   scatter  hit, photon and ray are read; the photon that stays is written, and the one that goes on as in emit
//   build    keys are made of the records, sorted by 8 bits at a time, and records moved to their places
//   gather   a probe and a rest for each photon that counts
//   eye      a ray is read and a hit written, a path's state read and written; shadow rays alike without a state
// The film is left out: threads of the host add it, once for many passes.
#include <cuda_runtime_api.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "cuda_check.h"
#include "gpurt.h"

namespace {

struct Options {
  std::vector<std::string> scenes;
  uint32_t width = 1024, height = 1024, photons = 10000000, passes = 64, repeats = 3;
};

// Bytes read and written a second by copies within the device.
double copy_rate()
{
  constexpr uint64_t bytes = uint64_t(1) << 30;
  constexpr int copies = 20;
  void *from, *to;
  check(cudaMalloc(&from, bytes), "cudaMalloc");
  check(cudaMalloc(&to, bytes), "cudaMalloc");
  double seconds = 0;
  for (int turn = 0; turn < 2; ++turn) {
    check(cudaDeviceSynchronize(), "cudaDeviceSynchronize");
    const double start = now();
    for (int i = 0; i < copies; ++i)
      check(cudaMemcpyAsync(to, from, bytes, cudaMemcpyDeviceToDevice, nullptr), "cudaMemcpyAsync");
    check(cudaDeviceSynchronize(), "cudaDeviceSynchronize");
    seconds = now() - start;
  }
  check(cudaFree(from), "cudaFree");
  check(cudaFree(to), "cudaFree");
  return 2.0 * double(bytes) * copies / seconds;
}

struct Timed {
  double seconds;
  gpurt_statistics statistics;
};

// With a job for all passes, or one for each.
Timed render(gpurt_scene scene, const Options &options, float radius, bool one_by_one = false)
{
  gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
  frame_desc.width = options.width;
  frame_desc.height = options.height;
  gpurt_frame frame;
  check(gpurt_frame_create(scene, &frame_desc, &frame), "gpurt_frame_create");
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.pipeline = GPURT_PIPELINE_PHOTON;
  desc.photon.photons_per_pass = options.photons;
  desc.photon.initial_radius = radius;
  const double start = now();
  for (uint32_t pass = one_by_one ? 1 : options.passes; pass <= options.passes; ++pass) {
    desc.samples_per_pixel = pass;
    gpurt_job job;
    check(gpurt_frame_submit(frame, &desc, nullptr, 0, &job), "gpurt_frame_submit");
    check(gpurt_job_wait(job, GPURT_WAIT_FOREVER), "gpurt_job_wait");
    check(gpurt_job_release(job), "gpurt_job_release");
  }
  Timed timed{now() - start, GPURT_STATISTICS_INIT};
  check(gpurt_frame_get_statistics(frame, &timed.statistics), "gpurt_frame_get_statistics");
  check(gpurt_frame_release(frame), "gpurt_frame_release");
  return timed;
}

struct Stage {
  const char *name;
  double seconds, bytes;
};

constexpr double photon_bytes = 32, ray_bytes = 32, word_bytes = 4, hit_bytes = 20, path_bytes = 80,
                 probe_bytes = 16, rest_bytes = 8, sort_passes = 3;

std::vector<Stage> stages_of(const gpurt_statistics &s)
{
  const gpurt_photon_counters &p = s.photon_counters;
  const double emitted = double(p.num_emitted), rays = double(p.num_rays), stored = double(p.num_stored);
  const double eye_rays = double(s.num_camera_rays + s.num_bounce_rays), shadows = double(s.num_shadow_rays);
  const double flying = photon_bytes + ray_bytes + word_bytes;
  // Keys and indices are written and, like a histogram of the keys, read; each pass of the sort reads and writes both.
  const double sorting = 2 * word_bytes + word_bytes + sort_passes * 4 * word_bytes;
  return {
      {"emit", p.emit_seconds, emitted * flying},
      {"rays", p.trace_seconds - p.emit_seconds - p.scatter_seconds, rays * (ray_bytes + hit_bytes)},
      {"scatter", p.scatter_seconds,
       rays * (hit_bytes + photon_bytes + ray_bytes) + stored * photon_bytes + (rays - emitted) * flying},
      {"build", p.build_seconds,
       stored * (photon_bytes + sorting + 2 * word_bytes + photon_bytes + probe_bytes + rest_bytes)},
      {"gather", p.gather_seconds, double(p.num_gathered) * (probe_bytes + rest_bytes)},
      {"eye rays", s.trace_seconds, eye_rays * (ray_bytes + hit_bytes)},
      {"eye shade", s.shade_seconds,
       eye_rays * (ray_bytes + hit_bytes + 2 * path_bytes) + shadows * (ray_bytes + 4 * word_bytes)},
      {"eye shadows", s.shadow_seconds, shadows * (ray_bytes + 1)},
      {"eye generate", s.generate_seconds, double(s.num_camera_rays) * (ray_bytes + path_bytes)},
  };
}

void bench(gpurt_device device, const char *device_name, const std::string &path, const Options &options,
           double copies)
{
  gpurt_scene scene;
  check(gpurt_scene_load(device, path.c_str(), &scene), "gpurt_scene_load");
  gpurt_build_desc build = GPURT_BUILD_DESC_INIT;
  build.accel = GPURT_ACCEL_BVH;
  check(gpurt_scene_commit(scene, &build), "gpurt_scene_commit");
  const float radius = render(scene, options, 0).statistics.photon.initial_radius;
  std::vector<Timed> turns;
  for (uint32_t i = 0; i < options.repeats; ++i) turns.push_back(render(scene, options, radius));
  std::sort(turns.begin(), turns.end(), [](auto &a, auto &b) { return a.seconds < b.seconds; });
  const Timed &m = turns[turns.size() / 2];
  const gpurt_statistics &s = m.statistics;
  const gpurt_photon_counters &p = s.photon_counters;
  const std::string file = path.substr(path.find_last_of('/') + 1);
  std::printf(
      "{\"bench\":\"photon_passes\",\"device\":\"%s\",\"scene\":\"%s\",\"width\":%u,\"height\":%u,"
      "\"photons\":%u,"
      "\"passes\":%u,\"radius\":%g,\"seconds\":%.4f,\"least_s\":%.4f,\"most_s\":%.4f,\"ms_per_pass\":%.3f,"
      "\"stored_per_pass\":%.0f,\"million_stored_per_s\":%.1f,\"million_emitted_per_s\":%.1f,"
      "\"million_photon_rays_per_s\":%.1f,\"memory_peak_bytes\":%llu,\"copy_gb_per_s\":%.0f,\"stages\":[",
      device_name, file.c_str(), options.width, options.height, options.photons, options.passes, radius,
      m.seconds, turns.front().seconds, turns.back().seconds, m.seconds / options.passes * 1e3,
      double(p.num_stored) / options.passes, double(p.num_stored) / m.seconds * 1e-6,
      double(p.num_emitted) / m.seconds * 1e-6, double(p.num_rays) / m.seconds * 1e-6,
      (unsigned long long)s.memory_peak_bytes, copies * 1e-9);
  const char *separator = "";
  for (const Stage &stage : stages_of(render(scene, options, radius, true).statistics)) {
    std::printf("%s{\"stage\":\"%s\",\"ms\":%.3f,\"megabytes\":%.1f,\"share_of_copy\":%.3f}", separator,
                stage.name, stage.seconds / options.passes * 1e3, stage.bytes / options.passes * 1e-6,
                stage.seconds > 0 ? stage.bytes / stage.seconds / copies : 0.0);
    separator = ",";
  }
  std::printf("]}\n");
  std::fflush(stdout);
  check(gpurt_scene_release(scene), "gpurt_scene_release");
}

Options parse(int argc, char **argv)
{
  Options options;
  for (int i = 1; i < argc; i += 2) {
    const std::string name = argv[i], value = i + 1 < argc ? argv[i + 1] : "";
    const auto number = [&] { return uint32_t(std::max(1, std::atoi(value.c_str()))); };
    if (name == "--scene" && !value.empty()) options.scenes.push_back(value);
    else if (name == "--size" && std::sscanf(value.c_str(), "%ux%u", &options.width, &options.height) == 2) {
    } else if (name == "--photons") options.photons = number();
    else if (name == "--passes") options.passes = number();
    else if (name == "--repeats") options.repeats = number();
    else {
      std::fprintf(stderr, "error: unknown option %s %s\n", name.c_str(), value.c_str());
      std::exit(2);
    }
  }
  return options;
}

}  // namespace

int main(int argc, char **argv)
{
  const Options options = parse(argc, argv);
  if (options.scenes.empty()) {
    std::fprintf(stderr, "no --scene: nothing to measure\n");
    return 0;
  }
  if (!is_cuda_there()) return 0;
  const gpurt_device device = create_cuda_device();
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  check(gpurt_device_get_properties(device, &properties), "gpurt_device_get_properties");
  const double copies = copy_rate();
  for (const std::string &scene : options.scenes) bench(device, properties.name, scene, options, copies);
  check(gpurt_device_release(device), "gpurt_device_release");
}
