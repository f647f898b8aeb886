#include "frame/frame.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <chrono>
#include <cmath>
#include <cstring>

#include "frame/error_estimate.h"
#include "frame/outputs.h"
#include "frame/photon_settings.h"
#include "frame/reyes_desc.h"
#include "photon_desc.h"
#include "schedule_desc.h"

namespace gpurt {

namespace {

constexpr uint32_t always_kept =
    1u << GPURT_OUTPUT_COLOR | 1u << GPURT_OUTPUT_ALPHA | 1u << GPURT_OUTPUT_SAMPLE_COUNT;

uint32_t checked_size(uint32_t wanted, uint32_t from_camera, const char *what)
{
  const uint32_t size = wanted != 0 ? wanted : from_camera != 0 ? from_camera : 512;
  if (size > max_frame_size)
    fail_invalid("{} is {}; a frame has at most {} x {} pixels", what, size, max_frame_size, max_frame_size);
  return size;
}

FrameSettings resolve(const gpurt_frame_desc &desc, const CompiledScene &scene)
{
  if (desc.camera >= scene.cameras.size()) {
    fail_invalid(
        "camera is {}, but the committed scene has {} cameras; add one with gpurt_scene_add_camera and "
        "commit",
        desc.camera, scene.cameras.size());
  }
  if (desc.outputs >> GPURT_OUTPUT_COUNT != 0)
    fail_invalid("outputs is {:#x}; its bits are 1 << gpurt_output", desc.outputs);
  if (desc.outputs & 1u << GPURT_OUTPUT_TIME) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "GPURT_OUTPUT_TIME is not supported by this version; leave its bit out of outputs");
  }
  const CameraData &camera = scene.cameras[desc.camera];
  FrameSettings settings;
  settings.width = checked_size(desc.width, camera.width, "width");
  settings.height = checked_size(desc.height, camera.height, "height");
  settings.camera = desc.camera;
  settings.outputs = desc.outputs | always_kept;
  settings.frame_index = desc.frame_index;
  settings.seed = desc.seed;
  settings.first_sample = desc.first_sample;
  return settings;
}

struct Vec3d {
  double x, y, z;
};
Vec3d cross(Vec3d a, Vec3d b)
{
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
Vec3d normalized(Vec3d v)
{
  const double length = std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z);
  return {v.x / length, v.y / length, v.z / length};
}

// A camera's scale and shear are ignored: its view direction is kept, its up direction is made perpendicular.
Camera make_camera(const CameraData &data, uint32_t width, uint32_t height)
{
  const auto column = [&](int c) {
    return Vec3d{data.transform.m[0][c], data.transform.m[1][c], data.transform.m[2][c]};
  };
  const Vec3d z = normalized(column(2)), x = normalized(cross(column(1), z)), y = cross(z, x);
  Camera camera{};
  camera.camera_to_world = {{{float(x.x), float(y.x), float(z.x), data.transform.m[0][3]},
                             {float(x.y), float(y.y), float(z.y), data.transform.m[1][3]},
                             {float(x.z), float(y.z), float(z.z), data.transform.m[2][3]}}};
  camera.tan_half_yfov = float(std::tan(0.5 * double(data.yfov_rad)));
  camera.width = width;
  camera.height = height;
  return camera;
}

// Where what micropolygons are larger for adds as much error as under a box: a wider filter spreads it. Mitchell's is wider too, but
// its negative lobes take that back. Measured: docs/reyes.md.
float default_shading_rate(ReyesFilter filter) { return filter == ReyesFilter::Gaussian ? 0.375f : 0.25f; }

void check_own_light(const ReyesSettings &reyes, const CompiledScene &scene)
{
  if (!scene.has_blending) return;
  fail(GPURT_ERROR_UNSUPPORTED,
       "reyes.shading is {}, but surfaces that blend are lit at samples; use GPURT_REYES_SHADING_SAMPLES",
       reyes.shading == ReyesShading::Blocks ? "GPURT_REYES_SHADING_BLOCKS"
                                             : "GPURT_REYES_SHADING_MICROPOLYGONS");
}

// Whether micropolygons' own light is found after visibility: where it takes rays, where not all that is seen is a
// micropolygon, or where more than light is asked for. Else samples keep it and nothing else.
bool needs_rays_for_own_light(const ReyesSettings &reyes, const CompiledScene &scene, uint32_t outputs)
{
  constexpr uint32_t outputs_of_light = 1u << GPURT_OUTPUT_COLOR | 1u << GPURT_OUTPUT_ALPHA |
                                        1u << GPURT_OUTPUT_SAMPLE_COUNT | 1u << GPURT_OUTPUT_VARIANCE;
  if (!reyes.no_shadows || scene.environment.is_present || scene.has_alpha_masks ||
      (outputs & ~outputs_of_light) != 0)
    return true;
  for (const Light &light : scene.lights) {
    if (light.type == LightType::Triangle) return true;
  }
  return scene.has_meshes();
}

}  // namespace

