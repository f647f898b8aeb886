// Stage 'sample' of meshes' triangles and of large ones from any stage. For .cu files alone.
#pragma once

#include "cuda/reyes/sampler.h"

namespace gpurt::cuda {

// Whether a look is for a root of a mesh.
template <Look look>
__device__ __forceinline__ bool is_triangle_wanted(const ReyesBatch &b, uint32_t root)
{
  if (look == Look::Spots && !is_visible(b, root)) return false;
  if (b.blends == nullptr) return true;
  const SceneView &scene = b.scene.scene;
  const bool blends =
      scene.materials[scene.segments[range_of_root(b.scene, root).segment].material].blends != 0;
  return blends == is_of_fragments(look);
}

// Small triangles a lane each; others go on.
template <Look look, bool has_masks>
__device__ __forceinline__ void sample_triangles_of(const ReyesBatch &b)
{
  const uint32_t lane = threadIdx.x % 32, num_triangles = b.numbers->num_triangles;
  const uint32_t num_groups = (num_triangles + 31) / 32;
  uint32_t num_fragments = 0;
  for (uint32_t group; (group = next_item(&b.numbers->tickets[1], num_groups)) != num_groups;) {
    const uint32_t i = group * 32 + lane;
    const uint32_t root = i < num_triangles ? b.triangles[i] : invalid_id;
    SmallTriangle t[1];
    CellRange cells{0, 0, -1, -1};
    int32_t ox = 0, oy = 0;
    bool has = false;
    if (root != invalid_id && is_triangle_wanted<look>(b, root)) {
      const RootRange range = range_of_root(b.scene, root);
      LargeTriangle large;
      transform_triangle(
          b.scene, b.projection, range,
          b.scene.scene.segments[range.segment].first_triangle + uint32_t(root - range.first_root),
          large.corners);
      const Vec2f places[3] = {{0.0f, 0.0f}, {1.0f, 0.0f}, {0.0f, 1.0f}};
      int32_t x[3], y[3];
      float z[3];
      bool is_projected = true;
      for (int c = 0; c < 3; ++c) {
        const RasterPoint h = large.corners[c];
        is_projected &= is_projectable(h);
        z[c] = 1.0f / h.w;
        x[c] = is_projectable(h) ? int32_t(project_x(h.x, z[c], b.projection)) : 0;
        y[c] = is_projectable(h) ? int32_t(project_y(h.y, z[c], b.projection)) : 0;
      }
      const int32_t x0 = min(min(x[0], x[1]), x[2]), x1 = max(max(x[0], x[1]), x[2]);
      const int32_t y0 = min(min(y[0], y[1]), y[2]), y1 = max(max(y[0], y[1]), y[2]);
      if (is_projected && x1 - x0 <= int32_t(small_extent) && y1 - y0 <= int32_t(small_extent)) {
        ox = x[0];
        oy = y[0];
        has = make_small_triangle(0.0f, 0.0f, z[0], float(x[1] - ox), float(y[1] - oy), z[1],
                                  float(x[2] - ox), float(y[2] - oy), z[2], t[0]) &&
              cells_of_box(b.samples, x0, y0, x1, y1, cells);
      } else {
        const float hx[3] = {large.corners[0].x, large.corners[1].x, large.corners[2].x},
                    hy[3] = {large.corners[0].y, large.corners[1].y, large.corners[2].y},
                    hw[3] = {large.corners[0].w, large.corners[1].w, large.corners[2].w};
        for (int c = 0; c < 3; ++c) large.places[c] = places[c];
        large.largest = largest_coordinates(hx, hy, hw, 3);
        large.root = root;
        large.middle = no_middle();
        hand_on_large<look, has_masks>(b, large, num_fragments);
      }
    }
    sample_small<look, has_masks>(
        b, root, has, cells, ox, oy, t,
        [&](int, Vec2f(&corners)[3]) {
          corners[0] = {0.0f, 0.0f};
          corners[1] = {1.0f, 0.0f};
          corners[2] = {0.0f, 1.0f};
        },
        no_middle(), num_fragments);
  }
  if (is_counted<look>(b)) add_of_lanes(&b.numbers->num_fragments, num_fragments);
}

// Rows of pixels that a warp looks at together, and in each of them the pixels that a large triangle may cover.
struct PixelRows {
  int32_t x[32];    // the first one
  int32_t end[32];  // pixels of the rows up to this one
};

// Fills the rows from y on; how many pixels that are. By all lanes of a warp.
__device__ __forceinline__ int32_t find_rows(const SampleGrid &g, const LargeCover &large,
                                             const CellRange &box, int32_t y, PixelRows &rows)
{
  const int32_t lane = int32_t(threadIdx.x % 32);
  int32_t x0 = 0, x1 = -1, sum;
  if (y + lane > box.y1 || !pixels_of_row(g, large, box, y + lane, x0, x1)) x1 = x0 - 1;
  sum = x1 - x0 + 1;
  for (int32_t offset = 1; offset < 32; offset *= 2) {
    const int32_t other = __shfl_up_sync(all_lanes, sum, offset);
    if (lane >= offset) sum += other;
  }
  __syncwarp();
  rows.x[lane] = x0;
  rows.end[lane] = sum;
  __syncwarp();
  return rows.end[31];
}

// As for_samples_of_pixels, of pixels [first, last) of rows from y on.
template <class Visit>
__device__ __forceinline__ void for_samples_of_rows(const SampleGrid &g, const PixelRows &rows, int32_t y,
                                                    int32_t first, int32_t last, const Visit &visit)
{
  const int32_t lane = int32_t(threadIdx.x % 32), s = cell_shift(g);
  int32_t row = 0;
  const auto x_of = [&](int32_t pixel) {
    while (rows.end[row] <= pixel) ++row;
    return rows.x[row] + pixel - (row != 0 ? rows.end[row - 1] : 0);
  };
  if (g.is_even == 0) {
    // A lane a pixel.
    for (int32_t begin = first; begin < last; begin += 32) {
      const bool is_pixel = begin + lane < last;
      const int32_t x = is_pixel ? x_of(begin + lane) : 0, at = y + row;
      SampleWalk walk(g, {x << s, at << s, ((x + 1) << s) - 1, ((at + 1) << s) - 1}, is_pixel);
      while (__any_sync(all_lanes, walk.is_at_sample())) {
        const bool is_there = walk.is_at_sample();
        visit(is_there, walk.slot(), is_there ? walk.x(g) : 0, is_there ? walk.y(g) : 0);
        walk.advance(g);
      }
    }
    return;
  }
  const int32_t n = int32_t(g.samples_per_pixel), row_pixels = g.cells_x >> s;
  const int32_t step_pixels = 32 / n, step_samples = 32 - step_pixels * n;
  int32_t pixel = first + lane / n, sample = lane % n;
  for (;; pixel += step_pixels, sample += step_samples) {
    if (sample >= n) {
      sample -= n;
      ++pixel;
    }
    const bool is_there = pixel < last;
    if (!__any_sync(all_lanes, is_there)) return;
    uint32_t slot = 0;
    int32_t x = 0, place = 0;
    if (is_there) {
      x = x_of(pixel);
      const uint32_t k = uint32_t((y + row) * row_pixels + x);
      slot = k * uint32_t(n) + uint32_t(sample);
      place = g.masks != nullptr ? g.places[uint64_t(k) * most_masked + uint32_t(sample)] : g.places[slot];
    }
    visit(is_there, slot, g.x0 + (x << unit_bits) + (place & 255),
          g.y0 + ((y + row) << unit_bits) + (place >> 8));
  }
}

// How many parts of part_pixels a large triangle has: those of 32 rows each for themselves. By all lanes of a warp.
__device__ __forceinline__ uint32_t count_parts(const ReyesBatch &b, const LargeTriangle &t, PixelRows &rows)
{
  LargeCover large;
  if (!make_large_cover(b, t, large)) return 0;
  const CellRange box = pixels_of(b.samples, large.cells);
  uint32_t num_parts = 0;
  for (int32_t y = box.y0; y <= box.y1; y += 32) {
    const uint32_t n = uint32_t(find_rows(b.samples, large, box, y, rows));
    num_parts += (n + b.part_pixels - 1) / b.part_pixels;
  }
  return num_parts;
}

// A warp a part of a large triangle.
template <Look look, bool has_masks>
__device__ __forceinline__ void sample_large_of(const ReyesBatch &b, LargeParts parts)
{
  __shared__ PixelRows rows_of_warps[block_size / 32];
  PixelRows &rows = rows_of_warps[threadIdx.x / 32];
  const SampleGrid &g = b.samples;
  const uint32_t n = min(b.numbers->num_large, b.large_capacity);
  const uint32_t end = b.numbers->num_large_parts;
  const uint32_t num_parts = parts.first < end ? min(end - parts.first, parts.num) : 0;
  uint32_t num_fragments = 0;
  for (uint32_t ticket; (ticket = next_item(&b.numbers->tickets[2], num_parts)) != num_parts;) {
    const uint32_t item = parts.first + ticket;
    // The first triangle whose sum is beyond the item.
    uint32_t lo = 0, hi = n - 1;
    while (lo < hi) {
      const uint32_t middle = (lo + hi) / 2;
      if (b.large_parts[middle] > item) hi = middle;
      else lo = middle + 1;
    }
    const LargeTriangle t = b.large[lo];
    LargeCover large;
    if (!make_large_cover(b, t, large)) continue;  // never: it has no parts then
    const CellRange box = pixels_of(g, large.cells);
    uint32_t index = item - (lo != 0 ? b.large_parts[lo - 1] : 0);
    for (int32_t y = box.y0; y <= box.y1; y += 32) {
      const uint32_t num_pixels = uint32_t(find_rows(g, large, box, y, rows));
      const uint32_t of_rows = (num_pixels + b.part_pixels - 1) / b.part_pixels;
      if (index >= of_rows) {
        index -= of_rows;
        continue;
      }
      const uint32_t first = index * b.part_pixels;
      for_samples_of_rows(g, rows, y, int32_t(first), int32_t(min(first + b.part_pixels, num_pixels)),
                          [&](bool is_there, uint32_t slot, int32_t px, int32_t py) {
                            float z = 0.0f;
                            Vec2f at{};
                            bool covers = false, takes = false;
                            if (is_there)
                              takes = test_large<look, has_masks>(b, t, large, slot, px, py, z, at, covers);
                            num_fragments += counts_fragment(look, covers, takes) ? 1 : 0;
                            __syncwarp();
                            if (takes) put<look>(b, slot, t.root, z, kept_place<look>(at, t.middle));
                          });
      break;
    }
  }
  if (is_counted<look>(b)) add_of_lanes(&b.numbers->num_fragments, num_fragments);
}

}  // namespace gpurt::cuda
