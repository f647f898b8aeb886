#include "frame/state_file.h"

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>

#include "error.h"
#include "image/atomic_file.h"

namespace gpurt {

namespace {

static_assert(std::endian::native == std::endian::little,
              "a big-endian machine needs byte swaps in this file");
static_assert(sizeof(PixelSums) == 112 && sizeof(PixelFeatures) == 48 && sizeof(PixelFirstHit) == 32 &&
                  sizeof(SampleRange) == 16 && sizeof(PixelErrors) == 152 && sizeof(PixelStatistics) == 64,
              "the file holds these as they lie in memory: a change of layout needs a new format_version");

constexpr char magic[8] = {'g', 'p', 'u', 'r', 't', 'f', 'r', 'm'};
constexpr uint32_t format_version = 5;
constexpr uint32_t library_version =
    GPURT_VERSION_MAJOR << 16 | GPURT_VERSION_MINOR << 8 | GPURT_VERSION_PATCH;

constexpr uint32_t film_only = film_errors | film_statistics;

// Everything but the arrays, in the order of the file. No padding: eight-byte fields first.
struct Header {
  char magic[8];
  uint32_t format_version;
  uint32_t library_version;  // samples of another version need not be those that this one would have taken
  uint64_t scene_hash;
  uint64_t seed;
  uint64_t first_sample;
  uint64_t num_samples, num_camera_rays, num_bounce_rays, num_shadow_rays, num_nonfinite, num_saturated;
  double generate_seconds, trace_seconds, shade_seconds, shadow_seconds, film_seconds, render_seconds;
  PhotonCounters photon_counters;
  Camera camera;
  float largest_sample;
  uint32_t width, height;
  uint32_t camera_index;
  uint32_t outputs;  // with film_errors and film_statistics
  uint32_t frame_index;
  uint32_t pipeline;
  uint32_t max_depth;
  uint32_t accel;
  uint32_t triangle_test;
  PhotonSettings photon;
  float reyes_shading_rate;
  uint32_t reyes_filter, reyes_shading, reyes_no_shadows;
  float reyes_flatness;
  uint32_t reyes_fragment_slots;
};
static_assert(sizeof(PhotonCounters) == 96 && sizeof(PhotonSettings) == 20);
static_assert(sizeof(Header) == 16 + 15 * 8 + 96 + sizeof(Camera) + 16 * 4 + 20 && sizeof(Header) % 8 == 0,
              "padding would be written");

// Four lanes of multiply and rotate over 64-bit words. Each step is a bijection of its lane, so any damage within one
// word changes the result for certain, other damage but for one case in 2^64.
class Checksum {
 public:
  void add(const void *data, uint64_t size_bytes)
  {
    const auto *bytes = static_cast<const std::byte *>(data);
    for (uint64_t i = 0; i < size_bytes; i += 8) {
      uint64_t word = 0;
      std::memcpy(&word, bytes + i, std::min<uint64_t>(8, size_bytes - i));
      uint64_t &lane = lanes_[count_++ & 3];
      lane = std::rotl((lane ^ word) * 0x9e3779b97f4a7c15u, 29);
    }
  }
  uint64_t value() const
  {
    uint64_t h = count_;
    for (uint64_t lane : lanes_) h = std::rotl((h ^ lane) * 0xbf58476d1ce4e5b9u, 31);
    return h ^ h >> 29;
  }

