// gpurt bench: rays per second of a scene, one JSON line a case.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>

#include "bench_schedule.h"
#include "json.h"
#include "options.h"
#include "ray_sets.h"

namespace cli {

namespace {

struct BenchOptions {
  std::string scene;
  std::vector<std::string> accels;
  uint32_t repeats = 5;
  RaySetOptions rays;
  DeviceOptions device;
  BuildOptions build;
};

struct Timing {
  double median, fastest, slowest;  // seconds
  uint64_t num_hits;
};

Timing time_set(gpurt_scene scene, const RaySet &set, uint32_t repeats)
{
  std::vector<gpurt_hit> hits(set.query == GPURT_QUERY_ANY ? 0 : set.rays.size());
  std::vector<uint8_t> occluded(set.query == GPURT_QUERY_ANY ? set.rays.size() : 0);
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = set.query;
  desc.num_rays = set.rays.size();
  desc.rays = set.rays.data();
  desc.hits = hits.empty() ? nullptr : hits.data();
  desc.occluded = occluded.empty() ? nullptr : occluded.data();
  check(gpurt_scene_trace(scene, &desc));  // warms up
  std::vector<double> seconds;
  for (uint32_t i = 0; i < repeats; ++i) {
    const auto start = std::chrono::steady_clock::now();
    check(gpurt_scene_trace(scene, &desc));
    seconds.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  std::sort(seconds.begin(), seconds.end());
  uint64_t num_hits = 0;
  for (const gpurt_hit &hit : hits) num_hits += hit.primitive != GPURT_INVALID_ID;
  for (uint8_t hit : occluded) num_hits += hit;
  return {seconds[seconds.size() / 2], seconds.front(), seconds.back(), num_hits};
}

void run(const BenchOptions &o)
{
  const Device device = o.device.create();
  const gpurt_device_properties properties = properties_of(device);
  std::vector<std::string> accels = o.accels;
  if (accels.empty())
    accels = properties.type == GPURT_DEVICE_CPU ? std::vector<std::string>{"kdtree", "bvh", "embree"}
                                                 : std::vector<std::string>{"kdtree", "bvh"};

  std::vector<RaySet> sets;  // of the first accelerator: all trace the same rays
  for (const std::string &accel : accels) {
    BuildOptions build = o.build;
    build.accel = accel;
    const Scene scene = load_scene(device, o.scene);
    commit(scene, build);
    add_default_camera(scene, build);
    const gpurt_scene_facts facts = facts_of(scene);
    if (sets.empty()) sets = make_ray_sets(scene, o.rays);
    for (const RaySet &set : sets) {
      if (set.rays.empty()) continue;
      const Timing timing = time_set(scene, set, o.repeats);
      const double n = double(set.rays.size()) * 1e-6;
      const Json line = {{"scene", o.scene},
                         {"device", properties.name},
                         {"instruction_set", properties.instruction_set},
                         {"threads", properties.num_threads},
                         {"accel", name_of(facts.accel)},
                         {"triangle_test", name_of(facts.triangle_test)},
                         {"triangles", facts.num_triangles},
                         {"world_triangles", facts.num_world_triangles},
                         {"build_seconds", facts.build_seconds},
                         {"accel_bytes", facts.accel_bytes},
                         {"memory_peak_bytes", properties_of(device).memory_peak_bytes},
                         {"rays", set.name},
                         {"num_rays", set.rays.size()},
                         {"num_hits", timing.num_hits},
                         {"repeats", o.repeats},
                         {"mrays_per_second", n / timing.median},
                         {"mrays_per_second_min", n / timing.slowest},
                         {"mrays_per_second_max", n / timing.fastest}};
      fmt::print("{}\n", line.dump());
      std::fflush(stdout);
    }
  }
}

}  // namespace

void add_bench_command(CLI::App &program)
{
  auto o = std::make_shared<BenchOptions>();
  CLI::App *command = program.add_subcommand("bench", "Measure rays per second on a scene");
  command->footer(R"(
Prints one JSON line for each accelerator and kind of rays: primary (camera), diffuse (cosine-distributed from what the
camera sees), ao (any hit within a tenth of the scene) and random. Every accelerator traces the same rays; the figures
are the median, the slowest and the fastest of --repeats runs, transfers included.

Examples:
  gpurt bench city.glb
  gpurt bench city.glb --accel kdtree --device cuda:0 --repeats 9 > city.jsonl
  gpurt bench schedule city.glb         every schedule of a CUDA device, side by side
)");
  command->add_option("scene", o->scene, "glTF 2.0 file (required)")->type_name("SCENE");
  command->add_option("--accel", o->accels, "kdtree, embree or bvh; by default those that the device has")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::IsMember({"kdtree", "embree", "bvh"}))
      ->type_name("A,B,...");
  command->add_option("--repeats", o->repeats, "runs of each case")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command->add_option("--width", o->rays.width, "of the camera's image; default 1024")
      ->check(CLI::Range(1, 16384));
  command->add_option("--height", o->rays.height)->check(CLI::Range(1, 16384));
  command->add_option("--camera", o->rays.camera, "which camera of the scene, counted from 0")
      ->capture_default_str();
  o->device.add_to(*command);
  add_bench_schedule_command(*command);
  command->require_subcommand(0, 1);
  command->callback([o, command] {
    if (!command->get_subcommands().empty()) return;  // which does its work itself
    if (o->scene.empty()) fail_usage("bench: SCENE is required; see gpurt bench --help");
    run(*o);
  });
}

}  // namespace cli
