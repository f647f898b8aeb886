// Stage 'sample' of a warp's grid of tiny micropolygons. For .cu files alone.
//
// A lane takes a micropolygon at a time, and the lanes of a warp write their samples together: what a memory transaction
// carries decides, not how many meet at a sample. Micropolygons are tiny: all numbers of their edges are whole and stay below
// 2^24 in whatever order they are added, so that fused operations have the bits of `cover`. Others are left to
// the general kernel.
#pragma once

#include "cuda/reyes/warp_grid.h"

namespace gpurt::cuda {

// A triangle from its vertex a, turned so that its inside is positive: edges a x + b y + c opposite to each corner.
struct TinyTriangle {
  float aa, ab, ac, ba, bb, ca, cb;  // those of b and c go through a
  float za, zb, zc;
  float threshold_a, threshold_b, threshold_c;
};

// As make_small_triangle.
__device__ __forceinline__ bool make_tiny_triangle(float az, float bx, float by, float bz, float cx, float cy,
                                                   float cz, TinyTriangle &t)
{
  const float twice_area = bx * cy - by * cx;
  const bool is_swapped = twice_area < 0.0f;
  const float inv_area = 1.0f / abs(twice_area);
  const float px = is_swapped ? cx : bx, py = is_swapped ? cy : by, qx = is_swapped ? bx : cx,
              qy = is_swapped ? by : cy;
  t.aa = py - qy;
  t.ab = qx - px;
  t.ac = (qy - py) * px - (qx - px) * py;
  t.ba = qy;
  t.bb = -qx;
  t.ca = -py;
  t.cb = px;
  t.threshold_a = edge_threshold(px, py, qx, qy);
  t.threshold_b = edge_threshold(qx, qy, 0.0f, 0.0f);
  t.threshold_c = edge_threshold(0.0f, 0.0f, px, py);
  t.za = az * inv_area;
  t.zb = (is_swapped ? cz : bz) * inv_area;
  t.zc = (is_swapped ? bz : cz) * inv_area;
  return twice_area != 0.0f;
}

// As `cover`.
__device__ __forceinline__ float cover_tiny(const TinyTriangle &t, float x, float y)
{
  const float ea = fma(t.aa, x, fma(t.ab, y, t.ac)), eb = fma(t.ba, x, t.bb * y), ec = fma(t.ca, x, t.cb * y);
  const float z = ea * t.za + eb * t.zb + ec * t.zc;
  return ea > t.threshold_a && eb > t.threshold_b && ec > t.threshold_c ? z : 0.0f;
}

// A lane's way through the samples of some cells, as SampleWalk's, with places from a micropolygon's first vertex.
class TinyWalk {
 public:
  __device__ TinyWalk(const SampleGrid &g, int32_t x0, int32_t y0, int32_t x1, int32_t y1, int32_t ax,
                      int32_t ay, bool is_there)
      : cells_{0, 0, -1, -1}, ax_(ax), ay_(ay)
  {
    is_there = is_there && cells_of_box(g, x0, y0, x1, y1, cells_);
    pixel_ = (cells_.x0 >> cell_shift(g)) - 1;
    y_ = is_there ? cells_.y0 : cells_.y1 + 1;
    seek(g);
  }
  // log2 of the height in raster units of what a box has wholly or not at all.
  static __device__ int32_t row_bits(const SampleGrid &g) { return g.cell_bits; }
  __device__ uint32_t place(const SampleGrid &g) const { return g.places[k_]; }
  __device__ bool is_at_sample() const { return k_ < end_; }
  __device__ uint32_t slot(const SampleGrid &) const { return k_; }
  __device__ void advance(const SampleGrid &g)
  {
    ++k_;
    seek(g);
  }
  // A byte behind the bits of 2^23 is 2^23 more than its value, exactly, and so is the sum.
  __device__ float x(uint32_t place) const { return __uint_as_float(0x4b000000u | (place & 255)) + base_x_; }
  __device__ float y(uint32_t place) const { return __uint_as_float(0x4b000000u | place >> 8) + base_y_; }