 private:
  uint64_t lanes_[4] = {1, 2, 3, 4};
  uint64_t count_ = 0;
};

Header make_header(const FrameState &s)
{
  Header h{};
  std::memcpy(h.magic, magic, sizeof magic);
  h.format_version = format_version;
  h.library_version = library_version;
  h.scene_hash = s.scene_hash;
  h.seed = s.settings.seed;
  h.first_sample = s.settings.first_sample;
  const RenderCounters &c = s.totals.counters;
  h.num_samples = c.num_samples;
  h.num_camera_rays = c.num_camera_rays;
  h.num_bounce_rays = c.num_bounce_rays;
  h.num_shadow_rays = c.num_shadow_rays;
  h.num_nonfinite = c.num_nonfinite;
  h.num_saturated = s.totals.num_saturated;
  h.generate_seconds = c.generate_seconds;
  h.trace_seconds = c.trace_seconds;
  h.shade_seconds = c.shade_seconds;
  h.shadow_seconds = c.shadow_seconds;
  h.film_seconds = c.film_seconds;
  h.render_seconds = s.totals.render_seconds;
  h.photon_counters = c.photon;
  h.photon = s.totals.photon;
  h.camera = s.camera;
  h.largest_sample = c.largest_sample;
  h.width = s.settings.width;
  h.height = s.settings.height;
  h.camera_index = s.settings.camera;
  h.outputs = s.settings.outputs | (s.film.outputs & film_only);
  h.frame_index = s.settings.frame_index;
  h.pipeline = s.totals.pipeline;
  h.max_depth = s.totals.max_depth;
  h.accel = uint32_t(s.accel);
  h.triangle_test = uint32_t(s.triangle_test);
  h.reyes_shading_rate = s.totals.reyes.shading_rate;
  h.reyes_filter = uint32_t(s.totals.reyes.filter);
  h.reyes_shading = uint32_t(s.totals.reyes.shading);
  h.reyes_no_shadows = s.totals.reyes.no_shadows;
  h.reyes_flatness = s.totals.reyes.flatness;
  h.reyes_fragment_slots = s.totals.reyes.fragment_slots;
  return h;
}

FrameState state_from(const Header &h)
{
  FrameState s;
  s.settings = {h.width,       h.height, h.camera_index, h.outputs & ~film_only,
                h.frame_index, h.seed,   h.first_sample};
  s.film.outputs = h.outputs;
  s.scene_hash = h.scene_hash;
  s.camera = h.camera;
  s.accel = Accel(h.accel);
  s.triangle_test = TriangleTest(h.triangle_test);
  s.totals.pipeline = gpurt_pipeline(h.pipeline);
  s.totals.max_depth = h.max_depth;
  s.totals.reyes = {h.reyes_shading_rate,
                    ReyesFilter(h.reyes_filter),
                    ReyesShading(h.reyes_shading),
                    h.reyes_no_shadows,
                    h.reyes_flatness,
                    h.reyes_fragment_slots,
                    0};  // the last one is found anew
  RenderCounters &c = s.totals.counters;
  c.num_samples = h.num_samples;
  c.num_camera_rays = h.num_camera_rays;
  c.num_bounce_rays = h.num_bounce_rays;
  c.num_shadow_rays = h.num_shadow_rays;
  c.num_nonfinite = h.num_nonfinite;
  c.generate_seconds = h.generate_seconds;
  c.trace_seconds = h.trace_seconds;
  c.shade_seconds = h.shade_seconds;
  c.shadow_seconds = h.shadow_seconds;
  c.film_seconds = h.film_seconds;
  c.largest_sample = h.largest_sample;
  c.photon = h.photon_counters;
  s.totals.photon = h.photon;
  s.totals.num_saturated = h.num_saturated;
  s.totals.render_seconds = h.render_seconds;
  return s;
}

// A file that is read once from front to back, with its checksum. No read goes past its end, so that a damaged length
// costs no memory.
class Reader {
 public:
  explicit Reader(const std::string &path) : path_(path), file_(std::fopen(path.c_str(), "rb"), &std::fclose)
  {
    if (!file_) fail(GPURT_ERROR_IO, "{}: cannot be read: {}", path_, std::strerror(errno));
    const bool sought = ::fseeko(file_.get(), 0, SEEK_END) == 0;
    const off_t size = sought ? ::ftello(file_.get()) : -1;
    if (size < 0 || ::fseeko(file_.get(), 0, SEEK_SET) != 0) {
      fail(GPURT_ERROR_IO, "{}: cannot be read: {}", path_, std::strerror(errno));
    }
    size_bytes_ = uint64_t(size);
  }
  uint64_t size_bytes() const { return size_bytes_; }
  uint64_t remaining_bytes() const { return size_bytes_ - position_; }
  void read(void *data, uint64_t size_bytes)
  {
    read_plain(data, size_bytes);
    checksum_.add(data, size_bytes);
  }
  void expect_checksum()
  {
    uint64_t stored;
    read_plain(&stored, sizeof stored);
    if (stored != checksum_.value()) fail(GPURT_ERROR_IO, "{}: damaged: its checksum does not match", path_);
  }

