// The sampler's loops over the samples of a block. For files that are compiled once per instruction set: the inner loops
// have no branches, so that the compiler makes vectors of them.
#pragma once

#include "core/reyes/lit_point.h"
#include "core/reyes/sample.h"
#include "core/scene/surface.h"
#include "cpu/reyes/depth_tiles.h"
#include "cpu/reyes/fragments.h"
#include "cpu/reyes/grid_light.h"
#include "cpu/reyes/tiny_quads.h"
#include "cpu/reyes/wide_kernel.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

constexpr uint32_t samples_per_run = 64;
// A micropolygon looks at num_lanes samples at a time, of the few that its cells of a row have. x, y, z and root of a block may
// be read so far beyond their ends, and written what they hold: other arrays of the same thread follow (ReyesMemory).

// Puts micropolygons and triangles, root by root, into the samples of a block.
class BlockSampler {
 public:
  /// `sink` takes what is not hidden by the block's surfaces; without one the block does. `wide`: null, or what takes grids.
  BlockSampler(const ReyesScene &scene, const RasterProjection &projection, const SampleBlock &block,
               bool has_own_light, const FragmentSink *sink, const WideKernels *wide)
      : sink_(sink),
        wide_(wide),
        scene_(scene),
        projection_(projection),
        block_(block),
        tiles_(block),
        origin_x_(float(block.origin_x)),
        origin_y_(float(block.origin_y)),
        has_masks_(scene.scene.has_alpha_masks != 0),
        has_own_light_(has_own_light)
  {}

  void begin_root(uint32_t root, RasterPoint largest)
  {
    root_ = root;
    largest_ = largest;
  }

  // Whether samples see something nearer than what lies within a box of the image, in raster units, and has 1 / w of z at most.
  bool hides(const RasterRect &box, float z)
  {
    return tiles_.hides(box.x0 - origin_x_, box.y0 - origin_y_, box.x1 - origin_x_, box.y1 - origin_y_, z);
  }
  // A grid within the box has been sampled.
  void touch(const RasterRect &box)
  {
    tiles_.touch(box.x0 - origin_x_, box.y0 - origin_y_, box.x1 - origin_x_, box.y1 - origin_y_);
  }

  // `light`: null, or what samples keep of the grid's micropolygons in place of the root. `middles`: null, or what they keep
  // in place of where they are on the patch.
  void sample_grid(const Grid &grid, const GridLight *light, const GridMiddles *middles = nullptr)
  {
    keeps_middle_ = middles != nullptr;
    if (wide_ != nullptr && grid.all_in_front) sample_wide_grid(grid, light, middles);
    else if (light != nullptr) sample_rows<true>(grid, light, nullptr);
    else sample_rows<false>(grid, nullptr, middles);
    keeps_middle_ = false;
  }

  // Any triangle, whatever its size and place.
  void sample_triangle(const RasterVertex &a, const RasterVertex &b, const RasterVertex &c)
  {
    CellRange cells{0, 0, block_.cells_x - 1, block_.cells_y - 1};
    if (a.is_projectable && b.is_projectable && c.is_projectable) {
      const float x0 = min(min(a.x, b.x), c.x), x1 = max(max(a.x, b.x), c.x);
      const float y0 = min(min(a.y, b.y), c.y), y1 = max(max(a.y, b.y), c.y);
      if (!cells_of_box(block_, x0, y0, x1, y1, cells)) return;
      if (x1 - x0 <= small_extent && y1 - y0 <= small_extent) {
        SmallTriangle t;
        if (!make_small_triangle(a.x - origin_x_, a.y - origin_y_, a.z, b.x - origin_x_, b.y - origin_y_, b.z,
                                 c.x - origin_x_, c.y - origin_y_, c.z, t)) {
          return;
        }
        sample_cells(
            cells, [](int32_t, CellRange &) {},
            [&](float x, float y, float &p, float &q) { return cover(t, x, y, p, q); },
            [&](float z, float share_b, float share_c) {
              return cover_uv(t, {{a.u, a.v}, {b.u, b.v}, {c.u, c.v}}, z, share_b, share_c);
            });
        return;
      }
    } else {
      const float x[3] = {a.h.x, b.h.x, c.h.x}, y[3] = {a.h.y, b.h.y, c.h.y}, w[3] = {a.h.w, b.h.w, c.h.w};
      if (!can_be_seen(x, y, w, 3, largest_, rect())) return;
    }
    AnyCover t;
    const RasterVertex *const corners[3] = {&a, &b, &c};
    if (!make_any_cover(corners, projection_, t)) return;
    const double origin_x = double(origin_x_), origin_y = double(origin_y_);
    sample_cells(
        cells, [&](int32_t row, CellRange &of_row) { narrow(t, row, of_row); },
        [&](float x, float y, float &p, float &q) {
          return cover_any(t, double(x) + origin_x, double(y) + origin_y, p, q);
        },
        [&](float z, float share_b, float share_c) { return cover_uv(a, b, c, z, share_b, share_c); });
  }

