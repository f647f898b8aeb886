// gpurt_frame_*: forwards to lib/frame.
#include "frame/frame.h"

#include <vector>

#include "api/descriptor.h"
#include "api/guard.h"
#include "api/objects.h"
#include "api/read_schedule.h"
#include "frame/job.h"
#include "frame/reyes_desc.h"
#include "frame/state_file.h"
#include "photon_desc.h"
#include "planner/plan.h"
#include "schedule_desc.h"

namespace gpurt::api {
namespace {

// Tiles are copied before they are used, so that their memory may go once the call returns.
std::span<const gpurt_tile> checked_tiles(const gpurt_tile *tiles, size_t num_tiles)
{
  if (!tiles && num_tiles != 0) fail_invalid("tiles is NULL, but num_tiles is {}", num_tiles);
  if (tiles && num_tiles == 0) {
    fail_invalid("num_tiles is 0, but tiles is given; pass NULL and 0 for the whole frame");
  }
  if (num_tiles > UINT32_MAX) fail_invalid("num_tiles is {}; at most {}", num_tiles, UINT32_MAX);
  return {tiles, num_tiles};
}

bool is_device_memory(const Backend &backend, const void *data)
{
  if (backend.info().type != GPURT_DEVICE_CUDA) return false;
  try {
    return backend.holds(data);
  } catch (const Error &) {
    return false;  // the device is lost: it has no memory any more
  }
}

}  // namespace
}  // namespace gpurt::api

using namespace gpurt;
using namespace gpurt::api;

gpurt_result gpurt_frame_create(gpurt_scene scene, const gpurt_frame_desc *desc, gpurt_frame *out_frame)
{
  return guard([&] {
    const auto s = get(scene, "scene");
    const gpurt_frame_desc d = read_optional_descriptor(desc);
    require(out_frame, "out_frame");
    const auto object = std::make_shared<FrameObject>();
    object->scene = s;
    object->commit = s->require_commit();
    const Commit &commit = *object->commit;
    object->frame = std::make_shared<Frame>(FrameScene{commit.committed, commit.compiled, s->device->memory(),
                                                       s->device->info().num_threads, commit.build_seconds},
                                            d);
    *out_frame = publish<gpurt_frame>(object);
  });
}

gpurt_result gpurt_frame_retain(gpurt_frame frame)
{
  return guard([&] { retain(frame, "frame"); });
}

gpurt_result gpurt_frame_release(gpurt_frame frame)
{
  return guard([&] { release(frame, "frame"); });
}

gpurt_result gpurt_frame_submit(gpurt_frame frame, const gpurt_render_desc *desc, const gpurt_tile *tiles,
                                size_t num_tiles, gpurt_job *out_job)
{
  return guard([&] {
    const auto f = get(frame, "frame");
    const gpurt_render_desc d = read_optional_descriptor(desc);
    require(out_job, "out_job");
    check_enum(d.pipeline, GPURT_PIPELINE_HYBRID + 1, "pipeline", "gpurt_pipeline");
    const Schedule asked = checked_schedule(d.schedule);
    check_enum(d.photon.estimator, GPURT_PHOTON_ESTIMATOR_ADAPTIVE + 1, "photon.estimator",
               "gpurt_photon_estimator");
    check_enum(d.photon.kernel, GPURT_PHOTON_KERNEL_CONE + 1, "photon.kernel", "gpurt_photon_kernel");
    RenderPlan plan = plan_render(d);
    const bool has_photons = plan.desc.pipeline == GPURT_PIPELINE_PHOTON;
    if (has_photons) f->commit->committed->require_photons();
    if (has_photons) plan.desc.schedule = describe(resolve_fused_schedule(asked, "photon mapping"));
    // What REYES does with it depends on the frame's settings.
    else if (plan.desc.pipeline != GPURT_PIPELINE_REYES)
      plan.desc.schedule = describe(f->commit->committed->resolve_schedule(asked, ScheduleUse::Render));
    const auto object = std::make_shared<JobObject>();
    object->frame = f;
    object->job = Job::submit(f->frame, plan.desc, checked_tiles(tiles, num_tiles));
    *out_job = publish<gpurt_job>(object);
  });
}

gpurt_result gpurt_frame_read(gpurt_frame frame, gpurt_output output, void *data, uint64_t size_bytes)
{
  return guard([&] {
    const auto f = get(frame, "frame");
    check_enum(output, GPURT_OUTPUT_COUNT, "output", "gpurt_output");
    require(data, "data");
    Backend &backend = *f->scene->device->backend;
    // The host cannot write there: either the device does, or it is given what the host has written.
    if (!is_device_memory(backend, data)) f->frame->read(output, data, size_bytes);
    else if (!f->frame->read_on_device(output, data, size_bytes)) {
      std::vector<std::byte> values(size_bytes);
      f->frame->read(output, values.data(), size_bytes);
      backend.copy_to_device(data, values.data(), size_bytes);
    }
  });
}

gpurt_result gpurt_frame_save(gpurt_frame frame, const char *path)
{
  return guard([&] {
    const auto f = get(frame, "frame");
    require(path, "path");
    f->frame->save(path);
  });
}

gpurt_result gpurt_frame_merge(gpurt_frame frame, gpurt_frame other)
{
  return guard([&] {
    const auto to = get(frame, "frame");
    const auto from = get(other, "other");
    if (to == from) fail_invalid("a frame cannot be merged with itself: its samples would count twice");
    to->frame->merge(*from->frame);
  });
}

gpurt_result gpurt_frame_load_state(gpurt_frame frame, const char *path)
{
  return guard([&] {
    const auto f = get(frame, "frame");
    require(path, "path");
    f->frame->load_state(path);
  });
}

gpurt_result gpurt_frame_get_statistics(gpurt_frame frame, gpurt_statistics *out_statistics)
{
  return guard([&] {
    const auto f = get(frame, "frame");
    check_output(out_statistics, "out_statistics");
    gpurt_statistics statistics = GPURT_STATISTICS_INIT;
    f->frame->statistics(statistics);
    // The frame knows why its samples are what they are, the commit why its accelerator is.
    const std::string reason =
        f->commit->accel_reason + (statistics.reason[0] ? "; " : "") + statistics.reason;
    statistics.reason[reason.copy(statistics.reason, sizeof statistics.reason - 1)] = 0;
    write_output(out_statistics, statistics, "out_statistics");
  });
}

gpurt_result gpurt_state_read_info(const char *path, gpurt_state_info *out_info)
{
  return guard([&] {
    require(path, "path");
    check_output(out_info, "out_info");
    const FrameState state = read_state_header(path);
    gpurt_state_info info = GPURT_STATE_INFO_INIT;
    info.width = state.settings.width;
    info.height = state.settings.height;
    info.camera = state.settings.camera;
    info.outputs = state.settings.outputs;
    info.frame_index = state.settings.frame_index;
    info.seed = state.settings.seed;
    info.first_sample = state.settings.first_sample;
    info.num_samples = state.totals.counters.num_samples;
    info.scene_hash = state.scene_hash;
    info.pipeline = state.totals.pipeline;
    info.accel = gpurt_accel(state.accel);
    info.triangle_test = gpurt_triangle_test(state.triangle_test);
    info.max_depth = state.totals.max_depth;
    info.photon = describe(state.totals.photon);
    info.reyes = public_settings(state.totals.reyes);
    write_output(out_info, info, "out_info");
  });
}