 private:
  __device__ void seek(const SampleGrid &g)
  {
    while (k_ >= end_ && y_ <= cells_.y1) {
      const int32_t s = cell_shift(g);
      if (++pixel_ > cells_.x1 >> s) {
        pixel_ = (cells_.x0 >> s) - 1;
        ++y_;
        continue;
      }
      const int32_t first = pixel_ << s;
      const uint32_t row = cell_index(g, first, y_) - uint32_t(first);
      k_ = g.first[row + uint32_t(max(cells_.x0, first))];
      end_ = g.first[row + uint32_t(min(cells_.x1, first + (1 << s) - 1)) + 1];
      base_x_ = float(g.x0 + (pixel_ << unit_bits) - ax_) - 0x1p23f;
      base_y_ = float(g.y0 + (y_ >> s << unit_bits) - ay_) - 0x1p23f;
    }
  }

  CellRange cells_;
  int32_t ax_, ay_, pixel_, y_;
  uint32_t k_ = 0, end_ = 0;
  float base_x_ = 0.0f, base_y_ = 0.0f;
};

// The same through pixels with masks: what lies in the eighths that the box touches, of two by two pixels at a time, so that
// lanes mostly look up once, together. Samples of two pixels beside each other follow one another.
class MaskWalk {
 public:
  __device__ MaskWalk(const SampleGrid &g, int32_t x0, int32_t y0, int32_t x1, int32_t y1, int32_t ax,
                      int32_t ay, bool is_there)
      : x0_(x0 - g.x0), y0_(y0 - g.y0), x1_(x1 - g.x0), y1_(y1 - g.y0), ax_(ax - g.x0), ay_(ay - g.y0)
  {
    x_ = max(x0_ >> unit_bits, 0);
    y_ = max(y0_ >> unit_bits, 0);
    if (!is_there || x_ > last_x(g)) y_ = last_y(g) + 1;
    look_up(g);
    find_sample(g);
  }
  static __device__ int32_t row_bits(const SampleGrid &) { return unit_bits - 3; }
  __device__ bool is_at_sample() const { return bits_ != 0; }
  __device__ uint32_t slot(const SampleGrid &g) const
  {
    return pixel_ * g.samples_per_pixel + sample_ +
           sample_ / most_masked * (g.samples_per_pixel - most_masked);
  }
  __device__ uint32_t place(const SampleGrid &) const { return place_; }
  __device__ void advance(const SampleGrid &g)
  {
    bits_ &= bits_ - 1;
    if (bits_ == 0 && below_ != 0) go_below(g);
    if (bits_ == 0 && is_wide_) {
      next(g);
      look_up(g);
    }
    find_sample(g);
  }
  // A number behind the bits of 2^23 is 2^23 more than its value, exactly, and so is the sum.
  __device__ float x(uint32_t place) const
  {
    const uint32_t pixels = sample_ / most_masked << unit_bits;
    return __uint_as_float(0x4b000000u | pixels | (place & 255)) + base_x_;
  }
  __device__ float y(uint32_t place) const { return __uint_as_float(0x4b000000u | place >> 8) + base_y_; }

 private:
  // Entries of an axis' masks that differ by the samples of a range of eighths; `rest`: where it ends with the pixel, all samples.
  struct Eighths {
    uint32_t first, last, rest;
  };