  // The block with a pixel around it, in pixels from the image's centre.
  RasterRect rect() const
  {
    const float scale = 1.0f / units_per_pixel;
    const float x0 = (origin_x_ - projection_.centre_x) * scale,
                y0 = (origin_y_ - projection_.centre_y) * scale;
    const float size_x = float(block_.cells_x << block_.cell_bits) * scale;
    const float size_y = float(block_.cells_y << block_.cell_bits) * scale;
    return {x0 - 1.0f, y0 - 1.0f, x0 + size_x + 1.0f, y0 + size_y + 1.0f};
  }

  uint64_t num_fragments() const { return num_fragments_; }

 private:
  void sample_wide_grid(const Grid &grid, const GridLight *light, const GridMiddles *middles)
  {
    struct Rest {
      BlockSampler &sampler;
      const Grid &grid;
      const GridLight *light;
      const GridMiddles *middles;

      BlockSampler &at(uint32_t i, uint32_t j) const
      {
        if (light != nullptr) sampler.light_ = light_of(*light, i, j);
        if (middles != nullptr) sampler.middle_ = middle_of(*middles, i, j);
        return sampler;
      }
    } rest{*this, grid, light, middles};
    const auto sample_quad = [](void *sampler, uint32_t i, uint32_t j) {
      const Rest &r = *static_cast<const Rest *>(sampler);
      const uint32_t width = r.grid.num_u + 1, a = j * width + i;
      r.at(i, j).sample_quad(r.grid, a, a + 1, a + width + 1, a + width);
    };
    const auto take = [](void *sampler, uint32_t i, uint32_t j, uint32_t slot, float z, float u, float v) {
      static_cast<const Rest *>(sampler)->at(i, j).take(slot, z, {u, v});
    };
    num_fragments_ += wide_->sample_grid(
        {grid, block_, root_, light, middles, sink_ == nullptr && !has_masks_, &rest, sample_quad, take});
  }

  template <bool has_light>
  void sample_rows(const Grid &grid, const GridLight *light, const GridMiddles *middles)
  {
    const uint32_t width = grid.num_u + 1;
    const SampleBlock block = block_;
    uint32_t num_fragments = 0;
    TinyQuads quads;
    for (uint32_t j = 0; j < grid.num_v; ++j) {
      for (uint32_t first = 0; first < grid.num_u; first += num_lanes) {
        const uint32_t n = min(grid.num_u - first, num_lanes);
        uint32_t left = (1u << n) - 1, tiny = 0;
        if (grid.all_in_front) {
          if (!make_tiny_quads(grid, j, first, n, block, quads)) continue;
          left = quads.are_there & (quads.have_area | ~quads.are_tiny);
          tiny = quads.are_tiny;
        }
        for (; left != 0; left &= left - 1) {
          const uint32_t k = uint32_t(__builtin_ctz(left)), i = first + k, a = j * width + i;
          const uint32_t own = has_light ? light_of(*light, i, j) : 0;
          if (!has_light && middles != nullptr) middle_ = middle_of(*middles, i, j);
          if (tiny >> k & 1) {
            sample_tiny_quad(block, quads, k, grid, a, has_light, lanes(own), num_fragments);
            continue;
          }
          light_ = own;
          sample_quad(grid, a, a + 1, a + width + 1, a + width);
        }
      }
    }
    num_fragments_ += num_fragments;
  }

