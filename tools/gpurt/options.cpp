#include "options.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include <unistd.h>

namespace cli {

namespace {

struct Named {
  const char *name;
  uint32_t value;
};

constexpr Named accels[] = {{"auto", GPURT_ACCEL_AUTO},
                            {"kdtree", GPURT_ACCEL_KDTREE},
                            {"embree", GPURT_ACCEL_EMBREE},
                            {"bvh", GPURT_ACCEL_BVH}};
constexpr Named tests[] = {{"watertight", GPURT_TRIANGLE_WATERTIGHT},
                           {"moller-trumbore", GPURT_TRIANGLE_MOLLER_TRUMBORE},
                           {"double", GPURT_TRIANGLE_DOUBLE}};
constexpr Named qualities[] = {{"auto", GPURT_BUILD_QUALITY_AUTO},
                               {"fast", GPURT_BUILD_QUALITY_FAST},
                               {"high", GPURT_BUILD_QUALITY_HIGH}};
constexpr Named pipelines[] = {{"auto", GPURT_PIPELINE_AUTO},
                               {"path", GPURT_PIPELINE_PATH},
                               {"photon", GPURT_PIPELINE_PHOTON},
                               {"reyes", GPURT_PIPELINE_REYES},
                               {"hybrid", GPURT_PIPELINE_HYBRID}};
constexpr Named estimators[] = {{"auto", GPURT_PHOTON_ESTIMATOR_AUTO},
                                {"memoryless", GPURT_PHOTON_ESTIMATOR_MEMORYLESS},
                                {"per-pixel", GPURT_PHOTON_ESTIMATOR_PER_PIXEL},
                                {"adaptive", GPURT_PHOTON_ESTIMATOR_ADAPTIVE}};
constexpr Named kernels[] = {{"auto", GPURT_PHOTON_KERNEL_AUTO},
                             {"constant", GPURT_PHOTON_KERNEL_CONSTANT},
                             {"cone", GPURT_PHOTON_KERNEL_CONE}};
constexpr Named remedies_known[] = {{"all", 0},
                                    {"none", GPURT_PHOTON_REMEDY_NONE},
                                    {"normal", GPURT_PHOTON_REMEDY_NORMAL},
                                    {"plane", GPURT_PHOTON_REMEDY_PLANE},
                                    {"side", GPURT_PHOTON_REMEDY_SIDE},
                                    {"boundary", GPURT_PHOTON_REMEDY_BOUNDARY},
                                    {"continue", GPURT_PHOTON_REMEDY_CONTINUE}};
constexpr Named outputs[] = {{"color", GPURT_OUTPUT_COLOR},
                             {"alpha", GPURT_OUTPUT_ALPHA},
                             {"depth", GPURT_OUTPUT_DEPTH},
                             {"normal", GPURT_OUTPUT_NORMAL},
                             {"albedo", GPURT_OUTPUT_ALBEDO},
                             {"position", GPURT_OUTPUT_POSITION},
                             {"primitive", GPURT_OUTPUT_PRIMITIVE},
                             {"instance", GPURT_OUTPUT_INSTANCE},
                             {"samples", GPURT_OUTPUT_SAMPLE_COUNT},
                             {"variance", GPURT_OUTPUT_VARIANCE},
                             {"bias", GPURT_OUTPUT_BIAS},
                             {"error", GPURT_OUTPUT_ERROR}};

template <size_t n>
const char *name_in(const Named (&names)[n], uint32_t value)
{
  for (const Named &named : names) {
    if (named.value == value) return named.name;
  }
  return "unknown";
}

template <size_t n>
uint32_t value_in(const Named (&names)[n], const std::string &name, const char *option)
{
  std::string known;
  for (const Named &named : names) {
    if (named.name == name) return named.value;
    known += fmt::format("{}{}", known.empty() ? "" : ", ", named.name);
  }
  fail_usage("{} does not know \"{}\"; it knows {}", option, name, known);
}

template <size_t n>
CLI::IsMember one_of(const Named (&names)[n])
{
  std::vector<std::string> known;
  for (const Named &named : names) known.emplace_back(named.name);
  return CLI::IsMember(known);
}

// The numbers of "cuda:0,1"; none where the text is not of that form.
std::vector<uint32_t> cuda_ordinals(const std::string &text)
{
  if (text.rfind("cuda:", 0) != 0) return {};
  std::vector<uint32_t> ordinals;
  for (size_t first = 5; first <= text.size();) {
    const size_t end = std::min(text.find(',', first), text.size());
    const std::string number = text.substr(first, end - first);
    const bool is_number =
        !number.empty() && number.size() < 7 &&
        std::all_of(number.begin(), number.end(), [](unsigned char c) { return std::isdigit(c); });
    if (!is_number) return {};
    ordinals.push_back(uint32_t(std::stoul(number)));
    first = end + 1;
  }
  return ordinals;
}

void print_message(void *, gpurt_log_level level, const char *message)
{
  if (level <= GPURT_LOG_WARNING)
    fmt::print(stderr, "gpurt: {}: {}\n", level == GPURT_LOG_ERROR ? "error" : "warning", message);
}

// CLI11's own tells the range with all digits of the largest double.
const CLI::Validator not_negative(
    [](const std::string &text) {
      char *end = nullptr;
      const double value = std::strtod(text.c_str(), &end);
      return end != text.c_str() && *end == '\0' && value >= 0 && std::isfinite(value)
                 ? std::string()
                 : "\"" + text + "\" is not a number from 0 on";
    },
    "", "not_negative");

}  // namespace

void DeviceOptions::add_to(CLI::App &command)
{
  const auto check_device = [](const std::string &text) {
    const bool is_known = text == "auto" || text == "cpu" || text == "cuda" || !cuda_ordinals(text).empty();
    return is_known ? std::string() : "is none of auto, cpu, cuda, cuda:N and cuda:N,N,...";
  };
  command
      .add_option(
          "--device", device,
          "auto (a CUDA device that works, else the CPU), cpu, cuda, cuda:N, or several that share the work: "
          "cuda:0,1")
      ->check(CLI::Validator(check_device, "DEVICE"))
      ->type_name("DEVICE")
      ->capture_default_str();
  command.add_option("--threads", threads, "CPU worker threads; 0: all")
      ->check(CLI::Range(0, 4096))
      ->capture_default_str();
  command
      .add_option("--memory-limit", memory_limit, "fail rather than hold more than this, such as 4G or 512M")
      ->type_name("SIZE");
  command.add_flag("-q,--quiet", quiet, "print nothing but errors");
}

Device DeviceOptions::create(gpurt_device_type type) const
{
  gpurt_device_desc desc = GPURT_DEVICE_DESC_INIT;
  if (type != GPURT_DEVICE_AUTO) desc.type = type;
  else if (device == "cpu") desc.type = GPURT_DEVICE_CPU;
  else if (device != "auto") desc.type = GPURT_DEVICE_CUDA;
  const std::vector<uint32_t> ordinals = cuda_ordinals(device);
  if (type == GPURT_DEVICE_AUTO && !ordinals.empty()) {
    desc.ordinals = ordinals.data();
    desc.num_ordinals = uint32_t(ordinals.size());
  }
  desc.num_threads = threads;
  if (!memory_limit.empty()) desc.memory_limit_bytes = parse_bytes(memory_limit, "--memory-limit");
  if (!quiet) desc.log = print_message;
  Device created;
  const gpurt_result result = gpurt_device_create(&desc, created.out());
  if ((result == GPURT_ERROR_DEVICE || result == GPURT_ERROR_UNSUPPORTED) && device != "auto")
    fail("--device {}: {}; gpurt devices lists what there is", device, in_options(gpurt_last_error()));
  check(result);
  return created;
}

void PhotonOptions::add_to(CLI::App &command)
{
  command
      .add_option("--photons", photons,
                  "photon mapping: photons of a pass, which is one sample of every pixel; 0: about one a "
                  "pixel, with --time by trials")
      ->type_name("N")
      ->capture_default_str();
  command
      .add_option(
          "--radius", radius,
          "photon mapping: radius of the first pass in metres; 0: from the scene, with --time by trials")
      ->check(not_negative)
      ->type_name("R")
      ->capture_default_str();
  command
      .add_option(
          "--photon-estimator", estimator,
          "photon mapping: memoryless, whose passes can be merged; per-pixel or adaptive, whose radii "
          "depend on the pixel")
      ->check(one_of(estimators))
      ->type_name("NAME")
      ->capture_default_str();
  command.add_option("--photon-kernel", kernel, "photon mapping: auto, constant or cone")
      ->check(one_of(kernels))
      ->type_name("NAME")
      ->capture_default_str();
  command
      .add_option(
          "--photon-remedies", remedies,
          "photon mapping: what is done about photons of other surfaces: all, none or some of normal, "
          "plane, side, boundary, and continue, which all is without")
      ->check(one_of(remedies_known))
      ->delimiter(',')
      ->allow_extra_args(false)
      ->type_name("A,B,...");
}

gpurt_photon_settings PhotonOptions::settings() const
{
  gpurt_photon_settings settings = GPURT_PHOTON_SETTINGS_INIT;
  settings.photons_per_pass = photons;
  settings.initial_radius = radius;
  settings.estimator = gpurt_photon_estimator(value_in(estimators, estimator, "--photon-estimator"));
  settings.kernel = gpurt_photon_kernel(value_in(kernels, kernel, "--photon-kernel"));
  for (const std::string &name : remedies) {
    if (name == "all") {
      settings.remedies |= uint32_t(GPURT_PHOTON_REMEDY_NORMAL) | GPURT_PHOTON_REMEDY_PLANE |
                           GPURT_PHOTON_REMEDY_SIDE | GPURT_PHOTON_REMEDY_BOUNDARY;
    } else {
      settings.remedies |= value_in(remedies_known, name, "--photon-remedies");
    }
  }
  return settings;
}

void BuildOptions::add_to(CLI::App &command, bool has_picture)
{
  command
      .add_option("--accel", accel,
                  "acceleration structure: auto, kdtree (same bits on every device), embree (CPU) or bvh")
      ->check(one_of(accels))
      ->type_name("NAME")
      ->capture_default_str();
  command
      .add_option("--triangle-test", triangle_test,
                  "watertight, moller-trumbore (leaks at edges) or double (not embree)")
      ->check(one_of(tests))
      ->type_name("NAME")
      ->capture_default_str();
  command
      .add_option("--build-quality", quality,
                  "auto, fast (CUDA, bvh: built on the device) or high (the tree that traces fastest)")
      ->check(one_of(qualities))
      ->type_name("NAME")
      ->capture_default_str();
  command
      .add_option(
          "--patch-tolerance", patch_tolerance,
          "largest distance of patches and the triangles that rays meet; 0: 1e-4 of the patches' diagonal")
      ->type_name("METRES");
  CLI::Option *pixels =
      command
          .add_option(
              "--patch-pixels", patch_pixels,
              "the same in pixels of a camera's picture: fewer triangles further away; 0: no such bound")
          ->check(not_negative)
          ->type_name("PIXELS");
  command
      .add_option("--tree-cache", tree_cache,
                  "read the kd-tree from this file if it fits the scene, else write it")
      ->type_name("FILE");
  if (has_picture) return;
  const auto of_picture = [&](const char *name, uint32_t &value, const char *text) {
    command.add_option(name, value, text)->needs(pixels)->type_name("N");
  };
  of_picture("--patch-camera", patch_camera, "whose picture that is");
  of_picture("--patch-width", patch_width, "of that picture; 0: what the camera says, else 512");
  of_picture("--patch-height", patch_height, "of that picture; 0: what the camera says, else 512");
}

gpurt_build_desc BuildOptions::desc() const
{
  gpurt_build_desc desc = GPURT_BUILD_DESC_INIT;
  desc.accel = gpurt_accel(value_in(accels, accel, "--accel"));
  desc.triangle_test = gpurt_triangle_test(value_in(tests, triangle_test, "--triangle-test"));
  desc.quality = gpurt_build_quality(value_in(qualities, quality, "--build-quality"));
  desc.patch_tolerance = patch_tolerance;
  desc.patch_pixels = patch_pixels;
  if (patch_pixels > 0) {
    desc.patch_camera = patch_camera;
    desc.patch_width = patch_width;
    desc.patch_height = patch_height;
  }
  if (!tree_cache.empty()) desc.tree_cache_path = tree_cache.c_str();
  return desc;
}

std::string in_options(std::string text)
{
  constexpr std::pair<const char *, const char *> names[] = {
      {"GPURT_ACCEL_AUTO", "--accel auto"},
      {"GPURT_ACCEL_KDTREE", "--accel kdtree"},
      {"GPURT_ACCEL_EMBREE", "--accel embree"},
      {"GPURT_ACCEL_BVH", "--accel bvh"},
      {"GPURT_PIPELINE_AUTO", "--pipeline auto"},
      {"GPURT_PIPELINE_PATH", "--pipeline path"},
      {"GPURT_PIPELINE_PHOTON", "--pipeline photon"},
      {"GPURT_PIPELINE_REYES", "--pipeline reyes"},
      {"GPURT_PIPELINE_HYBRID", "--pipeline hybrid"},
      {"GPURT_PHOTON_ESTIMATOR_MEMORYLESS", "--photon-estimator memoryless"},
      {"GPURT_PHOTON_ESTIMATOR_PER_PIXEL", "--photon-estimator per-pixel"},
      {"GPURT_PHOTON_KERNEL_CONSTANT", "--photon-kernel constant"},
      {"GPURT_OUTPUT_BIAS", "--aov bias"},
      {"GPURT_OUTPUT_ERROR", "--aov error"},
      {"GPURT_OUTPUT_VARIANCE", "--aov variance"},
      {"GPURT_TRIANGLE_WATERTIGHT", "--triangle-test watertight"},
      {"GPURT_TRIANGLE_MOLLER_TRUMBORE", "--triangle-test moller-trumbore"},
      {"GPURT_TRIANGLE_DOUBLE", "--triangle-test double"},
      {"memory_limit_bytes", "--memory-limit"},
      {"num_threads", "--threads"},
      {"photon.photons_per_pass", "--photons"},
      {"photon.initial_radius", "--radius"},
      {"photon.estimator", "--photon-estimator"},
      {"photon.kernel", "--photon-kernel"},
      {"photon.remedies", "--photon-remedies"},
      {"GPURT_REYES_SHADING_SAMPLES", "--shading samples"},
      {"GPURT_REYES_SHADING_MICROPOLYGONS", "--shading micropolygons"},
      {"GPURT_REYES_SHADING_BLOCKS", "--shading blocks"},
      {"reyes.shading_rate", "--shading-rate"},
      {"reyes.shading is ", ""},
      {"reyes.filter", "--filter"},
      {"reyes.flatness", "--flatness"},
      {"set no_shadows", "add --no-shadows"},
      {"patch_tolerance", "--patch-tolerance"},
      {"patch_pixels", "--patch-pixels"},
      {"patch_camera", "--patch-camera"},
      {"reyes.fragment_slots", "--fragment-slots"},
      {"samples_per_pixel", "--spp"},
      {"target_error", "--error"},
      {"time_limit_s", "--time"},
      {"max_depth", "--max-depth"}};
  for (const auto &[name, option] : names) {
    for (size_t at = 0; (at = text.find(name, at)) != std::string::npos; at += std::strlen(option))
      text.replace(at, std::strlen(name), option);
  }
  return text;
}

Scene load_scene(gpurt_device device, const std::string &path)
{
  Scene scene;
  check(gpurt_scene_load(device, path.c_str(), scene.out()));
  return scene;
}

void commit(gpurt_scene scene, const BuildOptions &options)
{
  gpurt_build_desc desc = options.desc();
  if (facts_of(scene).num_cameras == 0) {
    desc.patch_pixels = 0;
    desc.patch_camera = desc.patch_width = desc.patch_height = 0;
  }
  check(gpurt_scene_commit(scene, &desc));
}

gpurt_scene_facts facts_of(gpurt_scene scene)
{
  gpurt_scene_facts facts = GPURT_SCENE_FACTS_INIT;
  check(gpurt_scene_get_facts(scene, &facts));
  return facts;
}

gpurt_device_properties properties_of(gpurt_device device)
{
  gpurt_device_properties properties = GPURT_DEVICE_PROPERTIES_INIT;
  check(gpurt_device_get_properties(device, &properties));
  return properties;
}

bool add_default_camera(gpurt_scene scene, const BuildOptions &options)
{
  const gpurt_scene_facts facts = facts_of(scene);
  if (facts.num_cameras > 0) return false;
  // From the front, above and to the right, at the distance from which the sphere around the bounds fills the view.
  double center[3], radius2 = 0;
  for (int c = 0; c < 3; ++c) {
    const double lo = facts.bounds_min[c], hi = facts.bounds_max[c];
    if (!(lo <= hi)) fail("the scene has no camera and nothing to look at");
    center[c] = 0.5 * (lo + hi);
    radius2 += 0.25 * (hi - lo) * (hi - lo);
  }
  const double radius = radius2 > 0 ? std::sqrt(radius2) : 1;
  const double yfov = 0.7, distance = radius / std::sin(0.5 * yfov);
  const double z[3] = {0.48, 0.36, 0.8};  // towards the viewer, unit length
  const double x_length = std::hypot(z[2], z[0]), x[3] = {z[2] / x_length, 0, -z[0] / x_length};
  const double y[3] = {z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]};
  gpurt_camera_desc camera = GPURT_CAMERA_DESC_INIT;
  camera.yfov_rad = float(yfov);
  for (int row = 0; row < 3; ++row) {
    camera.transform[4 * row] = float(x[row]);
    camera.transform[4 * row + 1] = float(y[row]);
    camera.transform[4 * row + 2] = float(z[row]);
    camera.transform[4 * row + 3] = float(center[row] + distance * z[row]);
  }
  uint32_t id;
  check(gpurt_scene_add_camera(scene, &camera, &id));
  commit(scene, options);
  return true;
}