Frame::Frame(FrameScene scene, const gpurt_frame_desc &desc) : scene_(std::move(scene))
{
  FrameState &s = state_;
  s.settings = resolve(desc, *scene_.compiled);
  s.scene_hash = scene_.compiled->hash;
  s.camera = make_camera(scene_.compiled->cameras[desc.camera], s.settings.width, s.settings.height);
  s.accel = scene_.committed->accel_facts().accel;
  s.triangle_test = scene_.committed->accel_facts().triangle_test;
  const uint64_t num_pixels = uint64_t(s.settings.width) * s.settings.height;
  const uint64_t bytes = TileFilm::bytes_for(num_pixels, s.settings.outputs) + num_pixels * sizeof(uint32_t);
  memory_ = Reservation(scene_.memory, bytes, "the frame's film");
  try {
    s.film.reserve(s.settings.width, s.settings.height, s.settings.outputs);
    keeps_on_device_ = make_device_film() != nullptr;
    // Where nothing looks at them, they are never written.
    if (!keeps_on_device_) make_host_arrays();
    bands_ = std::vector<std::mutex>(s.settings.height / rows_per_band + 1);
  } catch (const std::bad_alloc &) {
    fail(GPURT_ERROR_OUT_OF_MEMORY,
         "no memory for a frame of {} x {} pixels: its film needs {} bytes; make the frame or its outputs "
         "smaller",
         s.settings.width, s.settings.height, bytes);
  }
}

Frame::~Frame() = default;

void Frame::check_output(gpurt_output output) const
{
  if (output < 0 || output >= GPURT_OUTPUT_COUNT)
    fail_invalid("output is {}; it is none of gpurt_output", int(output));
  if (output == GPURT_OUTPUT_TIME)
    fail(GPURT_ERROR_UNSUPPORTED, "GPURT_OUTPUT_TIME is not supported by this version");
  if (!(state_.settings.outputs & 1u << output)) {
    fail_invalid("the frame was created without {}; set bit {} of gpurt_frame_desc.outputs",
                 output_name(output), int(output));
  }
}

uint64_t Frame::output_bytes(gpurt_output output) const
{
  check_output(output);
  return uint64_t(state_.settings.width) * state_.settings.height * num_components(output) * 4;
}

SumRow Frame::row_of(uint32_t y) const
{
  const TileFilm &film = state_.film;
  const uint64_t first = pixel(0, y);
  PhotonEstimator estimator;
  {
    const std::scoped_lock lock(totals_mutex_);
    estimator = state_.totals.photon.estimator;
  }
  const auto row = [&](const auto &values) { return values.empty() ? nullptr : values.data() + first; };
  return {row(film.pixels), row(film.features),   row(film.first_hits),
          row(film.errors), row(film.statistics), estimator};
}

void Frame::read_row(gpurt_output output, uint32_t y, void *row) const
{
  const std::scoped_lock lock(band_mutex(y));
  resolve_row(output, row_of(y), state_.settings.width, row);
}

void Frame::check_read(gpurt_output output, const void *data, uint64_t size_bytes) const
{
  const uint64_t expected = output_bytes(output);
  if (size_bytes != expected) {
    fail_invalid("size_bytes is {}, but {} of {} x {} pixels has {} bytes", size_bytes, output_name(output),
                 state_.settings.width, state_.settings.height, expected);
  }
  if (!data) fail_invalid("data is NULL");
}

void Frame::read(gpurt_output output, void *data, uint64_t size_bytes) const
{
  if (read_on_device(output, data, size_bytes)) return;
  const std::unique_lock<std::mutex> lock = host_sums();
  const uint64_t row_bytes = size_bytes / state_.settings.height;
  const uint32_t num_parts = state_.settings.height / rows_per_band + 1;
  // Whoever waits for it must not begin another of its own tasks meanwhile, which may use the same frame.
  tbb::this_task_arena::isolate([&] {
    tbb::parallel_for(uint32_t(0), num_parts, [&](uint32_t part) {
      const uint32_t end = std::min((part + 1) * rows_per_band, state_.settings.height);
      for (uint32_t y = part * rows_per_band; y < end; ++y)
        read_row(output, y, static_cast<std::byte *>(data) + y * row_bytes);
    });
  });
}

