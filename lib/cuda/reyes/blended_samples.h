// Surfaces that blend before what the samples of a group of units see: an A-buffer in two passes, on a CUDA stream.
//
// Fragments are counted, their numbers summed, and then kept in exactly as much memory. Where there is room for fewer, parts of
// the samples take turns, each as large as its fragments allow: the same fragments in the same order, so that memory changes no
// bit. Where one sample alone has more than there is room for, it and some after it are peeled: looks for the nearest layers behind
// those that a sample has had.
//
// With ReyesSettings::fragment_slots it is the fixed A-buffer: a sample keeps its nearest fragments, as many as it has slots, and the
// others are lost.
#pragma once

#include "cuda/path/wave.h"
#include "cuda/reyes/blend.h"
#include "cuda/reyes/visible.h"

namespace gpurt::cuda {

/// Memory of a lane for that.
class BlendedSamples {
 public:
  /// For groups of up to `num_samples`, and so many fragments at a time, or so many slots for each sample where that is not 0.
  /// Throws OUT_OF_MEMORY.
  BlendedSamples(const std::shared_ptr<DeviceMemory> &memory, uint64_t num_samples, uint64_t most_fragments,
                 uint32_t num_slots, bool needs_rays);

  /// Shades the items that are shown of a part, through paths of a wave: calls launch_make_shown_paths and launch_add_shown.
  /// False: cancelled.
  using ShadeItems = std::function<bool(const Blending &blending, uint32_t num_items)>;

  /// Blends what `visible` has found of the group, and adds it to a film of zeros. `shade`: where rays are needed, else null.
  /// False if `cancelled` became true on the way.
  bool run(const WorkUnit &group, const PathSettings &settings, VisibleSamples &visible,
           const ShadeItems &shade, const FilmView &film, const std::atomic<bool> *cancelled,
           cudaStream_t stream, ReyesCounters &counters);

  uint64_t bytes() const { return buffer_.bytes(); }

 private:
  struct Arrays;
  static Arrays lay_out(std::byte *base, uint64_t num_samples, uint64_t capacity, uint32_t num_slots,
                        bool needs_rays);
  struct Part;
  bool blend(const Part &part, const FragmentView &view, bool is_first);
  FragmentSlots slots_for(const FragmentView &view, uint32_t layers, FragmentMark *had);
  bool fill_slots(const Part &part, const FragmentView &view);
  bool peel(const Part &part, FragmentView view, uint64_t num_fragments);
  bool blend_all(Part part, FragmentView view);
  bool blend_slots(const Part &part, FragmentView view);

  const uint64_t capacity_;
  const uint32_t num_slots_;
  const bool needs_rays_;
  DeviceBuffer<std::byte> buffer_;
  uint32_t *count_ = nullptr;
  uint64_t *first_ = nullptr;
  KeptFragment *kept_ = nullptr;
  FragmentMark *had_ = nullptr;
  SampleBlend *samples_ = nullptr;
  float *shares_ = nullptr, *behind_ = nullptr;
  uint32_t *num_shown_ = nullptr, *first_shown_ = nullptr;
  std::byte *scan_memory_ = nullptr;
  uint64_t scan_bytes_ = 0;
};

}  // namespace gpurt::cuda
