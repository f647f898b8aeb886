// Frames as files: images out, exact sums out and in.
#include <cctype>
#include <map>

#include "frame/frame.h"
#include "frame/outputs.h"
#include "frame/reyes_desc.h"
#include "frame/state_file.h"
#include "image/exr.h"
#include "image/png.h"

namespace gpurt {

namespace {

// How an output's components are called in a file, as image tools expect them.
struct Layer {
  gpurt_output output;
  std::vector<ExrChannel> channels;
};

std::vector<Layer> layers_of(uint32_t outputs)
{
  constexpr ExrType uint = ExrType::Uint;
  const std::vector<Layer> all = {
      {GPURT_OUTPUT_COLOR, {{"R"}, {"G"}, {"B"}}},
      {GPURT_OUTPUT_ALPHA, {{"A"}}},
      {GPURT_OUTPUT_DEPTH, {{"Z"}}},
      {GPURT_OUTPUT_NORMAL, {{"normal.X"}, {"normal.Y"}, {"normal.Z"}}},
      {GPURT_OUTPUT_ALBEDO, {{"albedo.R"}, {"albedo.G"}, {"albedo.B"}}},
      {GPURT_OUTPUT_POSITION, {{"position.X"}, {"position.Y"}, {"position.Z"}}},
      {GPURT_OUTPUT_PRIMITIVE, {{"primitive", uint}}},
      {GPURT_OUTPUT_INSTANCE, {{"instance", uint}}},
      {GPURT_OUTPUT_SAMPLE_COUNT, {{"sampleCount", uint}}},
      {GPURT_OUTPUT_VARIANCE, {{"variance.R"}, {"variance.G"}, {"variance.B"}}},
      {GPURT_OUTPUT_BIAS, {{"bias.R"}, {"bias.G"}, {"bias.B"}}},
      {GPURT_OUTPUT_ERROR, {{"error.R"}, {"error.G"}, {"error.B"}}},
  };
  std::vector<Layer> kept;
  for (const Layer &layer : all) {
    if (outputs & 1u << layer.output) kept.push_back(layer);
  }
  return kept;
}

std::string extension_of(const std::string &path)
{
  const size_t dot = path.find_last_of("./");
  std::string extension = dot != std::string::npos && path[dot] == '.' ? path.substr(dot) : "";
  for (char &c : extension) c = char(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

const char *test_name(TriangleTest test)
{
  switch (test) {
    case TriangleTest::Watertight:
      return "watertight";
    case TriangleTest::MollerTrumbore:
      return "moller-trumbore";
    case TriangleTest::Double:
      return "double";
    default:
      return "unknown";
  }
}

// Own accelerators give the same hits, so their samples belong to one image; Embree's do not promise that.
bool same_hits(Accel a, Accel b) { return (a == Accel::Embree) == (b == Accel::Embree); }

const char *pipeline_text(gpurt_pipeline pipeline)
{
  switch (pipeline) {
    case GPURT_PIPELINE_PATH:
      return "path";
    case GPURT_PIPELINE_PHOTON:
      return "photon";
    case GPURT_PIPELINE_REYES:
      return "reyes";
    default:
      return "none";
  }
}

std::string text_of(const PhotonSettings &s)
{
  static constexpr const char *estimators[] = {"none", "memoryless", "per_pixel", "adaptive"};
  return fmt::format("photons_per_pass={} initial_radius={} estimator={} kernel={} remedies={:#x}",
                     s.photons_per_pass, s.initial_radius, estimators[uint32_t(s.estimator) & 3],
                     s.kernel == PhotonKernel::Cone ? "cone" : "constant", s.remedies);
}

std::string text_of(std::span<const SampleRange> ranges)
{
  std::string text = "samples";
  for (const SampleRange &r : ranges) text += fmt::format(" {}..{}", r.begin, r.end - 1);
  return text;
}

}  // namespace

void Frame::save(const std::string &path) const
{
  const std::string extension = extension_of(path);
  if (extension == ".exr") return save_exr(path);
  if (extension == ".gpurt") return save_state(path);
  if (extension != ".png") fail_invalid("{}: its extension is none of .exr, .png and .gpurt", path);
  const std::unique_lock<std::mutex> lock = host_sums();
  write_png(path, state_.settings.width, state_.settings.height,
            [&](uint32_t y, float *rgb) { read_row(GPURT_OUTPUT_COLOR, y, rgb); });
}

void Frame::save_exr(const std::string &path) const
{
  const std::vector<Layer> layers = layers_of(state_.settings.outputs);
  std::vector<ExrChannel> channels;
  for (const Layer &layer : layers)
    channels.insert(channels.end(), layer.channels.begin(), layer.channels.end());

  const FrameSettings &s = state_.settings;
  const FrameTotals t = totals();
  ExrAttributes attributes = {
      {"gpurt:version",
       fmt::format("{}.{}.{}", GPURT_VERSION_MAJOR, GPURT_VERSION_MINOR, GPURT_VERSION_PATCH)},
      {"gpurt:settings",
       fmt::format(
           "pipeline={} accel={} triangle_test={} max_depth={} camera={} frame_index={} first_sample={}",
           pipeline_text(t.pipeline), accel_name(state_.accel), test_name(state_.triangle_test), t.max_depth,
           s.camera, s.frame_index, s.first_sample)},
      {"gpurt:seed", fmt::format("{}", s.seed)},
      {"gpurt:samples", fmt::format("{}", smallest_sample_count())},
      {"gpurt:sceneHash", fmt::format("{:016x}", state_.scene_hash)},
  };

  if (t.photon.photons_per_pass != 0) attributes.push_back({"gpurt:photon", text_of(t.photon)});

  std::vector<uint32_t> row(size_t(s.width) * 3);  // of one output, components interleaved
  const ExrFill fill = [&](uint32_t y0, uint32_t y1, const std::vector<void *> &planes) {
    size_t plane = 0;
    for (const Layer &layer : layers) {
      const size_t n = layer.channels.size();
      for (uint32_t y = y0; y < y1; ++y) {
        read_row(layer.output, y, row.data());
        for (size_t c = 0; c < n; ++c) {
          auto *to = static_cast<uint32_t *>(planes[plane + c]) + size_t(y - y0) * s.width;
          for (uint32_t x = 0; x < s.width; ++x) to[x] = row[x * n + c];
        }
      }
      plane += n;
    }
  };
  const std::unique_lock<std::mutex> lock = host_sums();
  write_exr(path, s.width, s.height, channels, attributes, fill);
}

void Frame::save_state(const std::string &path) const
{
  const std::unique_lock<std::mutex> host_lock = host_sums();
  FrameState header;
  header.settings = state_.settings;
  header.scene_hash = state_.scene_hash;
  header.camera = state_.camera;
  header.accel = state_.accel;
  header.triangle_test = state_.triangle_test;
  header.totals = host_totals();
  {
    const std::scoped_lock lock(band_mutex(0));
    header.film.outputs = state_.film.outputs;
  }
  write_state(
      path, header,
      [&](uint32_t y, const std::function<void(const FilmRow &)> &sink) {
        const std::scoped_lock lock(band_mutex(y));
        const SumRow row = row_of(y);
        // A job that is submitted meanwhile may have given the film more arrays than the header names.
        sink({row.pixels, row.features, row.first_hits,
              TileFilm::has_errors(header.film.outputs) ? row.errors : nullptr,
              header.film.outputs & film_statistics ? row.statistics : nullptr,
              state_.sample_sets.data() + pixel(0, y)});
      },
      [&] {
        const std::scoped_lock lock(sets_mutex_);
        return state_.sets;
      });
}

// Refuses samples of another image. Names the first difference and both values.
void Frame::check_same_image(const FrameState &other, const std::string &other_name) const
{
  const auto require = [&](const char *what, const auto &ours, const auto &theirs) {
    if (ours != theirs) {
      fail_invalid("{} cannot be merged: its {} is {}, that of the frame is {}", other_name, what, theirs,
                   ours);
    }
  };
  const FrameSettings &a = state_.settings, &b = other.settings;
  require("scene hash", fmt::format("{:016x}", state_.scene_hash), fmt::format("{:016x}", other.scene_hash));
  require("size", fmt::format("{} x {}", a.width, a.height), fmt::format("{} x {}", b.width, b.height));
  require("camera", a.camera, b.camera);
  require("seed", a.seed, b.seed);
  require("frame_index", a.frame_index, b.frame_index);
  require("set of outputs", fmt::format("{:#x}", a.outputs), fmt::format("{:#x}", b.outputs));
  const FrameTotals ours = totals();
  if (ours.max_depth != 0 && other.totals.max_depth != 0) {
    require("max_depth", ours.max_depth, other.totals.max_depth);
    require("pipeline", int(ours.pipeline), int(other.totals.pipeline));
    require("photon mapping", text_of(ours.photon), text_of(other.totals.photon));
    require("pipeline", describe(ours.reyes), describe(other.totals.reyes));
  }
  const bool both = ours.counters.num_samples != 0 && other.totals.counters.num_samples != 0;
  if (both && ours.photon.estimator != PhotonEstimator::Memoryless) {
    fail(
        GPURT_ERROR_UNSUPPORTED,
        "{} cannot be merged: passes of this photon.estimator go on from what the pixels had before, so that "
        "only a frame without samples can take them over; render parts that are to be merged with "
        "GPURT_PHOTON_ESTIMATOR_MEMORYLESS",
        other_name);
  }
  if (both && !state_.film.errors.empty() != TileFilm::has_errors(other.film.outputs)) {
    fail_invalid(
        "{} cannot be merged: {} has sums that tell the bias, the other has none; create the frames of all "
        "parts "
        "with GPURT_OUTPUT_BIAS, or none",
        other_name, state_.film.errors.empty() ? "it" : "the frame");
  }
  if (!same_hits(state_.accel, other.accel)) {
    fail_invalid(
        "{} cannot be merged: it was rendered with {}, the frame with {}, and their hits differ in rounding; "
        "render all parts with the same accelerator",
        other_name, accel_name(other.accel), accel_name(state_.accel));
  }
  require("triangle test", std::string(test_name(state_.triangle_test)),
          std::string(test_name(other.triangle_test)));
}

void Frame::merge(Frame &other)
{
  if (this == &other) fail_invalid("a frame cannot be merged into itself: its samples would count twice");
  const std::scoped_lock lock(jobs_mutex_, other.jobs_mutex_);
  if (is_rendering())
    fail_invalid("a job of the frame still runs; wait for it before merging into the frame");
  if (other.is_rendering())
    fail_invalid("a job of the other frame still runs; wait for it before merging that frame");
  leave_device();
  const std::unique_lock<std::mutex> others = other.host_sums();
  merge_state(other.state_, "the other frame");
}

void Frame::load_state(const std::string &path)
{
  const std::scoped_lock lock(jobs_mutex_);
  if (is_rendering())
    fail_invalid("a job of the frame still runs; wait for it before loading a state into the frame");
  const LoadedState loaded =
      read_state(path, scene_.memory, [&](const FrameState &header) { check_same_image(header, path); });
  leave_device();
  merge_state(loaded.state, path);
}

// Under jobs_mutex_: nobody else changes the film.
void Frame::merge_state(const FrameState &other, const std::string &other_name)
{
  check_same_image(other, other_name);
  const uint32_t width = state_.settings.width, height = state_.settings.height;

  // All is checked before anything is added, so that a refused merge leaves the frame as it was. Few pairs of sets
  // occur, so each is united once.
  std::map<std::pair<uint32_t, uint32_t>, uint32_t> united;
  for (uint64_t i = 0; i < state_.sample_sets.size(); ++i) {
    const uint32_t ours = state_.sample_sets[i], theirs = other.sample_sets[i];
    const auto [entry, is_new] = united.try_emplace({ours, theirs}, invalid_id);
    if (is_new) {
      const std::scoped_lock lock(sets_mutex_);
      entry->second = state_.sets.unite(ours, other.sets.ranges(theirs));
    }
    if (entry->second == invalid_id) {
      fail_invalid(
          "{} cannot be merged: samples would count twice: at pixel ({}, {}) it has {} and the frame {}; "
          "give each "
          "part its own first_sample",
          other_name, i % width, i / width, text_of(other.sets.ranges(theirs)),
          text_of(state_.sets.ranges(ours)));
    }
    if (is_new && state_.sets.num_samples(entry->second) > ~uint32_t(0)) {
      fail_invalid("{} cannot be merged: pixel ({}, {}) would have {} samples, more than a film can hold",
                   other_name, i % width, i / width, state_.sets.num_samples(entry->second));
    }
  }

  add_film_outputs(other.film.outputs & (film_errors | film_statistics));

  uint64_t num_saturated = 0;
  first_gap_ = no_gap;
  for (uint32_t y = 0; y < height; ++y) {
    const std::scoped_lock lock(band_mutex(y));
    add_film_row(state_.film, pixel(0, y), other.film, pixel(0, y), width);
    for (uint64_t i = pixel(0, y); i < pixel(0, y + 1); ++i) {
      uint32_t &set = state_.sample_sets[i];
      set = united.at({set, other.sample_sets[i]});
      if (first_gap_ == no_gap && state_.sets.has_gaps(set)) first_gap_ = i;
      num_saturated += num_saturated_sums(state_.film.pixels[i]);
    }
  }

  const std::scoped_lock lock(totals_mutex_);
  FrameTotals &t = state_.totals;
  if (t.max_depth == 0) {
    t.max_depth = other.totals.max_depth;
    t.pipeline = other.totals.pipeline;
    t.photon = other.totals.photon;
    t.reyes = other.totals.reyes;
  }
  add_counters(t.counters, other.totals.counters);
  t.num_saturated += other.totals.num_saturated + num_saturated;
  t.render_seconds += other.totals.render_seconds;
  generation_++;
}

}  // namespace gpurt