uint64_t parse_bytes(const std::string &text, const char *option)
{
  double value = 0;
  const char *end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, value);
  std::string unit(rest, end);
  for (char &c : unit) c = char(std::toupper(static_cast<unsigned char>(c)));
  if (unit.size() > 1 && unit.ends_with("IB")) unit.resize(unit.size() - 2);
  else if (unit.size() > 1 && unit.ends_with("B")) unit.resize(unit.size() - 1);
  const std::string units = "KMGT";
  const size_t power = unit.empty() || unit == "B" ? 0 : unit.size() == 1 ? units.find(unit[0]) + 1 : 0;
  const bool has_unit =
      unit.empty() || unit == "B" || (unit.size() == 1 && units.find(unit[0]) != std::string::npos);
  const double bytes = std::ldexp(value, int(10 * power));
  if (error != std::errc() || !has_unit || !(bytes >= 1) || bytes >= 0x1p63) {
    fail_usage("{} is \"{}\"; write a size such as 512M, 4G or 1.5GiB", option, text);
  }
  return uint64_t(bytes);
}

std::string format_bytes(uint64_t bytes)
{
  constexpr std::array units = {"B", "KiB", "MiB", "GiB", "TiB"};
  double value = double(bytes);
  size_t unit = 0;
  while (value >= 1024 && unit + 1 < units.size()) {
    value /= 1024;
    unit++;
  }
  return unit == 0 ? fmt::format("{} B", bytes)
                   : fmt::format("{:.{}f} {}", value,
                                 value < 10    ? 2
                                 : value < 100 ? 1
                                               : 0,
                                 units[unit]);
}