 private:
  void read_plain(void *data, uint64_t size_bytes)
  {
    if (size_bytes > remaining_bytes())
      fail(GPURT_ERROR_IO, "{}: damaged: {} bytes are too few", path_, size_bytes_);
    position_ += size_bytes;
    if (size_bytes == 0 || std::fread(data, 1, size_bytes, file_.get()) == size_bytes) return;
    const char *reason = std::ferror(file_.get()) ? std::strerror(errno) : "it ended while it was read";
    fail(GPURT_ERROR_IO, "{}: cannot be read: {}", path_, reason);
  }

  const std::string &path_;
  std::unique_ptr<std::FILE, int (*)(std::FILE *)> file_;
  uint64_t size_bytes_ = 0, position_ = 0;
  Checksum checksum_;
};

uint64_t num_pixels(const FrameSettings &settings) { return uint64_t(settings.width) * settings.height; }

uint64_t array_bytes(const FrameState &state)
{
  const uint64_t n = num_pixels(state.settings);
  return TileFilm::bytes_for(n, state.film.outputs) + n * sizeof(uint32_t);
}

Header read_header(const std::string &path, Reader &file)
{
  Header h{};
  if (file.size_bytes() < sizeof h)
    fail(GPURT_ERROR_IO, "{}: not a gpurt state file: only {} bytes long", path, file.size_bytes());
  file.read(&h, sizeof h);
  if (std::memcmp(h.magic, magic, sizeof magic) != 0)
    fail(GPURT_ERROR_IO, "{}: not a gpurt state file", path);
  if (h.format_version != format_version) {
    fail(GPURT_ERROR_IO, "{}: has format version {}; this library reads {}", path, h.format_version,
         format_version);
  }
  if (h.library_version != library_version) {
    const uint32_t theirs = h.library_version, ours = library_version;
    fail(GPURT_ERROR_IO,
         "{}: was written by gpurt {}.{}.{}; only that version can continue or merge it, this is {}.{}.{}",
         path, theirs >> 16, theirs >> 8 & 0xff, theirs & 0xff, ours >> 16, ours >> 8 & 0xff, ours & 0xff);
  }
  file.expect_checksum();
  // Sizes are below 2^16 each, so that products of them cannot overflow.
  if (h.width == 0 || h.height == 0 || h.width > max_frame_size || h.height > max_frame_size ||
      (h.outputs & ~film_only) >> GPURT_OUTPUT_COUNT != 0) {
    fail(GPURT_ERROR_IO, "{}: damaged: {} x {} pixels and outputs {:#x} are not those of a frame", path,
         h.width, h.height, h.outputs);
  }
  return h;
}

SampleSets read_sets(const std::string &path, Reader &file)
{
  const auto refuse = [&] {
    fail(GPURT_ERROR_IO, "{}: damaged: its table of samples contradicts itself", path);
  };
  SampleSets sets;
  uint64_t num_sets;
  file.read(&num_sets, sizeof num_sets);
  for (uint64_t set = 0; set < num_sets; ++set) {
    uint64_t num_ranges;
    file.read(&num_ranges, sizeof num_ranges);
    if (num_ranges > file.remaining_bytes() / sizeof(SampleRange)) refuse();
    std::vector<SampleRange> ranges(num_ranges);
    file.read(ranges.data(), num_ranges * sizeof(SampleRange));
    for (const SampleRange &r : ranges) {
      if (r.begin >= r.end) refuse();
    }
    // Entries come in the order of their numbers, the empty set first.
    if (sets.unite(SampleSets::empty, ranges) != set) refuse();
  }
  return sets;
}

// Sums are arbitrary bits, counts and sets must agree.
void check_pixels(const std::string &path, const FrameState &state)
{
  for (uint64_t i = 0; i < state.sample_sets.size(); ++i) {
    const PixelSums &p = state.film.pixels[i];
    const uint64_t finite = uint64_t(p.num_samples[0]) + p.num_samples[1];
    if (state.sample_sets[i] >= state.sets.size() || p.num_covered > finite ||
        state.sets.num_samples(state.sample_sets[i]) != finite + p.num_nonfinite) {
      fail(GPURT_ERROR_IO, "{}: damaged: the sample counts of pixel ({}, {}) contradict each other", path,
           i % state.settings.width, i / state.settings.width);
    }
  }
}

}  // namespace

void write_state(const std::string &path, const FrameState &header, const RowSource &rows,
                 const std::function<SampleSets()> &sets)
{
  AtomicFile file(path);
  Checksum checksum;
  const auto put = [&](const void *data, uint64_t size_bytes) {
    file.write(data, size_bytes);
    checksum.add(data, size_bytes);
  };
  const auto put_checksum = [&] {
    const uint64_t value = checksum.value();
    file.write(&value, sizeof value);
  };
  const Header h = make_header(header);
  put(&h, sizeof h);
  put_checksum();
  const uint64_t width = h.width;
  for (uint32_t y = 0; y < h.height; ++y) {
    rows(y, [&](const FilmRow &row) {
      put(row.pixels, width * sizeof(PixelSums));
      if (row.features) put(row.features, width * sizeof(PixelFeatures));
      if (row.first_hits) put(row.first_hits, width * sizeof(PixelFirstHit));
      if (row.errors) put(row.errors, width * sizeof(PixelErrors));
      if (row.statistics) put(row.statistics, width * sizeof(PixelStatistics));
      put(row.sample_sets, width * sizeof(uint32_t));
    });
  }
  const SampleSets table = sets();
  const uint64_t num_sets = table.size();
  put(&num_sets, sizeof num_sets);
  for (uint32_t set = 0; set < num_sets; ++set) {
    const auto ranges = table.ranges(set);
    const uint64_t num_ranges = ranges.size();
    put(&num_ranges, sizeof num_ranges);
    put(ranges.data(), ranges.size_bytes());
  }
  put_checksum();
  file.commit();
}

FrameState read_state_header(const std::string &path)
{
  Reader file(path);
  return state_from(read_header(path, file));
}

LoadedState read_state(const std::string &path, const std::shared_ptr<MemoryTracker> &memory,
                       const std::function<void(const FrameState &header)> &check)
{
  Reader file(path);
  const Header h = read_header(path, file);
  LoadedState loaded{state_from(h), {}};
  FrameState &state = loaded.state;
  if (file.remaining_bytes() < array_bytes(state)) {
    fail(GPURT_ERROR_IO, "{}: damaged: {} bytes do not hold a frame of {} x {} pixels", path,
         file.size_bytes(), h.width, h.height);
  }
  check(state);
  loaded.memory = Reservation(memory, array_bytes(state), "a loaded frame state");
  state.film.reset(h.width, h.height, h.outputs);
  state.sample_sets.resize(num_pixels(state.settings));
  for (uint64_t y = 0; y < h.height; ++y) {
    const uint64_t first = y * h.width;
    file.read(state.film.pixels.data() + first, h.width * sizeof(PixelSums));
    if (!state.film.features.empty())
      file.read(state.film.features.data() + first, h.width * sizeof(PixelFeatures));
    if (!state.film.first_hits.empty())
      file.read(state.film.first_hits.data() + first, h.width * sizeof(PixelFirstHit));
    if (!state.film.errors.empty())
      file.read(state.film.errors.data() + first, h.width * sizeof(PixelErrors));
    if (!state.film.statistics.empty())
      file.read(state.film.statistics.data() + first, h.width * sizeof(PixelStatistics));
    file.read(state.sample_sets.data() + first, h.width * sizeof(uint32_t));
  }
  state.sets = read_sets(path, file);
  file.expect_checksum();
  check_pixels(path, state);
  return loaded;
}

}  // namespace gpurt
