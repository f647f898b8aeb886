// gpurt scene: writes generated scenes, so that there is something to render without any download.
#include <filesystem>

#include "options.h"
#include "report.h"
#include "scenes/scenes.h"

namespace cli {

namespace {

struct KnownScene {
  const char *name, *what;
  void (*make)(scenes::GlbWriter &, const scenes::SceneOptions &);
};

constexpr KnownScene known_scenes[] = {
    {"cornell", "the Cornell box, 32 triangles", scenes::make_cornell},
    {"glass", "glass, mirror and metal on a wooden table under a lamp", scenes::make_glass},
    {"outdoor", "a valley with a pond and trees under a sky: about a million triangles, instanced, textured",
     scenes::make_outdoor},
    {"furnace", "a closed sphere lit from its centre: radiance 1 everywhere", scenes::make_furnace},
    {"icosphere", "a grey sphere under a constant sky", scenes::make_icosphere},
};

struct SceneCommandOptions {
  std::string name, output;
  scenes::SceneOptions scene;
  bool quiet = false;
};

void run(SceneCommandOptions o)
{
  if (extension_of(o.output) != ".glb") fail_usage("-o {}: its extension is not .glb", o.output);
  check_folder_of(o.output);
  const std::filesystem::path output(o.output);
  o.scene.stem = output.stem().string();
  for (const KnownScene &known : known_scenes) {
    if (o.name != known.name) continue;
    scenes::GlbWriter glb;
    known.make(glb, o.scene);
    const std::string bytes = glb.bytes();
    std::string files;
    for (const auto &[name, content] : glb.companions()) {
      const std::string path = (output.parent_path() / name).string();
      check_folder_of(path);
      write_file(path, std::string(content.begin(), content.end()));
      files += path + ", ";
    }
    write_file(o.output, bytes);
    if (!o.quiet) {
      fmt::print("{} triangles stored, {} seen, {}\nwrote {}{}\n", glb.num_stored_triangles(),
                 glb.num_placed_triangles(), format_bytes(bytes.size()), files, o.output);
    }
  }
}

}  // namespace

void write_generated_scene(const std::string &name, const std::string &path)
{
  SceneCommandOptions o;
  o.name = name;
  o.output = path;
  o.quiet = true;
  run(std::move(o));
}

void add_scene_command(CLI::App &program)
{
  auto o = std::make_shared<SceneCommandOptions>();
  CLI::App *command = program.add_subcommand("scene", "Write a generated scene as a .glb file");
  std::string list = "\nScenes:\n";
  std::vector<std::string> names;
  for (const KnownScene &known : known_scenes) {
    list += fmt::format("  {:<10} {}\n", known.name, known.what);
    names.emplace_back(known.name);
  }
  command->footer(list +
                  "\nExample:\n  gpurt scene outdoor -o outdoor.glb\n  gpurt render outdoor.glb -o "
                  "outdoor.png --spp 32\n");
  command->add_option("name", o->name, "which scene")
      ->required()
      ->check(CLI::IsMember(names))
      ->type_name("NAME");
  command->add_option("-o,--output", o->output, "file to write")->required()->type_name("FILE.glb");
  command->add_option("--width", o->scene.width, "of the camera's image")->check(CLI::Range(1, 65535));
  command->add_option("--height", o->scene.height, "one of both keeps the proportions")
      ->check(CLI::Range(1, 65535));
  command->add_option("--detail", o->scene.detail, "scales the number of triangles along an edge")
      ->check(CLI::Range(0.05, 4.0))
      ->capture_default_str();
  command->add_flag("-q,--quiet", o->quiet, "print nothing but errors");
  command->callback([o] { run(*o); });
}

}  // namespace cli
