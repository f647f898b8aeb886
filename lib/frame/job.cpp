#include "frame/job.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "schedule_desc.h"
#include "steady_seconds.h"

namespace gpurt {

namespace {

constexpr uint32_t default_samples = 64;
constexpr uint32_t default_depth = 17;
constexpr uint32_t reyes_depth = 2;  // emission and direct light
// A pass ends with a device that runs empty: the fastest ones get passes that are long beside that.
constexpr uint64_t max_unit_samples = 1024;
constexpr uint64_t max_unit_paths = 65536;
constexpr double unit_seconds = 0.05;    // what a unit may take a worker, so that cancelling is quick
constexpr double passes_seconds = 0.15;  // what passes of photon mapping may take together
constexpr double progress_interval_seconds = 0.05;

uint64_t area(const gpurt_tile &t) { return uint64_t(t.x1 - t.x0) * (t.y1 - t.y0); }

uint64_t area(std::span<const gpurt_tile> tiles)
{
  uint64_t sum = 0;
  for (const gpurt_tile &t : tiles) sum += area(t);
  return sum;
}

const char *pipeline_name(gpurt_pipeline pipeline)
{
  switch (pipeline) {
    case GPURT_PIPELINE_PATH:
      return "path";
    case GPURT_PIPELINE_PHOTON:
      return "photon";
    case GPURT_PIPELINE_REYES:
      return "reyes";
    case GPURT_PIPELINE_HYBRID:
      return "hybrid";
    default:
      return nullptr;
  }
}

// Puts values for zeros and refuses what cannot be done.
gpurt_render_desc resolve(gpurt_render_desc desc, const FrameSettings &frame,
                          std::span<const gpurt_tile> tiles, uint32_t num_threads)
{
  if (desc.pipeline == GPURT_PIPELINE_AUTO) desc.pipeline = GPURT_PIPELINE_PATH;
  const char *name = pipeline_name(desc.pipeline);
  if (!name) fail_invalid("pipeline is {}; it is none of gpurt_pipeline", int(desc.pipeline));
  if (desc.pipeline == GPURT_PIPELINE_HYBRID) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "the pipeline {} is not supported by this version; use path, photon, reyes or auto", name);
  }
  if (!(desc.target_error >= 0) || std::isinf(desc.target_error))
    fail_invalid("target_error is {}; it must be 0 or a positive number", desc.target_error);
  if (!(desc.time_limit_s >= 0) || std::isinf(desc.time_limit_s))
    fail_invalid("time_limit_s is {}; it must be 0 or a positive number", desc.time_limit_s);
  if (desc.samples_per_pixel == 0 && desc.target_error == 0 && desc.time_limit_s == 0)
    desc.samples_per_pixel = default_samples;
  if (desc.tile_size > max_tile_size)
    fail_invalid("tile_size is {}; it is at most {}, or 0 for the library's choice", desc.tile_size,
                 max_tile_size);
  if (desc.target_error > 0 && area(tiles) != uint64_t(frame.width) * frame.height) {
    fail_invalid(
        "target_error is the error of the whole frame, but the tiles cover only {} of its {} pixels; submit "
        "the "
        "whole frame or give samples_per_pixel",
        area(tiles), uint64_t(frame.width) * frame.height);
  }
  const bool is_reyes = desc.pipeline == GPURT_PIPELINE_REYES;
  if (desc.max_depth == 0) desc.max_depth = is_reyes ? reyes_depth : default_depth;
  if (desc.pipeline == GPURT_PIPELINE_PHOTON && desc.max_depth > max_photon_depth)
    fail_invalid("max_depth is {}; photon mapping has at most {}", desc.max_depth, max_photon_depth);
  // A tile of REYES looks at all that it may see, whatever its size.
  if (desc.tile_size == 0) desc.tile_size = choose_tile_size(tiles, num_threads, is_reyes ? 64 : 32);
  return desc;
}

}  // namespace

