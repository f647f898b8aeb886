#include "cuda/reyes/blended_samples.h"

#include <algorithm>

#include "cuda/layout.h"
#include "error.h"

namespace gpurt::cuda {

struct BlendedSamples::Arrays {
  uint32_t *count, *num_shown, *first_shown;
  uint64_t *first;
  KeptFragment *kept;
  SampleBlend *samples;
  float *shares, *behind;
  std::byte *scan_memory;
  uint64_t scan_bytes, bytes;
};

BlendedSamples::Arrays BlendedSamples::lay_out(std::byte *base, uint64_t num_samples, uint64_t capacity,
                                               bool needs_rays)
{
  Layout layout(base);
  Arrays a;
  a.count = layout.take<uint32_t>(num_samples + 1);
  a.first = layout.take<uint64_t>(num_samples + 1);
  a.kept = layout.take<KeptFragment>(capacity);
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
                               uint64_t capacity, bool needs_rays)
    : capacity_(capacity),
      needs_rays_(needs_rays),
      buffer_(memory, lay_out(nullptr, num_samples, capacity, needs_rays).bytes,
              "fragments of surfaces that blend")
{
  const Arrays a = lay_out(buffer_.data(), num_samples, capacity, needs_rays);
  count_ = a.count;
  first_ = a.first;
  kept_ = a.kept;
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

// Keeps the fragments of the view, which have been counted, and blends them.
bool BlendedSamples::blend(const Part &part, const FragmentView &view)
{
  if (!part.look(Look::Keep, view)) return false;
  Blending b = part.blending;
  b.fragments = view;
  b.is_first = b.is_last = 1;
  part.visible.begin_shading(part.stream);
  if (needs_rays_) launch_find_shares(b, scan_memory_, scan_bytes_, part.stream);
  else launch_blend_at_once(b, part.stream);
  part.visible.end_shading(part.stream);
  if (!needs_rays_) return true;
  return part.shade(b, part.visible.read_numbers(part.stream).num_items);
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
  Part part{visible, {eye, {}, samples_, num_samples, 1, 1, shares_, behind_, num_shown_, first_shown_},
            shade,   cancelled,
            stream,  counters,
            0,       num_grid_pixels - 1};
  FragmentView view{count_, first_, kept_, 0, capacity_, 0, 0, num_samples, 0, ~0ull};
  check(cudaMemsetAsync(count_, 0, (uint64_t(num_samples) + 1) * sizeof *count_, stream), "cudaMemsetAsync");
  if (!part.look(Look::Count, view)) return false;
  launch_sum_fragments(view, first_, num_samples, scan_memory_, scan_bytes_, eye.numbers, stream);
  const uint64_t total = visible.read_numbers(stream).part_fragments;
  if (total <= capacity_) {
    counters.largest_fragments = std::max(counters.largest_fragments, total);
    if (!blend(part, view)) return false;
  } else {
    for (uint32_t begin = 0; begin != num_samples; begin = view.end) {
      launch_find_part(grid, first_, begin, capacity_, eye.numbers, stream);
      const ReyesNumbers found = visible.read_numbers(stream);
      part.first_pixel = found.first_pixel;
      part.last_pixel = found.last_pixel;
      view.begin = begin;
      view.end = found.part_end;
      view.base = found.part_first;
      if (found.part_fragments > capacity_) {
        fail(GPURT_ERROR_OUT_OF_MEMORY,
             "a sample sees {} surfaces that blend, and there is room for {}; raise the memory limit",
             found.part_fragments, capacity_);
      }
      counters.largest_fragments = std::max<uint64_t>(counters.largest_fragments, found.part_fragments);
      if (!blend(part, view)) return false;
    }
  }
  visible.begin_shading(stream);
  launch_add_blended({eye, view, samples_, num_samples, 1, 1, shares_, behind_, num_shown_, first_shown_},
                     film, num_pixels, &eye.numbers->largest_sample, stream);
  visible.end_shading(stream);
  if (visible.read_numbers(stream).num_misplaced != 0)
    fail(GPURT_ERROR_INTERNAL, "fragments of surfaces that blend came up that had not been counted");
  return true;
}

}  // namespace gpurt::cuda
