#include "cuda/reyes/blended_samples.h"

#include <algorithm>

#include "cuda/layout.h"
#include "error.h"

namespace gpurt::cuda {

namespace {

// Layers that samples are peeled by at a time. More take fewer looks, of fewer samples, but longer ones: a layer that comes in
// front moves those behind it.
constexpr uint32_t least_peeled_layers = 32, most_peeled_layers = 64;

}  // namespace

struct BlendedSamples::Arrays {
  uint32_t *count, *num_shown, *first_shown;
  uint64_t *first;
  KeptFragment *kept;
  FragmentMark *had;
  SampleBlend *samples;
  float *shares, *behind;
  std::byte *scan_memory;
  uint64_t scan_bytes, bytes;
};

BlendedSamples::Arrays BlendedSamples::lay_out(std::byte *base, uint64_t num_samples, uint64_t capacity,
                                               uint32_t num_slots, bool needs_rays)
{
  const bool is_exact = num_slots == 0;
  Layout layout(base);
  Arrays a;
  a.count = layout.take<uint32_t>(is_exact ? num_samples + 1 : 0);
  a.first = layout.take<uint64_t>(is_exact ? num_samples + 1 : 0);
  a.kept = layout.take<KeptFragment>(capacity);
  a.had = layout.take<FragmentMark>(is_exact ? capacity / least_peeled_layers : 0);
  a.samples = layout.take<SampleBlend>(num_samples);
  a.shares = layout.take<float>(needs_rays ? capacity : 0);
  a.behind = layout.take<float>(needs_rays ? num_samples : 0);
  a.num_shown = layout.take<uint32_t>(needs_rays ? num_samples + 1 : 0);
  a.first_shown = layout.take<uint32_t>(needs_rays ? num_samples + 1 : 0);
  a.scan_bytes = fragment_scan_bytes(num_samples);
  a.scan_memory = layout.take<std::byte>(a.scan_bytes);
  a.bytes = layout.bytes();
  return a;
}

BlendedSamples::BlendedSamples(const std::shared_ptr<DeviceMemory> &memory, uint64_t num_samples,
                               uint64_t most_fragments, uint32_t num_slots, bool needs_rays)
    : capacity_(num_slots != 0 ? num_samples * num_slots : most_fragments),
      num_slots_(num_slots),
      needs_rays_(needs_rays),
      buffer_(memory, lay_out(nullptr, num_samples, capacity_, num_slots, needs_rays).bytes,
              "fragments of surfaces that blend")
{
  const Arrays a = lay_out(buffer_.data(), num_samples, capacity_, num_slots, needs_rays);
  count_ = a.count;
  first_ = a.first;
  kept_ = a.kept;
  had_ = a.had;
  samples_ = a.samples;
  shares_ = a.shares;
  behind_ = a.behind;
  num_shown_ = a.num_shown;
  first_shown_ = a.first_shown;
  scan_memory_ = a.scan_memory;
  scan_bytes_ = a.scan_bytes;
}

// A part of the group's samples that is under way.
struct BlendedSamples::Part {
  VisibleSamples &visible;
  Blending blending;
  const ShadeItems &shade;
  const std::atomic<bool> *cancelled;
  cudaStream_t stream;
  ReyesCounters &counters;
  uint32_t first_pixel, last_pixel;

