// gpurt devices and gpurt info: what there is to render on, and to render.
#include <nlohmann/json.hpp>

#include "json.h"
#include "options.h"
#include "progress.h"

namespace cli {

namespace {

std::vector<gpurt_device_properties> all_devices()
{
  uint32_t count = 0;
  check(gpurt_device_enumerate(nullptr, 0, &count));
  std::vector<gpurt_device_properties> devices(count);
  for (gpurt_device_properties &d : devices) d = GPURT_DEVICE_PROPERTIES_INIT;
  check(gpurt_device_enumerate(devices.data(), count, &count));
  return devices;
}

void print_devices(bool as_json)
{
  const std::vector<gpurt_device_properties> devices = all_devices();
  if (as_json) {
    Json json = Json::array();
    for (const gpurt_device_properties &d : devices) json.push_back(to_json(d));
    fmt::print("{}\n", json.dump(2));
    return;
  }
  for (const gpurt_device_properties &d : devices) {
    const std::string name = d.type == GPURT_DEVICE_CPU ? "cpu" : fmt::format("cuda:{}", d.ordinal);
    fmt::print("{:8} {}, {} {}, {}, {}\n", name, d.name, d.num_threads,
               d.type == GPURT_DEVICE_CPU ? "threads" : "multiprocessors", format_bytes(d.memory_bytes),
               d.instruction_set);
  }
}

struct InfoOptions {
  std::string path;
  bool build = false, json = false;
  DeviceOptions device;
  BuildOptions build_options;
};

void print_facts(const std::string &path, const gpurt_scene_facts &f, bool with_build)
{
  const auto line = [](const char *what, const std::string &value) { fmt::print("{:<14}{}\n", what, value); };
  const auto yes = [](uint32_t flag) { return std::string(flag ? "yes" : "no"); };
  fmt::print("{}\n", path);
  line("geometry", fmt::format("{} geometries, {} instances", f.num_geometries, f.num_instances));
  line("triangles",
       fmt::format("{} stored, {} seen through all instances", f.num_triangles, f.num_world_triangles));
  if (f.num_patches) line("patches", fmt::format("{}", f.num_patches));
  line("materials", fmt::format("{}, {} textures", f.num_materials, f.num_textures));
  line("lights", fmt::format("{} emissive triangles, {} point and spot, {} distant, environment: {}",
                             f.num_emissive_triangles, f.num_point_lights, f.num_distant_lights,
                             yes(f.has_environment)));
  line("glass", yes(f.has_glass));
  line("alpha masks", yes(f.has_alpha_masks));
  line("blending", yes(f.has_blending));
  line("cameras", fmt::format("{}", f.num_cameras));
  if (f.bounds_min[0] <= f.bounds_max[0]) {
    line("bounds",
         fmt::format("({:.6g}, {:.6g}, {:.6g}) to ({:.6g}, {:.6g}, {:.6g})", f.bounds_min[0], f.bounds_min[1],
                     f.bounds_min[2], f.bounds_max[0], f.bounds_max[1], f.bounds_max[2]));
  }
  if (!with_build) return;
  line("accelerator",
       fmt::format("{}, {} in {}{}", name_of(f.accel), format_bytes(f.accel_bytes),
                   format_seconds(f.build_seconds), f.tree_from_cache ? " (tree from the cache)" : ""));
  line("scene memory", format_bytes(f.scene_bytes));
  if (f.num_nodes) {
    line("tree", fmt::format("{} nodes, {} references, depth {}, SAH cost {:.4g}", f.num_nodes,
                             f.num_references, f.tree_depth, f.sah_cost));
  }
}

Json state_json(const gpurt_state_info &i)
{
  return {{"width", i.width},
          {"height", i.height},
          {"camera", i.camera},
          {"outputs", i.outputs},
          {"frame_index", i.frame_index},
          {"seed", i.seed},
          {"first_sample", i.first_sample},
          {"num_samples", i.num_samples},
          {"pipeline", name_of(i.pipeline)},
          {"accel", name_of(i.accel)},
          {"triangle_test", name_of(i.triangle_test)},
          {"max_depth", i.max_depth},
          {"scene_hash", fmt::format("{:016x}", i.scene_hash)}};
}

void print_state(const InfoOptions &o)
{
  gpurt_state_info info = GPURT_STATE_INFO_INIT;
  check(gpurt_state_read_info(o.path.c_str(), &info));
  const Json json = state_json(info);
  if (o.json) {
    fmt::print("{}\n", json.dump(2));
    return;
  }
  fmt::print("{}\n", o.path);
  for (const auto &[name, value] : json.items())
    fmt::print("{:<14}{}\n", name, value.is_string() ? value.get<std::string>() : value.dump());
}

void print_info(const InfoOptions &o)
{
  if (extension_of(o.path) == ".gpurt") return print_state(o);
  // A commit counts triangles, those of patches too. Counting needs no GPU; a build is shown as the device makes it.
  const Device device = o.device.create(o.build ? GPURT_DEVICE_AUTO : GPURT_DEVICE_CPU);
  const Scene scene = load_scene(device, o.path);
  commit(scene, o.build_options);
  gpurt_scene_facts facts = facts_of(scene);
  if (!o.json) return print_facts(o.path, facts, o.build);
  if (!o.build) facts.is_committed = 0;  // leaves out what was built
  fmt::print("{}\n", to_json(facts).dump(2));
}

}  // namespace

void add_devices_command(CLI::App &program)
{
  auto as_json = std::make_shared<bool>(false);
  CLI::App *command = program.add_subcommand("devices", "List the devices of this machine");
  command->footer("\nThe name in the first column is what --device takes.\n");
  command->add_flag("--json", *as_json, "print JSON");
  command->callback([as_json] { print_devices(*as_json); });
}

void add_info_command(CLI::App &program)
{
  auto o = std::make_shared<InfoOptions>();
  CLI::App *command = program.add_subcommand("info", "Print what a scene or a .gpurt file holds");
  command->footer(
      "\nExamples:\n  gpurt info city.glb\n  gpurt info city.glb --build --accel kdtree     what the tree is "
      "like\n  gpurt info part0.gpurt --json\n");
  command->add_option("file", o->path, "glTF 2.0 scene, or .gpurt state")->required()->type_name("FILE");
  CLI::Option *build = command->add_flag("--build", o->build, "tell of the acceleration structure too");
  command->add_flag("--json", o->json, "print JSON");
  o->device.add_to(*command);
  o->build_options.add_to(*command);
  for (const char *option : {"--device", "--accel", "--triangle-test", "--patch-tolerance", "--tree-cache"})
    command->get_option(option)->needs(build);
  command->callback([o] { print_info(*o); });
}

}  // namespace cli