// Outputs that say what the error is belong to photon mapping, and to settings that can tell.
void Frame::check_error_outputs(const gpurt_render_desc &desc, const PhotonSettings &photon) const
{
  constexpr uint32_t bias = 1u << GPURT_OUTPUT_BIAS, error = 1u << GPURT_OUTPUT_ERROR;
  const uint32_t asked = state_.settings.outputs & (bias | error);
  const char *name = asked & bias ? "GPURT_OUTPUT_BIAS" : "GPURT_OUTPUT_ERROR";
  if (desc.pipeline != GPURT_PIPELINE_PHOTON) {
    if (asked == 0) return;
    fail(GPURT_ERROR_UNSUPPORTED,
         "{} is an output of GPURT_PIPELINE_PHOTON alone, and the frame was created with it: create a frame "
         "without, whose noise GPURT_OUTPUT_VARIANCE tells",
         name);
  }
  if (photon.estimator != PhotonEstimator::PerPixel) return;
  if (asked != 0) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "{} is not supported with GPURT_PHOTON_ESTIMATOR_PER_PIXEL, whose bias is not known: create a frame "
         "without, or use another photon.estimator",
         name);
  }
  if (desc.target_error > 0) {
    fail(GPURT_ERROR_UNSUPPORTED,
         "target_error is not supported with GPURT_PHOTON_ESTIMATOR_PER_PIXEL, whose bias is not known: give "
         "samples_per_pixel or time_limit_s, or use another photon.estimator");
  }
}

// Under jobs_mutex_.
void Frame::begin_samples(const gpurt_render_desc &desc, const ReyesSettings &reyes)
{
  const FrameTotals t = totals();
  const bool is_free = t.counters.num_samples == 0 && jobs_.empty();
  if (!is_free && t.max_depth != desc.max_depth) {
    fail_invalid(
        "max_depth is {}, but the frame holds samples of depth {}; create a new frame for another depth",
        desc.max_depth, t.max_depth);
  }
  if (!is_free && t.pipeline != desc.pipeline) {
    fail_invalid("the frame holds samples of another pipeline; create a new frame for this one");
  }
  if (!is_free && !(t.reyes == reyes)) {
    fail_invalid(
        "the frame holds samples of {}; create a new frame for {}, or leave its settings zero to go on with "
        "it",
        describe(t.reyes), describe(reyes));
  }
  PhotonSettings photon{};
  uint32_t more = 0;
  if (desc.pipeline == GPURT_PIPELINE_PHOTON) {
    const uint64_t num_pixels = uint64_t(state_.settings.width) * state_.settings.height;
    photon = resolve_photon_settings(desc.photon, is_free ? PhotonSettings{} : t.photon, num_pixels);
    if (photon.estimator != PhotonEstimator::Memoryless) {
      scene_.committed->require_photon_statistics();
      more |= film_statistics;
    }
    if (desc.target_error > 0) more |= film_errors;
  }
  check_error_outputs(desc, photon);
  if (!is_free && more & film_errors && state_.film.errors.empty()) {
    fail_invalid(
        "target_error asks for the bias of photon mapping too, but the frame's samples do not tell it: "
        "create the frame with GPURT_OUTPUT_BIAS, or give its first job a target_error");
  }
  // Later jobs have the settings of the first one, which may be finding its radius just now.
  if (!is_free) return;
  add_film_outputs(more);
  const std::scoped_lock lock(totals_mutex_);
  state_.totals.pipeline = desc.pipeline;
  state_.totals.max_depth = desc.max_depth;
  state_.totals.reyes = reyes;
  state_.totals.photon = photon;
}

// Under jobs_mutex_.
void Frame::add_film_outputs(uint32_t more)
{
  more &= ~state_.film.outputs;
  if (more == 0) return;
  const uint64_t num_pixels = state_.film.pixels.size();
  const uint64_t bytes = TileFilm::bytes_for(num_pixels, state_.film.outputs | more) -
                         TileFilm::bytes_for(num_pixels, state_.film.outputs);
  memory_.resize(memory_.bytes() + bytes, "the frame's film");
  std::vector<std::unique_lock<std::mutex>> locks;
  for (std::mutex &band : bands_) locks.emplace_back(band);
  try {
    state_.film.add_outputs(more);
  } catch (const std::bad_alloc &) {
    memory_.resize(memory_.bytes() - bytes, "the frame's film");
    fail(GPURT_ERROR_OUT_OF_MEMORY,
         "no memory for what photon mapping keeps of a frame: {} bytes more; make it smaller", bytes);
  }
}