std::shared_ptr<Job> Job::submit(std::shared_ptr<Frame> frame, const gpurt_render_desc &desc,
                                 std::span<const gpurt_tile> tiles)
{
  const FrameSettings &settings = frame->settings();
  const gpurt_tile whole{0, 0, settings.width, settings.height};
  if (tiles.empty()) tiles = {&whole, 1};
  else check_tiles(tiles, settings.width, settings.height);
  const gpurt_render_desc resolved = resolve(desc, settings, tiles, frame->scene().num_threads);

  // The constructor starts no thread: a job that cannot be queued leaves nothing behind.
  std::shared_ptr<Job> job(new Job(frame, resolved, {tiles.begin(), tiles.end()}));
  const std::scoped_lock lock(frame->jobs_mutex_);
  if (frame->first_gap_ != Frame::no_gap) {
    fail_invalid(
        "the frame cannot be continued: the samples of pixel ({}, {}) have gaps; merge the missing parts "
        "first",
        frame->first_gap_ % settings.width, frame->first_gap_ / settings.width);
  }
  if (resolved.pipeline == GPURT_PIPELINE_REYES) {
    const CommittedScene &scene = *frame->scene().committed;
    scene.require_reyes();
    job->reyes_ = frame->resolve_reyes(resolved.reyes);
    const Schedule asked = job->schedule_;
    job->reyes_schedule_ = scene.resolve_reyes_schedule(asked, job->reyes_);
    job->schedule_ =
        scene.resolve_schedule(rays_of_reyes(asked, "GPURT_PIPELINE_REYES"), ScheduleUse::Render);
    job->desc_.schedule = describe(job->schedule_);
    job->desc_.schedule.launch = gpurt_launch(job->reyes_schedule_.split);
    job->desc_.schedule.traversal = gpurt_traversal(job->reyes_schedule_.stages);
  }
  frame->begin_samples(resolved, job->reyes_);
  frame->jobs_.push_back(job.get());
  try {
    job->thread_ = std::thread(&Job::run, job.get());
  } catch (...) {
    frame->jobs_.pop_back();
    throw;
  }
  return job;
}

Job::Job(std::shared_ptr<Frame> frame, const gpurt_render_desc &desc, std::vector<gpurt_tile> tiles)
    : frame_(std::move(frame)), desc_(desc), tiles_(std::move(tiles)), schedule_(schedule_from(desc.schedule))
{}

Job::~Job()
{
  cancel();
  if (thread_.joinable()) thread_.join();
}

void Job::cancel()
{
  cancelled_ = true;
  // A job that still waits for its turn looks again. The lock keeps the message from falling between its look and sleep.
  {
    const std::scoped_lock lock(frame_->jobs_mutex_);
  }
  frame_->jobs_changed_.notify_all();
}

void Job::wait(uint64_t timeout_ns)
{
  std::unique_lock lock(mutex_);
  const auto is_finished = [&] { return finished_; };
  // Longer than the clock can count is for ever.
  if (timeout_ns >= uint64_t(1) << 62) finished_changed_.wait(lock, is_finished);
  else if (!finished_changed_.wait_for(lock, std::chrono::nanoseconds(timeout_ns), is_finished)) {
    fail(GPURT_ERROR_TIMEOUT, "the job still runs after {} s of waiting", double(timeout_ns) * 1e-9);
  }
  if (result_ != GPURT_OK) throw Error(result_, error_);
}

void Job::finish(gpurt_result result, std::string error)
{
  {
    const std::scoped_lock lock(mutex_);
    finished_ = true;
    result_ = result;
    error_ = std::move(error);
  }
  finished_changed_.notify_all();
}

// False: cancelled before its turn.
bool Job::wait_for_turn()
{
  std::unique_lock lock(frame_->jobs_mutex_);
  frame_->jobs_changed_.wait(lock, [&] { return cancelled_ || frame_->jobs_.front() == this; });
  return !cancelled_;
}

void Job::run()
{
  gpurt_result result = GPURT_OK;
  std::string error;
  try {
    if (wait_for_turn()) render();
    if (cancelled_ && share_ < 1) {
      result = GPURT_ERROR_CANCELLED;
      error = "the job was cancelled; the frame keeps the samples that it has";
    }
  } catch (const Error &e) {
    result = e.result();
    error = e.what();
  } catch (const std::bad_alloc &) {
    result = GPURT_ERROR_OUT_OF_MEMORY;
    error = "no memory for the job; make tiles or the frame smaller";
  } catch (const std::exception &e) {
    result = GPURT_ERROR_INTERNAL;
    error = fmt::format("rendering failed: {}", e.what());
  } catch (...) {
    // Of no type of ours: the caller's progress function can throw anything.
    result = GPURT_ERROR_INTERNAL;
    error = "rendering failed: an exception of unknown type";
  }
  {
    const std::scoped_lock lock(frame_->jobs_mutex_);
    std::erase(frame_->jobs_, this);
  }
  frame_->jobs_changed_.notify_all();
  finish(result, std::move(error));
}

std::vector<Region> Job::plan() const
{
  const FrameState &state = frame_->state_;
  const PixelSets sets = frame_->pixel_sets();
  const auto set_of = [&](uint32_t x, uint32_t y) { return sets.of(frame_->pixel(x, y)); };
  std::vector<gpurt_tile> uniform = cut_tiles(tiles_, desc_.tile_size);
  if (!sets.has_one_set()) {
    for (const gpurt_tile &tile : std::exchange(uniform, {})) split_uniform(tile, set_of, uniform);
  }
  std::vector<Region> regions;
  for (const gpurt_tile &tile : uniform) {
    const uint32_t set = set_of(tile.x0, tile.y0);
    const uint64_t first =
        set == SampleSets::empty ? state.settings.first_sample : state.sets.ranges(set)[0].begin;
    regions.push_back({tile, first, state.sets.num_samples(set)});
  }
  return regions;
}

