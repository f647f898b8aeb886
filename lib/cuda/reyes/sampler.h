// Stage 'sample' on a lane of a warp: samples that triangles cover, and what they leave there. For .cu files alone.
#pragma once

#include <type_traits>

#include "core/reyes/map.h"
#include "core/scene/surface.h"
#include "cuda/launch.h"
#include "cuda/reyes/stages.h"

namespace gpurt::cuda {

constexpr unsigned all_lanes = 0xffffffffu;

__device__ __forceinline__ bool is_visible(const ReyesBatch &b, uint32_t root)
{
  return b.visible == nullptr || (b.visible[root / 32] >> root % 32 & 1) != 0;
}

// Cells that a box in raster units of the image touches; false: none.
__device__ __forceinline__ bool cells_of_box(const SampleGrid &g, int32_t x0, int32_t y0, int32_t x1,
                                             int32_t y1, CellRange &cells)
{
  cells.x0 = max((x0 - g.x0) >> g.cell_bits, 0);
  cells.y0 = max((y0 - g.y0) >> g.cell_bits, 0);
  cells.x1 = min((x1 - g.x0) >> g.cell_bits, g.cells_x - 1);
  cells.y1 = min((y1 - g.y0) >> g.cell_bits, g.cells_y - 1);
  return cells.x0 <= cells.x1 && cells.y0 <= cells.y1;
}

__device__ __forceinline__ unsigned long long sample_key_of(float z, uint32_t root)
{
  return static_cast<unsigned long long>(float_bits(z)) << 32 | uint32_t(~root);
}

// Whether a look is for a root of this slot.
template <Look look>
__device__ __forceinline__ bool is_wanted(const ReyesBatch &b, uint32_t slot, uint32_t root)
{
  if (look == Look::OwnLight) return true;
  if (b.blends != nullptr && (b.blends[slot] != 0) != is_of_fragments(look)) return false;
  return look != Look::Spots || is_visible(b, root);
}

// Whether a surface that blends is a fragment of the part: before what is opaque there.
__device__ __forceinline__ bool is_fragment(const ReyesBatch &b, uint32_t slot, uint32_t root, float z)
{
  const FragmentView &f = b.fragments;
  return slot - f.begin < f.end - f.begin && sample_key_of(z, root) > b.samples.keys[slot];
}

// Whether a look of slots wants a fragment of the part: it shows something, lies behind what the sample has had, and may
// still find a slot, or has one. Where nothing has been had, those without a slot are wanted too: they are counted. `at`: where
// on its root it lies, for looks of places; others find it out where they need it.
template <Look look, class Place>
__device__ __forceinline__ bool is_for_slots(const ReyesBatch &b, uint32_t slot, uint32_t root, float z,
                                             const Place &place, Vec2f &at)
{
  const FragmentSlots &s = b.fragments.slots;
  const uint32_t i = slot - b.fragments.begin;
  const unsigned long long key = sample_key_of(z, root);
  if (look == Look::Places || s.had != nullptr) {
    // Slots only ever take what is nearer: one that is too far now will be.
    if (key < __ldcg(s.keys + uint64_t(i) * s.layers + (s.layers - 1))) return false;
  }
  const bool may_be_had = s.had != nullptr && key >= s.had[i].key;
  if (may_be_had && key > s.had[i].key) return false;
  if (look == Look::Places || may_be_had || b.may_show_nothing != 0) at = place();
  if (may_be_had && place_key(at) <= s.had[i].place) return false;
  // What is in a slot was found to show something where it was put there, but at another place maybe.
  if (b.may_show_nothing == 0) return true;
  const Hit hit = hit_of_root(b.scene, root, at.x, at.y, 0.0f);
  return opacity_at(b.scene.scene, hit.triangle, hit.u, hit.v) > 0.0f;
}

// Whether a sample that is covered takes the surface, and where on it it lies. The first time samples keep what is
// nearest, the second time the smallest place of that; of surfaces that blend all that are before it.
template <Look look, bool has_masks, class Place>
__device__ __forceinline__ bool is_taken(const ReyesBatch &b, uint32_t slot, uint32_t root, float z,
                                         const Place &place, Vec2f &at)
{
  if constexpr (look == Look::Spots) {
    if (b.samples.keys[slot] != sample_key_of(z, root)) return false;
  }
  if constexpr (is_of_fragments(look)) {
    if (!is_fragment(b, slot, root, z)) return false;
  }
  if constexpr (is_of_slots(look)) return is_for_slots<look>(b, slot, root, z, place, at);
  if constexpr (look == Look::Spots || look == Look::Keep || has_masks) at = place();
  if constexpr (has_masks && !is_of_slots(look)) {
    const Hit hit = hit_of_root(b.scene, root, at.x, at.y, 0.0f);
    if (!(opacity_at(b.scene.scene, hit.triangle, hit.u, hit.v) > 0.0f)) return false;
  }
  return true;
}

// Whether a look counts the samples that take a triangle.
GPURT_INLINE constexpr bool counts_takers(Look look) { return look == Look::Count || look == Look::Slots; }

// Whether a look counts a sample that a triangle covers, or that takes it.
__device__ __forceinline__ constexpr bool counts_fragment(Look look, bool covers, bool takes)
{
  return counts_takers(look) ? takes : (look == Look::Nearest && covers);
}

// Whether what a look counts is what statistics tell: looks that come again count nothing.
template <Look look>
__device__ __forceinline__ bool is_counted(const ReyesBatch &b)
{
  if constexpr (look == Look::Slots) return b.fragments.slots.had == nullptr;
  return look == Look::Nearest || look == Look::OwnLight || look == Look::Count;
}

// Puts a fragment into the next place of those that were counted for its sample.
__device__ __forceinline__ void keep_fragment(const ReyesBatch &b, uint32_t slot, const KeptFragment &kept)
{
  const FragmentView &f = b.fragments;
  const uint32_t before = atomicSub(f.count + (slot - f.origin), 1u) - 1;
  const uint64_t at = f.first[slot - f.origin] - f.base + before;
  if (before >= f.capacity || at >= f.capacity) {
    atomicAdd(&b.numbers->num_misplaced, 1u);
    return;
  }
  *reinterpret_cast<float4 *>(f.kept + at) = make_float4(kept.z, float_from_bits(kept.root), kept.u, kept.v);
}

// What stands for the middle of a surface that is no micropolygon.
__device__ __forceinline__ Vec2f no_middle() { return {-1.0f, -1.0f}; }

// What a sample keeps of where on its root it is.
template <Look look>
__device__ __forceinline__ Vec2f kept_place(Vec2f at, Vec2f middle)
{
  return look == Look::Spots && middle.x >= 0.0f ? middle : at;
}

// The first slot that a key may belong to: those before it hold as much or more. Slots are in descending order at all times, and
// what each holds only grows, so that nothing changes that while others write.
__device__ __forceinline__ uint32_t first_slot_below(const unsigned long long *keys, uint32_t layers,
                                                     unsigned long long key)
{
  uint32_t lo = 0, hi = layers;
  while (lo < hi) {
    const uint32_t middle = (lo + hi) / 2;
    if (__ldcg(keys + middle) >= key) lo = middle + 1;
    else hi = middle;
  }
  return lo;
}

// Slots keep the largest keys in descending order: what a key displaces goes on to the next slot. Each slot ends with the
// largest of the keys that came by, and passes all others on, so that what is kept does not depend on the order. Fixed
// A-buffers that take a place by a counter keep what came first instead, which changes from run to run.
// Source: Liu et al. 2010, FreePipe: fragments in sorted arrays by atomic minima.
__device__ inline void put_into_slots(const ReyesBatch &b, uint32_t slot, unsigned long long key)
{
  const FragmentSlots &s = b.fragments.slots;
  unsigned long long *keys = s.keys + uint64_t(slot - b.fragments.begin) * s.layers;
  for (uint32_t i = first_slot_below(keys, s.layers, key); i < s.layers; ++i) {
    const unsigned long long old = atomicMax(keys + i, key);
    if (old == 0) return;
    key = old < key ? old : key;
  }
  if (s.had != nullptr) return;
  // One addition for the lanes that are here together.
  const uint32_t lanes = __activemask();
  if (threadIdx.x % 32 == uint32_t(__ffs(int(lanes))) - 1)
    atomicAdd(&b.numbers->num_lost_fragments, static_cast<unsigned long long>(__popc(lanes)));
}

// The same of places, among the slots that have the fragment's key.
__device__ inline void put_place_of_slots(const ReyesBatch &b, uint32_t slot, unsigned long long key,
                                          unsigned long long place)
{
  const FragmentSlots &s = b.fragments.slots;
  const uint64_t first = uint64_t(slot - b.fragments.begin) * s.layers;
  for (uint32_t i = first_slot_below(s.keys + first, s.layers, key + 1);
       i < s.layers && s.keys[first + i] == key; ++i) {
    const unsigned long long old = atomicMin(s.places + first + i, place);
    if (old == ~0ull) return;
    place = old > place ? old : place;
  }
}

template <Look look>
__device__ __forceinline__ void put(const ReyesBatch &b, uint32_t slot, uint32_t root, float z, Vec2f at)
{
  if constexpr (look == Look::Spots) atomicMin(b.samples.spots + slot, place_key(at));
  else if constexpr (look == Look::Count) atomicAdd(b.fragments.count + (slot - b.fragments.origin), 1u);
  else if constexpr (look == Look::Keep) keep_fragment(b, slot, {z, root, at.x, at.y});
  else if constexpr (look == Look::Slots) put_into_slots(b, slot, sample_key_of(z, root));
  else if constexpr (look == Look::Places) put_place_of_slots(b, slot, sample_key_of(z, root), place_key(at));
  else atomicMax(b.samples.keys + slot, sample_key_of(z, root));
}

__device__ __forceinline__ uint32_t place_of_slot(const SampleGrid &g, uint32_t slot)
{
  if (g.masks == nullptr) return g.places[slot];
  const uint32_t pixel = slot / g.samples_per_pixel;
  return g.places[uint64_t(pixel) * most_masked + (slot - pixel * g.samples_per_pixel)];
}

// A lane's way through the samples of some cells, one at a time. Cells of a pixel's row follow one another.
class SampleWalk {
 public:
  __device__ SampleWalk(const SampleGrid &g, const CellRange &cells, bool is_there)
      : cells_(cells), pixel_((cells.x0 >> cell_shift(g)) - 1), y_(cells.y0), is_there_(is_there)
  {
    seek(g);
  }
  __device__ bool is_at_sample() const { return k_ < end_; }
  __device__ void advance(const SampleGrid &g)
  {
    if (k_ < end_) ++k_;
    seek(g);
  }
  __device__ uint32_t slot() const { return k_; }
  // In raster units of the image.
  __device__ int32_t x(const SampleGrid &g) const { return x(g, place_of_slot(g, k_)); }
  __device__ int32_t y(const SampleGrid &g) const { return y(g, place_of_slot(g, k_)); }
  __device__ int32_t x(const SampleGrid &g, uint32_t place) const
  {
    return g.x0 + (pixel_ << unit_bits) + int32_t(place & 255);
  }
  __device__ int32_t y(const SampleGrid &g, uint32_t place) const
  {
    return g.y0 + (y_ >> cell_shift(g) << unit_bits) + int32_t(place >> 8);
  }

