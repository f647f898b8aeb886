#include "planner/plan.h"

#include <cmath>
#include <cstring>

#include "core/accel/kd_tree.h"
#include "error.h"

namespace gpurt {
namespace {

constexpr uint32_t default_samples_per_pixel = 64;
constexpr uint32_t reyes_samples_per_pixel = 9, reyes_max_depth = 2;

void check_factor(float value, const char *field)
{
  if (!(value >= 0) || std::isinf(value))
    fail_invalid("{} is {}; it must be 0 or a positive number", field, value);
}

// What only the kd-tree understands, as the first such field that is set; null if there is none.
const char *kd_tree_setting(const gpurt_build_desc &desc)
{
  if (desc.tree_cache_path && *desc.tree_cache_path) return "tree_cache_path";
  if (desc.max_depth != 0) return "max_depth";
  if (desc.traversal_cost != 0) return "traversal_cost";
  if (desc.empty_bonus != 0) return "empty_bonus";
  return nullptr;
}

void choose_accel(const gpurt_build_desc &desc, const DeviceInfo &device, bool has_imported_trees,
                  BuildPlan &plan)
{
  const auto choose = [&](Accel accel, std::string why) {
    plan.options.accel = accel;
    plan.reason = fmt::format("accel {}: {}", accel_name(accel), why);
  };
  if (desc.accel != GPURT_ACCEL_AUTO) return choose(Accel(desc.accel), "as asked");
  const bool is_cuda = device.type == GPURT_DEVICE_CUDA;
  if (has_imported_trees) return choose(Accel::KdTree, "a tree was imported");
  if (const char *setting = kd_tree_setting(desc))
    return choose(Accel::KdTree, fmt::format("{} is set", setting));
  // The backend compares trees of the scene, and says why.
  if (is_cuda) return choose(Accel::Auto, "of a CUDA device's choice");
  if (desc.triangle_test == GPURT_TRIANGLE_DOUBLE)
    return choose(Accel::KdTree, "embree has no double triangle test");
  choose(Accel::Embree, "the fastest on CPUs");
}

}  // namespace

BuildPlan plan_build(const gpurt_build_desc &desc, const DeviceInfo &device, bool has_imported_trees)
{
  if (desc.max_depth > uint32_t(kd_max_depth))
    fail_invalid("max_depth is {}; at most {}", desc.max_depth, kd_max_depth);
  check_factor(desc.traversal_cost, "traversal_cost");
  check_factor(desc.empty_bonus, "empty_bonus");
  check_factor(desc.patch_tolerance, "patch_tolerance");
  check_factor(desc.patch_pixels, "patch_pixels");
  if (desc.patch_pixels == 0) {
    const auto refuse = [](const char *field, uint32_t value) {
      if (value != 0)
        fail_invalid("{} is {}, but patch_pixels is 0, which sets no bound; set patch_pixels too", field,
                     value);
    };
    refuse("patch_camera", desc.patch_camera);
    refuse("patch_width", desc.patch_width);
    refuse("patch_height", desc.patch_height);
  }

  BuildPlan plan;
  plan.options.triangle_test = TriangleTest(desc.triangle_test);
  plan.options.quality = BuildQuality(desc.quality);
  plan.options.max_depth = desc.max_depth;
  plan.options.traversal_cost = desc.traversal_cost;
  plan.options.empty_bonus = desc.empty_bonus;
  if (desc.tree_cache_path) plan.options.cache_path = desc.tree_cache_path;
  choose_accel(desc, device, has_imported_trees, plan);

  const Accel accel = plan.options.accel;
  if (accel == Accel::Embree && device.type != GPURT_DEVICE_CPU) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "embree runs on the CPU device alone; use GPURT_ACCEL_BVH or GPURT_ACCEL_KDTREE");
  }
  if (accel == Accel::Embree && desc.triangle_test == GPURT_TRIANGLE_DOUBLE) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "embree has no double triangle test; use GPURT_ACCEL_KDTREE, or leave accel AUTO");
  }
  if (accel != Accel::KdTree) {
    if (const char *setting = kd_tree_setting(desc)) {
      plan.warnings.push_back(fmt::format("{} has no effect with accel {}; it is a setting of kdtree",
                                          setting, accel_name(accel)));
    }
    if (has_imported_trees) {
      plan.warnings.push_back(
          fmt::format("the imported kd-trees have no effect with accel {}; commit with kdtree to use "
                      "them",
                      accel_name(accel)));
    }
  }
  return plan;
}

