// Stage 'bound': whether a piece can be seen in a rectangle of the image, from its control points alone.
//
// A Bezier patch lies in the hull of its control points: if all of them lie beyond one side of the rectangle's viewing
// frustum, or behind the eye, so does the patch. The tests are linear in (x, y, w): pieces that cross the eye plane need no
// projection. Margins cover the rounding of control points and of grid vertices.
#pragma once

#include "core/reyes/bezier.h"

namespace gpurt {

// A rectangle of the image, in pixels from its centre.
struct RasterRect {
  float x0, y0, x1, y1;
};

// Bounds of a root on the image: pixels, or the whole of it.
struct RasterBox {
  int32_t x0, y0, x1, y1;  // empty: x0 > x1
};

// How far points reach to the inner side of a rectangle's viewing frustum: the largest of each.
struct FrustumReach {
  float left, right, top, bottom, front;
};

// w below this is behind the eye: far from the smallest float, so that 1 / w and products of it stay finite.
constexpr float smallest_w = 0x1p-60f;
// Relative rounding error of a control point or a vertex, in units of the largest coordinate, generously.
constexpr float raster_error = 0x1p-19f;

GPURT_FUNCTIONS_BEGIN

GPURT_HD inline RasterPoint largest_coordinates(const float *x, const float *y, const float *w, int n)
{
  RasterPoint m{0.0f, 0.0f, 0.0f};
  for (int i = 0; i < n; ++i) m = {max(m.x, abs(x[i])), max(m.y, abs(y[i])), max(m.w, abs(w[i]))};
  return m;
}

GPURT_INLINE FrustumReach frustum_reach(float x, float y, float w, const RasterRect &rect)
{
  return {x - rect.x0 * w, rect.x1 * w - x, y - rect.y0 * w, rect.y1 * w - y, w};
}
GPURT_INLINE FrustumReach max(FrustumReach a, FrustumReach b)
{
  return {max(a.left, b.left), max(a.right, b.right), max(a.top, b.top), max(a.bottom, b.bottom),
          max(a.front, b.front)};
}

// `largest`: of the root that the points are part of, whose coordinates they are computed from.
GPURT_INLINE bool can_be_seen(const FrustumReach &reach, RasterPoint largest, const RasterRect &rect)
{
  const float margin_x = -raster_error * (largest.x + max(abs(rect.x0), abs(rect.x1)) * largest.w);
  const float margin_y = -raster_error * (largest.y + max(abs(rect.y0), abs(rect.y1)) * largest.w);
  return reach.front >= -raster_error * largest.w && reach.left >= margin_x && reach.right >= margin_x &&
         reach.top >= margin_y && reach.bottom >= margin_y;
}

GPURT_HD inline bool can_be_seen(const float *x, const float *y, const float *w, int n, RasterPoint largest,
                                 const RasterRect &rect)
{
  FrustumReach reach{-infinity, -infinity, -infinity, -infinity, -infinity};
  for (int i = 0; i < n; ++i) reach = max(reach, frustum_reach(x[i], y[i], w[i], rect));
  return can_be_seen(reach, largest, rect);
}

// Whether all points are as good as behind the eye. A patch in front of nothing, or one that lies in the eye, could be cut
// forever: no part of it is ever before the eye.
GPURT_HD inline bool is_behind(const float *w, int n)
{
  float most = w[0];
  for (int i = 1; i < n; ++i) most = max(most, w[i]);
  return !(most >= smallest_w);
}

// Pixels that the hull of n points may touch; false: none of the image.
GPURT_HD inline bool raster_box(const float *x, const float *y, const float *w, int n, uint32_t width,
                                uint32_t height, RasterBox &box)
{
  const float half_w = 0.5f * float(width), half_h = 0.5f * float(height);
  if (is_behind(w, n)) return false;
  const RasterPoint largest = largest_coordinates(x, y, w, n);
  if (!can_be_seen(x, y, w, n, largest, {-half_w - 1.0f, -half_h - 1.0f, half_w + 1.0f, half_h + 1.0f}))
    return false;
  float min_w = infinity;
  for (int i = 0; i < n; ++i) min_w = min(min_w, w[i]);
  box = {0, 0, int32_t(width) - 1, int32_t(height) - 1};
  // What reaches behind the eye, if only by rounding, is not projected.
  if (min_w < smallest_w || min_w <= raster_error * largest.w) return true;
  Vec2f lo{infinity, infinity}, hi{-infinity, -infinity};
  for (int i = 0; i < n; ++i) {
    const float inv_w = 1.0f / w[i];
    lo = {min(lo.x, x[i] * inv_w), min(lo.y, y[i] * inv_w)};
    hi = {max(hi.x, x[i] * inv_w), max(hi.y, y[i] * inv_w)};
  }
  const float margin_x = 1.0f + raster_error * (largest.x + half_w * largest.w) / min_w;
  const float margin_y = 1.0f + raster_error * (largest.y + half_h * largest.w) / min_w;
  // Cut to the image before they become whole numbers.
  const float w_limit = float(width), h_limit = float(height);
  box.x0 = int32_t(floor(clamp(lo.x - margin_x + half_w, 0.0f, w_limit)));
  box.y0 = int32_t(floor(clamp(lo.y - margin_y + half_h, 0.0f, h_limit)));
  box.x1 = int32_t(floor(clamp(hi.x + margin_x + half_w, -1.0f, w_limit - 1.0f)));
  box.y1 = int32_t(floor(clamp(hi.y + margin_y + half_h, -1.0f, h_limit - 1.0f)));
  return box.x0 <= box.x1 && box.y0 <= box.y1;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
