// Texture lookups: bilinear or nearest, without mipmaps, the same bits on every backend (no texture units).
#pragma once

#include "core/math/functions.h"
#include "core/scene/scene_view.h"

namespace gpurt {

struct Texel {
  float r, g, b, a;
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE uint32_t wrap_texel(int64_t i, uint32_t size, Wrap wrap)
{
  const int64_t n = size;
  if (wrap == Wrap::Clamp) return uint32_t(i < 0 ? 0 : (i >= n ? n - 1 : i));
  const int64_t period = wrap == Wrap::Mirror ? 2 * n : n;
  int64_t m = i % period;
  if (m < 0) m += period;
  return uint32_t(m < n ? m : period - 1 - m);
}

GPURT_INLINE Texel fetch_texel(const Texture &t, uint32_t x, uint32_t y)
{
  const size_t i = (size_t(y) * t.width + x) * 4;
  if (t.format == TexelFormat::Rgba32f) {
    const float *p = static_cast<const float *>(t.texels) + i;
    return {p[0], p[1], p[2], p[3]};
  }
  const uint8_t *p = static_cast<const uint8_t *>(t.texels) + i;
  const float a = p[3] / 255.0f;
  if (t.format == TexelFormat::Rgba8Linear) return {p[0] / 255.0f, p[1] / 255.0f, p[2] / 255.0f, a};
  return {linear_from_srgb8(p[0]), linear_from_srgb8(p[1]), linear_from_srgb8(p[2]), a};
}

GPURT_INLINE Texel lerp(Texel p, Texel q, float t)
{
  return {fma(t, q.r - p.r, p.r), fma(t, q.g - p.g, p.g), fma(t, q.b - p.b, p.b), fma(t, q.a - p.a, p.a)};
}

// Coordinates beyond +-2^31 texels have lost their fraction anyway; they are read as texel 0, as are NaNs.
GPURT_INLINE Texel sample_texture(const Texture &t, Vec2f uv)
{
  float x = uv.x * float(t.width);
  float y = uv.y * float(t.height);
  if (!(abs(x) < 0x1p31f)) x = 0.0f;
  if (!(abs(y) < 0x1p31f)) y = 0.0f;
  if (t.nearest) {
    return fetch_texel(t, wrap_texel(int64_t(floor(x)), t.width, t.wrap_u),
                       wrap_texel(int64_t(floor(y)), t.height, t.wrap_v));
  }
  x -= 0.5f;
  y -= 0.5f;
  const float fx = floor(x), fy = floor(y);
  const int64_t ix = int64_t(fx), iy = int64_t(fy);
  const uint32_t x0 = wrap_texel(ix, t.width, t.wrap_u), x1 = wrap_texel(ix + 1, t.width, t.wrap_u);
  const uint32_t y0 = wrap_texel(iy, t.height, t.wrap_v), y1 = wrap_texel(iy + 1, t.height, t.wrap_v);
  return lerp(lerp(fetch_texel(t, x0, y0), fetch_texel(t, x1, y0), x - fx),
              lerp(fetch_texel(t, x0, y1), fetch_texel(t, x1, y1), x - fx), y - fy);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