namespace {

void check_reyes(const gpurt_render_desc &d)
{
  const gpurt_reyes_settings &r = d.reyes;
  if (d.max_depth > 2) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "max_depth is {}, but GPURT_PIPELINE_REYES has emission (1) and direct light (2) alone; use "
         "GPURT_PIPELINE_PATH for more",
         d.max_depth);
  }
  if (r.shading_rate != 0 && !(r.shading_rate >= 0x1p-8f && r.shading_rate <= 0x1p8f))
    fail_invalid("reyes.shading_rate is {}; it must lie in [2^-8, 2^8], or be 0 for 0.25", r.shading_rate);
  if (uint32_t(r.filter) > GPURT_REYES_FILTER_MITCHELL)
    fail_invalid("reyes.filter is {}; it must be a value of gpurt_reyes_filter", uint32_t(r.filter));
  if (uint32_t(r.shading) > GPURT_REYES_SHADING_BLOCKS)
    fail_invalid("reyes.shading is {}; it must be a value of gpurt_reyes_shading", uint32_t(r.shading));
  if (r.no_shadows > 1) fail_invalid("reyes.no_shadows is {}; it must be 0 or 1", r.no_shadows);
  if (!(r.flatness >= 0 && r.flatness <= 16))
    fail_invalid("reyes.flatness is {}; it must lie in [0, 16] pixels", r.flatness);
  if (r.fragment_slots > 64)
    fail_invalid("reyes.fragment_slots is {}; it must be at most 64", r.fragment_slots);
}

// Settings of a pipeline that is not asked for are a mistake.
void refuse_reyes_settings(const gpurt_reyes_settings &r)
{
  const auto refuse = [](const char *field, auto value) {
    fail_invalid("reyes.{} is {}, but the pipeline is not GPURT_PIPELINE_REYES; set it to 0", field, value);
  };
  if (r.shading_rate != 0) refuse("shading_rate", r.shading_rate);
  if (r.filter != 0) refuse("filter", uint32_t(r.filter));
  if (r.shading != 0) refuse("shading", uint32_t(r.shading));
  if (r.no_shadows != 0) refuse("no_shadows", r.no_shadows);
  if (!(r.flatness == 0)) refuse("flatness", r.flatness);
  if (r.fragment_slots != 0) refuse("fragment_slots", r.fragment_slots);
}

}  // namespace

RenderPlan plan_render(const gpurt_render_desc &desc)
{
  RenderPlan plan{desc, "pipeline path: as asked"};
  gpurt_render_desc &d = plan.desc;
  switch (d.pipeline) {
    case GPURT_PIPELINE_AUTO:
      d.pipeline = GPURT_PIPELINE_PATH;
      plan.reason = "pipeline path: the one that renders everything";
      break;
    case GPURT_PIPELINE_PATH:
      break;
    case GPURT_PIPELINE_PHOTON:
      plan.reason = "pipeline photon: as asked";
      break;
    case GPURT_PIPELINE_REYES:
      plan.reason = "pipeline reyes: as asked";
      check_reyes(d);
      break;
    case GPURT_PIPELINE_HYBRID:
      fail(GPURT_ERROR_UNSUPPORTED,
           "GPURT_PIPELINE_HYBRID is not supported by this version; use GPURT_PIPELINE_PATH");
    default:
      fail_invalid("pipeline is {}; it must be a value of gpurt_pipeline", uint32_t(d.pipeline));
  }
  constexpr gpurt_photon_settings no_photons = GPURT_PHOTON_SETTINGS_INIT;
  if (d.pipeline != GPURT_PIPELINE_PHOTON && std::memcmp(&d.photon, &no_photons, sizeof d.photon) != 0) {
    fail_invalid(
        "settings of photon mapping are set, but the pipeline is not GPURT_PIPELINE_PHOTON; leave photon "
        "zero "
        "or choose that pipeline");
  }
  if (!(d.target_error >= 0) || std::isinf(d.target_error)) {
    fail_invalid("target_error is {}; it must be 0 or a positive number", d.target_error);
  }
  if (!(d.time_limit_s >= 0) || std::isinf(d.time_limit_s)) {
    fail_invalid("time_limit_s is {}; it must be 0 or a positive number", d.time_limit_s);
  }
  const bool is_reyes = d.pipeline == GPURT_PIPELINE_REYES;
  if (!is_reyes) refuse_reyes_settings(d.reyes);
  if (d.max_depth == 0) d.max_depth = is_reyes ? reyes_max_depth : default_max_depth;
  if (d.samples_per_pixel == 0 && d.target_error == 0 && d.time_limit_s == 0) {
    d.samples_per_pixel = is_reyes ? reyes_samples_per_pixel : default_samples_per_pixel;
    plan.reason += fmt::format("; {} samples per pixel: the default", d.samples_per_pixel);
  }
  return plan;
}

}  // namespace gpurt
