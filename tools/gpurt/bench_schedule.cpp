// gpurt bench schedule: every schedule of a CUDA device side by side, on queries and on renders.
#include "bench_schedule.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <nlohmann/json.hpp>

#include "gpurt_cuda.h"
#include "json.h"
#include "options.h"
#include "progress.h"
#include "ray_sets.h"

namespace cli {

namespace {

struct ScheduleOptions {
  std::string scene, accel = "kdtree", only;
  std::vector<std::string> names;  // empty: all
  uint32_t repeats = 5, samples = 16;
  uint64_t ray_budget = 0;
  RaySetOptions rays;
  DeviceOptions device;
  bool json = false;
};

struct NamedSchedule {
  std::string name;
  gpurt_schedule schedule;
  double talk = 0;  // how much faster than the first one the talk found it; 0: it does not say
};

NamedSchedule named(const char *name, gpurt_traversal traversal, gpurt_launch launch, gpurt_fetch fetch)
{
  NamedSchedule s{name, GPURT_SCHEDULE_INIT};
  s.schedule.traversal = traversal;
  s.schedule.launch = launch;
  s.schedule.fetch = fetch;
  return s;
}

// The first one is what the others are compared with.
std::vector<NamedSchedule> traversals()
{
  const auto regular = GPURT_LAUNCH_REGULAR;
  const auto persistent = GPURT_LAUNCH_PERSISTENT;
  const auto single = GPURT_FETCH_PER_THREAD;
  std::vector<NamedSchedule> all = {
      named("stack", GPURT_TRAVERSAL_STACK, regular, single),
      named("stack, persistent", GPURT_TRAVERSAL_STACK, persistent, single),
      named("leaf lists", GPURT_TRAVERSAL_LEAF_LISTS, regular, single),
      named("leaf lists, persistent", GPURT_TRAVERSAL_LEAF_LISTS, persistent, single),
      named("uber-kernel", GPURT_TRAVERSAL_UBER, regular, single),
      named("uber-kernel, persistent", GPURT_TRAVERSAL_UBER, persistent, single),
      named("packets", GPURT_TRAVERSAL_STACK, regular, GPURT_FETCH_PACKETS),
      named("packets, persistent", GPURT_TRAVERSAL_STACK, persistent, GPURT_FETCH_PACKETS)};
  all[6].talk = 1.3;
  return all;
}

std::vector<NamedSchedule> pipeline_schedules(const ScheduleOptions &o)
{
  std::vector<NamedSchedule> all = traversals();
  const auto add = [&](const char *name, auto change) {
    NamedSchedule s{name, GPURT_SCHEDULE_INIT};
    s.schedule.launch = GPURT_LAUNCH_REGULAR;
    change(s.schedule);
    all.push_back(s);
  };
  add("compaction: pyramid", [](gpurt_schedule &s) { s.compaction = GPURT_COMPACTION_PYRAMID; });
  add("compaction: naive scan", [](gpurt_schedule &s) { s.compaction = GPURT_COMPACTION_NAIVE_SCAN; });
  add("compaction: library scan", [](gpurt_schedule &s) { s.compaction = GPURT_COMPACTION_LIBRARY_SCAN; });
  add("shading: sorted", [](gpurt_schedule &s) { s.shading = GPURT_SHADING_SORTED; });
  add("generation: slots", [](gpurt_schedule &s) { s.generation = GPURT_GENERATION_SLOTS; });
  add("generation: refilled", [](gpurt_schedule &s) { s.generation = GPURT_GENERATION_REFILLED; });
  add("generation: counted", [](gpurt_schedule &s) { s.generation = GPURT_GENERATION_COUNTED; });
  add("generation: counted, budget", [&](gpurt_schedule &s) {
    s.generation = GPURT_GENERATION_COUNTED;
    s.ray_budget = o.ray_budget != 0 ? o.ray_budget : uint64_t(1) << 18;
  });
  return all;
}

// Those that were asked for, in the table's order.
std::vector<NamedSchedule> wanted(std::vector<NamedSchedule> all, const ScheduleOptions &o)
{
  if (o.names.empty()) return all;
  std::erase_if(all, [&](const NamedSchedule &s) {
    return std::find(o.names.begin(), o.names.end(), s.name) == o.names.end();
  });
  return all;
}

void check_names(const ScheduleOptions &o)
{
  const std::vector<NamedSchedule> all = pipeline_schedules(o);
  for (const std::string &name : o.names) {
    const auto is_it = [&](const NamedSchedule &s) { return s.name == name; };
    if (std::any_of(all.begin(), all.end(), is_it)) continue;
    std::string known;
    for (const NamedSchedule &s : all) known += fmt::format("{}\"{}\"", known.empty() ? "" : ", ", s.name);
    fail_usage("there is no schedule \"{}\"; there are {}", name, known);
  }
}

// What a kernel's line tells; those that ran between two listings.
std::vector<gpurt_cuda_kernel> list_kernels(gpurt_device device)
{
  uint32_t count = 0;
  check(gpurt_cuda_get_kernels(device, nullptr, 0, &count));
  std::vector<gpurt_cuda_kernel> kernels(count);
  check(gpurt_cuda_get_kernels(device, kernels.data(), count, &count));
  return kernels;
}

std::vector<gpurt_cuda_kernel> kernels_since(gpurt_device device,
                                             const std::vector<gpurt_cuda_kernel> &before)
{
  std::vector<gpurt_cuda_kernel> ran;
  const std::vector<gpurt_cuda_kernel> now = list_kernels(device);
  for (size_t i = 0; i < now.size(); ++i) {
    gpurt_cuda_kernel k = now[i];
    if (i < before.size()) k.num_launches -= before[i].num_launches;
    if (k.num_launches != 0) ran.push_back(k);
  }
  return ran;
}

Json kernel_json(const gpurt_cuda_kernel &k)
{
  return {{"name", k.name},
          {"launches", k.num_launches},
          {"block_threads", k.block_threads},
          {"registers", k.registers},
          {"local_bytes", k.local_bytes},
          {"shared_bytes", k.shared_bytes},
          {"blocks_per_multiprocessor", k.blocks_per_multiprocessor},
          {"occupancy", k.occupancy}};
}

Json counters_json(const gpurt_schedule_counters &c)
{
  Json json;
  const auto add = [&](const char *name, uint64_t value) {
    if (value != 0) json[name] = value;
  };
  add("ray_refills", c.ray_refills);
  add("list_rounds", c.list_rounds);
  add("list_overflows", c.list_overflows);
  add("mode_switches", c.mode_switches);
  add("packets", c.packets);
  add("shared_triangles", c.shared_triangles);
  add("compactions", c.compactions);
  add("sorted_hits", c.sorted_hits);
  add("counted_rays", c.counted_rays);
  add("wave_splits", c.wave_splits);
  add("path_refills", c.path_refills);
  add("warp_steps", c.warp_steps);
  add("lane_steps", c.lane_steps);
  return json.is_null() ? Json::object() : json;
}

std::string counters_text(const gpurt_schedule_counters &c)
{
  std::string text;
  const Json json = counters_json(c);
  for (const auto &[name, value] : json.items())
    text += fmt::format("{}{} {}", text.empty() ? "" : ", ", name, value.get<uint64_t>());
  return text;
}

constexpr size_t max_shown_kernels = 3;

struct Measured {
  bool exists = true;
  std::string reason;                                               // why it does not
  double seconds = 0;                                               // median
  gpurt_schedule_counters counters = GPURT_SCHEDULE_COUNTERS_INIT;  // of one run
  std::vector<gpurt_cuda_kernel> kernels;
  std::vector<unsigned char> result;
  std::vector<unsigned char> counted_result;  // of the run that counted lanes; empty: none did
  uint64_t warp_steps = 0, lane_steps = 0;