 private:
  __device__ void seek(const SampleGrid &g)
  {
    while (k_ == end_ && is_there_) {
      const int32_t s = cell_shift(g);
      if (++pixel_ > cells_.x1 >> s) {
        pixel_ = cells_.x0 >> s;
        if (++y_ > cells_.y1) {
          is_there_ = false;
          return;
        }
      }
      const int32_t first = pixel_ << s;
      const uint32_t row = cell_index(g, first, y_) - uint32_t(first);
      k_ = g.first[row + uint32_t(max(cells_.x0, first))];
      end_ = g.first[row + uint32_t(min(cells_.x1, first + (1 << s) - 1)) + 1];
    }
  }

  CellRange cells_;
  int32_t pixel_, y_;
  bool is_there_;
  uint32_t k_ = 0, end_ = 0;
};

// A sample at (x, y) from the triangles' origin; the lanes of a warp have one each, or none, and write together.
template <Look look, bool has_masks, int num, class Places>
__device__ __forceinline__ void sample_one(const ReyesBatch &b, uint32_t root, bool is_at_sample,
                                           uint32_t slot, float x, float y, const SmallTriangle (&t)[num],
                                           const Places &places, Vec2f middle, uint32_t &num_fragments)
{
  float z[num], share_b[num], share_c[num];
  float nearest = 0.0f;
  if (is_at_sample) {
    for (int i = 0; i < num; ++i) {
      z[i] = cover(t[i], x, y, share_b[i], share_c[i]);
      nearest = z[i] > nearest ? z[i] : nearest;
    }
  }
  if constexpr (look == Look::Nearest) num_fragments += nearest > 0.0f ? 1 : 0;
  if constexpr (look == Look::Nearest && !has_masks) {
    __syncwarp();
    if (nearest > 0.0f) put<look>(b, slot, root, nearest, {});
  } else if (__any_sync(all_lanes, nearest > 0.0f)) {
    for (int i = 0; i < num; ++i) {
      Vec2f at{};
      const bool takes = nearest > 0.0f && z[i] > 0.0f &&
                         is_taken<look, has_masks>(
                             b, slot, root, z[i],
                             [&] {
                               Vec2f corners[3];
                               places(i, corners);
                               return cover_uv(t[i], corners, z[i], share_b[i], share_c[i]);
                             },
                             at);
      if constexpr (counts_takers(look)) num_fragments += takes ? 1 : 0;
      __syncwarp();
      if (takes) put<look>(b, slot, root, z[i], kept_place<look>(at, middle));
    }
  }
}

// One or two small triangles a lane, from an origin in raster units; `places(i, corners)` are the (u, v) of their corners.
// The lanes of a warp look at a sample each at a time, so that they write together.
template <Look look, bool has_masks, int num, class Places>
__device__ void sample_small(const ReyesBatch &b, uint32_t root, bool is_there, const CellRange &cells,
                             int32_t origin_x, int32_t origin_y, const SmallTriangle (&t)[num],
                             const Places &places, Vec2f middle, uint32_t &num_fragments)
{
  const SampleGrid &g = b.samples;
  SampleWalk walk(g, cells, is_there);
  while (__any_sync(all_lanes, walk.is_at_sample())) {
    const bool is_at_sample = walk.is_at_sample();
    sample_one<look, has_masks>(
        b, root, is_at_sample, walk.slot(), is_at_sample ? float(walk.x(g) - origin_x) : 0.0f,
        is_at_sample ? float(walk.y(g) - origin_y) : 0.0f, t, places, middle, num_fragments);
    walk.advance(g);
  }
}

// Calls visit(is_there, slot, x, y) by all lanes of a warp together until each sample of the pixels was some lane's: at (x, y)
// in raster units of the image.
template <class Visit>
__device__ __forceinline__ void for_samples_of_pixels(const SampleGrid &g, const CellRange &pixels,
                                                      const Visit &visit)
{
  const int32_t lane = int32_t(threadIdx.x % 32), width = pixels.x1 - pixels.x0 + 1, s = cell_shift(g);
  if (g.is_even == 0) {
    // A lane a pixel.
    const int32_t n = width * (pixels.y1 - pixels.y0 + 1);
    for (int32_t first = 0; first < n; first += 32) {
      const int32_t i = first + lane, row = i / width;
      const int32_t x = pixels.x0 + (i - row * width), y = pixels.y0 + row;
      SampleWalk walk(g, {x << s, y << s, ((x + 1) << s) - 1, ((y + 1) << s) - 1}, i < n);
      while (__any_sync(all_lanes, walk.is_at_sample())) {
        const bool is_there = walk.is_at_sample();
        visit(is_there, walk.slot(), is_there ? walk.x(g) : 0, is_there ? walk.y(g) : 0);
        walk.advance(g);
      }
    }
    return;
  }
  // A lane a sample, row by row: what lanes read and write lies side by side.
  const int32_t n = int32_t(g.samples_per_pixel), row_pixels = g.cells_x >> s;
  const int32_t step_pixels = 32 / n, step_samples = 32 - step_pixels * n;
  int32_t y = pixels.y0, x = pixels.x0 + lane / n, sample = lane % n;
  for (;; x += step_pixels, sample += step_samples) {
    if (sample >= n) {
      sample -= n;
      ++x;
    }
    while (x > pixels.x1) {
      x -= width;
      ++y;
    }
    const bool is_there = y <= pixels.y1;
    if (!__any_sync(all_lanes, is_there)) return;
    const uint32_t pixel = uint32_t(y * row_pixels + x), slot = pixel * uint32_t(n) + uint32_t(sample);
    uint32_t place = 0;
    if (is_there)
      place =
          g.masks != nullptr ? g.places[uint64_t(pixel) * most_masked + uint32_t(sample)] : g.places[slot];
    visit(is_there, slot, g.x0 + (x << unit_bits) + int32_t(place & 255),
          g.y0 + (y << unit_bits) + int32_t(place >> 8));
  }
}

// A large triangle and the cells that it may cover.
struct LargeCover {
  RasterVertex corners[3];
  AnyCover cover;
  CellRange cells;
  bool is_projected;
};

// False: it covers nothing.
__device__ inline bool make_large_cover(const ReyesBatch &b, const LargeTriangle &t, LargeCover &out)
{
  const SampleGrid &g = b.samples;
  for (int i = 0; i < 3; ++i)
    out.corners[i] = raster_vertex(t.corners[i], t.places[i].x, t.places[i].y, b.projection);
  const RasterVertex(&c)[3] = out.corners;
  out.is_projected = c[0].is_projectable && c[1].is_projectable && c[2].is_projectable;
  out.cells = {0, 0, g.cells_x - 1, g.cells_y - 1};
  if (out.is_projected) {
    const float x0 = min(min(c[0].x, c[1].x), c[2].x), x1 = max(max(c[0].x, c[1].x), c[2].x);
    const float y0 = min(min(c[0].y, c[1].y), c[2].y), y1 = max(max(c[0].y, c[1].y), c[2].y);
    if (!cells_of_box(g, int32_t(x0), int32_t(y0), int32_t(x1), int32_t(y1), out.cells)) return false;
  } else {
    const float x[3] = {c[0].h.x, c[1].h.x, c[2].h.x}, y[3] = {c[0].h.y, c[1].h.y, c[2].h.y},
                w[3] = {c[0].h.w, c[1].h.w, c[2].h.w};
    if (!can_be_seen(x, y, w, 3, t.largest, b.rect)) return false;
  }
  const RasterVertex *const corners[3] = {&c[0], &c[1], &c[2]};
  return make_any_cover(corners, b.projection, out.cover);
}

// The pixels that cells lie in.
__device__ __forceinline__ CellRange pixels_of(const SampleGrid &g, const CellRange &cells)
{
  const int32_t s = cell_shift(g);
  return {cells.x0 >> s, cells.y0 >> s, cells.x1 >> s, cells.y1 >> s};
}

// The pixels [x0, x1] of row y of a box that a triangle may cover; false: none.
__device__ inline bool pixels_of_row(const SampleGrid &g, const LargeCover &large, const CellRange &box,
                                     int32_t y, int32_t &x0, int32_t &x1)
{
  constexpr double units = double(units_per_pixel);
  const double left = double(g.x0), top = double(g.y0) + double(y) * units;
  double begin = left + double(box.x0) * units, end = left + double(box.x1 + 1) * units;
  if (!narrow_row(large.cover, top, top + units, begin, end)) return false;
  x1 = min(int32_t((end - left) / units), box.x1);
  x0 = min(int32_t((begin - left) / units), x1);
  return true;
}

// A sample at (x, y) in raster units of the image; whether it takes the triangle, and whether this covers it.
template <Look look, bool has_masks>
__device__ bool test_large(const ReyesBatch &b, const LargeTriangle &t, const LargeCover &large,
                           uint32_t slot, int32_t x, int32_t y, float &z, Vec2f &at, bool &covers)
{
  float share_b, share_c;
  z = cover_any(large.cover, double(x), double(y), share_b, share_c);
  covers = z > 0.0f;
  return covers &&
         is_taken<look, has_masks>(
             b, slot, t.root, z,
             [&] {
               return cover_uv(large.corners[0], large.corners[1], large.corners[2], z, share_b, share_c);
             },
             at);
}

// Leaves a large triangle to the kernel for those; where the list of them is full, samples it by this lane alone. Lanes
// need not be together.
template <Look look, bool has_masks>
__device__ __noinline__ void hand_on_large(const ReyesBatch &b, const LargeTriangle &t,
                                           uint32_t &num_fragments)
{
  const uint32_t at = atomicAdd(&b.numbers->num_large, 1u);
  if (at < b.large_capacity) {
    b.large[at] = t;
    return;
  }
  LargeCover large;
  if (!make_large_cover(b, t, large)) return;
  const SampleGrid &g = b.samples;
  const CellRange box = pixels_of(g, large.cells);
  const int32_t s = cell_shift(g);
  for (int32_t y = box.y0; y <= box.y1; ++y) {
    int32_t x0, x1;
    if (!pixels_of_row(g, large, box, y, x0, x1)) continue;
    SampleWalk walk(g, {x0 << s, y << s, ((x1 + 1) << s) - 1, ((y + 1) << s) - 1}, true);
    for (; walk.is_at_sample(); walk.advance(g)) {
      float z;
      Vec2f place{};
      bool covers;
      const bool takes =
          test_large<look, has_masks>(b, t, large, walk.slot(), walk.x(g), walk.y(g), z, place, covers);
      if (takes) put<look>(b, walk.slot(), t.root, z, kept_place<look>(place, t.middle));
      num_fragments += counts_fragment(look, covers, takes) ? 1 : 0;
    }
  }
}

// Adds what the lanes of a warp counted.
__device__ __forceinline__ void add_of_lanes(unsigned long long *sum, uint32_t count)
{
  for (int offset = 16; offset != 0; offset /= 2) count += __shfl_down_sync(all_lanes, count, offset);
  if (threadIdx.x % 32 == 0 && count != 0) atomicAdd(sum, static_cast<unsigned long long>(count));
}

// The next of `n` items for this warp; n: none is left.
__device__ __forceinline__ uint32_t next_item(uint32_t *ticket, uint32_t n)
{
  uint32_t item = 0;
  if (threadIdx.x % 32 == 0) item = atomicAdd(ticket, 1u);
  item = __shfl_sync(all_lanes, item, 0);
  return item < n ? item : n;
}

/// Calls launch(kernel) with the instance of a kernel template for the batch: Look::Nearest or Look::Spots.
template <class Launch>
void choose_kernel(Look look, bool has_masks, const Launch &launch_kernel)
{
  using Nearest = std::integral_constant<Look, Look::Nearest>;
  using Spots = std::integral_constant<Look, Look::Spots>;
  if (look == Look::Spots) {
    if (has_masks) launch_kernel(Spots(), std::true_type());
    else launch_kernel(Spots(), std::false_type());
  } else {
    if (has_masks) launch_kernel(Nearest(), std::true_type());
    else launch_kernel(Nearest(), std::false_type());
  }
}

/// The same for looks of fragments.
template <class Launch>
void choose_fragment_kernel(Look look, const Launch &launch_kernel)
{
  if (look == Look::Count) launch_kernel(std::integral_constant<Look, Look::Count>());
  else if (look == Look::Keep) launch_kernel(std::integral_constant<Look, Look::Keep>());
  else if (look == Look::Slots) launch_kernel(std::integral_constant<Look, Look::Slots>());
  else launch_kernel(std::integral_constant<Look, Look::Places>());
}

}  // namespace gpurt::cuda
