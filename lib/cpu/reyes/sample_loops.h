// The sampler's loops over the samples of a block. For files that are compiled once per instruction set: the inner loops
// have no branches, so that the compiler makes vectors of them.
#pragma once

#include "core/reyes/map.h"
#include "core/reyes/sample.h"
#include "core/scene/surface.h"
#include "cpu/reyes/fragments.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

constexpr uint32_t samples_per_run = 64;
// Samples that a micropolygon looks at at a time, of the few that its cells of a row have. x, y, z and root of a block may be
// read so far beyond their ends, and written what they hold: other arrays of the same thread follow (ReyesMemory).
constexpr uint32_t samples_per_vector = 8;

// Packed light of a grid's micropolygons, or of its blocks of them.
struct GridLight {
  uint32_t shift_u, shift_v;  // log2 of the micropolygons along a block
  uint32_t bits_u;            // log2 of the blocks along u
  uint32_t packed[max_segments * max_segments];

  uint32_t of(uint32_t i, uint32_t j) const { return packed[(j >> shift_v) << bits_u | i >> shift_u]; }
};

// Puts micropolygons and triangles, root by root, into the samples of a block.
class BlockSampler {
 public:
  /// `sink` takes what is not hidden by the block's surfaces; without one the block does.
  BlockSampler(const ReyesScene &scene, const RasterProjection &projection, const SampleBlock &block,
               bool has_own_light, const FragmentSink *sink)
      : sink_(sink),
        scene_(scene),
        projection_(projection),
        block_(block),
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

