#include "cuda/reyes/visible.h"

#include <algorithm>
#include <utility>

#include "cuda/layout.h"
#include "cuda/reyes/split_schedules.h"
#include "error.h"

namespace gpurt::cuda {
namespace {

// So that a cell has about a sample: a micropolygon looks at few of them, and at few cells.
int32_t cell_bits_for(uint64_t samples_per_pixel)
{
  if (samples_per_pixel < 3) return unit_bits;
  return samples_per_pixel < 8 || samples_per_pixel > max_fine_samples ? unit_bits - 1 : unit_bits - 2;
}

// Grids that separate kernels hand on at a time, of the leaves that there is room for.
uint32_t staged_grids(const ReyesListSizes &sizes) { return std::max(sizes.leaves / 64, 64u); }

// Samples that a launch tests against large triangles at most: 6 ms of an H100, some 0.2 s of devices with few units of double
// precision. Jobs are cancelled between launches.
constexpr uint64_t large_tests_of_launch = uint64_t(1) << 30;

// Micropolygons of this area in pixels are mostly below four pixels along an axis.
constexpr float largest_masked_rate = 4.0f;

}  // namespace

ReyesListSizes ReyesListSizes::at_level(unsigned level, bool is_spare, uint64_t num_roots)
{
  const auto room = [&](unsigned bits, unsigned more_levels, uint32_t least) {
    const unsigned cut = level + (is_spare ? more_levels : 0);
    return std::max(cut < bits ? uint32_t(1) << (bits - cut) : 1u, least);
  };
  // Roots shrink last: each batch of them is a launch of every stage, and waits for the host.
  ReyesListSizes s{std::min(room(19, 0, 256), uint32_t(1) << 17), room(19, 1, 1024), room(20, 2, 1024),
                   room(16, 2, 256), room(17, 2, 256)};
  s.roots = uint32_t(std::clamp<uint64_t>(num_roots, 1, s.roots));
  return s;
}

struct VisibleSamples::Arrays {
  uint32_t *ready, *first, *slots, *counts, *visible, *roots, *triangles, *rest, *large_parts;
  uint16_t *at, *masks;
  unsigned long long *keys, *spots;
  std::byte *scan_memory, *staged;
  uint64_t scan_bytes;
  RasterPatch *patches;
  RasterPoint *largest;
  uint8_t *blends;
  QueuedPiece *stack, *leaves;
  LargeTriangle *large;
  SpreadQuad *spread;
  ReyesNumbers *numbers;
  MappedQueue queue;
  uint64_t bytes;
};

VisibleSamples::Arrays VisibleSamples::lay_out(std::byte *base, const ReyesListSizes &sizes,
                                               uint64_t num_samples, uint64_t num_cells, uint64_t num_roots,
                                               const ReyesSettings &settings, const ReyesSchedule &schedule,
                                               bool has_masks, bool has_blending)
{
  const bool has_filter = settings.filter != ReyesFilter::Box;
  Layout layout(base);
  Arrays a;
  a.first = layout.take<uint32_t>(num_cells + 1);
  a.at = layout.take<uint16_t>(has_masks ? num_cells * most_masked : num_samples);
  a.masks = layout.take<uint16_t>(has_masks ? num_cells * most_masked : 0);
  a.slots = layout.take<uint32_t>(has_masks ? 0 : num_samples);
  a.keys = layout.take<unsigned long long>(num_samples);
  a.spots = layout.take<unsigned long long>(keeps_own_light(settings) ? 0 : num_samples);
  a.counts = layout.take<uint32_t>(has_filter ? num_cells : 0);
  a.scan_bytes = has_filter ? place_scan_bytes(uint32_t(num_cells)) : 0;
  a.scan_memory = layout.take<std::byte>(a.scan_bytes);
  a.visible = layout.take<uint32_t>(num_roots / 32 + 1);
  a.roots = layout.take<uint32_t>(sizes.roots);
  a.triangles = layout.take<uint32_t>(sizes.roots);
  a.patches = layout.take<RasterPatch>(sizes.roots);
  a.largest = layout.take<RasterPoint>(sizes.roots);
  a.blends = layout.take<uint8_t>(has_blending ? sizes.roots : 0);
  a.stack = layout.take<QueuedPiece>(sizes.stack);
  a.leaves = layout.take<QueuedPiece>(sizes.leaves);
  a.rest = layout.take<uint32_t>(sizes.leaves);
  a.large = layout.take<LargeTriangle>(sizes.large);
  a.large_parts = layout.take<uint32_t>(sizes.large);
  a.spread = layout.take<SpreadQuad>(sizes.spread);
  a.ready = layout.take<uint32_t>(schedule.split == Launch::Persistent ? sizes.stack : 0);
  a.staged = layout.take<std::byte>(
      schedule.stages == Traversal::LeafLists ? staged_grids(sizes) * diced_grid_bytes() : 0);
  a.numbers = layout.take<ReyesNumbers>(1);
  if (schedule.places != Compaction::Auto)
    a.queue = MappedQueue::lay_out(layout, schedule.places, sizes.stack);
  a.bytes = layout.bytes();
  return a;
}

VisibleSamples::VisibleSamples(const std::shared_ptr<DeviceMemory> &memory, const ReyesDeviceScene &scene,
                               const ReyesSettings &settings, const ReyesSchedule &schedule,
                               const ReyesListSizes &sizes, uint64_t num_samples, uint64_t num_cells,
                               bool has_masks, PinnedBuffer &pinned)
    : num_roots_(scene.num_roots),
      settings_(settings),
      schedule_(schedule),
      has_masks_(has_masks),
      has_own_light_(keeps_own_light(settings)),
      sizes_(sizes),
      num_cells_(num_cells),
      buffer_(memory,
              lay_out(nullptr, sizes, num_samples, num_cells, scene.num_roots, settings, schedule, has_masks,
                      scene.has_blending)
                  .bytes,
              "what REYES samples see, and its lists"),
      has_meshes_(scene.has_meshes),
      has_blending_(scene.has_blending),
      has_opaque_(scene.has_opaque),
      // Large micropolygons are left to kernels that come after the host has looked.
      resolves_ahead_(settings.shading_rate <= 1),
      split_blocks_(split_blocks()),
      pinned_(pinned)
{
  const bool has_filter = settings.filter != ReyesFilter::Box;
  const Arrays a = lay_out(buffer_.data(), sizes, num_samples, num_cells, num_roots_, settings, schedule,
                           has_masks, has_blending_);
  first_ = a.first;
  at_ = a.at;
  ready_ = schedule.split == Launch::Persistent ? a.ready : nullptr;
  queue_ = a.queue;
  staged_ = reinterpret_cast<DicedGrid *>(a.staged);
  num_staged_ = staged_grids(sizes);
  masks_ = has_masks ? a.masks : nullptr;
  slots_ = has_masks ? nullptr : a.slots;
  counts_ = has_filter ? a.counts : nullptr;
  scan_memory_ = a.scan_memory;
  scan_bytes_ = a.scan_bytes;
  visible_ = a.visible;
  batch_.scene = scene.view;
  batch_.has_own_light = has_own_light_ ? 1 : 0;
  batch_.keeps_middles = settings.lights_by_rays;
  batch_.has_cutouts = scene.has_cutouts ? 1 : 0;
  batch_.may_show_nothing = scene.may_show_nothing ? 1 : 0;
  batch_.blends = has_blending_ ? a.blends : nullptr;
  batch_.samples.masks = masks_;
  batch_.samples.first = a.first;
  batch_.samples.places = a.at;
  batch_.samples.keys = a.keys;
  batch_.samples.spots = a.spots;
  batch_.patches = a.patches;
  batch_.largest = a.largest;
  batch_.roots = a.roots;
  batch_.triangles = a.triangles;
  batch_.stack = a.stack;
  batch_.stack_capacity = sizes.stack;
  batch_.leaves = a.leaves;
  batch_.leaf_capacity = sizes.leaves;
  batch_.rest = a.rest;
  batch_.large = a.large;
  batch_.large_parts = a.large_parts;
  batch_.large_capacity = sizes.large;
  batch_.spread = a.spread;
  batch_.spread_capacity = sizes.spread;
  batch_.numbers = a.numbers;
  // Where micropolygons are meant to be large, grids have few: a lane that went through samples of many pixels alone would hold up
  // its warp, and most of the device would wait.
  batch_.tiny_extent = settings.shading_rate > 1 ? 1 << unit_bits : largest_tiny_extent;
  if (has_filter) make_filter_table(settings.filter, places_.table);
  pinned_.reserve(sizeof(ReyesNumbers));
  // Those of a plain frame: making one takes the host as long as starting a kernel.
  for (int i = 0; i < 8; ++i) events_.push_back(std::make_unique<Event>());
}

uint64_t VisibleSamples::cells_of(const WorkUnit &group, const ReyesSettings &settings, bool has_masks)
{
  const uint64_t reach = uint64_t(filter_reach(settings.filter));
  const uint64_t num_pixels = (group.x1 - group.x0 + 2 * reach) * (group.y1 - group.y0 + 2 * reach);
  return num_pixels << 2 * (has_masks ? 0 : unit_bits - cell_bits_for(group.num_samples));
}

bool VisibleSamples::suits_masks(const ReyesDeviceScene &scene, const ReyesSettings &settings,
                                 uint64_t most_samples_per_pixel)
{
  return settings.filter == ReyesFilter::Box && most_samples_per_pixel <= most_masked &&
         settings.shading_rate <= largest_masked_rate && !scene.has_meshes && !scene.has_cutouts;
}

void VisibleSamples::mark(Stage stage, cudaStream_t stream)
{
  if (events_.size() == stages_.size()) events_.push_back(std::make_unique<Event>());
  events_[stages_.size()]->record(stream);
  stages_.push_back(stage);
}

// Pixels [x0, x1) x [y0, y1) of the grid with a pixel around them, in pixels from the image's centre.
RasterRect VisibleSamples::rect_of_pixels(uint32_t x0, uint32_t y0, uint32_t x1, uint32_t y1) const
{
  const int32_t left = batch_.samples.x0 >> unit_bits, top = batch_.samples.y0 >> unit_bits;
  const float half_width = batch_.dice.half_width, half_height = batch_.dice.half_height;
  return {float(left + int32_t(x0) - 1) - half_width, float(top + int32_t(y0) - 1) - half_height,
          float(left + int32_t(x1) + 1) - half_width, float(top + int32_t(y1) + 1) - half_height};
}

// What the stages have to know of a group.
void VisibleSamples::begin(const WorkUnit &group, const PathSettings &settings)
{
  const int32_t reach = filter_reach(settings_.filter);
  SampleGrid &g = batch_.samples;
  const int32_t x0 = int32_t(group.x0) - reach, y0 = int32_t(group.y0) - reach;
  const int32_t width = int32_t(group.x1 - group.x0) + 2 * reach,
                height = int32_t(group.y1 - group.y0) + 2 * reach;
  g.x0 = x0 * (1 << unit_bits);
  g.y0 = y0 * (1 << unit_bits);
  g.cell_bits = has_masks_ ? unit_bits : cell_bits_for(group.num_samples);
  g.samples_per_pixel = uint32_t(group.num_samples);
  g.is_even = settings_.filter == ReyesFilter::Box ? 1 : 0;
  // The parts of all large triangles together are counted in 32 bits.
  const uint64_t num_pixels = uint64_t(width) * uint64_t(height);
  batch_.part_pixels = 256;
  const auto most_parts = [&] { return num_pixels / batch_.part_pixels + uint64_t(height) / 32 + 2; };
  while (most_parts() * sizes_.large >> 32 != 0) batch_.part_pixels *= 2;
  most_parts_ = most_parts();
  g.cells_x = width << (unit_bits - g.cell_bits);
  g.cells_y = height << (unit_bits - g.cell_bits);
  g.num_samples = uint32_t(uint64_t(group.x1 - group.x0) * (group.y1 - group.y0) * group.num_samples);
  batch_.projection = raster_projection(settings.camera);
  batch_.own = own_light(batch_.projection, settings_.shading == ReyesShading::Blocks ? 1 : 0,
                         settings.max_depth >= 2);
  batch_.dice = dice_settings(settings_.shading_rate, settings_.flatness, settings.camera.width,
                              settings.camera.height);
  batch_.rect = rect_of_pixels(0, 0, uint32_t(width), uint32_t(height));
  places_.unit = {group.x0, group.y0, group.x1, group.y1, group.first_sample, 0};
  places_.num_samples = group.num_samples;
  places_.seed = settings.seed;
  places_.frame_index = settings.frame_index;
  places_.filter = settings_.filter;
}

// Finds places for the samples, unless that was done, beside what the stream does: cutting waits most of its time. What comes next
// on the stream waits for both.
void VisibleSamples::place(cudaStream_t stream)
{
  if (beside_ == nullptr) return;
  const cudaStream_t beside = std::exchange(beside_, nullptr);
  const SampleGrid &g = batch_.samples;
  check(cudaStreamWaitEvent(beside, begun_->get(), 0), "cudaStreamWaitEvent");
  launch_place_samples(places_, g, first_, at_, masks_, slots_, counts_, scan_memory_, scan_bytes_, beside);
  if (!has_own_light_) {
    check(cudaMemsetAsync(g.spots, 0xff, uint64_t(g.num_samples) * sizeof *g.spots, beside),
          "cudaMemsetAsync");
  }
  placed_.record(beside);
  check(cudaStreamWaitEvent(stream, placed_.get(), 0), "cudaStreamWaitEvent");
  mark(Stage::Place, stream);
}

// Adds up what samples see of micropolygons' own light.
void VisibleSamples::resolve(cudaStream_t stream)
{
  launch_resolve_own_light(eye_hits(group_settings_), film_, film_.width * film_.height,
                           &batch_.numbers->largest_sample, stream);
  mark(Stage::Shade, stream);
}

// Clears what sampling the lists counts, and sums of rounds of cutting.
void VisibleSamples::clear_lists(cudaStream_t stream)
{
  if (std::exchange(has_clear_lists_, false)) return;
  check(cudaMemsetAsync(&batch_.numbers->num_large, 0,
                        offsetof(ReyesNumbers, queue_head) - offsetof(ReyesNumbers, num_large), stream),
        "cudaMemsetAsync");
}

ReyesNumbers VisibleSamples::read_numbers(cudaStream_t stream)
{
  auto *host = static_cast<ReyesNumbers *>(pinned_.reserve(sizeof(ReyesNumbers)));
  check(cudaMemcpyAsync(host, batch_.numbers, sizeof *host, cudaMemcpyDeviceToHost, stream),
        "cudaMemcpyAsync");
  check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
  return *host;
}

void VisibleSamples::split(const ReyesNumbers *last, cudaStream_t stream)
{
  if (schedule_.split == Launch::Regular) {
    const uint32_t levels = split_by_levels(batch_, queue_, [&] { return read_numbers(stream); }, stream);
    // Of what waits, and of what is to be diced.
    if (queue_.method != Compaction::Auto) compactions_ += 2 * uint64_t(levels);
  } else if (schedule_.split == Launch::Persistent) {
    if (turn_ == 0)
      check(cudaMemsetAsync(ready_, 0, sizes_.stack * sizeof(uint32_t), stream), "cudaMemsetAsync");
    if (last == nullptr) is_in_rounds_ = false;
    if (!is_in_rounds_ && !split_by_queues(batch_, ready_, turn_ + 1, last, stream)) {
      stack_queues(batch_, turn_, *last, stream);
      is_in_rounds_ = true;
    }
    if (is_in_rounds_) launch_split(batch_, split_blocks_, stream);
    else ++turn_;
  } else {
    launch_split(batch_, split_blocks_, stream);
  }
  mark(Stage::Split, stream);
}

// Whether a look is the first one at the group's fragments.
bool VisibleSamples::counts_fragments(Look look) const
{
  return look == Look::Count || (look == Look::Slots && batch_.fragments.slots.had == nullptr);
}

// What the lists hold goes into the samples. Once they have gone through it, it is known which of them are empty.
void VisibleSamples::sample(Look look, cudaStream_t stream, bool has_triangles)
{
  const ReyesNumbers &known = batch_numbers_;
  clear_lists(stream);
  if (has_triangles && has_meshes_ && !(has_all_ && known.num_triangles == 0)) {
    if (is_of_fragments(look)) launch_fragments_of_triangles(batch_, look, stream);
    else launch_sample_triangles(batch_, look, stream);
  }
  if (is_of_fragments(look)) {
    launch_fragments_of_grids(batch_, look, stream);
  } else if (schedule_.stages == Traversal::LeafLists) {
    const uint32_t num_leaves = read_numbers(stream).num_leaves;
    list_rounds_ += launch_staged_grids(batch_, num_leaves, staged_, num_staged_, stream);
  } else if (schedule_.stages == Traversal::Uber) {
    launch_uber_grids(batch_, stream);
  } else {
    launch_sample_grids(batch_, look, stream);
  }
  mark(Stage::Sample, stream);
}

// What grids and triangles left to kernels of their own, if anything: `numbers` are of the lists after sample(). False: cancelled.
bool VisibleSamples::sample_rest(Look look, const ReyesNumbers &numbers, const std::atomic<bool> *cancelled,
                                 cudaStream_t stream)
{
  if (numbers.num_rest == 0 && numbers.num_large == 0) return true;
  mark(Stage::None, stream);
  if (numbers.num_rest != 0) {
    if (is_of_fragments(look)) launch_fragments_of_rest(batch_, look, stream);
    else launch_sample_rest(batch_, look, stream);
  }
  const uint32_t most = numbers.num_rest != 0 ? sizes_.large : std::min(numbers.num_large, sizes_.large);
  if (!sample_large(look, most, cancelled, stream)) return false;
  mark(Stage::Sample, stream);
  return true;
}

// At most `most_triangles` large ones, so many parts a launch that none takes long. Where one may not be enough, the host waits
// and looks. False: cancelled.
bool VisibleSamples::sample_large(Look look, uint32_t most_triangles, const std::atomic<bool> *cancelled,
                                  cudaStream_t stream)
{
  const SampleGrid &g = batch_.samples;
  const uint64_t part_tests = uint64_t(batch_.part_pixels) * g.samples_per_pixel;
  const uint32_t at_a_time = uint32_t(std::max<uint64_t>(large_tests_of_launch / part_tests, 1));
  const auto launch = [&](uint32_t first) {
    if (is_of_fragments(look)) launch_fragments_of_large(batch_, look, {first, at_a_time}, stream);
    else launch_sample_large(batch_, look, {first, at_a_time}, stream);
  };
  launch_count_large_parts(batch_, stream);
  launch(0);
  if (most_parts_ * most_triangles <= at_a_time) return true;
  const uint32_t num_parts = read_numbers(stream).num_large_parts;
  for (uint32_t first = at_a_time; first < num_parts; first += at_a_time) {
    if (cancelled != nullptr && cancelled->load(std::memory_order_relaxed)) return false;
    check(cudaMemsetAsync(&batch_.numbers->tickets[2], 0, sizeof(uint32_t), stream), "cudaMemsetAsync");
    launch(first);
    check(cudaStreamSynchronize(stream), "cudaStreamSynchronize");
    // The sum of parts may be all that 32 bits hold.
    if (num_parts - first <= at_a_time) break;
  }
  return true;
}

// False: cancelled.
bool VisibleSamples::run_batch(uint64_t first, Look look, const std::atomic<bool> *cancelled,
                               cudaStream_t stream, ReyesCounters &counters)
{
  ReyesNumbers *numbers = batch_.numbers;
  if (!std::exchange(is_clear_, false))
    check(cudaMemsetAsync(numbers, 0, offsetof(ReyesNumbers, largest_queue), stream), "cudaMemsetAsync");
  has_clear_lists_ = true;
  const uint32_t n = uint32_t(std::min<uint64_t>(sizes_.roots, num_roots_ - first));
  const bool is_first_look = look == Look::Nearest, is_whole = n == num_roots_;
  // A first look whose lists may hold everything does the bounding and cutting for all looks.
  batch_.kinds = is_whole && is_first_look ? 3 : (is_of_fragments(look) ? 2 : 1);
  launch_bound_roots(batch_, first, n, stream);
  mark(Stage::Bound, stream);
  if (beside_ != nullptr) begun_ = events_[stages_.size() - 1].get();
  for (bool is_first = true;; is_first = false) {
    split(is_first ? nullptr : &batch_numbers_, stream);
    place(stream);
    sample(look, stream, is_first);
    // Mostly that was all, and the device need not wait for the host to look.
    is_resolved_ = has_own_light_ && resolves_ahead_ && is_first && is_whole;
    if (is_resolved_) resolve(stream);
    const ReyesNumbers done = read_numbers(stream);
    if (!sample_rest(look, done, cancelled, stream)) return false;
    const bool is_finished = done.waiting == 0 && done.next_slot == done.num_slots;
    // Unless the first look counted both kinds.
    if (is_finished && (is_first_look || (counts_fragments(look) && !(is_whole && has_opaque_)))) {
      counters.num_patches += done.num_slots;
      counters.num_triangles += done.num_triangles;
      counters.largest_bucket = std::max<uint64_t>(counters.largest_bucket, n);
    }
    has_all_ = is_first && is_finished && is_whole && !is_narrow_ &&
               (is_first_look || (counts_fragments(look) && !has_opaque_));
    batch_numbers_ = done;
    resolves_ahead_ = is_first && is_finished && done.num_rest == 0 && done.num_large == 0;
    is_resolved_ &= resolves_ahead_;
    if (is_finished) return true;
    check(cudaMemsetAsync(&numbers->num_leaves, 0,
                          offsetof(ReyesNumbers, queue_head) - offsetof(ReyesNumbers, num_leaves), stream),
          "cudaMemsetAsync");
    has_clear_lists_ = true;
  }
}

// False: cancelled.
bool VisibleSamples::run_batches(Look look, const std::atomic<bool> *cancelled, cudaStream_t stream,
                                 ReyesCounters &counters)
{
  has_all_ = false;
  for (uint64_t first = 0; first < num_roots_; first += sizes_.roots) {
    if (cancelled != nullptr && cancelled->load(std::memory_order_relaxed)) return false;
    if (!run_batch(first, look, cancelled, stream, counters)) return false;
  }
  return true;
}

bool VisibleSamples::find(const WorkUnit &group, const PathSettings &settings, const FilmView &film,
                          const std::atomic<bool> *cancelled, cudaStream_t stream, cudaStream_t beside,
                          ReyesCounters &counters)
{
  begin(group, settings);
  group_settings_ = settings;
  film_ = film;
  beside_ = beside;
  stages_.clear();
  check(cudaMemsetAsync(batch_.numbers, 0, sizeof *batch_.numbers, stream), "cudaMemsetAsync");
  mark(Stage::None, stream);
  begun_ = events_[0].get();
  is_clear_ = true;
  batch_.visible = nullptr;
  has_all_ = is_narrow_ = is_resolved_ = false;
  if (has_opaque_ && !run_batches(Look::Nearest, cancelled, stream, counters)) return false;
  place(stream);
  if (has_own_light_ && !is_resolved_) {
    mark(Stage::None, stream);
    resolve(stream);
  }
  if (has_own_light_ || !has_opaque_) return true;
  // What is nearest is known: a second look at what is seen tells where on it samples lie.
  check(cudaMemsetAsync(visible_, 0, (num_roots_ / 32 + 1) * sizeof *visible_, stream), "cudaMemsetAsync");
  launch_mark_visible(batch_.samples, visible_, stream);
  batch_.visible = visible_;
  if (has_all_) {
    sample(Look::Spots, stream, true);
    return sample_rest(Look::Spots, batch_numbers_, cancelled, stream);
  }
  ReyesCounters again;
  return run_batches(Look::Spots, cancelled, stream, again);
}

bool VisibleSamples::look_at_fragments(Look look, const FragmentView &view, uint32_t first_pixel,
                                       uint32_t last_pixel, const std::atomic<bool> *cancelled,
                                       cudaStream_t stream, ReyesCounters &counters)
{
  batch_.fragments = view;
  batch_.visible = nullptr;
  const SampleGrid &g = batch_.samples;
  const uint32_t width = uint32_t(g.cells_x >> cell_shift(g)), height = uint32_t(g.cells_y >> cell_shift(g));
  const uint32_t y0 = first_pixel / width, y1 = last_pixel / width + 1;
  // Lists of all are good for parts too, but parts of a few rows are better cut anew.
  is_narrow_ = y1 - y0 != height;
  if (!is_narrow_ && has_all_) {
    // The numbers of the first look are of the other kind of roots; those of the second one are known.
    mark(Stage::None, stream);
    sample(look, stream, true);
    if (counts_fragments(look)) {
      const ReyesNumbers done = read_numbers(stream);
      batch_numbers_.num_rest = done.num_rest;
      batch_numbers_.num_large = done.num_large;
    }
    return sample_rest(look, batch_numbers_, cancelled, stream);
  }
  if (y1 - y0 == 1) batch_.rect = rect_of_pixels(first_pixel % width, y0, last_pixel % width + 1, y1);
  else batch_.rect = rect_of_pixels(0, y0, width, y1);
  ReyesCounters again;
  return run_batches(look, cancelled, stream, counts_fragments(look) ? counters : again);
}

EyeHits VisibleSamples::eye_hits(const PathSettings &settings) const
{
  return {batch_.scene,         settings,      places_, places_.unit, slots_, batch_.samples.keys,
          batch_.samples.spots, batch_.numbers};
}

void VisibleSamples::write_eye_hits(const PathSettings &settings, const PathUnit &unit, const PathWave &wave,
                                    uint32_t num_paths, cudaStream_t stream) const
{
  EyeHits eye = eye_hits(settings);
  eye.unit = unit;
  launch_eye_hits(eye, wave, num_paths, stream);
}

void VisibleSamples::shade_at_once(const PathSettings &settings, const FilmView &film, cudaStream_t stream)
{
  mark(Stage::None, stream);
  launch_shade_pixels(eye_hits(settings), film, film.width * film.height, &batch_.numbers->largest_sample,
                      stream);
  mark(Stage::Shade, stream);
}

void VisibleSamples::collect(cudaStream_t stream, RenderCounters &counters)
{
  const ReyesNumbers n = read_numbers(stream);
  ReyesCounters &r = counters.reyes;
  r.num_splits += n.num_splits;
  r.num_culled += n.num_culled;
  r.num_grids += n.num_grids;
  r.num_micropolygons += n.num_micropolygons;
  r.num_fragments += n.num_fragments;
  r.num_lost_fragments += n.num_lost_fragments;
  r.num_shaded += n.num_shaded;
  r.split_rounds += n.split_rounds;
  r.num_donated += n.num_donated;
  counters.schedule.mode_switches += n.num_switches;
  counters.schedule.list_rounds += list_rounds_;
  list_rounds_ = 0;
  counters.schedule.compactions += compactions_;
  compactions_ = 0;
  r.largest_queue = std::max<uint64_t>(r.largest_queue, n.largest_queue);
  counters.largest_sample = std::max(counters.largest_sample, float_from_bits(n.largest_sample));
  for (size_t i = 1; i < stages_.size(); ++i) {
    const double seconds = seconds_between(*events_[i - 1], *events_[i]);
    if (stages_[i] == Stage::Bound) r.bound_seconds += seconds;
    else if (stages_[i] == Stage::Split) r.split_seconds += seconds;
    else if (stages_[i] == Stage::Sample) r.sample_seconds += seconds;
    else if (stages_[i] == Stage::Place) counters.generate_seconds += seconds;
    else if (stages_[i] == Stage::Shade) counters.shade_seconds += seconds;
  }
  stages_.clear();
}

}  // namespace gpurt::cuda