  bool look(Look look, const FragmentView &view) const
  {
    return visible.look_at_fragments(look, view, first_pixel, last_pixel, cancelled, stream, counters);
  }
};

// Blends the fragments of the view, which are there.
bool BlendedSamples::blend(const Part &part, const FragmentView &view, bool is_first)
{
  Blending b = part.blending;
  b.fragments = view;
  b.is_first = is_first ? 1 : 0;
  part.visible.begin_shading(part.stream);
  if (needs_rays_) launch_find_shares(b, scan_memory_, scan_bytes_, part.stream);
  else launch_blend_at_once(b, part.stream);
  part.visible.end_shading(part.stream);
  if (!needs_rays_) return true;
  return part.shade(b, part.visible.read_numbers(part.stream).num_items);
}

// Slots for the view's samples in the memory of kept fragments: numbers of their keys, then as many of their places.
FragmentSlots BlendedSamples::slots_for(const FragmentView &view, uint32_t layers, FragmentMark *had)
{
  auto *keys = reinterpret_cast<unsigned long long *>(kept_);
  return {layers, keys, keys + uint64_t(view.end - view.begin) * layers, had};
}

// Finds the nearest fragments of the view's samples, and where they lie.
bool BlendedSamples::fill_slots(const Part &part, const FragmentView &view)
{
  const uint64_t bytes = uint64_t(view.end - view.begin) * view.slots.layers * sizeof *view.slots.keys;
  check(cudaMemsetAsync(view.slots.keys, 0, bytes, part.stream), "cudaMemsetAsync");
  check(cudaMemsetAsync(view.slots.places, 0xff, bytes, part.stream), "cudaMemsetAsync");
  return part.look(Look::Slots, view) && part.look(Look::Places, view);
}

// Some sample of the view has more fragments than there is room for: the nearest layers at a time, until the view's
// `num_fragments` have had their turn.
bool BlendedSamples::peel(const Part &part, FragmentView view, uint64_t num_fragments)
{
  const uint64_t layers = std::min<uint64_t>(capacity_ / (view.end - view.begin), most_peeled_layers);
  view.slots = slots_for(view, uint32_t(layers), had_);
  check(cudaMemsetAsync(had_, 0xff, (view.end - view.begin) * sizeof *had_, part.stream), "cudaMemsetAsync");
  uint32_t *num_open = &part.blending.eye.numbers->num_open;
  const uint64_t most_turns = num_fragments / layers + 1;
  for (uint64_t turn = 0; turn != most_turns; ++turn) {
    check(cudaMemsetAsync(num_open, 0, sizeof *num_open, part.stream), "cudaMemsetAsync");
    if (!fill_slots(part, view) || !blend(part, view, turn == 0)) return false;
    if (part.visible.read_numbers(part.stream).num_open == 0) return true;
  }
  fail(GPURT_ERROR_INTERNAL, "layers of surfaces that blend came up that had not been counted");
}

// All fragments of the group's samples, in as many turns as it takes.
bool BlendedSamples::blend_all(Part part, FragmentView view)
{
  const SampleGrid &grid = part.visible.grid();
  ReyesNumbers *numbers = part.blending.eye.numbers;
  const uint32_t num_samples = grid.num_samples;
  uint64_t &largest = part.counters.largest_fragments;
  check(cudaMemsetAsync(count_, 0, (uint64_t(num_samples) + 1) * sizeof *count_, part.stream),
        "cudaMemsetAsync");
  if (!part.look(Look::Count, view)) return false;
  launch_sum_fragments(view, first_, num_samples, scan_memory_, scan_bytes_, numbers, part.stream);
  const uint64_t total = part.visible.read_numbers(part.stream).part_fragments;
  if (total <= capacity_) {
    largest = std::max(largest, total);
    return part.look(Look::Keep, view) && blend(part, view, true);
  }
  const uint32_t most_peeled = uint32_t(std::min<uint64_t>(capacity_ / least_peeled_layers, num_samples));
  for (uint32_t begin = 0; begin != num_samples; begin = view.end) {
    launch_find_part(grid, first_, begin, capacity_, most_peeled, numbers, part.stream);
    const ReyesNumbers found = part.visible.read_numbers(part.stream);
    part.first_pixel = found.first_pixel;
    part.last_pixel = found.last_pixel;
    view.begin = begin;
    view.end = found.part_end;
    view.base = found.part_first;
    if (found.part_fragments > capacity_) {
      largest = std::max(largest, capacity_);
      if (!peel(part, view, found.part_fragments)) return false;
    } else {
      largest = std::max<uint64_t>(largest, found.part_fragments);
      if (!part.look(Look::Keep, view) || !blend(part, view, true)) return false;
    }
  }
  return true;
}

// The fixed A-buffer: what is behind a sample's last slot is lost.
bool BlendedSamples::blend_slots(const Part &part, FragmentView view)
{
  view.slots = slots_for(view, num_slots_, nullptr);
  const uint64_t before = part.visible.read_numbers(part.stream).num_fragments;
  if (!fill_slots(part, view)) return false;
  const ReyesNumbers found = part.visible.read_numbers(part.stream);
  part.counters.largest_fragments = std::max<uint64_t>(
      part.counters.largest_fragments, found.num_fragments - before - found.num_lost_fragments);
  return blend(part, view, true);
}

bool BlendedSamples::run(const WorkUnit &group, const PathSettings &settings, VisibleSamples &visible,
                         const ShadeItems &shade, const FilmView &film, const std::atomic<bool> *cancelled,
                         cudaStream_t stream, ReyesCounters &counters)
{
  const SampleGrid &grid = visible.grid();
  const EyeHits eye = visible.eye_hits(settings);
  const uint32_t num_samples = grid.num_samples, num_pixels = (group.x1 - group.x0) * (group.y1 - group.y0);
  const int32_t s = cell_shift(grid);
  const uint32_t num_grid_pixels = uint32_t(grid.cells_x >> s) * uint32_t(grid.cells_y >> s);
  const FragmentView view{count_, first_, kept_, 0, capacity_, 0, 0, num_samples, {}};
  const Blending blending{eye, view, samples_, num_samples, 1, shares_, behind_, num_shown_, first_shown_};
  const Part part{visible, blending, shade, cancelled, stream, counters, 0, num_grid_pixels - 1};
  if (!(num_slots_ != 0 ? blend_slots(part, view) : blend_all(part, view))) return false;
  visible.begin_shading(stream);
  launch_add_blended(blending, film, num_pixels, &eye.numbers->largest_sample, stream);
  visible.end_shading(stream);
  if (visible.read_numbers(stream).num_misplaced != 0)
    fail(GPURT_ERROR_INTERNAL, "fragments of surfaces that blend came up that had not been counted");
  return true;
}

}  // namespace gpurt::cuda