  __device__ int32_t last_x(const SampleGrid &g) const { return min(x1_ >> unit_bits, g.cells_x - 1); }
  __device__ int32_t last_y(const SampleGrid &g) const { return min(y1_ >> unit_bits, g.cells_y - 1); }
  // Its place is there once it is the sample's turn.
  __device__ void find_sample(const SampleGrid &g)
  {
    sample_ = uint32_t(__ffs(int(bits_))) - 1;
    if (bits_ != 0) place_ = g.places[pixel_ * most_masked + sample_];
  }
  // Those that [from, to], from the pixel's corner, touches; none where the pixel is not there.
  static __device__ Eighths eighths(int32_t from, int32_t to, bool is_there, uint32_t all)
  {
    const uint32_t end = is_there ? uint32_t(min((to >> (unit_bits - 3)) + 1, 8)) : 0;
    return {is_there ? uint32_t(max(from >> (unit_bits - 3), 0)) : 0, end % 8, end == 8 ? all : 0};
  }
  static __device__ uint32_t between(const uint16_t *masks, Eighths e)
  {
    return masks[e.first] ^ masks[e.last] ^ e.rest;
  }
  __device__ void next(const SampleGrid &g)
  {
    x_ += 2;
    if (x_ <= last_x(g)) return;
    x_ = max(x0_ >> unit_bits, 0);
    y_ += 2;
  }
  __device__ void go_below(const SampleGrid &g)
  {
    bits_ = below_;
    below_ = 0;
    pixel_ += uint32_t(g.cells_x);
    base_y_ += units_per_pixel;
  }
  // The samples of the next two by two pixels that have some.
  __device__ void look_up(const SampleGrid &g)
  {
    const int32_t end_x = last_x(g), end_y = last_y(g);
    const uint32_t all = (1u << g.samples_per_pixel) - 1;
    is_wide_ = false;
    for (; y_ <= end_y; next(g)) {
      const bool has_right = x_ < end_x, has_lower = y_ < end_y;
      const int32_t corner_x = x_ << unit_bits, corner_y = y_ << unit_bits;
      constexpr int32_t pixel = 1 << unit_bits;
      const Eighths left = eighths(x0_ - corner_x, x1_ - corner_x, true, all),
                    right = eighths(x0_ - corner_x - pixel, x1_ - corner_x - pixel, has_right, all),
                    upper = eighths(y0_ - corner_y, y1_ - corner_y, true, all),
                    lower = eighths(y0_ - corner_y - pixel, y1_ - corner_y - pixel, has_lower, all);
      pixel_ = uint32_t(y_ * g.cells_x + x_);
      // A pixel that is not there shows nothing, whatever masks are read in its place.
      const uint32_t to_right = has_right ? most_masked : 0,
                     to_lower = has_lower ? uint32_t(g.cells_x) * most_masked : 0;
      const uint16_t *const at = g.masks + pixel_ * most_masked;
      const auto samples = [&](uint32_t offset, Eighths x, Eighths y) {
        return between(at + offset, x) & between(at + offset + most_masked / 2, y);
      };
      bits_ = samples(0, left, upper) | samples(to_right, right, upper) << most_masked;
      below_ = samples(to_lower, left, lower) | samples(to_lower + to_right, right, lower) << most_masked;
      base_x_ = float(corner_x - ax_) - 0x1p23f;
      base_y_ = float(corner_y - ay_) - 0x1p23f;
      is_wide_ = x_ + 2 <= end_x || y_ + 2 <= end_y;
      if (bits_ == 0 && below_ != 0) go_below(g);
      if (bits_ != 0) break;
    }
  }

