// gpurt render: a scene to pictures, and on from where an earlier run stopped.
#include <cmath>
#include <filesystem>
#include <limits>
#include <optional>

#include "options.h"
#include "progress.h"
#include "report.h"

namespace cli {

namespace {

struct RenderOptions {
  std::string scene;
  OutputOptions output;
  DeviceOptions device;
  BuildOptions build;
  PhotonOptions photon;
  std::string pipeline = "auto", filter = "box", shading = "samples";
  float shading_rate = 0;
  bool no_shadows = false;
  float flatness = 0;
  uint32_t fragment_slots = 0;
  uint32_t width = 0, height = 0, camera = 0, samples = 0, tile = 0, max_depth = 0, frame_index = 0;
  float error = 0;
  double time = 0;
  uint64_t seed = 0, first_sample = 0;
  std::vector<std::string> aovs;
  std::string stats, state;
};

constexpr const char *examples = R"(
Output goes by extension: .exr holds linear radiance and every --aov as a named layer, .png is tonemapped
(x / (1 + x), sRGB, after --exposure), .gpurt holds the exact sums, to go on from later (--state) or to merge (gpurt merge).

Examples:
  gpurt render cornell.glb -o cornell.png                     64 samples per pixel
  gpurt render cornell.glb -o c.exr -o c.png --error 0.001    until the estimated relMSE is below 0.001
  gpurt render glass.glb -o glass.exr --pipeline photon       where caustics matter: 64 passes of photons
  gpurt render city.glb -o city.exr --time 60 --aov normal,albedo,depth
  gpurt render city.glb -o city.png --state city.gpurt --spp 256     Ctrl-C, and go on with the same command
  gpurt render a.glb -o part0.gpurt --spp 128 --first-sample 0       on one machine,
  gpurt render a.glb -o part1.gpurt --spp 128 --first-sample 128     on another;
  gpurt merge a.glb part0.gpurt part1.gpurt -o a.exr                 the same bits as --spp 256 at once
)";

gpurt_pipeline pipeline_of(const std::string &name)
{
  for (int p = GPURT_PIPELINE_AUTO; p <= GPURT_PIPELINE_HYBRID; ++p) {
    if (name == name_of(gpurt_pipeline(p))) return gpurt_pipeline(p);
  }
  return GPURT_PIPELINE_AUTO;
}

// Which of the names it is; they count as the enum does.
int index_of(const std::string &name, std::initializer_list<const char *> names)
{
  int i = 0;
  for (const char *n : names) {
    if (name == n) return i;
    ++i;
  }
  return 0;
}

// What the state file was made with holds for the rest of the run too, except where the command line says otherwise:
// then the library refuses with the difference.
void take_settings(RenderOptions &o, const gpurt_state_info &info, const CLI::App &command,
                   gpurt_frame_desc &desc)
{
  const auto is_given = [&](const char *option) { return command.count(option) > 0; };
  if (!is_given("--width")) desc.width = info.width;
  if (!is_given("--height")) desc.height = info.height;
  if (!is_given("--camera")) desc.camera = info.camera;
  if (!is_given("--frame")) desc.frame_index = info.frame_index;
  if (!is_given("--seed")) desc.seed = info.seed;
  if (!is_given("--first-sample")) desc.first_sample = info.first_sample;
  if (!is_given("--aov")) desc.outputs = info.outputs;
  if (!is_given("--max-depth")) o.max_depth = info.max_depth;
  if (!is_given("--pipeline")) o.pipeline = name_of(info.pipeline);
  if (!is_given("--accel")) o.build.accel = name_of(info.accel);
  if (!is_given("--triangle-test")) o.build.triangle_test = name_of(info.triangle_test);
}

// One of the sizes is given: the other keeps the camera's proportions.
void complete_size(gpurt_frame_desc &desc, gpurt_scene scene)
{
  if ((desc.width == 0) == (desc.height == 0)) return;
  gpurt_camera_desc camera = GPURT_CAMERA_DESC_INIT;
  check(gpurt_scene_get_camera(scene, desc.camera, &camera));
  if (camera.width == 0 || camera.height == 0) return;
  const double aspect = double(camera.width) / camera.height;
  if (desc.width == 0) desc.width = uint32_t(std::max(1.0, std::round(desc.height * aspect)));
  else desc.height = uint32_t(std::max(1.0, std::round(desc.width / aspect)));
}

void check_outputs(const RenderOptions &o)
{
  if (o.output.paths.empty() && o.state.empty())
    fail_usage("no output: give -o FILE.exr, FILE.png or FILE.gpurt, or --state FILE.gpurt");
  o.output.check_paths();
  if (!o.state.empty() && extension_of(o.state) != ".gpurt")
    fail_usage("--state {}: its extension is not .gpurt", o.state);
  if (!o.state.empty()) check_folder_of(o.state);
  if (!o.stats.empty()) check_folder_of(o.stats);
}

// Waits for the job; true if it was interrupted.
bool wait_with_progress(gpurt_job job, bool quiet)
{
  InterruptGuard guard;
  Progress progress("rendering", quiet);
  bool was_interrupted = false;
  for (;;) {
    const gpurt_result result = gpurt_job_wait(job, 100'000'000);
    if (result == GPURT_ERROR_CANCELLED && was_interrupted) return true;
    if (result != GPURT_ERROR_TIMEOUT) {
      check(result);
      return was_interrupted;  // it came to its end before it saw the request
    }
    double share = 0;
    check(gpurt_job_get_progress(job, &share));
    progress.update(share);
    if (InterruptGuard::interrupted() && !was_interrupted) {
      was_interrupted = true;
      check(gpurt_job_cancel(job));
    }
  }
}

void run(RenderOptions o, const CLI::App &command)
{
  check_outputs(o);
  gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
  desc.width = o.width;
  desc.height = o.height;
  desc.camera = o.camera;
  desc.frame_index = o.frame_index;
  desc.seed = o.seed;
  desc.first_sample = o.first_sample;
  desc.outputs = parse_outputs(o.aovs);
  std::error_code error;
  const bool goes_on = !o.state.empty() && std::filesystem::exists(o.state, error);
  if (goes_on) {
    gpurt_state_info info = GPURT_STATE_INFO_INIT;
    check(gpurt_state_read_info(o.state.c_str(), &info));
    take_settings(o, info, command, desc);
  }

  const Device device = o.device.create();
  const Scene scene = load_scene(device, o.scene);
  if (const uint32_t n = facts_of(scene).num_cameras; n != 0) {
    if (o.camera >= n)
      fail("--camera {}: {} has {}, counted from 0: the last is --camera {}", o.camera, o.scene,
           n == 1 ? "one camera" : fmt::format("{} cameras", n), n - 1);
    complete_size(desc, scene);
  }
  o.build.patch_camera = desc.camera;
  o.build.patch_width = desc.width;
  o.build.patch_height = desc.height;
  commit(scene, o.build);
  if (add_default_camera(scene, o.build) && !o.device.quiet) {
    fmt::print(stderr, "gpurt: {} has no camera; looking at all of it from the front\n", o.scene);
  }
  if (o.camera >= facts_of(scene).num_cameras)
    fail("--camera {}: {} has one camera, counted from 0: the last is --camera 0", o.camera, o.scene);

  Frame frame;
  check(gpurt_frame_create(scene, &desc, frame.out()));
  if (goes_on) check(gpurt_frame_load_state(frame, o.state.c_str()));

  gpurt_render_desc render = GPURT_RENDER_DESC_INIT;
  render.pipeline = pipeline_of(o.pipeline);
  render.samples_per_pixel = o.samples;
  render.target_error = o.error;
  render.time_limit_s = o.time;
  render.max_depth = o.max_depth;
  render.tile_size = o.tile;
  render.photon = o.photon.settings();
  if (render.pipeline == GPURT_PIPELINE_REYES) {
    // What is not given is left to the library: a frame that goes on has its settings.
    const auto is_given = [&](const char *option) { return command.count(option) > 0; };
    render.reyes.shading_rate = o.shading_rate;
    if (is_given("--filter"))
      render.reyes.filter = gpurt_reyes_filter(index_of(o.filter, {"auto", "box", "gaussian", "mitchell"}));
    if (is_given("--shading"))
      render.reyes.shading =
          gpurt_reyes_shading(index_of(o.shading, {"auto", "samples", "micropolygons", "blocks"}));
    render.reyes.no_shadows = o.no_shadows ? 1 : 0;
    render.reyes.flatness = o.flatness;
    render.reyes.fragment_slots = o.fragment_slots;
  }
  Job job;
  check(gpurt_frame_submit(frame, &render, nullptr, 0, job.out()));
  const bool was_interrupted = wait_with_progress(job, o.device.quiet);

  if (!o.state.empty()) check(gpurt_frame_save(frame, o.state.c_str()));
  o.output.save(frame);
  if (!o.stats.empty()) write_statistics(o.stats, o.scene, device, scene, frame);
  if (!o.device.quiet) print_summary(device, frame, o.output.paths, o.state);
  if (was_interrupted) throw Failure("interrupted; what was rendered is saved", exit_interrupted);
}

}  // namespace

