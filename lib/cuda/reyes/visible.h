// What the samples of a group of units see, found by REYES on a CUDA stream.
#pragma once

#include <atomic>
#include <memory>
#include <vector>

#include "backend.h"
#include "cuda/lanes.h"
#include "cuda/reyes/render.h"
#include "cuda/reyes/split_schedules.h"
#include "cuda/reyes/stages.h"

namespace gpurt::cuda {

/// Room of the lists between stages. What does not fit at a time is done in several turns.
struct ReyesListSizes {
  uint32_t roots;   // of a batch
  uint32_t stack;   // pieces that wait to be cut
  uint32_t leaves;  // pieces that wait to be diced
  uint32_t large;   // triangles that a lane of its own would take long for
  uint32_t spread;  // micropolygons of which that is so

  /// Level 0 is the largest; each further one has half of the last one's room. Spare ones leave a level's memory to samples: a
  /// list that fills up once more costs less than one more group of them.
  static ReyesListSizes at_level(unsigned level, bool is_spare, uint64_t num_roots);
};

/// Whether samples keep light in place of what they see.
inline bool keeps_own_light(const ReyesSettings &settings)
{
  return settings.shading != ReyesShading::Samples && settings.lights_by_rays == 0;
}

/// Memory of a lane for groups of samples, and the stages from 'transform' to 'sample' that run in it.
class VisibleSamples {
 public:
  /// For groups of up to `num_samples` in `num_cells`. Counts come through `pinned`. Throws OUT_OF_MEMORY.
  VisibleSamples(const std::shared_ptr<DeviceMemory> &memory, const ReyesDeviceScene &scene,
                 const ReyesSettings &settings, const ReyesSchedule &schedule, const ReyesListSizes &sizes,
                 uint64_t num_samples, uint64_t num_cells, bool has_masks, PinnedBuffer &pinned);

  /// Whether samples are found by masks of pixels: groups have at most so many a pixel, and micropolygons are small.
  static bool suits_masks(const ReyesDeviceScene &scene, const ReyesSettings &settings,
                          uint64_t most_samples_per_pixel);
  /// Cells of a group's samples.
  static uint64_t cells_of(const WorkUnit &group, const ReyesSettings &settings, bool has_masks);

  /// Finds what the group's samples see of what does not blend; where micropolygons' own light is all that they keep, adds it
  /// up in `film`, which need not be clear. Places of samples are found on the stream `beside`, while patches are cut. False if
  /// `cancelled` became true on the way.
  bool find(const WorkUnit &group, const PathSettings &settings, const FilmView &film,
            const std::atomic<bool> *cancelled, cudaStream_t stream, cudaStream_t beside,
            ReyesCounters &counters);

  /// Looks at fragments of surfaces that blend, of the group's samples in the view, all of which lie in the pixels
  /// [first_pixel, last_pixel] of the grid; false if `cancelled` became true on the way.
  bool look_at_fragments(Look look, const FragmentView &view, uint32_t first_pixel, uint32_t last_pixel,
                         const std::atomic<bool> *cancelled, cudaStream_t stream, ReyesCounters &counters);
  /// Of the group: its samples, and what decides where they lie and what they see.
  const SampleGrid &grid() const { return batch_.samples; }
  EyeHits eye_hits(const PathSettings &settings) const;
  /// Where on their primitives samples lie, by keys: as eye_hits has them.
  unsigned long long *spots() const { return batch_.samples.spots; }
  ReyesNumbers read_numbers(cudaStream_t stream);
  /// What is put on the stream in between counts as shading.
  void begin_shading(cudaStream_t stream) { mark(Stage::None, stream); }
  void end_shading(cudaStream_t stream) { mark(Stage::Shade, stream); }

  /// Writes what eye rays of the unit, a part of the group, meet.
  void write_eye_hits(const PathSettings &settings, const PathUnit &unit, const PathWave &wave,
                      uint32_t num_paths, cudaStream_t stream) const;

  /// Shades the group's samples without rays, where the scene allows it (launch_shade_pixels); not for micropolygons' own light.
  void shade_at_once(const PathSettings &settings, const FilmView &film, cudaStream_t stream);