  int32_t x0_, y0_, x1_, y1_, ax_, ay_, x_, y_;
  uint32_t bits_ = 0, below_ = 0;    // of two pixels, and of the two below them
  uint32_t sample_ = 0, place_ = 0;  // the first of the bits
  uint32_t pixel_ = 0;               // the left one
  bool is_wide_ = false;
  float base_x_ = 0.0f, base_y_ = 0.0f;
};

// Samples of a warp's grid that see it: where on it they lie is found out by all lanes together.
struct SeenSamples {
  WarpPlaces places;
  uint32_t slot[64], quad[64];
  float x[64], y[64];  // from the micropolygon's first vertex
};

// Where on the root a sample of a micropolygon lies: of its two triangles, if both are there equally near, the smaller.
__device__ __forceinline__ uint64_t spot_of(const WarpGrid &g, const WarpPlaces &places, uint32_t quad,
                                            float x, float y)
{
  const uint32_t width = (1u << g.piece.grid_u) + 1, num_u = width - 1;
  const uint32_t a = (quad >> g.piece.grid_u) * width + (quad & (num_u - 1));
  const uint32_t at[4] = {a, a + 1, a + width + 1, a + width};
  const int32_t ox = g.x[a], oy = g.y[a];
  float nearest = 0.0f;
  uint64_t spot = ~uint64_t(0);
  for (int i = 0; i < 2; ++i) {
    const uint32_t k[3] = {at[0], at[i + 1], at[i + 2]};
    SmallTriangle t;
    if (!make_small_triangle(0.0f, 0.0f, g.z[k[0]], float(g.x[k[1]] - ox), float(g.y[k[1]] - oy), g.z[k[1]],
                             float(g.x[k[2]] - ox), float(g.y[k[2]] - oy), g.z[k[2]], t)) {
      continue;
    }
    float share_b, share_c;
    const float z = cover(t, x, y, share_b, share_c);
    if (!(z > 0.0f && z >= nearest)) continue;
    const Vec2f corners[3] = {
        {places.u[k[0]], places.v[k[0]]}, {places.u[k[1]], places.v[k[1]]}, {places.u[k[2]], places.v[k[2]]}};
    const uint64_t key = place_key(cover_uv(t, corners, z, share_b, share_c));
    spot = z > nearest ? key : min(spot, key);
    nearest = z;
  }
  return spot;
}

// The last n of the samples that were seen, at most a warp's.
__device__ __forceinline__ void put_spots(const ReyesBatch &b, const WarpGrid &g, const SeenSamples &seen,
                                          uint32_t first, uint32_t n, uint32_t lane)
{
  __syncwarp();
  if (lane < n) {
    const uint32_t i = first + lane, quad = seen.quad[i], num_u = 1u << g.piece.grid_u;
    const uint64_t spot = b.keeps_middles != 0
                              ? place_key(middle_of(middles_of(g.piece, b.own.block_bits), quad & (num_u - 1),
                                                    quad >> g.piece.grid_u))
                              : spot_of(g, seen.places, quad, seen.x[i], seen.y[i]);
    atomicMin(b.samples.spots + seen.slot[i], static_cast<unsigned long long>(spot));
  }
  __syncwarp();
}

// Fragments of the last n of the samples that were seen, at most a warp's: a micropolygon that is not convex may be two.
template <Look look>
__device__ __forceinline__ void keep_fragments(const ReyesBatch &b, const WarpGrid &g,
                                               const SeenSamples &seen, uint32_t root, uint32_t first,
                                               uint32_t n, uint32_t lane, uint32_t &num_fragments)
{
  __syncwarp();
  const uint32_t i = first + (lane < n ? lane : 0), width = (1u << g.piece.grid_u) + 1;
  const uint32_t quad = lane < n ? seen.quad[i] : 0, slot = seen.slot[i];
  const uint32_t a = (quad >> g.piece.grid_u) * width + (quad & (width - 2));
  const uint32_t at[4] = {a, a + 1, a + width + 1, a + width};
  const int32_t ox = g.x[a], oy = g.y[a];
  for (int half = 0; half < 2; ++half) {
    const uint32_t k[3] = {at[0], at[half + 1], at[half + 2]};
    SmallTriangle t;
    float z = 0.0f, share_b, share_c;
    if (lane < n &&
        make_small_triangle(0.0f, 0.0f, g.z[k[0]], float(g.x[k[1]] - ox), float(g.y[k[1]] - oy), g.z[k[1]],
                            float(g.x[k[2]] - ox), float(g.y[k[2]] - oy), g.z[k[2]], t)) {
      z = cover(t, seen.x[i], seen.y[i], share_b, share_c);
    }
    __syncwarp();
    if (!(z > 0.0f && is_fragment(b, slot, root, z))) continue;
    const WarpPlaces &p = seen.places;
    const Vec2f corners[3] = {{p.u[k[0]], p.v[k[0]]}, {p.u[k[1]], p.v[k[1]]}, {p.u[k[2]], p.v[k[2]]}};
    const auto place = [&] { return cover_uv(t, corners, z, share_b, share_c); };
    Vec2f at{};
    if constexpr (is_of_slots(look)) {
      if (!is_for_slots<look>(b, slot, root, z, place, at)) continue;
      num_fragments += 1;
    } else {
      at = place();
    }
    put<look>(b, slot, root, z, at);
  }
  __syncwarp();
}

// Whether a look finds out where on their root samples lie.
GPURT_INLINE constexpr bool collects_samples(Look look)
{
  return look == Look::Spots || look == Look::Keep || is_of_slots(look);
}

// `light`: packed, of micropolygons with light of their own; `seen`: of looks for spots or fragments. Both else null.
template <Look look, class Walk>
__device__ __forceinline__ void sample_quads(const ReyesBatch &b, const WarpGrid &g, bool is_in_front,
                                             uint32_t leaf, uint32_t root, const WarpLight *light,
                                             SeenSamples *seen, uint32_t lane, uint32_t &num_fragments)
{
  constexpr bool collects = collects_samples(look), has_light = look == Look::OwnLight;
  const auto put_last = [&](uint32_t first, uint32_t n) {
    if constexpr (look == Look::Keep || is_of_slots(look))
      keep_fragments<look>(b, g, *seen, root, first, n, lane, num_fragments);
    else if constexpr (look == Look::Spots) put_spots(b, g, *seen, first, n, lane);
  };
  const uint32_t grid_bits = g.piece.grid_u + g.piece.grid_v, num_quads = 1u << grid_bits,
                 num_u = 1u << g.piece.grid_u, width = num_u + 1;
  // Of grids that have fewer micropolygons than a warp has lanes, several lanes share each: they take rows of its samples.
  const uint32_t share_bits = grid_bits < 5 ? 5 - grid_bits : 0;
  const int32_t share = int32_t(lane >> (5 - share_bits));
  uint32_t num_seen = 0, left = 0;
  for (uint32_t first = 0; first < num_quads; first += 32) {
    const uint32_t q = first + (lane & (31u >> share_bits));
    const uint32_t ia = (q >> g.piece.grid_u) * width + (q & (num_u - 1)), ib = ia + 1, ic = ia + width + 1,
                   id = ia + width;
    const int32_t ax = g.x[ia], ay = g.y[ia], bx = g.x[ib], by = g.y[ib], cx = g.x[ic], cy = g.y[ic],
                  dx = g.x[id], dy = g.y[id];
    const int32_t x0 = min(min(ax, bx), min(cx, dx)), x1 = max(max(ax, bx), max(cx, dx));
    const int32_t y0 = min(min(ay, by), min(cy, dy)), y1 = max(max(ay, by), max(cy, dy));
    const bool is_tiny = is_in_front && x1 - x0 <= b.tiny_extent && y1 - y0 <= b.tiny_extent;
    if (__any_sync(all_lanes, !is_tiny)) {
      left |= 1u << first / 32;
      if (!__any_sync(all_lanes, is_tiny)) continue;
    }
    TinyTriangle s, t;
    const float za = g.z[ia], zc = g.z[ic];
    const float rcx = float(cx - ax), rcy = float(cy - ay);
    const bool has_s = make_tiny_triangle(za, float(bx - ax), float(by - ay), g.z[ib], rcx, rcy, zc, s);
    const bool has_t = make_tiny_triangle(za, rcx, rcy, zc, float(dx - ax), float(dy - ay), g.z[id], t);
    bool is_there = is_tiny && (has_s || has_t);
    // What samples keep: the root's number or, in its place, light.
    uint32_t kept = root;
    if constexpr (has_light) kept = ~light_of(b, g, *light, q);
    // One without area covers nothing.
    if (!has_s) s.threshold_a = infinity;
    if (!has_t) t.threshold_a = infinity;
    int32_t from_y = y0, to_y = y1;
    if (share_bits != 0) {
      const int32_t bits = Walk::row_bits(b.samples), row = y0 >> bits, n = (y1 >> bits) - row + 1;
      const int32_t begin = row + (share * n >> share_bits), end = row + ((share + 1) * n >> share_bits);
      is_there &= begin < end;
      from_y = max(y0, begin << bits);
      to_y = min(y1, (end << bits) - 1);
    }
    Walk walk(b.samples, x0, from_y, x1, to_y, ax, ay, is_there);
    while (__any_sync(all_lanes, walk.is_at_sample())) {
      float z = 0.0f, x = 0.0f, y = 0.0f;
      uint32_t slot = 0, num_taken = 0;  // of fragments
      if (walk.is_at_sample()) {
        const uint32_t place = walk.place(b.samples);
        x = walk.x(place);
        y = walk.y(place);
        slot = walk.slot(b.samples);
        walk.advance(b.samples);
        const float zs = cover_tiny(s, x, y), zt = cover_tiny(t, x, y);
        z = zt > zs ? zt : zs;
        if constexpr (is_of_fragments(look)) {
          if (z > 0.0f) {
            num_taken = (zs > 0.0f && is_fragment(b, slot, root, zs) ? 1 : 0) +
                        (zt > 0.0f && is_fragment(b, slot, root, zt) ? 1 : 0);
          }
        }
      }
      if constexpr (look == Look::Count) {
        num_fragments += num_taken;
        __syncwarp();
        if (num_taken != 0) atomicAdd(b.fragments.count + (slot - b.fragments.origin), num_taken);
      } else if constexpr (collects) {
        bool takes = num_taken != 0;
        if constexpr (look == Look::Spots) takes = z > 0.0f && b.samples.keys[slot] == sample_key_of(z, root);
        const uint32_t takers = __ballot_sync(all_lanes, takes);
        if (takes) {
          const uint32_t i = num_seen + uint32_t(__popc(takers & ((1u << lane) - 1)));
          seen->slot[i] = slot;
          seen->quad[i] = q;
          seen->x[i] = x;
          seen->y[i] = y;
        }
        num_seen += uint32_t(__popc(takers));
        if (num_seen >= 32) {
          num_seen -= 32;
          put_last(num_seen, 32);
        }
      } else {
        num_fragments += z > 0.0f ? 1 : 0;
        __syncwarp();
        if (z > 0.0f) put<look>(b, slot, kept, z, {});
      }
    }
  }
  put_last(0, num_seen);
  if (left != 0 && lane == 0) b.rest[atomicAdd(&b.numbers->num_rest, 1u)] = leaf << 8 | left;
  __syncwarp();
}

// What the warps of a kernel counted.
struct GridCounts {
  uint32_t grids = 0, micropolygons = 0, shaded = 0, fragments = 0;

