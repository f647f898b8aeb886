// Stage 'sample' of meshes' triangles and of large ones from any stage. For .cu files alone.
#pragma once

#include "cuda/reyes/sampler.h"

namespace gpurt::cuda {

constexpr int32_t tile_pixels = 32;  // of the parts that large triangles are cut to

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
        num_fragments);
  }
  if (look == Look::Nearest || look == Look::Count) add_of_lanes(&b.numbers->num_fragments, num_fragments);
}

__device__ inline int32_t cells_a_tile(const SampleGrid &g)
{
  return tile_pixels << (unit_bits - g.cell_bits);
}

// Whether a tile lies beyond one of the edges, all of whose numbers are whole.
__device__ inline bool is_beyond_edge(const LargeCover &large, const SampleGrid &g, const CellRange &cells)
{
  if (!large.is_projected) return false;
  const double x0 = double(g.x0 + (cells.x0 << g.cell_bits)),
               x1 = double(g.x0 + ((cells.x1 + 1) << g.cell_bits));
  const double y0 = double(g.y0 + (cells.y0 << g.cell_bits)),
               y1 = double(g.y0 + ((cells.y1 + 1) << g.cell_bits));
  for (const EdgeForm &e : large.cover.edge) {
    const double s = large.cover.sign;
    if (edge_value(e, x0, y0) * s < 0.0 && edge_value(e, x1, y0) * s < 0.0 &&
        edge_value(e, x0, y1) * s < 0.0 && edge_value(e, x1, y1) * s < 0.0) {
      return true;
    }
  }
  return false;
}

// A warp a tile of a large triangle.
template <Look look, bool has_masks>
__device__ __forceinline__ void sample_large_of(const ReyesBatch &b)
{
  const SampleGrid &g = b.samples;
  const uint32_t n = min(b.numbers->num_large, b.large_capacity), lane = threadIdx.x % 32;
  if (n == 0) return;
  const uint32_t num_tiles = b.large_tiles[n - 1];
  const int32_t tile = cells_a_tile(g);
  uint32_t num_fragments = 0;
  for (uint32_t item; (item = next_item(&b.numbers->tickets[2], num_tiles)) != num_tiles;) {
    // The first triangle whose sum is beyond the item.
    uint32_t lo = 0, hi = n - 1;
    while (lo < hi) {
      const uint32_t middle = (lo + hi) / 2;
      if (b.large_tiles[middle] > item) hi = middle;
      else lo = middle + 1;
    }
    const LargeTriangle t = b.large[lo];
    LargeCover large;
    if (!make_large_cover(b, t, large)) continue;  // never: it has no tiles then
    const CellRange box = large.cells;
    const uint32_t index = item - (lo != 0 ? b.large_tiles[lo - 1] : 0);
    const int32_t tiles_x = box.x1 / tile - box.x0 / tile + 1;
    const int32_t tile_x = box.x0 / tile + int32_t(index) % tiles_x,
                  tile_y = box.y0 / tile + int32_t(index) / tiles_x;
    const CellRange cells{max(box.x0, tile_x * tile), max(box.y0, tile_y * tile),
                          min(box.x1, tile_x * tile + tile - 1), min(box.y1, tile_y * tile + tile - 1)};
    if (is_beyond_edge(large, g, cells)) continue;
    if (!large.is_projected) {
      const float scale = 1.0f / units_per_pixel;
      const auto pixel = [&](int32_t units, float centre) { return (float(units) - centre) * scale; };
      const RasterRect rect{pixel(g.x0 + (cells.x0 << g.cell_bits), b.projection.centre_x) - 1.0f,
                            pixel(g.y0 + (cells.y0 << g.cell_bits), b.projection.centre_y) - 1.0f,
                            pixel(g.x0 + ((cells.x1 + 1) << g.cell_bits), b.projection.centre_x) + 1.0f,
                            pixel(g.y0 + ((cells.y1 + 1) << g.cell_bits), b.projection.centre_y) + 1.0f};
      const float x[3] = {t.corners[0].x, t.corners[1].x, t.corners[2].x},
                  y[3] = {t.corners[0].y, t.corners[1].y, t.corners[2].y},
                  w[3] = {t.corners[0].w, t.corners[1].w, t.corners[2].w};
      if (!can_be_seen(x, y, w, 3, t.largest, rect)) continue;
    }
    // A lane a cell.
    const int32_t width = cells.x1 - cells.x0 + 1, num_cells = width * (cells.y1 - cells.y0 + 1);
    for (int32_t first = 0; first < num_cells; first += 32) {
      const int32_t c = first + int32_t(lane), x = cells.x0 + c % width, y = cells.y0 + c / width;
      SampleWalk walk(g, {x, y, x, y}, c < num_cells);
      while (__any_sync(all_lanes, walk.is_at_sample())) {
        float z = 0.0f;
        Vec2f at{};
        bool covers = false, takes = false;
        if (walk.is_at_sample()) takes = test_large<look, has_masks>(b, t, large, walk, z, at, covers);
        num_fragments += counts_fragment(look, covers, takes) ? 1 : 0;
        __syncwarp();
        if (takes) put<look>(b, walk.slot(), t.root, z, at);
        walk.advance(g);
      }
    }
  }
  if (look == Look::Nearest || look == Look::Count) add_of_lanes(&b.numbers->num_fragments, num_fragments);
}

}  // namespace gpurt::cuda