  /// Adds what was counted, once all of the group's work is on the stream, and times.
  void collect(cudaStream_t stream, RenderCounters &counters);

  uint64_t bytes() const { return buffer_.bytes(); }

 private:
  enum class Stage { None, Place, Bound, Split, Sample, Shade };
  struct Arrays;
  static Arrays lay_out(std::byte *base, const ReyesListSizes &sizes, uint64_t num_samples,
                        uint64_t num_cells, uint64_t num_roots, const ReyesSettings &settings,
                        const ReyesSchedule &schedule, bool has_masks, bool has_blending);
  void mark(Stage stage, cudaStream_t stream);
  void begin(const WorkUnit &group, const PathSettings &settings);
  void place(cudaStream_t stream);
  void resolve(cudaStream_t stream);
  void clear_lists(cudaStream_t stream);
  RasterRect rect_of_pixels(uint32_t x0, uint32_t y0, uint32_t x1, uint32_t y1) const;
  void split(const ReyesNumbers *last, cudaStream_t stream);
  bool counts_fragments(Look look) const;
  void sample(Look look, cudaStream_t stream, bool has_triangles);
  bool sample_rest(Look look, const ReyesNumbers &numbers, const std::atomic<bool> *cancelled,
                   cudaStream_t stream);
  bool sample_large(Look look, uint32_t most_triangles, const std::atomic<bool> *cancelled,
                    cudaStream_t stream);
  bool run_batch(uint64_t first, Look look, const std::atomic<bool> *cancelled, cudaStream_t stream,
                 ReyesCounters &counters);
  bool run_batches(Look look, const std::atomic<bool> *cancelled, cudaStream_t stream,
                   ReyesCounters &counters);

  const uint64_t num_roots_;
  const ReyesSettings settings_;
  const ReyesSchedule schedule_;
  const bool has_masks_, has_own_light_;
  const ReyesListSizes sizes_;
  const uint64_t num_cells_;
  DeviceBuffer<std::byte> buffer_;
  ReyesBatch batch_{};
  uint64_t most_parts_ = 0;  // that a large triangle has
  SamplePlaces places_{};
  uint32_t *first_ = nullptr, *slots_ = nullptr, *counts_ = nullptr, *visible_ = nullptr;
  uint32_t *ready_ = nullptr;    // of queues of pieces
  uint32_t turn_ = 0;            // launches with such queues
  bool is_in_rounds_ = false;    // the batch goes on without them
  MappedQueue queue_;            // of levels
  uint64_t compactions_ = 0;     // of that
  DicedGrid *staged_ = nullptr;  // between separate kernels
  uint32_t num_staged_ = 0;
  uint64_t list_rounds_ = 0;  // times that these ran
  uint16_t *at_ = nullptr, *masks_ = nullptr;
  std::byte *scan_memory_ = nullptr;
  uint64_t scan_bytes_ = 0;
  const bool has_meshes_, has_blending_, has_opaque_;
  // Of the last batch: its lists hold all that the group needs, of both kinds of roots, and what it counted.
  bool has_all_ = false;
  bool is_narrow_ = false;  // what is bounded and cut is for a part of the group
  ReyesNumbers batch_numbers_{};
  // What is clear, of numbers: all; those of lists that sampling fills.
  bool is_clear_ = false, has_clear_lists_ = false;
  // Of the group: settings, and the film that micropolygons' own light goes to.
  PathSettings group_settings_{};
  FilmView film_{};
  // The stream that finds places of the group's samples, until it does; what it waits for: not before pieces are about to be cut,
  // which come first.
  cudaStream_t beside_ = nullptr;
  const Event *begun_ = nullptr;
  Event placed_{cudaEventDisableTiming};
  // Whether the film has the light of all that samples see; whether it is to have it before the host has looked at what is left.
  bool is_resolved_ = false, resolves_ahead_;
  const unsigned split_blocks_;
  PinnedBuffer &pinned_;
  std::vector<std::unique_ptr<Event>> events_;
  std::vector<Stage> stages_;
};

}  // namespace gpurt::cuda