  double active_lanes() const { return double(lane_steps) / (32 * double(warp_steps)); }  // a share
};

double median(std::vector<double> values)
{
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

// Once more, by kernels that count the lanes of warps that work; they have the same hits.
void count_lanes(gpurt_scene scene, gpurt_trace_desc desc, Measured &m)
{
  gpurt_schedule_counters counters = GPURT_SCHEDULE_COUNTERS_INIT;
  m.counted_result.resize(m.result.size());
  desc.hits = m.counted_result.data();
  desc.count_lanes = 1;
  desc.out_counters = &counters;
  check(gpurt_scene_trace(scene, &desc));
  m.warp_steps = counters.warp_steps;
  m.lane_steps = counters.lane_steps;
}

// Time on the device: what the kernels take, with what the host does between them.
Measured measure_query(gpurt_device device, gpurt_scene scene, const RaySet &set,
                       const gpurt_schedule &schedule, uint32_t repeats)
{
  Measured m;
  const bool is_any = set.query == GPURT_QUERY_ANY;
  m.result.resize(set.rays.size() * (is_any ? 1 : sizeof(gpurt_hit)));
  gpurt_trace_desc desc = GPURT_TRACE_DESC_INIT;
  desc.query = set.query;
  desc.num_rays = set.rays.size();
  desc.rays = set.rays.data();
  if (is_any) desc.occluded = m.result.data();
  else desc.hits = m.result.data();
  desc.schedule = schedule;
  desc.out_counters = &m.counters;
  const std::vector<gpurt_cuda_kernel> before = list_kernels(device);
  const gpurt_result result = gpurt_scene_trace(scene, &desc);  // warms up
  if (result == GPURT_ERROR_UNSUPPORTED) {
    m.exists = false;
    m.reason = gpurt_last_error();
    return m;
  }
  check(result);
  std::vector<double> seconds;
  for (uint32_t i = 0; i < repeats; ++i) {
    check(gpurt_scene_trace(scene, &desc));
    seconds.push_back(double(m.counters.device_ns) * 1e-9);
  }
  m.seconds = median(seconds);
  m.kernels = kernels_since(device, before);
  if (!is_any) count_lanes(scene, desc, m);
  return m;
}

Measured measure_render(gpurt_device device, gpurt_scene scene, const ScheduleOptions &o,
                        const gpurt_schedule &schedule)
{
  Measured m;
  gpurt_frame_desc frame_desc = GPURT_FRAME_DESC_INIT;
  frame_desc.camera = o.rays.camera;
  frame_desc.width = o.rays.width ? o.rays.width : 1024;
  frame_desc.height = o.rays.height;
  gpurt_camera_desc camera = GPURT_CAMERA_DESC_INIT;
  check(gpurt_scene_get_camera(scene, o.rays.camera, &camera));
  if (frame_desc.height == 0) {
    frame_desc.height =
        camera.width ? std::max(1u, uint32_t(uint64_t(frame_desc.width) * camera.height / camera.width))
                     : frame_desc.width;
  }
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.samples_per_pixel = o.samples;
  desc.schedule = schedule;
  std::vector<double> seconds;
  std::vector<gpurt_cuda_kernel> before;
  for (uint32_t i = 0; i <= o.repeats; ++i) {
    Frame frame;
    check(gpurt_frame_create(scene, &frame_desc, frame.out()));
    before = list_kernels(device);
    Job job;
    const auto start = std::chrono::steady_clock::now();
    const gpurt_result result = gpurt_frame_submit(frame, &desc, nullptr, 0, job.out());
    if (result == GPURT_ERROR_UNSUPPORTED) {
      m.exists = false;
      m.reason = gpurt_last_error();
      return m;
    }
    check(result);
    check(gpurt_job_wait(job, GPURT_WAIT_FOREVER));
    const double s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    if (i != 0 || o.repeats == 0) seconds.push_back(s);  // the first one warms up
    if (i < o.repeats) continue;
    gpurt_statistics statistics = GPURT_STATISTICS_INIT;
    check(gpurt_frame_get_statistics(frame, &statistics));
    m.counters = statistics.schedule_counters;
    m.kernels = kernels_since(device, before);
    m.result.resize(size_t(frame_desc.width) * frame_desc.height * 3 * sizeof(float));
    check(gpurt_frame_read(frame, GPURT_OUTPUT_COLOR, m.result.data(), m.result.size()));
  }
  m.seconds = median(seconds);
  return m;
}

// The kernels that the first schedule has not, or of that one those with the most registers, which limit it.
std::string kernels_text(const std::vector<gpurt_cuda_kernel> &kernels,
                         const std::vector<gpurt_cuda_kernel> &known)
{
  const auto is_known = [&](const gpurt_cuda_kernel &k) {
    return std::any_of(known.begin(), known.end(),
                       [&](const gpurt_cuda_kernel &other) { return !std::strcmp(k.name, other.name); });
  };
  std::vector<gpurt_cuda_kernel> shown;
  std::copy_if(kernels.begin(), kernels.end(), std::back_inserter(shown),
               [&](const auto &k) { return !is_known(k); });
  std::stable_sort(shown.begin(), shown.end(),
                   [](const auto &a, const auto &b) { return a.registers > b.registers; });
  if (shown.size() > max_shown_kernels) shown.resize(max_shown_kernels);
  std::string text;
  for (const gpurt_cuda_kernel &k : shown) {
    text += fmt::format("{}{}: {} registers, {:.0f} % occupancy", text.empty() ? "" : "; ", k.name,
                        k.registers, 100 * double(k.occupancy));
  }
  return text;
}

class Report {
 public:
  Report(const ScheduleOptions &o, const gpurt_device_properties &properties, double build_seconds)
      : o_(o), properties_(properties), build_seconds_(build_seconds)
  {}

  void begin(const char *what, const char *unit)
  {
    has_reference_ = false;
    what_ = what;
    if (!o_.json)
      fmt::print("\n{:<28} {:>12} {:>8} {:>6} {:>6}   {}\n", what, unit, "x first", "talk", "lanes",
                 "kernels; counted");
  }

  void add(const NamedSchedule &s, const Measured &m, double work)
  {
    if (!m.exists) {
      if (o_.json) print({{"schedule", s.name}, {"unsupported", m.reason}});
      else fmt::print("{:<28} {:>12}   {}\n", s.name, "-", m.reason);
      return;
    }
    if (!has_reference_) {
      has_reference_ = true;
      reference_ = m;
      reference_name_ = s.name;
    }
    // Bits first: a fast schedule that answers otherwise is no schedule.
    const bool same =
        m.result == reference_.result && (m.counted_result.empty() || m.counted_result == m.result);
    all_same_ = all_same_ && same;
    const double rate = work / m.seconds * 1e-6, factor = reference_.seconds / m.seconds;
    if (o_.json) {
      Json kernels = Json::array();
      for (const gpurt_cuda_kernel &k : m.kernels) kernels.push_back(kernel_json(k));
      Json line = {{"schedule", s.name},   {"millions_per_second", rate},
                   {"seconds", m.seconds}, {"x_first", factor},
                   {"same_bits", same},    {"counters", counters_json(m.counters)},
                   {"kernels", kernels}};
      if (s.talk != 0) line["talk_x"] = s.talk;
      if (m.warp_steps != 0) {
        line["active_lanes"] = m.active_lanes();
        line["warp_steps"] = m.warp_steps;
        line["lane_steps"] = m.lane_steps;
      }
      print(std::move(line));
      return;
    }
    const bool is_first = reference_name_ == s.name;
    const std::string counted = counters_text(m.counters),
                      kernels = kernels_text(
                          m.kernels, is_first ? std::vector<gpurt_cuda_kernel>() : reference_.kernels);
    fmt::print("{:<28} {:>12.1f} {:>8.2f} {:>6} {:>6}   {}{}{}\n", s.name, rate, factor,
               s.talk != 0 ? fmt::format("{:.1f}", s.talk) : "",
               m.warp_steps != 0 ? fmt::format("{:.0f} %", 100 * m.active_lanes()) : "", kernels,
               counted.empty() ? "" : (kernels.empty() ? "" : "; ") + counted,
               same ? "" : "; DIFFERENT BITS");
    std::fflush(stdout);
  }

  bool all_same() const { return all_same_; }

 private:
  void print(Json line)
  {
    Json all = {{"scene", o_.scene},     {"device", properties_.name},
                {"accel", o_.accel},     {"build_seconds", build_seconds_},
                {"repeats", o_.repeats}, {"what", what_}};
    all.update(line);
    fmt::print("{}\n", all.dump());
    std::fflush(stdout);
  }

  const ScheduleOptions &o_;
  const gpurt_device_properties &properties_;
  const double build_seconds_;
  std::string what_, reference_name_;
  bool has_reference_ = false, all_same_ = true;
  Measured reference_;
};

// A scene of our own where none is given; it goes with this object.
class SceneFile {
 public:
  explicit SceneFile(ScheduleOptions &o)
  {
    if (!o.scene.empty()) return;
    path_ = std::filesystem::temp_directory_path() /
            fmt::format("gpurt_bench_{}.glb", std::chrono::steady_clock::now().time_since_epoch().count());
    write_generated_scene("glass", path_.string());
    o.scene = path_.string();
  }
  ~SceneFile()
  {
    std::error_code ignored;
    if (!path_.empty()) std::filesystem::remove(path_, ignored);
  }
  SceneFile(const SceneFile &) = delete;
  SceneFile &operator=(const SceneFile &) = delete;
  bool is_ours() const { return !path_.empty(); }

 private:
  std::filesystem::path path_;
};

void run(ScheduleOptions o)
{
  if (o.device.device == "cpu")
    fail_usage(
        "bench schedule compares schedules of CUDA devices, and the CPU device has one; use --device cuda");
  check_names(o);
  const SceneFile file(o);
  const Device device = o.device.create(GPURT_DEVICE_CUDA);
  const gpurt_device_properties properties = properties_of(device);
  const Scene scene = load_scene(device, o.scene);
  if (file.is_ours()) o.scene = "glass (gpurt scene glass)";
  BuildOptions build;
  build.accel = o.accel;
  commit(scene, build);
  add_default_camera(scene, build);
  const gpurt_scene_facts facts = facts_of(scene);
  if (!o.json)
    fmt::print("{}, {}, {} triangles, {}, built in {}\n", properties.name, o.scene, facts.num_triangles,
               o.accel, format_seconds(facts.build_seconds));

  Report report(o, properties, facts.build_seconds);
  for (const RaySet &set : o.only == "renders" ? std::vector<RaySet>() : make_ray_sets(scene, o.rays)) {
    if (set.rays.empty()) continue;
    report.begin(fmt::format("{} rays", set.name).c_str(), "Mrays/s");
    for (const NamedSchedule &s : wanted(traversals(), o))
      report.add(s, measure_query(device, scene, set, s.schedule, o.repeats), double(set.rays.size()));
  }
  if (o.only != "queries") report.begin("renders", "Msamples/s");
  const std::vector<NamedSchedule> none;
  for (const NamedSchedule &s : o.only != "queries" ? wanted(pipeline_schedules(o), o) : none) {
    const Measured m = measure_render(device, scene, o, s.schedule);
    report.add(s, m, double(m.result.size() / (3 * sizeof(float))) * o.samples);
  }
  if (!report.all_same()) fail("schedules gave different bits; this is a defect of gpurt");
}

}  // namespace

void add_bench_schedule_command(CLI::App &bench)
{
  auto o = std::make_shared<ScheduleOptions>();
  CLI::App *command = bench.add_subcommand("schedule", "Every schedule of a CUDA device side by side");
  command->footer(R"(
Times queries (on the device, without copies) and renders (as a whole) under every schedule, with the registers and the
occupancy of the kernels that ran and what was counted. "x first" compares with the first line; "talk" is the figure of
the 2009 talk that these schedules come from; "lanes" is the share of a warp's lanes that work at a step of traversal, which
closest hits count in a run of its own. All results must have the same bits. docs/schedules.md explains them.

Examples:
  gpurt bench schedule
  gpurt bench schedule city.glb --json > city.jsonl
)");
  command->add_option("scene", o->scene, "glTF 2.0 file; by default a generated scene")->type_name("SCENE");
  command->add_option("--accel", o->accel, "kdtree or bvh")
      ->check(CLI::IsMember({"kdtree", "bvh"}))
      ->capture_default_str();
  command->add_option("--repeats", o->repeats, "runs of each case")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command->add_option("--spp", o->samples, "samples per pixel of renders")
      ->check(CLI::Range(1, 65536))
      ->capture_default_str();
  command->add_option("--only", o->only, "queries or renders; by default both")
      ->check(CLI::IsMember({"queries", "renders"}))
      ->type_name("WHAT");
  command
      ->add_option("--schedule", o->names,
                   "a schedule by its name in the table; may be given several times; by default all")
      ->type_name("NAME")
      ->allow_extra_args(false);
  command->add_option("--ray-budget", o->ray_budget, "of counted generation; default 262144")
      ->check(CLI::Range(uint64_t(2), uint64_t(1) << 40));
  command->add_option("--width", o->rays.width, "of the camera's image; default 1024")
      ->check(CLI::Range(1, 16384));
  command->add_option("--height", o->rays.height)->check(CLI::Range(1, 16384));
  command->add_option("--camera", o->rays.camera, "which camera of the scene, counted from 0")
      ->capture_default_str();
  command->add_flag("--json", o->json, "one JSON line a case");
  o->device.add_to(*command);
  command->callback([o] { run(*o); });
}

}  // namespace cli
