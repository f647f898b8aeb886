// Before a job of photon mapping renders for a time: a few passes on a frame of their own, which tell how many photons and which
// radius make the least error in the time. They may take a tenth of it.
#include <algorithm>
#include <cmath>

#include "frame/error_estimate.h"
#include "frame/job.h"
#include "frame/photon_settings.h"
#include "frame/photon_trial.h"
#include "photon_desc.h"
#include "steady_seconds.h"

namespace gpurt {

namespace {

constexpr double trial_share = 0.1;                        // of the time
constexpr uint64_t fewest_passes = 32, most_passes = 128;  // that tell something, and enough
constexpr double most_photons = 32;                        // over the usual number
constexpr uint64_t look_ns = 20'000'000;                   // between looks whether the job was cancelled

// Tiles along a frame's longer side. The pilot's discs are narrower, so that blotches are, mostly.
constexpr uint32_t tiles_of_side = 16;

// Means over the pixels of a frame, of the plain quotients: where two frames are compared, caution would hide the difference.
// Tiles are taken as independent: the bias's deviation follows from how much they differ.
PhotonTrial::Error error_of(uint32_t width, uint32_t height, const MomentSource &moments)
{
  const uint32_t tile_size = (std::max(width, height) + tiles_of_side - 1) / tiles_of_side;
  const uint32_t num_columns = (width + tile_size - 1) / tile_size;
  std::vector<double> biases(size_t(num_columns) * ((height + tile_size - 1) / tile_size), 0.0);
  std::vector<PixelMoments> row(width);
  PhotonTrial::Error sum{};
  for (uint32_t y = 0; y < height; ++y) {
    moments(y, y + 1, row.data());
    for (uint32_t x = 0; x < width; ++x) {
      const PixelMoments &m = row[x];
      for (int k = 0; k < 3; ++k) {
        const double divisor = double(m.mean[k]) * double(m.mean[k]) + 0.01;
        if (!std::isfinite(m.variance[k]) || !std::isfinite(m.bias2[k])) continue;
        sum.noise += double(m.variance[k]) / divisor;
        biases[size_t(y / tile_size) * num_columns + x / tile_size] += double(m.bias2[k]) / divisor;
      }
    }
  }
  double squares = 0;
  for (const double bias : biases) {
    sum.bias += bias;
    squares += bias * bias;
  }
  const double n = 3.0 * width * height;
  return {sum.noise / n, sum.bias / n, std::sqrt(squares) / n};
}

// What photons, their maps and gathers took so far, and paths from the eye. Films are added once a job by the host, and jobs
// for a time have few.
struct StageSeconds {
  double photons, paths;
};
StageSeconds stage_seconds(const RenderCounters &c)
{
  return {c.photon.trace_seconds + c.photon.build_seconds + c.photon.gather_seconds,
          c.generate_seconds + c.trace_seconds + c.shade_seconds + c.shadow_seconds};
}

}  // namespace

void Job::prepare_photons()
{
  emission_ = make_emission_table(*frame_->scene().compiled);
  photon_request_.emission = emission_.view();
  // Settings that were free when the job was submitted may have been chosen since by the one before it.
  const FrameTotals t = frame_->totals();
  const FrameSettings &f = frame_->settings();
  const bool is_first = t.counters.num_samples == 0;
  if (!is_first) resolve_photon_settings(desc_.photon, t.photon, uint64_t(f.width) * f.height);
  float widest_radius = 0;
  PhotonSettings settings = frame_->photon_settings(photon_request_.emission, widest_radius);
  uint64_t area = 0;
  for (const gpurt_tile &tile : tiles_) area += uint64_t(tile.x1 - tile.x0) * (tile.y1 - tile.y0);
  const bool is_free = widest_radius > 0 || desc_.photon.photons_per_pass == 0;
  if (is_first && is_free && desc_.time_limit_s > 0 && area == uint64_t(f.width) * f.height &&
      settings.estimator == PhotonEstimator::Memoryless && emission_.view().cdf != nullptr)
    settings = tune_photons(settings, widest_radius);
  photon_request_.settings = settings;
}

// Brings a frame to num_passes. False: cancelled.
bool Job::try_photons(const std::shared_ptr<Frame> &frame, const PhotonSettings &settings,
                      uint64_t num_passes) const
{
  gpurt_render_desc desc = GPURT_RENDER_DESC_INIT;
  desc.pipeline = GPURT_PIPELINE_PHOTON;
  desc.samples_per_pixel = uint32_t(num_passes);
  desc.max_depth = desc_.max_depth;
  desc.tile_size = desc_.tile_size;
  desc.photon = describe(settings);
  const std::shared_ptr<Job> job = submit(frame, desc, {});
  for (;;) {
    try {
      job->wait(look_ns);
      return true;
    } catch (const Error &e) {
      if (e.result() != GPURT_ERROR_TIMEOUT) throw;
    }
    if (cancelled_) return false;
  }
}

PhotonSettings Job::tune_photons(const PhotonSettings &settings, float widest_radius)
{
  const FrameSettings &f = frame_->settings();
  gpurt_frame_desc desc = GPURT_FRAME_DESC_INIT;
  desc.width = f.width;
  desc.height = f.height;
  desc.camera = f.camera;
  desc.outputs = 1u << GPURT_OUTPUT_COLOR | 1u << GPURT_OUTPUT_BIAS;
  desc.frame_index = f.frame_index;
  desc.seed = ~f.seed;  // what is chosen must not depend on the samples that are made with it
  const double seconds = trial_share * desc_.time_limit_s;
  try {
    const auto wide = std::make_shared<Frame>(frame_->scene(), desc);
    // The first pass has delays of its own, and jobs of few passes others: so the last ones are what counts.
    uint64_t num_passes = 1;
    if (!try_photons(wide, settings, num_passes)) return settings;
    const double start = steady_seconds();
    double each = 0, share = 0;  // of a pass, and of photons in it
    for (;;) {
      const double before = steady_seconds(), left = 0.5 * seconds - (before - start);
      const StageSeconds stages = stage_seconds(wide->totals().counters);
      uint64_t goal = num_passes == 1 ? 2 : num_passes == 2 ? 6 : fewest_passes;
      if (num_passes >= fewest_passes) {
        goal = std::min(num_passes + uint64_t(std::max(left / each, 0.0)), most_passes);
        if (goal < num_passes + num_passes / 2) break;
      } else if (double(goal - num_passes) * each > (num_passes == 2 ? 0.25 * seconds : seconds)) {
        return settings;  // without having lost much
      }
      if (!try_photons(wide, settings, goal)) return settings;
      const StageSeconds since = stage_seconds(wide->totals().counters);
      const double photons = since.photons - stages.photons, paths = since.paths - stages.paths;
      each = (steady_seconds() - before) / double(goal - num_passes);
      share = photons / (photons + paths);
      num_passes = goal;
    }
    PhotonSettings half = settings;
    half.initial_radius *= 0.5f;
    const auto narrow = std::make_shared<Frame>(frame_->scene(), desc);
    if (!try_photons(narrow, half, num_passes)) return settings;

    const auto error = [&](const Frame &frame) {
      const std::unique_lock<std::mutex> lock = frame.host_sums();
      return error_of(f.width, f.height, [&](uint32_t y, uint32_t, PixelMoments *out) {
        const SumRow row = frame.row_of(y);
        for (uint32_t x = 0; x < f.width; ++x) moments_of(row, x, out[x]);
      });
    };
    const PhotonTrial trial{double(num_passes), each * (1 - share), each * share, error(*wide),
                            error(*narrow)};
    const bool keeps_photons = desc_.photon.photons_per_pass != 0;
    const double room = double(most_default_photons) / settings.photons_per_pass;
    const PhotonChoice choice =
        choose_photons(trial, 0.9 * (desc_.time_limit_s - elapsed_seconds()),
                       {desc_.samples_per_pixel != 0 ? double(desc_.samples_per_pixel) : 4e9,
                        keeps_photons ? 1 : std::min(most_photons, room),
                        double(widest_radius) / double(settings.initial_radius), !(widest_radius > 0)});
    PhotonSettings chosen = settings;
    chosen.photons_per_pass = uint32_t(double(settings.photons_per_pass) * choice.photons);
    chosen.initial_radius = float(double(settings.initial_radius) * choice.radius);
    frame_->set_photon_settings(chosen);
    photon_reason_ = fmt::format(": {} photons a pass and a radius of {:.3g} by {} trial passes",
                                 chosen.photons_per_pass, chosen.initial_radius, 2 * num_passes);
    return chosen;
  } catch (const Error &e) {
    // The usual settings do without a second frame.
    if (e.result() != GPURT_ERROR_OUT_OF_MEMORY) throw;
    return settings;
  }
}

}  // namespace gpurt