ReyesSettings Frame::resolve_reyes(const gpurt_reyes_settings &asked) const
{
  const std::scoped_lock lock(totals_mutex_);
  ReyesSettings s = state_.totals.reyes;
  if (s.shading_rate == 0 || state_.totals.counters.num_samples == 0)
    s = {0, ReyesFilter::Box, ReyesShading::Samples, 0, 0, 0, 0};
  if (asked.filter != 0) s.filter = ReyesFilter(asked.filter);
  if (asked.shading_rate != 0) s.shading_rate = asked.shading_rate;
  else if (s.shading_rate == 0) s.shading_rate = default_shading_rate(s.filter);
  if (asked.shading != 0) s.shading = ReyesShading(asked.shading);
  if (asked.no_shadows != 0) s.no_shadows = 1;
  if (asked.flatness != 0) s.flatness = asked.flatness;
  if (asked.fragment_slots != 0) s.fragment_slots = asked.fragment_slots;
  s.lights_by_rays = 0;
  if (s.shading != ReyesShading::Samples) {
    check_own_light(s, *scene_.compiled);
    s.lights_by_rays = needs_rays_for_own_light(s, *scene_.compiled, state_.settings.outputs) ? 1 : 0;
  }
  return s;
}

// Of the job that renders: no other changes the settings meanwhile.
PhotonSettings Frame::photon_settings(const EmissionView &emission, float &widest_radius)
{
  const FrameTotals t = totals();
  PhotonSettings settings = t.photon;
  if (settings.initial_radius == 0) {
    const InitialRadius found = choose_initial_radius(*scene_.committed, path_settings(t.max_depth), emission,
                                                      settings.photons_per_pass);
    settings.initial_radius = found.radius;
    widest_radius = found.widest;
    set_photon_settings(settings);
  }
  return settings;
}

void Frame::set_photon_settings(const PhotonSettings &settings)
{
  const std::scoped_lock lock(totals_mutex_);
  state_.totals.photon = settings;
}

PathSettings Frame::path_settings(uint32_t max_depth) const
{
  return {state_.camera, state_.settings.seed, state_.settings.frame_index, max_depth};
}

void Frame::add_unit(const WorkUnit &unit, const TileFilm &film, const RenderCounters &counters)
{
  const auto start = std::chrono::steady_clock::now();
  const uint32_t width = unit.x1 - unit.x0;
  const SampleRange taken{unit.first_sample, unit.first_sample + unit.num_samples};
  uint64_t num_saturated = 0;
  uint32_t old_set = invalid_id, new_set = invalid_id;  // of the last pixel: mostly those of the next one too
  for (uint32_t y = unit.y0; y < unit.y1;) {
    const uint32_t band_end = std::min((y / rows_per_band + 1) * rows_per_band, unit.y1);
    const std::scoped_lock lock(band_mutex(y));
    for (; y < band_end; ++y) {
      const uint64_t to = pixel(unit.x0, y);
      add_film_row(state_.film, to, film, uint64_t(y - unit.y0) * width, width);
      for (uint64_t i = to; i < to + width; ++i) {
        uint32_t &set = state_.sample_sets[i];
        if (set != old_set) {
          const std::scoped_lock sets_lock(sets_mutex_);
          old_set = set;
          new_set = state_.sets.unite(set, {&taken, 1});
          if (new_set == invalid_id) {
            fail(GPURT_ERROR_INTERNAL, "a work unit brought samples {} .. {} of pixel {} twice", taken.begin,
                 taken.end, i);
          }
        }
        set = new_set;
        num_saturated += num_saturated_sums(state_.film.pixels[i]);
      }
    }
  }
  RenderCounters counted = counters;
  counted.num_nonfinite = 0;  // the film knows best
  for (const PixelSums &p : film.pixels) counted.num_nonfinite += p.num_nonfinite;
  counted.film_seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const std::scoped_lock lock(totals_mutex_);
  add_counters(state_.totals.counters, counted);
  state_.totals.num_saturated += num_saturated;
  generation_++;
}

FrameTotals Frame::totals() const
{
  const std::scoped_lock lock(totals_mutex_);
  return state_.totals;
}

void Frame::set_outcome(uint32_t tile_size, const gpurt_schedule &schedule, std::string reason)
{
  const std::scoped_lock lock(totals_mutex_);
  last_tile_size_ = tile_size;
  last_schedule_ = schedule;
  reason_ = std::move(reason);
}

void Frame::add_render_seconds(double seconds)
{
  const std::scoped_lock lock(totals_mutex_);
  state_.totals.render_seconds += seconds;
}