  static RasterVertex vertex(const Grid &g, uint32_t k)
  {
    const RasterPoint h{g.hx[k], g.hy[k], g.hw[k]};
    return {g.x[k], g.y[k], g.z[k], g.u[k], g.v[k], h, is_projectable(h)};
  }

  void sample_quad(const Grid &g, uint32_t a, uint32_t b, uint32_t c, uint32_t d)
  {
    const RasterVertex va = vertex(g, a), vb = vertex(g, b), vc = vertex(g, c), vd = vertex(g, d);
    sample_triangle(va, vb, vc);
    sample_triangle(va, vc, vd);
  }

  // Both triangles of micropolygon k of eight, whose first vertex is a of the grid. What is read again and again is handed in:
  // stores to samples could change members, for all that the compiler knows.
  GPURT_INLINE void sample_tiny_quad(const SampleBlock &block, const TinyQuads &q, uint32_t k, const Grid &g,
                                     uint32_t a, bool has_light, UintLanes light, uint32_t &num_fragments)
  {
    const FloatLanes ax = lanes(q.ax[k]), ay = lanes(q.ay[k]);
    const IntLanes lane{0, 1, 2, 3, 4, 5, 6, 7};
    const uint32_t cells_x = uint32_t(block.cells_x), num_rows = uint32_t(q.y1[k] - q.y0[k]) + 1;
    const uint32_t *from = block.first + uint32_t(q.y0[k]) * cells_x + uint32_t(q.x0[k]);
    const uint32_t *to = from + uint32_t(q.x1[k] - q.x0[k]) + 1;
    for (uint32_t row = 0; row < num_rows; ++row, from += cells_x, to += cells_x) {
      const uint32_t end = *to;
      for (uint32_t first = *from; first < end; first += num_lanes) {
        // Always whole lanes: what lies behind the run is computed and not taken.
        const FloatLanes x = load_lanes(block.x + first) - ax, y = load_lanes(block.y + first) - ay,
                         old_z = load_lanes(block.z + first);
        const TinyCover of_s = cover_tiny(q.s, k, x, y), of_t = cover_tiny(q.t, k, x, y);
        const FloatLanes z = max(of_s.z, of_t.z);
        IntLanes is_near = (z >= old_z) & (z > 0.0f) & (lane < int32_t(end - first));
        const uint32_t near = bits_of_mask(is_near);
        if (near == 0) continue;
        if (has_light) {
          // Of equally near light the larger number stays, whatever comes first.
          const UintLanes old_light = load_lanes(block.root + first);
          is_near &= (z > old_z) | (old_light < light);
          store_lanes(block.z + first, is_near ? z : old_z);
          store_lanes(block.root + first, is_near ? light : old_light);
          num_fragments += uint32_t(__builtin_popcount(bits_of_mask(is_near)));
          continue;
        }
        // A micropolygon that is not convex may cover a sample twice.
        const uint32_t c = a + g.num_u + 2;
        take_lanes(block, of_s, q.s.is_swapped[k] != 0, near, first, g, a, a + 1, c);
        take_lanes(block, of_t, q.t.is_swapped[k] != 0, near, first, g, a, c, c - 1);
      }
    }
  }

  // Those of samples first .. that a triangle a b c of the grid covers.
  GPURT_INLINE void take_lanes(const SampleBlock &block, const TinyCover &cover, bool is_swapped,
                               uint32_t near, uint32_t first, const Grid &g, uint32_t a, uint32_t b,
                               uint32_t c)
  {
    near &= bits_of_mask((cover.z > 0.0f) & (cover.z >= load_lanes(block.z + first)));
    if (near == 0) return;
    FloatLanes u, v;
    cover_uv(cover, is_swapped, {g.u[a], g.v[a]}, {g.u[b], g.v[b]}, {g.u[c], g.v[c]}, u, v);
    for (; near != 0; near &= near - 1) {
      const uint32_t k = uint32_t(__builtin_ctz(near));
      take(first + k, cover.z[k], {u[k], v[k]});
    }
  }

