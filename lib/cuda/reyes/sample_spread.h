// Stage 'sample' of micropolygons of some pixels, by a warp each whose lanes take samples side by side. For .cu files alone.
//
// Where micropolygons are large their grids are few, and have few of them: a lane that went through the samples of one alone
// would take long, and most of the device would wait.
#pragma once

#include "cuda/reyes/sampler.h"

namespace gpurt::cuda {

// Samples what sample_rest_of handed on.
template <Look look, bool has_masks>
__device__ __forceinline__ void sample_spread_of(const ReyesBatch &b)
{
  const SampleGrid &g = b.samples;
  const uint32_t n = min(b.numbers->num_spread, b.spread_capacity);
  const int32_t s = cell_shift(g);
  uint32_t num_fragments = 0;
  for (uint32_t item; (item = next_item(&b.numbers->tickets[4], n)) != n;) {
    const SpreadQuad q = b.spread[item];
    const int32_t ox = q.x[0], oy = q.y[0];
    SmallTriangle t[2];
    int32_t x0 = INT32_MAX, y0 = INT32_MAX, x1 = INT32_MIN, y1 = INT32_MIN;
#pragma unroll
    for (int i = 0; i < 2; ++i) {
      if ((q.has >> i & 1) == 0) continue;
      make_small_triangle(0.0f, 0.0f, q.z[0], float(q.x[i + 1] - ox), float(q.y[i + 1] - oy), q.z[i + 1],
                          float(q.x[i + 2] - ox), float(q.y[i + 2] - oy), q.z[i + 2], t[i]);
      x0 = min(x0, min(ox, min(q.x[i + 1], q.x[i + 2])));
      x1 = max(x1, max(ox, max(q.x[i + 1], q.x[i + 2])));
      y0 = min(y0, min(oy, min(q.y[i + 1], q.y[i + 2])));
      y1 = max(y1, max(oy, max(q.y[i + 1], q.y[i + 2])));
    }
    CellRange cells;
    if (!cells_of_box(g, x0, y0, x1, y1, cells)) continue;  // never: it was not handed on then
    // In the place of one that is not there stands the other, but for fragments, which take no sample twice.
    if (q.has == 1) t[1] = t[0];
    if (q.has == 2) t[0] = t[1];
    if constexpr (is_of_fragments(look)) {
      if (q.has == 1) t[1].threshold_a = infinity;
      if (q.has == 2) t[0].threshold_a = infinity;
    }
    for_samples_of_pixels(g, {cells.x0 >> s, cells.y0 >> s, cells.x1 >> s, cells.y1 >> s},
                          [&](bool is_there, uint32_t slot, int32_t x, int32_t y) {
                            sample_one<look, has_masks>(
                                b, q.kept, is_there, slot, float(x - ox), float(y - oy), t,
                                [&](int i, Vec2f(&corners)[3]) {
                                  const bool is_second = (q.has >> i & 1) != 0 ? i == 1 : i == 0;
                                  corners[0] = q.places[0];
                                  corners[1] = is_second ? q.places[2] : q.places[1];
                                  corners[2] = is_second ? q.places[3] : q.places[2];
                                },
                                q.middle, num_fragments);
                          });
  }
  if (is_counted<look>(b)) add_of_lanes(&b.numbers->num_fragments, num_fragments);
}

}  // namespace gpurt::cuda