uint64_t Frame::smallest_sample_count() const
{
  uint64_t smallest = ~uint64_t(0);
  const std::unique_lock<std::mutex> host_lock = host_sums();
  for (uint32_t y = 0; y < state_.settings.height; ++y) {
    const std::scoped_lock lock(band_mutex(y));
    for (uint64_t i = pixel(0, y); i < pixel(0, y + 1); ++i) {
      const PixelSums &p = state_.film.pixels[i];
      smallest = std::min(smallest, uint64_t(p.num_samples[0]) + p.num_samples[1]);
    }
  }
  return smallest;
}

Frame::Error Frame::estimated_error() const
{
  const std::scoped_lock lock(estimate_mutex_);
  uint64_t generation, num_samples;
  gpurt_pipeline pipeline;
  PhotonSettings photon;
  PhotonCounters photon_counters;
  {
    const std::scoped_lock totals_lock(totals_mutex_);
    pipeline = state_.totals.pipeline;
    photon = state_.totals.photon;
    photon_counters = state_.totals.counters.photon;
    generation = generation_;
    num_samples = state_.totals.counters.num_samples;
  }
  if (generation == estimate_generation_) return estimate_;
  bool is_known = true, has_errors = false;
  const std::unique_lock<std::mutex> host_lock = host_sums();
  const auto moments = [&](uint32_t y0, uint32_t y1, PixelMoments *out) {
    for (uint32_t y = y0; y < y1; ++y) {
      const std::scoped_lock band_lock(band_mutex(y));
      const SumRow row = row_of(y);
      has_errors = row.errors != nullptr;
      for (uint32_t x = 0; x < state_.settings.width; ++x) is_known &= moments_of(row, x, *out++);
    }
  };
  const uint32_t width = state_.settings.width, height = state_.settings.height;
  const double mean_samples = double(num_samples) / (double(width) * height);
  const bool has_bias = pipeline == GPURT_PIPELINE_PHOTON;
  PhotonDoubt photons{};
  if (has_bias) {
    photons = {photon_radiance(*scene_.compiled, photon, photon_counters.smallest_radius),
               double(photon_counters.num_gathered)};
  }
  const ErrorEstimate estimate = estimate_relmse(
      width, height, mean_samples, unseen_radiance(*scene_.compiled), moments, has_bias ? &photons : nullptr);
  estimate_ = {};
  if (is_known) {
    estimate_ = {estimate.noise, !has_bias ? 0 : has_errors ? estimate.bias : -1};
  }
  estimate_generation_ = generation;
  return estimate_;
}

void Frame::statistics(gpurt_statistics &out) const
{
  const uint64_t samples_per_pixel = smallest_sample_count();
  const Error error = estimated_error();
  const std::scoped_lock lock(totals_mutex_);
  const FrameTotals &t = state_.totals;
  const RenderCounters &c = t.counters;
  out.pipeline = t.pipeline;
  out.accel = gpurt_accel(state_.accel);
  out.triangle_test = gpurt_triangle_test(state_.triangle_test);
  out.max_depth = t.max_depth;
  out.tile_size = last_tile_size_;
  out.num_threads = scene_.num_threads;
  out.width = state_.settings.width;
  out.height = state_.settings.height;
  out.seed = state_.settings.seed;
  out.samples_per_pixel = samples_per_pixel;
  out.num_samples = c.num_samples;
  out.num_camera_rays = c.num_camera_rays;
  out.num_bounce_rays = c.num_bounce_rays;
  out.num_shadow_rays = c.num_shadow_rays;
  out.num_nonfinite = c.num_nonfinite;
  out.num_saturated = t.num_saturated;
  out.render_seconds = t.render_seconds;
  out.generate_seconds = c.generate_seconds;
  out.trace_seconds = c.trace_seconds;
  out.shade_seconds = c.shade_seconds;
  out.shadow_seconds = c.shadow_seconds;
  out.film_seconds = c.film_seconds;
  out.build_seconds = scene_.build_seconds;
  out.estimated_error = error.total();
  out.estimated_bias = error.bias;
  out.largest_sample = double(c.largest_sample);
  out.memory_peak_bytes = scene_.memory ? scene_.memory->peak() : 0;
  out.schedule = last_schedule_;
  out.schedule_counters = describe(c.schedule);
  out.photon = describe(t.photon);
  out.photon_counters = describe(c.photon);
  out.reyes = public_settings(t.reyes);
  out.reyes_counters = public_counters(c.reyes);
  std::memset(out.reason, 0, sizeof out.reason);
  reason_.copy(out.reason, sizeof out.reason - 1);
}

}  // namespace gpurt