  // Leaves out cells at both ends of a row of `cells` that a triangle cannot cover.
  void narrow(const AnyCover &t, int32_t row, CellRange &cells) const
  {
    const double size = double(1 << block_.cell_bits), origin_x = double(origin_x_);
    const double y0 = double(origin_y_) + double(row) * size;
    double x0 = origin_x + double(cells.x0) * size, x1 = origin_x + double(cells.x1 + 1) * size;
    if (!narrow_row(t, y0, y0 + size, x0, x1)) {
      cells.x1 = cells.x0 - 1;
      return;
    }
    // Both lie within the row now.
    cells.x1 = min(int32_t((x1 - origin_x) / size), cells.x1);
    cells.x0 = min(int32_t((x0 - origin_x) / size), cells.x1);
  }

  // `narrow_row` may make the range of cells of a row smaller.
  template <class NarrowRow, class Cover, class Uv>
  void sample_cells(const CellRange &cells, const NarrowRow &narrow_row, const Cover &cover_sample,
                    const Uv &uv)
  {
    for (int32_t row = cells.y0; row <= cells.y1; ++row) {
      CellRange of_row = cells;
      narrow_row(row, of_row);
      if (of_row.x0 > of_row.x1) continue;
      const uint32_t cell = uint32_t(row) * uint32_t(block_.cells_x);
      const uint32_t end = block_.first[cell + uint32_t(of_row.x1) + 1];
      for (uint32_t first = block_.first[cell + uint32_t(of_row.x0)]; first < end; first += samples_per_run) {
        const uint32_t n = min(end - first, samples_per_run);
        float z[samples_per_run];
        const float *px = block_.x + first, *py = block_.y + first, *old_z = block_.z + first;
        uint32_t any = 0;
        for (uint32_t k = 0; k < n; ++k) {
          float p, q;
          const float covered = cover_sample(px[k], py[k], p, q);
          const float taken = covered >= old_z[k] ? covered : 0.0f;
          z[k] = taken;
          any |= float_bits(taken);
        }
        if (any == 0) continue;
        for (uint32_t k = 0; k < n; ++k) {
          if (!(z[k] > 0.0f)) continue;
          float share_b, share_c;
          cover_sample(px[k], py[k], share_b, share_c);
          take(first + k, z[k], uv(z[k], share_b, share_c));
        }
      }
    }
  }

  // What is as near as what the sample has, or nearer.
  void take(uint32_t slot, float z, Vec2f place)
  {
    if (has_own_light_) {
      // Whatever comes first, of equally near light the larger number stays.
      if (z == block_.z[slot] && light_ <= block_.root[slot]) return;
      ++num_fragments_;
      block_.z[slot] = z;
      block_.root[slot] = light_;
      return;
    }
    const Vec2f kept = keeps_middle_ ? middle_ : place;
    if (z == block_.z[slot]) {
      const uint32_t root = block_.root[slot];
      if (root < root_) return;
      if (root == root_ && place_key(kept) >= place_key({block_.u[slot], block_.v[slot]})) return;
    }
    if (sink_ != nullptr) {
      const Hit hit = hit_of_root(scene_, root_, place.x, place.y, 0.0f);
      const float opacity = opacity_at(scene_.scene, hit.triangle, hit.u, hit.v);
      if (opacity > 0.0f) sink_->take(slot, {z, root_, place.x, place.y, opacity});
      return;
    }
    if (has_masks_) {
      const Hit hit = hit_of_root(scene_, root_, place.x, place.y, 0.0f);
      if (!(opacity_at(scene_.scene, hit.triangle, hit.u, hit.v) > 0.0f)) return;
    }
    ++num_fragments_;
    block_.z[slot] = z;
    block_.root[slot] = root_;
    block_.u[slot] = kept.x;
    block_.v[slot] = kept.y;
  }

  const FragmentSink *const sink_;
  const WideKernels *const wide_;
  const ReyesScene &scene_;
  const RasterProjection &projection_;
  const SampleBlock block_;
  DepthTiles tiles_;
  const float origin_x_, origin_y_;
  const bool has_masks_, has_own_light_;
  uint32_t root_ = invalid_id;
  uint32_t light_ = 0;  // of the micropolygon, packed
  bool keeps_middle_ = false;
  Vec2f middle_{};  // of the micropolygon, or of its block
  RasterPoint largest_{};
  uint64_t num_fragments_ = 0;
};

GPURT_FUNCTIONS_END
}  // namespace gpurt
