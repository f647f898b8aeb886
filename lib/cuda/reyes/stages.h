// REYES' stages as host code calls them, and the lists that they hand on in device memory.
#pragma once

#include <cuda_runtime_api.h>

#include "core/path/path_wave.h"
#include "core/reyes/filter.h"
#include "core/reyes/lit_point.h"
#include "core/reyes/sample.h"
#include "core/reyes/shade.h"

namespace gpurt::cuda {

/// The samples of a rectangle of the image, by square cells of it: whole pixels, or their four quarters one after another,
/// pixels row by row. Samples of cell c are first[c] .. first[c + 1] - 1.
///
/// With masks cells are pixels, whose samples lie as they are numbered: `places` has most_masked of them for each pixel, and
/// so has `masks`: bit s of entry i < 8 says that sample s lies left of i eighths of the pixel, of entry 8 + i that it lies above.
/// Every pixel has as many samples.
struct SampleGrid {
  const uint32_t *first;      // [cells + 1]
  const uint16_t *places;     // where in its pixel a sample lies, in raster units: x | y << 8
  const uint16_t *masks;      // null: cells
  unsigned long long *keys;   // what it sees: the bits of 1 / w, then ~root, or packed light; 0: nothing
  unsigned long long *spots;  // place_key of that; all bits set: not known yet
  int32_t x0, y0;             // raster units of cell 0 in the image
  int32_t cells_x, cells_y;
  int32_t cell_bits;  // log2 of a cell's edge in raster units
  uint32_t num_samples;
  uint32_t samples_per_pixel;
  uint32_t is_even;  // 1: every pixel has so many, which follow those of the pixel before
};

/// Samples of a pixel that a mask has bits for.
constexpr uint32_t most_masked = 16;

// log2 of the cells that a pixel has along an axis.
GPURT_INLINE int32_t cell_shift(const SampleGrid &g) { return unit_bits - g.cell_bits; }

GPURT_INLINE uint32_t cell_index(const SampleGrid &g, int32_t x, int32_t y)
{
  const int32_t s = cell_shift(g), mask = (1 << s) - 1;
  const uint32_t pixel = uint32_t((y >> s) * (g.cells_x >> s) + (x >> s));
  return pixel << 2 * s | uint32_t((y & mask) << s | (x & mask));
}

// Of a tiny micropolygon's box. Samples of its cells lie up to a pixel beyond: 3 * 2048 * (2048 + 256) < 2^24.
constexpr int32_t largest_tiny_extent = 2048;

/// A piece of a patch that is to be cut, or diced.
struct QueuedPiece {
  Piece piece;
  uint32_t slot;  // of its patch in the batch
};

/// A triangle that is too large for one lane, or behind the eye in part.
struct LargeTriangle {
  RasterPoint corners[3];
  Vec2f places[3];  // (u, v) of its root
  RasterPoint largest;
  Vec2f middle;  // as SpreadQuad's
  uint32_t root;
};

/// A micropolygon that takes a lane of its own long, with small triangles a b c and a c d.
struct SpreadQuad {
  int32_t x[4], y[4];  // raster units
  float z[4];
  Vec2f places[4];  // (u, v) on its root, for looks that ask for them
  Vec2f middle;     // what samples keep in place of where on it they are; x below 0: nothing
  uint32_t kept;    // what samples keep: the root's number or, in its place, light
  uint32_t slot;    // of its root
  uint32_t has;     // a bit a triangle
};

/// A look at the micropolygons is for what is nearest, for where on it samples lie, for what is nearest with its light, or,
/// of surfaces that blend, for the number of fragments, for these, for the nearest ones in slots, or for where these lie.
enum class Look : uint32_t { Nearest, Spots, OwnLight, Count, Keep, Slots, Places };

GPURT_INLINE constexpr bool is_of_slots(Look look) { return look == Look::Slots || look == Look::Places; }
GPURT_INLINE constexpr bool is_of_fragments(Look look)
{
  return look == Look::Count || look == Look::Keep || is_of_slots(look);
}

/// A surface that blends, as a sample sees it.
struct alignas(16) KeptFragment {
  float z;  // 1 / w
  uint32_t root;
  float u, v;  // place on it
};

/// The last fragment that a sample has had: those behind it have smaller keys or, of equal keys, larger places.
struct FragmentMark {
  unsigned long long key, place;
};

/// Slots for the nearest fragments of samples: those of sample s begin at (s - begin) * layers.
struct FragmentSlots {
  uint32_t layers;             // of a sample; 0: there are no slots
  unsigned long long *keys;    // of fragments, in descending order; 0: the slot is empty
  unsigned long long *places;  // place_key; all bits set: not known yet
  FragmentMark *had;           // [s - begin]: what is behind is wanted; null: all is
};

/// Fragments of samples [begin, end) of a grid.
struct FragmentView {
  uint32_t *
      count;  // [slot - origin]: how many a sample has; once there is room for them, how many are still to come
  const uint64_t *first;  // [slot - origin]: those of all samples before
  KeptFragment *kept;     // those of sample s are kept[first[s] - base] ..
  uint64_t base;
  uint64_t capacity;  // of kept
  uint32_t origin;
  uint32_t begin, end;
  FragmentSlots slots;
};

/// What the stages count, in device memory.
struct ReyesNumbers {
  // Of the batch.
  uint32_t num_slots, num_triangles;
  uint32_t next_slot;     // patches that were taken to be cut
  uint32_t waiting;       // pieces on the stack
  uint32_t waiting_high;  // of these, on the upper one of two stacks
  uint32_t num_leaves;    // that are to be diced
  uint32_t num_large, num_large_parts;
  uint32_t num_rest;        // grids that are left to the general kernel
  uint32_t num_spread;      // micropolygons that this leaves to warps
  uint32_t tickets[5];      // of grids, triangles, large triangles, the rest of grids, spread micropolygons
  uint32_t pushed;          // by a level of cutting
  uint32_t num_cut_leaves;  // by one that maps: pieces that are to be diced
  unsigned long long rounds[3];  // of cutting: what each made
  // Of queues of blocks: the queue of all, what blocks left behind it, blocks that wait, pieces anywhere; 1: leaves are full.
  uint32_t queue_head, queue_tail, left_at, num_left, idle_blocks, live_pieces, stops;
  // Of the group.
  uint32_t largest_queue;
  uint32_t largest_sample;  // bits of the largest radiance
  // Of samples whose fragments are kept together: where they end, the pixels of the first and the last of them, fragments
  // before theirs, and their own.
  uint32_t part_end, first_pixel, last_pixel;
  uint32_t num_misplaced;  // fragments that had not been counted: never
  unsigned long long part_first, part_fragments;
  uint32_t num_items;  // that a part shows: fragments and what lies behind them
  uint32_t num_open;   // samples whose slots are full, and may have more to show
  unsigned long long num_patches, num_triangles_seen, num_splits, num_culled, num_grids, num_micropolygons,
      num_fragments, num_lost_fragments, num_shaded, split_rounds, num_donated, num_switches;
};

/// A batch of roots on its way through the stages, and the group of samples that it is for.
struct ReyesBatch {
  ReyesScene scene;
  RasterProjection projection;
  DiceSettings dice;
  RasterRect rect;  // of the samples, with a pixel around them
  SampleGrid samples;
  OwnLight own;               // of micropolygons
  uint32_t has_own_light;     // 1: samples keep it in place of roots
  uint32_t keeps_middles;     // 1: of micropolygons, in place of where samples lie on their roots
  uint32_t has_cutouts;       // 1: some root that does not blend has holes
  uint32_t may_show_nothing;  // 1: some root that blends lets everything through in places
  const uint32_t *visible;    // a bit a root; null: all roots may be seen
  RasterPatch *patches;       // [slots]
  RasterPoint *largest;       // of a slot's control points
  uint32_t *roots;            // of slots
  uint8_t *blends;            // whether the material of a slot's root does; null: none does
  uint32_t kinds;             // of roots that are bounded: 1: those that do not blend, 2: those that do
  FragmentView fragments;
  uint32_t *triangles;  // roots of meshes
  QueuedPiece *stack;
  uint32_t stack_capacity;
  QueuedPiece *leaves;
  uint32_t leaf_capacity;
  int32_t
      tiny_extent;  // of the box of a micropolygon that is a lane's own, in raster units; at most largest_tiny_extent
  uint32_t *
      rest;  // grids whose micropolygons are not all tiny: leaf * 256 and a bit for each 32 of which some are not
  LargeTriangle *large;
  uint32_t *large_parts;  // sums of the parts of large triangles
  uint32_t large_capacity;
  uint32_t part_pixels;  // of a part at most
  SpreadQuad *spread;
  uint32_t spread_capacity;
  ReyesNumbers *numbers;
};

/// Samples a pixel that may lie in 4 x 4 cells: their numbers are bytes.
constexpr uint64_t max_fine_samples = 255;

/// What decides where samples lie, and which of the group they are.
struct SamplePlaces {
  PathUnit unit;         // the group
  uint64_t num_samples;  // a pixel
  uint64_t seed;
  uint32_t frame_index;
  ReyesFilter filter;
  FilterTable table;
};

/// Finds places for the samples of a group: slots[k] is where the sample of path k lies in the grid, whose `first` and
/// `places` are written and whose keys are cleared. `counts`: a number a cell, and `scan_memory`, where the filter is not a
/// box's; else null. `masks`: null, or what is written in place of slots.
void launch_place_samples(const SamplePlaces &places, const SampleGrid &grid, uint32_t *first, uint16_t *at,
                          uint16_t *masks, uint32_t *slots, uint32_t *counts, void *scan_memory,
                          uint64_t scan_bytes, cudaStream_t stream);

/// Roots first_root .. first_root + num_roots - 1: patches that may be seen get slots, triangles are listed.
void launch_bound_roots(const ReyesBatch &batch, uint64_t first_root, uint32_t num_roots,
                        cudaStream_t stream);

/// Cuts pieces until none wait, or until the list of those that are to be diced is full, by as many blocks as split_blocks says of the
/// device that is current.
void launch_split(const ReyesBatch &batch, unsigned num_blocks, cudaStream_t stream);
unsigned split_blocks();

/// Dices pieces and puts micropolygons into the samples; the second time, samples learn where on their root they are. With
/// light of their own micropolygons are shaded before, and there is no second time. Roots that blend are for looks of
/// fragments, all others for the other looks.
void launch_sample_grids(const ReyesBatch &batch, Look look, cudaStream_t stream);

/// The same of leaves that have light of their own, by other schedules: a kernel each for dicing, shading and sampling, with
/// `grids` between them, as many leaves at a time as it has room for; returns how many times. Or one kernel whose warps turn
/// to what waits.
struct DicedGrid;
uint64_t launch_staged_grids(const ReyesBatch &batch, uint32_t num_leaves, DicedGrid *grids,
                             uint32_t capacity, cudaStream_t stream);
uint64_t diced_grid_bytes();
void launch_uber_grids(const ReyesBatch &batch, cudaStream_t stream);

/// What sample_grids leaves, and the micropolygons that this leaves in turn.
void launch_sample_rest(const ReyesBatch &batch, Look look, cudaStream_t stream);
void launch_sample_triangles(const ReyesBatch &batch, Look look, cudaStream_t stream);

/// The same of roots that blend, for looks of fragments.
void launch_fragments_of_grids(const ReyesBatch &batch, Look look, cudaStream_t stream);
void launch_fragments_of_rest(const ReyesBatch &batch, Look look, cudaStream_t stream);
void launch_fragments_of_triangles(const ReyesBatch &batch, Look look, cudaStream_t stream);

/// Parts of large triangles, of about part_pixels each, are counted; then launches take some of them each, whose tickets are clear.
struct LargeParts {
  uint32_t first, num;
};
void launch_count_large_parts(const ReyesBatch &batch, cudaStream_t stream);
void launch_sample_large(const ReyesBatch &batch, Look look, LargeParts parts, cudaStream_t stream);
void launch_fragments_of_large(const ReyesBatch &batch, Look look, LargeParts parts, cudaStream_t stream);

/// Sets the bits of the roots that samples see.
void launch_mark_visible(const SampleGrid &grid, uint32_t *visible, cudaStream_t stream);

/// What eye rays of paths 0 .. n - 1 of the unit meet is what samples first_slot .. see.
struct EyeHits {
  ReyesScene scene;
  PathSettings settings;
  SamplePlaces places;
  PathUnit unit;
  const uint32_t *slots;  // null: samples lie pixel by pixel, row by row
  const unsigned long long *keys, *spots;
  ReyesNumbers *numbers;
};

/// Where the sample of a path lies whose pixel is the `local`-th of the group, row by row.
GPURT_INLINE uint64_t slot_of(const EyeHits &eye, uint64_t path, uint32_t local, uint64_t turn)
{
  return eye.slots != nullptr ? eye.slots[path] : local * eye.places.num_samples + turn;
}

void launch_eye_hits(const EyeHits &eye, const PathWave &wave, uint32_t n, cudaStream_t stream);

/// Shades the group's samples into a film of zeros without a ray: eye.unit is the whole group. For scenes where nothing but
/// points, spots and distant lights shines, without shadows. largest_bits: the bits of the largest radiance.
void launch_shade_pixels(const EyeHits &eye, const FilmView &film, uint32_t num_pixels,
                         uint32_t *largest_bits, cudaStream_t stream);

/// Adds up what samples see of micropolygons' own light, into a film that need not be clear.
void launch_resolve_own_light(const EyeHits &eye, const FilmView &film, uint32_t num_pixels,
                              uint32_t *largest_bits, cudaStream_t stream);

/// Bytes for sums over `n` counts.
uint64_t place_scan_bytes(uint32_t n);

}  // namespace gpurt::cuda