  __device__ void add_to(ReyesNumbers &numbers) const
  {
    if (threadIdx.x % 32 == 0) {
      if (grids != 0) atomicAdd(&numbers.num_grids, static_cast<unsigned long long>(grids));
      if (micropolygons != 0)
        atomicAdd(&numbers.num_micropolygons, static_cast<unsigned long long>(micropolygons));
      if (shaded != 0) atomicAdd(&numbers.num_shaded, static_cast<unsigned long long>(shaded));
    }
    add_of_lanes(&numbers.num_fragments, fragments);
  }
};

// Dices the batch's grids and samples them, a warp each.
template <Look look, class Walk>
__device__ __forceinline__ void sample_grids_of(const ReyesBatch &b)
{
  constexpr bool collects = collects_samples(look), has_light = look == Look::OwnLight;
  __shared__ WarpLight lights[has_light ? block_size / 32 : 1];
  __shared__ WarpGrid grids[block_size / 32];
  __shared__ SeenSamples seen_samples[collects ? block_size / 32 : 1];
  const uint32_t lane = threadIdx.x % 32, warp = threadIdx.x / 32;
  WarpGrid &g = grids[warp];
  WarpLight *light = has_light ? &lights[warp] : nullptr;
  SeenSamples *seen = collects ? &seen_samples[warp] : nullptr;
  const uint32_t num_leaves = b.numbers->num_leaves;
  GridCounts counts;
  for (uint32_t leaf; (leaf = next_item(&b.numbers->tickets[0], num_leaves)) != num_leaves;) {
    const uint32_t slot = b.leaves[leaf].slot, root = b.roots[slot];
    if (!is_wanted<look>(b, slot, root)) continue;
    copy_words(g.piece, b.leaves[leaf].piece, lane);
    copy_words(g.patch, b.patches[slot], lane);
    __syncwarp();
    const bool is_in_front = dice(g, b.projection, lane, collects ? &seen->places : nullptr);
    __syncwarp();
    ++counts.grids;
    counts.micropolygons += 1u << (g.piece.grid_u + g.piece.grid_v);
    if constexpr (has_light) counts.shaded += shade_grid(b, g, root, *light, lane);
    sample_quads<look, Walk>(b, g, is_in_front, leaf, root, light, seen, lane, counts.fragments);
  }
  if (is_counted<look>(b)) counts.add_to(*b.numbers);
}

}  // namespace gpurt::cuda