double Job::elapsed_seconds() const { return steady_seconds() - start_seconds_; }

void Job::render()
{
  start_seconds_ = steady_seconds();
  frame_->set_outcome(desc_.tile_size, desc_.schedule, "rendering");
  if (has_photons()) prepare_photons();
  is_on_device_ = !has_photons() && frame_->take_to_device();
  if (!is_on_device_) frame_->leave_device();
  regions_ = plan();
  uint64_t most = 0;
  for (const Region &r : regions_) most = std::max(most, r.num_samples);

  const uint64_t limit = desc_.samples_per_pixel != 0 ? desc_.samples_per_pixel : ~uint32_t(0);
  uint64_t goal = desc_.target_error > 0 ? std::min(limit, checkpoint_from(most)) : limit;
  if (desc_.target_error > 0 || desc_.samples_per_pixel != 0) {
    double expected = 0;
    for (const Region &r : regions_)
      expected += double(area(r.tile)) * double(goal - std::min(goal, r.num_samples));
    expected_ = expected;
  }
  std::string reason;
  for (;;) {
    if (!render_to(goal)) {
      reason = fmt::format("another pass would not have fit into {} s", desc_.time_limit_s);
      break;
    }
    if (cancelled_) return;
    double error = -1;
    if (desc_.target_error > 0) {
      error = frame_->estimated_error().total();
      if (error >= 0 && error <= double(desc_.target_error)) {
        reason = fmt::format("the estimated error {:.3g} is below {:.3g}", error, desc_.target_error);
        break;
      }
    }
    if (goal >= limit) {
      if (desc_.samples_per_pixel == 0) {
        fail(GPURT_ERROR_UNSUPPORTED,
             "a film holds no more than {} samples per pixel, and the estimated error is still {}", limit,
             error);
      }
      reason = "as many as asked for";
      break;
    }
    goal = std::min(limit, checkpoint_after(goal));
    // The error falls with the number of samples: a guess for the progress alone.
    if (error > 0) {
      expected_ = std::max(double(done_) * error / double(desc_.target_error), double(done_) * 1.01);
    }
  }
  uint64_t fewest = ~uint64_t(0);
  for (const Region &r : regions_) fewest = std::min(fewest, r.num_samples);
  frame_->set_outcome(desc_.tile_size, desc_.schedule,
                      fmt::format("pipeline {}{}; stopped at {} samples per pixel: {}",
                                  pipeline_name(desc_.pipeline), photon_reason_, fewest, reason));
  share_ = 1;
  // A job that found nothing to do has done all of it too.
  const double done = std::max(1.0, double(done_));
  if (desc_.progress) desc_.progress(desc_.progress_user, done, done);
}

// The level that the next pass goes to: a few samples further than those who have fewest.
uint64_t Job::pass_samples(uint64_t num_samples, uint64_t from) const
{
  if (has_photons()) {
    // The photons of a pass serve one sample of every pixel. Devices that follow several passes hand over the film of
    // all of them at once.
    const double pass_seconds = last_seconds_per_path_ * double(area(tiles_));
    const double most = double(frame_->scene().committed->most_photon_passes());
    const double passes = pass_seconds > 0 ? std::min(passes_seconds / pass_seconds, most) : 1;
    return std::min(num_samples, from + std::max<uint64_t>(uint64_t(passes), 1));
  }
  // What REYES splits and dices serves all samples of a pass.
  if (desc_.pipeline == GPURT_PIPELINE_REYES) return std::min(num_samples, from + max_unit_samples);
  const uint64_t unit_area = uint64_t(desc_.tile_size) * desc_.tile_size;
  uint64_t samples = std::clamp<uint64_t>(max_unit_paths / unit_area, 1, max_unit_samples);
  // Before anything is measured one sample is all that is safe.
  const double thread_seconds = seconds_per_path_ * frame_->scene().num_threads * double(unit_area);
  if (thread_seconds > 0) samples = std::min(samples, uint64_t(std::max(1.0, unit_seconds / thread_seconds)));
  else samples = 1;
  return std::min(num_samples, from + samples);
}

