// Stage 'blend' as host code calls it: fragments of surfaces that blend, sample by sample from front to back.
#pragma once

#include "core/path/film_view.h"
#include "cuda/reyes/stages.h"

namespace gpurt::cuda {

/// What has been blended of a sample so far.
struct SampleBlend {
  Vec3f radiance;
  float through;      // what is seen behind it
  float to_standing;  // shares until the surface that stands for the sample; below 0 after it
  Hit standing;       // what stands for the sample in outputs that do not blend
};

/// Samples whose fragments are kept, and what becomes of them. Arrays of samples go in the order of paths.
struct Blending {
  EyeHits eye;  // eye.unit is the whole group
  FragmentView fragments;
  SampleBlend *samples;
  uint32_t num_samples;
  uint32_t is_first;  // of a sample's fragments none were blended before these
  // Where rays are needed: shares of what is shown, which `kept` is reduced to, and of what lies behind it; what a sample shows.
  float *shares, *behind;
  uint32_t *num_shown;
  uint32_t *first_shown;  // [num_samples + 1]: sums of these
};

/// Bytes that sums over `n` samples work in.
uint64_t fragment_scan_bytes(uint64_t n);

/// first[i] = counts before slot i of the view, for 0 .. n; numbers->part_fragments = their sum.
void launch_sum_fragments(const FragmentView &view, uint64_t *first, uint32_t n, void *scan_memory,
                          uint64_t scan_bytes, ReyesNumbers *numbers, cudaStream_t stream);

/// Finds the largest part from slot `begin` on that has room for its fragments, or, where the first sample alone has more,
/// at most `most_peeled` samples: numbers->part_...
void launch_find_part(const SampleGrid &grid, const uint64_t *first, uint32_t begin, uint64_t capacity,
                      uint32_t most_peeled, ReyesNumbers *numbers, cudaStream_t stream);

/// Blends the samples of the view, and shades on the way what needs no ray. What does not blend, or the background, lies behind
/// a sample's fragments, but for samples that have all of the view's slots and want what is behind: numbers->num_open.
void launch_blend_at_once(const Blending &blending, cudaStream_t stream);

/// The same up to shading: sorts fragments and finds the shares of what is shown, numbers->num_items in all.
void launch_find_shares(const Blending &blending, void *scan_memory, uint64_t scan_bytes,
                        cudaStream_t stream);
/// Makes paths of what is shown, n of it from first on; and adds their light to the samples.
void launch_make_shown_paths(const Blending &blending, const PathWave &wave, uint32_t first, uint32_t n,
                             cudaStream_t stream);
void launch_add_shown(const Blending &blending, const PathWave &wave, uint32_t first, uint32_t n,
                      cudaStream_t stream);

/// Adds the samples to a film of zeros.
void launch_add_blended(const Blending &blending, const FilmView &film, uint32_t num_pixels,
                        uint32_t *largest_bits, cudaStream_t stream);

}  // namespace gpurt::cuda
