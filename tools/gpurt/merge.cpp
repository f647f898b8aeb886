// gpurt merge: adds parts of a frame that were rendered elsewhere.
#include "options.h"
#include "report.h"

namespace cli {

namespace {

struct MergeOptions {
  std::string scene;
  std::vector<std::string> parts;
  OutputOptions output;
  DeviceOptions device;
};

void run(const MergeOptions &o)
{
  if (o.output.paths.empty()) fail_usage("no output: give -o FILE.exr, FILE.png or FILE.gpurt");
  o.output.check_paths();
  gpurt_state_info info = GPURT_STATE_INFO_INIT;
  check(gpurt_state_read_info(o.parts[0].c_str(), &info));

  // Nothing is traced, but a frame belongs to a committed scene, and its hash tells whether the parts are of this one.
  const Device device = o.device.create(GPURT_DEVICE_CPU);
  const Scene scene = load_scene(device, o.scene);
  BuildOptions build;
  build.accel = name_of(info.accel);
  build.triangle_test = name_of(info.triangle_test);
  commit(scene, build);
  add_default_camera(scene, build);

  gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
  desc.width = info.width;
  desc.height = info.height;
  desc.camera = info.camera;
  desc.outputs = info.outputs;
  desc.frame_index = info.frame_index;
  desc.seed = info.seed;
  desc.first_sample = info.first_sample;
  Frame frame;
  check(gpurt_frame_create(scene, &desc, frame.out()));
  for (const std::string &part : o.parts) check(gpurt_frame_load_state(frame, part.c_str()));
  o.output.save(frame);
  if (!o.device.quiet) print_summary(device, frame, o.output.paths, "");
}

}  // namespace

void add_merge_command(CLI::App &program)
{
  auto o = std::make_shared<MergeOptions>();
  CLI::App *command = program.add_subcommand("merge", "Add .gpurt files of one frame, exactly");
  command->footer(
      "\nThe parts must be of the same scene file, size, seed and settings, and hold different samples "
      "(--first-sample of\n"
      "gpurt render) or different pixels. The order does not matter: the result has the bits of rendering at "
      "once.\n\n"
      "Example:\n  gpurt merge a.glb part0.gpurt part1.gpurt part2.gpurt -o a.exr -o a.png\n");
  command->add_option("scene", o->scene, "the scene that the parts were rendered from")
      ->required()
      ->type_name("SCENE");
  command->add_option("parts", o->parts, ".gpurt files")->required()->type_name("PART...");
  o->output.add_to(*command);
  o->device.add_to(*command);
  command->callback([o] { run(*o); });
}

}  // namespace cli
