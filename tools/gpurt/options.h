// Options that several commands have, and what they mean to the library.
#pragma once

#include <string>
#include <vector>

#include "cli.h"

namespace cli {

/// --device, --threads, --memory-limit.
struct DeviceOptions {
  std::string device = "auto";
  uint32_t threads = 0;
  std::string memory_limit;
  bool quiet = false;

  void add_to(CLI::App &command);
  /// `type` in place of what --device says, unless it is AUTO.
  Device create(gpurt_device_type type = GPURT_DEVICE_AUTO) const;
};

/// --accel, --triangle-test, --build-quality, --tree-cache.
/// --photons and what else photon mapping is set with.
struct PhotonOptions {
  uint32_t photons = 0;
  float radius = 0;
  std::string estimator = "auto";
  std::string kernel = "auto";
  std::vector<std::string> remedies;

  void add_to(CLI::App &command);
  gpurt_photon_settings settings() const;
};

struct BuildOptions {
  std::string accel = "auto";
  std::string triangle_test = "watertight";
  std::string quality = "auto";
  float patch_tolerance = 0;
  float patch_pixels = 0;
  uint32_t patch_camera = 0, patch_width = 0, patch_height = 0;  // with patch_pixels
  std::string tree_cache;

  /// With `has_picture` the command itself says which picture --patch-pixels is about.
  void add_to(CLI::App &command, bool has_picture = false);
  gpurt_build_desc desc() const;  // refers to tree_cache
};

Scene load_scene(gpurt_device device, const std::string &path);
/// A scene without cameras has no bound in pixels yet: see add_default_camera.
void commit(gpurt_scene scene, const BuildOptions &options);
gpurt_scene_facts facts_of(gpurt_scene scene);
gpurt_device_properties properties_of(gpurt_device device);

/// Adds a camera that sees everything to a committed scene without cameras, and commits again. True if it did.
bool add_default_camera(gpurt_scene scene, const BuildOptions &options);

/// Writes a scene that `gpurt scene` knows as a .glb file.
void write_generated_scene(const std::string &name, const std::string &path);

/// -o of the commands that write pictures.
struct OutputOptions {
  std::vector<std::string> paths;
  double exposure = 0;

  void add_to(CLI::App &command);
  /// Fails unless every file has a known extension and a folder that can be written to.
  void check_paths() const;
  void save(gpurt_frame frame) const;
};

/// "4G", "512M", "1.5GiB", "1000000": bytes, with units of 1024. Throws a usage failure.
uint64_t parse_bytes(const std::string &text, const char *option);
std::string format_bytes(uint64_t bytes);

/// Bits of gpurt_frame_desc.outputs for "normal,albedo" or "all". Throws a usage failure naming what is not known.
uint32_t parse_outputs(const std::vector<std::string> &names);

const char *name_of(gpurt_accel accel);
const char *name_of(gpurt_triangle_test test);
const char *name_of(gpurt_photon_estimator estimator);
const char *name_of(gpurt_pipeline pipeline);
const char *name_of(gpurt_device_type type);

/// Lower-case extension with its dot, "" if there is none.
std::string extension_of(const std::string &path);
/// Fails before hours of work do: is the folder of this file there?
void check_folder_of(const std::string &path);

}  // namespace cli