  // `light`: null, or what samples keep of the grid's micropolygons in place of the root.
  void sample_grid(const Grid &grid, const GridLight *light)
  {
    const uint32_t width = grid.num_u + 1;
    for (uint32_t j = 0; j < grid.num_v; ++j) {
      for (uint32_t i = 0; i < grid.num_u; ++i) {
        const uint32_t a = j * width + i;
        if (light != nullptr) light_ = light->of(i, j);
        sample_quad(grid, a, a + 1, a + width + 1, a + width);
      }
    }
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
            cells, [&](float x, float y, float &p, float &q) { return cover(t, x, y, p, q); },
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
        cells,
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
  static RasterVertex vertex(const Grid &g, uint32_t k)
  {
    const RasterPoint h{g.hx[k], g.hy[k], g.hw[k]};
    return {g.x[k], g.y[k], g.z[k], g.u[k], g.v[k], h, is_projectable(h)};
  }

  void sample_quad(const Grid &g, uint32_t a, uint32_t b, uint32_t c, uint32_t d)
  {
    if (g.all_in_front) {
      const float x0 = min(min(g.x[a], g.x[b]), min(g.x[c], g.x[d]));
      const float x1 = max(max(g.x[a], g.x[b]), max(g.x[c], g.x[d]));
      const float y0 = min(min(g.y[a], g.y[b]), min(g.y[c], g.y[d]));
      const float y1 = max(max(g.y[a], g.y[b]), max(g.y[c], g.y[d]));
      CellRange cells;
      if (!cells_of_box(block_, x0, y0, x1, y1, cells)) return;
      if (x1 - x0 <= small_extent && y1 - y0 <= small_extent) {
        sample_small_quad(g, a, b, c, d, cells);
        return;
      }
    }
    const RasterVertex va = vertex(g, a), vb = vertex(g, b), vc = vertex(g, c), vd = vertex(g, d);
    sample_triangle(va, vb, vc);
    sample_triangle(va, vc, vd);
  }

  // Both triangles of a micropolygon, a b c and a c d, at a time.
  void sample_small_quad(const Grid &g, uint32_t a, uint32_t b, uint32_t c, uint32_t d,
                         const CellRange &cells)
  {
    const float ax = g.x[a] - origin_x_, ay = g.y[a] - origin_y_, bx = g.x[b] - origin_x_,
                by = g.y[b] - origin_y_, cx = g.x[c] - origin_x_, cy = g.y[c] - origin_y_,
                dx = g.x[d] - origin_x_, dy = g.y[d] - origin_y_;
    SmallTriangle s, t;
    const bool has_s = make_small_triangle(ax, ay, g.z[a], bx, by, g.z[b], cx, cy, g.z[c], s);
    const bool has_t = make_small_triangle(ax, ay, g.z[a], cx, cy, g.z[c], dx, dy, g.z[d], t);
    if (!has_s && !has_t) return;
    // In the place of one without area, which covers nothing, stands the other.
    if (!has_s) s = t;
    if (!has_t) t = s;
    const uint32_t s_b = has_s ? b : c, s_c = has_s ? c : d, t_b = has_t ? c : b, t_c = has_t ? d : c;
    for (int32_t row = cells.y0; row <= cells.y1; ++row) {
      const uint32_t cell = uint32_t(row) * uint32_t(block_.cells_x);
      const uint32_t end = block_.first[cell + uint32_t(cells.x1) + 1];
      for (uint32_t first = block_.first[cell + uint32_t(cells.x0)]; first < end;
           first += samples_per_vector) {
        // Always a whole vector: what lies behind the run is computed and not taken.
        const uint32_t n = min(end - first, samples_per_vector);
        float z[samples_per_vector];
        const float *px = block_.x + first, *py = block_.y + first, *old_z = block_.z + first;
        uint32_t any = 0;
        for (uint32_t k = 0; k < samples_per_vector; ++k) {
          float p, q;
          const float zs = cover(s, px[k], py[k], p, q), zt = cover(t, px[k], py[k], p, q);
          const float nearest = zt > zs ? zt : zs;
          const float taken = (nearest >= old_z[k]) & (k < n) ? nearest : 0.0f;
          z[k] = taken;
          any |= float_bits(taken);
        }
        if (any == 0) continue;
        if (has_own_light_) {
          take_light(first, z);
          continue;
        }
        for (uint32_t k = 0; k < n; ++k) {
          if (!(z[k] > 0.0f)) continue;
          // A micropolygon that is not convex may cover a sample twice.
          const auto take_if_nearer = [&](const SmallTriangle &triangle, uint32_t i_b, uint32_t i_c) {
            float pb, pc;
            const float covered = cover(triangle, px[k], py[k], pb, pc);
            if (!(covered > 0.0f && covered >= old_z[k])) return;
            const Vec2f corners[3] = {{g.u[a], g.v[a]}, {g.u[i_b], g.v[i_b]}, {g.u[i_c], g.v[i_c]}};
            take(first + k, covered, cover_uv(triangle, corners, covered, pb, pc));
          };
          take_if_nearer(s, s_b, s_c);
          take_if_nearer(t, t_b, t_c);
        }
      }
    }
  }

  template <class Cover, class Uv>
  void sample_cells(const CellRange &cells, const Cover &cover_sample, const Uv &uv)
  {
    for (int32_t row = cells.y0; row <= cells.y1; ++row) {
      const uint32_t cell = uint32_t(row) * uint32_t(block_.cells_x);
      const uint32_t end = block_.first[cell + uint32_t(cells.x1) + 1];
      for (uint32_t first = block_.first[cell + uint32_t(cells.x0)]; first < end; first += samples_per_run) {
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

  // Samples first .. whose z is not 0: of equally near light the larger number stays, whatever comes first.
  void take_light(uint32_t first, const float (&z)[samples_per_vector])
  {
    float *old_z = block_.z + first;
    uint32_t *old_light = block_.root + first;
    uint32_t num = 0;
    for (uint32_t k = 0; k < samples_per_vector; ++k) {
      const bool takes = (z[k] > 0.0f) & ((z[k] > old_z[k]) | (light_ > old_light[k]));
      old_z[k] = takes ? z[k] : old_z[k];
      old_light[k] = takes ? light_ : old_light[k];
      num += takes ? 1 : 0;
    }
    num_fragments_ += num;
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
    if (z == block_.z[slot]) {
      const uint32_t root = block_.root[slot];
      if (root < root_) return;
      if (root == root_ && place_key(place) >= place_key({block_.u[slot], block_.v[slot]})) return;
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
    block_.u[slot] = place.x;
    block_.v[slot] = place.y;
  }

  const FragmentSink *const sink_;
  const ReyesScene &scene_;
  const RasterProjection &projection_;
  const SampleBlock block_;
  const float origin_x_, origin_y_;
  const bool has_masks_, has_own_light_;
  uint32_t root_ = invalid_id;
  uint32_t light_ = 0;  // of the micropolygon, packed
  RasterPoint largest_{};
  uint64_t num_fragments_ = 0;
};

GPURT_FUNCTIONS_END
}  // namespace gpurt
