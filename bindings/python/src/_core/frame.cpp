#include <pybind11/stl.h>

#include <array>
#include <memory>
#include <mutex>
#include <set>
#include <tuple>
#include <vector>

#include "arrays.h"
#include "objects.h"

namespace gpurt_python {

namespace {

struct LiveJobs {
  std::mutex mutex;
  std::set<const Job *> jobs;
};

// Never destroyed: jobs may be dropped while the process ends.
LiveJobs &live_jobs()
{
  static auto *instance = new LiveJobs;
  return *instance;
}

std::unique_ptr<Frame> create(const Scene &scene, uint32_t width, uint32_t height, uint32_t camera,
                              uint32_t outputs, uint32_t frame_index, uint64_t seed, uint64_t first_sample)
{
  auto frame = std::make_unique<Frame>();
  gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
  desc.width = width;
  desc.height = height;
  desc.camera = camera;
  desc.outputs = outputs;
  desc.frame_index = frame_index;
  desc.seed = seed;
  desc.first_sample = first_sample;
  call([&] { return gpurt_frame_create(scene.handle.get(), &desc, frame->handle.out()); });
  return frame;
}

std::unique_ptr<Job> submit(Frame &frame, int pipeline, uint32_t samples_per_pixel, float target_error,
                            double time_limit, uint32_t max_depth, uint32_t tile_size,
                            const py::object &tiles, const py::object &progress,
                            const std::array<uint64_t, 7> &schedule,
                            const std::tuple<uint32_t, float, int, int, uint32_t> &photon,
                            const std::tuple<float, int, int, uint32_t, float, uint32_t> &reyes)
{
  auto job = std::make_unique<Job>(CallbackId(progress));
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.pipeline = static_cast<gpurt_pipeline>(pipeline);
  desc.samples_per_pixel = samples_per_pixel;
  desc.target_error = target_error;
  desc.time_limit_s = time_limit;
  desc.max_depth = max_depth;
  desc.tile_size = tile_size;
  desc.schedule.traversal = static_cast<gpurt_traversal>(schedule[0]);
  desc.schedule.launch = static_cast<gpurt_launch>(schedule[1]);
  desc.schedule.fetch = static_cast<gpurt_fetch>(schedule[2]);
  desc.schedule.compaction = static_cast<gpurt_compaction>(schedule[3]);
  desc.schedule.shading = static_cast<gpurt_shading>(schedule[4]);
  desc.schedule.generation = static_cast<gpurt_generation>(schedule[5]);
  desc.schedule.ray_budget = schedule[6];
  int estimator = 0, kernel = 0;
  std::tie(desc.photon.photons_per_pass, desc.photon.initial_radius, estimator, kernel,
           desc.photon.remedies) = photon;
  desc.photon.estimator = static_cast<gpurt_photon_estimator>(estimator);
  desc.photon.kernel = static_cast<gpurt_photon_kernel>(kernel);
  int filter = 0, shading = 0;
  std::tie(desc.reyes.shading_rate, filter, shading, desc.reyes.no_shadows, desc.reyes.flatness,
           desc.reyes.fragment_slots) = reyes;
  desc.reyes.filter = static_cast<gpurt_reyes_filter>(filter);
  desc.reyes.shading = static_cast<gpurt_reyes_shading>(shading);
  if (job->progress.is_set()) {
    desc.progress = forward_progress;
    desc.progress_user = job->progress.user();
  }
  const std::size_t num_tiles = tiles.is_none() ? 0 : py::len(tiles);
  const auto *tile_data =
      static_cast<const gpurt_tile *>(packed_data(tiles, num_tiles * sizeof(gpurt_tile), "tiles"));
  call(
      [&] { return gpurt_frame_submit(frame.handle.get(), &desc, tile_data, num_tiles, job->handle.out()); });
  return job;
}

void read(const Frame &frame, int output, const py::array &data)
{
  const auto size_bytes = static_cast<uint64_t>(data.nbytes());
  void *memory = packed_output(data, size_bytes, "data");
  call([&] {
    return gpurt_frame_read(frame.handle.get(), static_cast<gpurt_output>(output), memory, size_bytes);
  });
}

void save(const Frame &frame, const py::bytes &path)
{
  const std::string path_text = to_path(path);
  call([&] { return gpurt_frame_save(frame.handle.get(), path_text.c_str()); });
}

void merge(Frame &frame, const Frame &other)
{
  call([&] { return gpurt_frame_merge(frame.handle.get(), other.handle.get()); });
}

void load_state(Frame &frame, const py::bytes &path)
{
  const std::string path_text = to_path(path);
  call([&] { return gpurt_frame_load_state(frame.handle.get(), path_text.c_str()); });
}

py::dict get_statistics(const Frame &frame)
{
  using namespace py::literals;
  gpurt_statistics s = GPURT_STATISTICS_INIT;
  call([&] { return gpurt_frame_get_statistics(frame.handle.get(), &s); });
  const gpurt_schedule &schedule = s.schedule;
  const gpurt_schedule_counters &counters = s.schedule_counters;
  const gpurt_photon_settings &photon = s.photon;
  const gpurt_photon_counters &photons = s.photon_counters;
  const gpurt_reyes_counters &reyes = s.reyes_counters;
  return py::dict(
      "pipeline"_a = static_cast<int>(s.pipeline), "accel"_a = static_cast<int>(s.accel),
      "triangle_test"_a = static_cast<int>(s.triangle_test), "max_depth"_a = s.max_depth,
      "tile_size"_a = s.tile_size, "num_threads"_a = s.num_threads, "width"_a = s.width,
      "height"_a = s.height, "seed"_a = s.seed, "samples_per_pixel"_a = s.samples_per_pixel,
      "num_samples"_a = s.num_samples, "num_camera_rays"_a = s.num_camera_rays,
      "num_bounce_rays"_a = s.num_bounce_rays, "num_shadow_rays"_a = s.num_shadow_rays,
      "num_nonfinite"_a = s.num_nonfinite, "num_saturated"_a = s.num_saturated,
      "render_seconds"_a = s.render_seconds, "generate_seconds"_a = s.generate_seconds,
      "trace_seconds"_a = s.trace_seconds, "shade_seconds"_a = s.shade_seconds,
      "shadow_seconds"_a = s.shadow_seconds, "film_seconds"_a = s.film_seconds,
      "build_seconds"_a = s.build_seconds, "estimated_error"_a = s.estimated_error,
      "estimated_bias"_a = s.estimated_bias, "largest_sample"_a = s.largest_sample,
      "memory_peak"_a = s.memory_peak_bytes, "reason"_a = s.reason,
      "schedule"_a = py::dict(
          "traversal"_a = static_cast<int>(schedule.traversal),
          "launch"_a = static_cast<int>(schedule.launch), "fetch"_a = static_cast<int>(schedule.fetch),
          "compaction"_a = static_cast<int>(schedule.compaction),
          "shading"_a = static_cast<int>(schedule.shading),
          "generation"_a = static_cast<int>(schedule.generation), "ray_budget"_a = schedule.ray_budget),
      "schedule_counters"_a =
          py::dict("ray_refills"_a = counters.ray_refills, "list_rounds"_a = counters.list_rounds,
                   "list_overflows"_a = counters.list_overflows, "mode_switches"_a = counters.mode_switches,
                   "packets"_a = counters.packets, "shared_triangles"_a = counters.shared_triangles,
                   "compactions"_a = counters.compactions, "sorted_hits"_a = counters.sorted_hits,
                   "counted_rays"_a = counters.counted_rays, "wave_splits"_a = counters.wave_splits,
                   "path_refills"_a = counters.path_refills, "warp_steps"_a = counters.warp_steps,
                   "lane_steps"_a = counters.lane_steps),
      "photon"_a =
          py::dict("photons_per_pass"_a = photon.photons_per_pass, "initial_radius"_a = photon.initial_radius,
                   "estimator"_a = static_cast<int>(photon.estimator),
                   "kernel"_a = static_cast<int>(photon.kernel), "remedies"_a = photon.remedies),
      "photon_counters"_a =
          py::dict("num_emitted"_a = photons.num_emitted, "num_rays"_a = photons.num_rays,
                   "num_stored"_a = photons.num_stored, "num_gathered"_a = photons.num_gathered,
                   "num_visible"_a = photons.num_visible, "num_sub_passes"_a = photons.num_sub_passes,
                   "trace_seconds"_a = photons.trace_seconds, "build_seconds"_a = photons.build_seconds,
                   "gather_seconds"_a = photons.gather_seconds, "smallest_radius"_a = photons.smallest_radius,
                   "emit_seconds"_a = photons.emit_seconds, "scatter_seconds"_a = photons.scatter_seconds),
      "reyes"_a =
          py::dict("shading_rate"_a = s.reyes.shading_rate, "filter"_a = static_cast<int>(s.reyes.filter),
                   "shading"_a = static_cast<int>(s.reyes.shading), "shadows"_a = s.reyes.no_shadows == 0,
                   "flatness"_a = s.reyes.flatness, "fragment_slots"_a = s.reyes.fragment_slots),
      "reyes_counters"_a =
          py::dict("num_patches"_a = reyes.num_patches, "num_triangles"_a = reyes.num_triangles,
                   "num_splits"_a = reyes.num_splits, "num_culled"_a = reyes.num_culled,
                   "num_grids"_a = reyes.num_grids, "num_micropolygons"_a = reyes.num_micropolygons,
                   "num_fragments"_a = reyes.num_fragments, "num_shaded"_a = reyes.num_shaded,
                   "largest_queue"_a = reyes.largest_queue, "largest_bucket"_a = reyes.largest_bucket,
                   "working_bytes"_a = reyes.working_bytes, "bound_seconds"_a = reyes.bound_seconds,
                   "split_seconds"_a = reyes.split_seconds, "dice_seconds"_a = reyes.dice_seconds,
                   "sample_seconds"_a = reyes.sample_seconds, "split_rounds"_a = reyes.split_rounds,
                   "num_donated"_a = reyes.num_donated, "largest_fragments"_a = reyes.largest_fragments,
                   "num_lost_fragments"_a = reyes.num_lost_fragments));
}

// True when the job has ended well, False when it still runs; its failure is raised.
bool wait(const Job &job, uint64_t timeout_ns)
{
  std::string message;
  const gpurt_result result =
      call_unchecked([&] { return gpurt_job_wait(job.handle.get(), timeout_ns); }, message);
  if (result == GPURT_ERROR_TIMEOUT) return false;
  if (result != GPURT_OK) raise_result(result, message);
  return true;
}

void cancel(const Job &job)
{
  call([&] { return gpurt_job_cancel(job.handle.get()); });
}

double get_progress(const Job &job)
{
  double share = 0;
  call([&] { return gpurt_job_get_progress(job.handle.get(), &share); });
  return share;
}

}  // namespace

Job::Job(CallbackId &&callback) : progress(std::move(callback))
{
  std::lock_guard lock(live_jobs().mutex);
  live_jobs().jobs.insert(this);
}

Job::~Job()
{
  std::lock_guard lock(live_jobs().mutex);
  live_jobs().jobs.erase(this);
}

void stop_jobs()
{
  // Retained under the lock, so that a job that is dropped meanwhile stays valid here.
  std::vector<gpurt_job> jobs;
  {
    std::lock_guard lock(live_jobs().mutex);
    for (const Job *job : live_jobs().jobs) {
      if (job->handle.get() && gpurt_job_retain(job->handle.get()) == GPURT_OK)
        jobs.push_back(job->handle.get());
    }
  }
  const py::gil_scoped_release release;
  for (gpurt_job job : jobs) gpurt_job_cancel(job);
  for (gpurt_job job : jobs) {
    gpurt_job_wait(job, GPURT_WAIT_FOREVER);
    gpurt_job_release(job);
  }
}

void bind_frame(py::module_ &module)
{
  py::class_<Frame>(module, "Frame")
      .def(py::init(&create), py::arg("scene"), py::arg("width"), py::arg("height"), py::arg("camera"),
           py::arg("outputs"), py::arg("frame_index"), py::arg("seed"), py::arg("first_sample"))
      .def("submit", submit, py::arg("pipeline"), py::arg("samples_per_pixel"), py::arg("target_error"),
           py::arg("time_limit"), py::arg("max_depth"), py::arg("tile_size"), py::arg("tiles"),
           py::arg("progress"), py::arg("schedule"), py::arg("photon"), py::arg("reyes"))
      .def("read", read, py::arg("output"), py::arg("data"))
      .def("save", save, py::arg("path"))
      .def("merge", merge, py::arg("other"))
      .def("load_state", load_state, py::arg("path"))
      .def("statistics", get_statistics);
  py::class_<Job>(module, "Job")
      .def("wait", wait, py::arg("timeout_ns"))
      .def("cancel", cancel)
      .def("progress", get_progress);
}

}  // namespace gpurt_python