uint32_t parse_outputs(const std::vector<std::string> &names)
{
  uint32_t bits = 0;
  for (const std::string &name : names) {
    if (name == "all") {
      for (const Named &output : outputs) bits |= 1u << output.value;
      // Photon mapping's own are asked for by name.
      bits &= ~(1u << GPURT_OUTPUT_BIAS | 1u << GPURT_OUTPUT_ERROR);
    } else {
      bits |= 1u << value_in(outputs, name, "--aov");
    }
  }
  return bits;
}

const char *name_of(gpurt_accel accel) { return name_in(accels, accel); }
const char *name_of(gpurt_triangle_test test) { return name_in(tests, test); }
const char *name_of(gpurt_photon_estimator estimator) { return name_in(estimators, estimator); }
const char *name_of(gpurt_pipeline pipeline) { return name_in(pipelines, pipeline); }
const char *name_of(gpurt_device_type type)
{
  return type == GPURT_DEVICE_CPU ? "cpu" : type == GPURT_DEVICE_CUDA ? "cuda" : "auto";
}

std::string extension_of(const std::string &path)
{
  std::string extension = std::filesystem::path(path).extension().string();
  for (char &c : extension) c = char(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

void check_folder_of(const std::string &path)
{
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  std::error_code error;
  if (!folder.empty() && !std::filesystem::is_directory(folder, error))
    fail("{}: the folder {} does not exist; make it first", path, folder.string());
  if (std::filesystem::is_directory(path, error))
    fail("{}: is a folder; name a file, such as one in it", path);
  // Files are written beside their place and then moved there.
  if (::access(folder.empty() ? "." : folder.c_str(), W_OK) != 0)
    fail("{}: the folder {} is not writable", path, folder.empty() ? "." : folder.string());
}

}  // namespace cli