void add_render_command(CLI::App &program)
{
  auto o = std::make_shared<RenderOptions>();
  CLI::App *command = program.add_subcommand("render", "Render a scene to EXR and PNG files");
  command->footer(examples);
  command->add_option("scene", o->scene, "glTF 2.0 file, .glb or .gltf")->required()->type_name("SCENE");
  o->output.add_to(*command);
  command
      ->add_option("--pipeline", o->pipeline,
                   "auto (path), path, photon, reyes or hybrid; this version has path, photon and reyes")
      ->check(CLI::IsMember({"auto", "path", "photon", "reyes", "hybrid"}))
      ->type_name("NAME")
      ->capture_default_str();
  o->device.add_to(*command);
  o->build.add_to(*command, true);
  command->add_option("--width", o->width, "pixels; by default what the camera says, else 512")
      ->check(CLI::Range(1, 65535));
  command->add_option("--height", o->height, "pixels; one of both keeps the camera's proportions")
      ->check(CLI::Range(1, 65535));
  command->add_option("--camera", o->camera, "which camera of the scene, counted from 0")
      ->capture_default_str();

  const auto positive = CLI::Validator(
      [](const std::string &text) {
        char *end = nullptr;
        const double value = std::strtod(text.c_str(), &end);
        return end != text.c_str() && *end == '\0' && value > 0 && std::isfinite(value)
                   ? std::string()
                   : "\"" + text + "\" is not a positive number";
      },
      "POSITIVE");
  CLI::Option *samples = command
                             ->add_option("--spp", o->samples,
                                          "until every pixel has this many samples (default 64, of reyes 9)")
                             ->check(CLI::Range(1u, std::numeric_limits<uint32_t>::max()))
                             ->type_name("N");
  CLI::Option *error =
      command
          ->add_option("--error", o->error,
                       "until the frame's estimated relMSE is below this, of photon mapping noise and bias")
          ->check(positive)
          ->type_name("E");
  CLI::Option *time = command->add_option("--time", o->time, "as many samples as fit into this many seconds")
                          ->check(positive)
                          ->type_name("S");
  samples->excludes(error)->excludes(time);
  error->excludes(time);

  command->add_option("--tile", o->tile, "edge of a work unit in pixels; 0: automatic; changes no bits")
      ->check(CLI::Range(0, 256))
      ->capture_default_str();
  command
      ->add_option("--max-depth", o->max_depth,
                   "path length: 1 is emission alone, 2 direct light; 0: 17, of reyes 2")
      ->capture_default_str();
  command
      ->add_option("--shading-rate", o->shading_rate,
                   "reyes: area of a micropolygon in pixels (default 0.25, of --filter gaussian 0.375)")
      ->check(CLI::Range(0.00390625, 256.0))
      ->type_name("A");
  command->add_option("--filter", o->filter, "reyes: box, gaussian or mitchell")
      ->check(CLI::IsMember({"box", "gaussian", "mitchell"}))
      ->type_name("NAME")
      ->capture_default_str();
  command
      ->add_option(
          "--shading", o->shading,
          "reyes: light at all samples, or once for all those of micropolygons or of blocks of 2 x 2")
      ->check(CLI::IsMember({"samples", "micropolygons", "blocks"}))
      ->type_name("NAME")
      ->capture_default_str();
  command
      ->add_option(
          "--flatness", o->flatness,
          "reyes: micropolygons may be larger, with edges of up to 2.8 pixels, where they stay within PIXELS "
          "of the surface; 0: none are")
      ->type_name("PIXELS");
  command
      ->add_option("--fragment-slots", o->fragment_slots,
                   "reyes: samples keep the nearest N surfaces that blend, a study variant; 0: all")
      ->check(CLI::Range(0, 64))
      ->type_name("N");
  command->add_flag("--no-shadows", o->no_shadows, "reyes: nothing stands between surfaces and lights");
  command->add_option("--seed", o->seed, "another seed gives independent noise")->capture_default_str();
  command
      ->add_option("--frame", o->frame_index,
                   "frame of an animation: decorrelates its noise from other frames'")
      ->capture_default_str();
  command
      ->add_option("--first-sample", o->first_sample,
                   "sample index to start from, for parts that are merged later")
      ->capture_default_str();
  command
      ->add_option("--aov", o->aovs,
                   "more layers for .exr: alpha, depth, normal, albedo, position, primitive, instance, "
                   "samples, variance or all; of photon mapping bias and error")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->type_name("A,B,...");
  o->photon.add_to(*command);
  command->add_option("--state", o->state, "go on from this .gpurt file if it is there, and save to it")
      ->type_name("FILE");
  command->add_option("--stats", o->stats, "write statistics as JSON")->type_name("FILE");
  command->callback([o, command] { run(*o, *command); });
}

}  // namespace cli
