#include "report.h"

#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "json.h"
#include "options.h"
#include "progress.h"

namespace cli {

gpurt_statistics statistics_of(gpurt_frame frame)
{
  gpurt_statistics statistics = GPURT_STATISTICS_INIT;
  check(gpurt_frame_get_statistics(frame, &statistics));
  return statistics;
}

void write_file(const std::string &path, const std::string &content)
{
  const std::string temporary = fmt::format("{}.tmp-{}", path, ::getpid());
  std::FILE *file = std::fopen(temporary.c_str(), "wb");
  bool is_good = file && std::fwrite(content.data(), 1, content.size(), file) == content.size();
  if (file) is_good = std::fclose(file) == 0 && is_good;
  if (is_good && std::rename(temporary.c_str(), path.c_str()) == 0) return;
  const int error = errno;
  std::remove(temporary.c_str());
  fail("{}: cannot be written: {}", path, std::strerror(error));
}

Json to_json(const gpurt_device_properties &d)
{
  Json json = {{"type", name_of(d.type)},
               {"ordinal", d.ordinal},
               {"name", d.name},
               {"instruction_set", d.instruction_set},
               {"num_threads", d.num_threads},
               {"memory_bytes", d.memory_bytes}};
  if (d.type == GPURT_DEVICE_CUDA) json["compute_capability"] = d.compute_capability;
  return json;
}

Json to_json(const gpurt_scene_facts &f)
{
  Json json = {{"geometries", f.num_geometries},
               {"instances", f.num_instances},
               {"materials", f.num_materials},
               {"textures", f.num_textures},
               {"cameras", f.num_cameras},
               {"point_lights", f.num_point_lights},
               {"distant_lights", f.num_distant_lights},
               {"patches", f.num_patches},
               {"triangles", f.num_triangles},
               {"world_triangles", f.num_world_triangles},
               {"emissive_triangles", f.num_emissive_triangles},
               {"has_environment", f.has_environment != 0},
               {"has_glass", f.has_glass != 0},
               {"has_alpha_masks", f.has_alpha_masks != 0},
               {"has_blending", f.has_blending != 0},
               {"patch_error", f.patch_error}};
  if (f.patch_error_pixels > 0) {
    // Not proven is no number.
    const bool is_proven = std::isfinite(f.patch_error_pixels);
    json["patch_error_pixels"] = is_proven ? Json(f.patch_error_pixels) : Json(nullptr);
  }
  if (f.bounds_min[0] <= f.bounds_max[0]) {
    json["bounds_min"] = f.bounds_min;
    json["bounds_max"] = f.bounds_max;
  }
  if (f.is_committed) {
    json["accel"] = name_of(f.accel);
    json["triangle_test"] = name_of(f.triangle_test);
    json["accel_bytes"] = f.accel_bytes;
    json["scene_bytes"] = f.scene_bytes;
    json["nodes"] = f.num_nodes;
    json["references"] = f.num_references;
    json["tree_depth"] = f.tree_depth;
    json["tree_from_cache"] = f.tree_from_cache != 0;
    json["build_seconds"] = f.build_seconds;
    json["sah_cost"] = f.sah_cost;
    json["accel_build_seconds"] = f.accel_build_seconds;
    if (f.tree_refitted) json["tree_refitted"] = true;
    if (f.build_peak_bytes) json["build_peak_bytes"] = f.build_peak_bytes;
  }
  return json;
}

Json to_json(const gpurt_schedule &s)
{
  // The names of the Python package, by the enumerators' values.
  const auto name = [](uint32_t value, std::initializer_list<const char *> names) {
    return value < names.size() ? std::string(names.begin()[value]) : fmt::format("unknown ({})", value);
  };
  return {{"traversal", name(s.traversal, {"auto", "stack", "leaf_lists", "uber"})},
          {"launch", name(s.launch, {"auto", "regular", "persistent", "rounds"})},
          {"fetch", name(s.fetch, {"auto", "per_thread", "packets"})},
          {"compaction", name(s.compaction, {"auto", "block_scan", "pyramid", "naive_scan", "library_scan"})},
          {"shading", name(s.shading, {"auto", "immediate", "sorted"})},
          {"generation", name(s.generation, {"auto", "slots", "counted"})},
          {"ray_budget", s.ray_budget}};
}

Json to_json(const gpurt_photon_settings &s, const gpurt_photon_counters &c)
{
  return {{"photons_per_pass", s.photons_per_pass},
          {"initial_radius", s.initial_radius},
          {"estimator", name_of(s.estimator)},
          {"kernel", s.kernel == GPURT_PHOTON_KERNEL_CONE ? "cone" : "constant"},
          {"remedies", s.remedies},
          {"num_emitted", c.num_emitted},
          {"num_rays", c.num_rays},
          {"num_stored", c.num_stored},
          {"num_gathered", c.num_gathered},
          {"num_visible", c.num_visible},
          {"num_sub_passes", c.num_sub_passes},
          {"trace_seconds", c.trace_seconds},
          {"build_seconds", c.build_seconds},
          {"gather_seconds", c.gather_seconds},
          {"smallest_radius", c.smallest_radius},
          {"emit_seconds", c.emit_seconds},
          {"scatter_seconds", c.scatter_seconds}};
}

// Counters of REYES, and what it was asked for.
Json to_json(const gpurt_reyes_settings &s, const gpurt_reyes_counters &c)
{
  const auto name = [](uint32_t value, std::initializer_list<const char *> names) {
    return value < names.size() ? std::string(names.begin()[value]) : fmt::format("unknown ({})", value);
  };
  return {{"shading_rate", s.shading_rate},
          {"filter", name(s.filter, {"auto", "box", "gaussian", "mitchell"})},
          {"shading", name(s.shading, {"auto", "samples", "micropolygons", "blocks"})},
          {"shadows", s.no_shadows == 0},
          {"flatness", s.flatness},
          {"fragment_slots", s.fragment_slots},
          {"num_patches", c.num_patches},
          {"num_triangles", c.num_triangles},
          {"num_splits", c.num_splits},
          {"num_culled", c.num_culled},
          {"num_grids", c.num_grids},
          {"num_micropolygons", c.num_micropolygons},
          {"num_fragments", c.num_fragments},
          {"num_shaded", c.num_shaded},
          {"largest_queue", c.largest_queue},
          {"largest_bucket", c.largest_bucket},
          {"working_bytes", c.working_bytes},
          {"bound_seconds", c.bound_seconds},
          {"split_seconds", c.split_seconds},
          {"dice_seconds", c.dice_seconds},
          {"sample_seconds", c.sample_seconds},
          {"split_rounds", c.split_rounds},
          {"num_donated", c.num_donated},
          {"largest_fragments", c.largest_fragments},
          {"num_lost_fragments", c.num_lost_fragments}};
}

Json to_json(const gpurt_statistics &s)
{
  return {{"pipeline", name_of(s.pipeline)},
          {"accel", name_of(s.accel)},
          {"triangle_test", name_of(s.triangle_test)},
          {"max_depth", s.max_depth},
          {"tile_size", s.tile_size},
          {"num_threads", s.num_threads},
          {"width", s.width},
          {"height", s.height},
          {"seed", s.seed},
          {"samples_per_pixel", s.samples_per_pixel},
          {"num_samples", s.num_samples},
          {"num_camera_rays", s.num_camera_rays},
          {"num_bounce_rays", s.num_bounce_rays},
          {"num_shadow_rays", s.num_shadow_rays},
          {"num_nonfinite", s.num_nonfinite},
          {"num_saturated", s.num_saturated},
          {"render_seconds", s.render_seconds},
          {"generate_seconds", s.generate_seconds},
          {"trace_seconds", s.trace_seconds},
          {"shade_seconds", s.shade_seconds},
          {"shadow_seconds", s.shadow_seconds},
          {"film_seconds", s.film_seconds},
          {"build_seconds", s.build_seconds},
          // Not known is no number.
          {"estimated_error", s.estimated_error >= 0 ? Json(s.estimated_error) : Json(nullptr)},
          {"estimated_bias", s.estimated_bias >= 0 ? Json(s.estimated_bias) : Json(nullptr)},
          {"largest_sample", s.largest_sample},
          {"memory_peak_bytes", s.memory_peak_bytes},
          {"schedule", to_json(s.schedule)},
          {"photon", s.photon.photons_per_pass ? to_json(s.photon, s.photon_counters) : Json(nullptr)},
          {"reyes", s.pipeline == GPURT_PIPELINE_REYES ? to_json(s.reyes, s.reyes_counters) : Json(nullptr)},
          {"reason", s.reason}};
}

void write_statistics(const std::string &path, const std::string &scene_path, gpurt_device device,
                      gpurt_scene scene, gpurt_frame frame)
{
  const uint32_t v = gpurt_version();
  const Json json = {{"gpurt", fmt::format("{}.{}.{}", v >> 16, v >> 8 & 0xff, v & 0xff)},
                     {"scene", scene_path},
                     {"device", to_json(properties_of(device))},
                     {"facts", to_json(facts_of(scene))},
                     {"statistics", to_json(statistics_of(frame))}};
  write_file(path, json.dump(2) + "\n");
}

void print_summary(gpurt_device device, gpurt_frame frame, const std::vector<std::string> &outputs,
                   const std::string &state)
{
  const gpurt_statistics s = statistics_of(frame);
  const double rays =
      double(s.num_camera_rays + s.num_bounce_rays + s.num_shadow_rays + s.photon_counters.num_rays);
  fmt::print("{} x {} pixels, {} samples each, {} with {} on {}\n", s.width, s.height, s.samples_per_pixel,
             name_of(s.pipeline), name_of(s.accel), properties_of(device).name);
  fmt::print("rendered in {} ({:.2f} million rays/s), built in {}, peak memory {}\n",
             format_seconds(s.render_seconds), s.render_seconds > 0 ? rays / s.render_seconds * 1e-6 : 0.0,
             format_seconds(s.build_seconds), format_bytes(s.memory_peak_bytes));
  if (s.photon.photons_per_pass) {
    fmt::print("{} photons a pass, {:.3g} million stored, radius {:.4g} to {:.4g}\n",
               s.photon.photons_per_pass, double(s.photon_counters.num_stored) * 1e-6,
               s.photon.initial_radius, s.photon_counters.smallest_radius);
  }
  if (s.estimated_error >= 0) {
    std::string parts;
    if (s.photon.photons_per_pass && s.estimated_bias < 0) parts = " of noise, the bias is not known";
    else if (s.photon.photons_per_pass) parts = fmt::format(" ({:.3g} of it bias)", s.estimated_bias);
    fmt::print("estimated relMSE {:.3g}{}, largest sample {:.4g}\n", s.estimated_error, parts,
               s.largest_sample);
  }
  if (s.num_nonfinite > 0) fmt::print("{} samples were not finite and left out\n", s.num_nonfinite);
  std::string files;
  for (const std::string &path : outputs) files += (files.empty() ? "" : ", ") + path;
  if (!state.empty()) files += (files.empty() ? "" : ", ") + state;
  if (!files.empty()) fmt::print("wrote {}\n", files);
}

}  // namespace cli