// Brings all regions to num_samples, pass by pass. False: out of time.
bool Job::render_to(uint64_t num_samples)
{
  while (!cancelled_) {
    uint64_t fewest = num_samples;
    for (const Region &r : regions_) fewest = std::min(fewest, r.num_samples);
    if (fewest == num_samples) break;
    uint64_t level = pass_samples(num_samples, fewest);
    if (desc_.time_limit_s > 0 && seconds_per_path_ > 0) {
      // A tenth is kept in reserve for passes that turn out slower than the last one.
      const double left = 0.9 * (desc_.time_limit_s - elapsed_seconds());
      const double seconds_per_sample = seconds_per_path_ * double(area(tiles_));
      if (left < seconds_per_sample) return false;
      level = std::min(level, fewest + uint64_t(std::min(left / seconds_per_sample, 1e9)));
    }
    const std::vector<WorkUnit> units = take_units(regions_, level);
    const double before = steady_seconds();
    const uint64_t done_before = done_;
    render_pass(units);
    const double seconds = steady_seconds() - before;
    frame_->add_render_seconds(seconds);
    if (is_on_device_) frame_->secure_on_host(seconds);
    pass_seconds_ += seconds;
    if (done_ > done_before) last_seconds_per_path_ = seconds / double(done_ - done_before);
    // Passes of photon mapping are alike and short: one that was slow by chance must not end the job.
    if (has_photons() && done_ > 0) seconds_per_path_ = pass_seconds_ / double(done_);
    else if (done_ > done_before) seconds_per_path_ = seconds / double(done_ - done_before);
  }
  return true;
}

void Job::render_pass(std::span<const WorkUnit> units)
{
  std::atomic<size_t> num_delivered{0};
  RenderPass pass;
  pass.settings = frame_->path_settings(desc_.max_depth);
  pass.outputs = frame_->state_.film.outputs;
  pass.units = units;
  if (has_photons()) {
    pass.photon = &photon_request_;
    if (!frame_->state_.film.statistics.empty()) pass.statistics = frame_->state_.film.statistics.data();
  }
  if (desc_.pipeline == GPURT_PIPELINE_REYES) pass.reyes = &reyes_;
  pass.schedule = schedule_;
  pass.reyes_schedule = reyes_schedule_;
  pass.cancelled = &cancelled_;
  pass.deliver = [&](const WorkUnit &unit, const TileFilm &film, const RenderCounters &counters) {
    frame_->add_unit(unit, film, counters);
    num_delivered++;
    report_progress(uint64_t(unit.x1 - unit.x0) * (unit.y1 - unit.y0) * unit.num_samples);
  };
  FilmOnDevice on_device;
  if (is_on_device_) {
    on_device.film = frame_->on_device_.film.get();
    on_device.deliver = [&](std::span<const WorkUnit> done, const RenderCounters &counters,
                            const std::function<FilmFinds()> &add) {
      frame_->add_on_device(done, counters, add);
      num_delivered += done.size();
      uint64_t num_samples = 0;
      for (const WorkUnit &u : done) num_samples += uint64_t(u.x1 - u.x0) * (u.y1 - u.y0) * u.num_samples;
      report_progress(num_samples);
    };
    pass.on_device = &on_device;
    // Without what a job of photons that rendered nothing may have added.
    pass.outputs = frame_->settings().outputs;
  }
  try {
    frame_->scene().committed->render(pass);
  } catch (const Error &e) {
    if (e.result() != GPURT_ERROR_OUT_OF_MEMORY || !is_on_device_ || num_delivered != 0) throw;
    // Without the film there may be enough.
    frame_->leave_device();
    is_on_device_ = false;
    pass.on_device = nullptr;
    pass.outputs = frame_->state_.film.outputs;
    frame_->scene().committed->render(pass);
  }
  if (const uint64_t n = frame_->totals().num_saturated) {
    fail(GPURT_ERROR_INTERNAL,
         "{} sums of the film left their range; the image is not valid: the scene's lights are too strong",
         n);
  }
  if (!cancelled_ && num_delivered != units.size()) {
    fail(GPURT_ERROR_INTERNAL, "the backend delivered {} of {} work units", num_delivered.load(),
         units.size());
  }
}

void Job::report_progress(uint64_t new_samples)
{
  const uint64_t done = done_ += new_samples;
  const std::unique_lock lock(progress_mutex_, std::try_to_lock);
  if (!lock) return;
  const double now = elapsed_seconds();
  if (now - last_report_seconds_ < progress_interval_seconds) return;
  last_report_seconds_ = now;
  double share = expected_ > 0 ? double(done) / expected_ : 0;
  if (desc_.time_limit_s > 0) share = std::max(share, now / desc_.time_limit_s);
  // A guess may be passed; only the end of the job is the whole.
  share = std::max(share_.load(), std::min(share, 0.999));
  share_ = share;
  if (desc_.progress) desc_.progress(desc_.progress_user, double(done), double(done) / share);
}

}  // namespace gpurt
