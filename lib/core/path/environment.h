// Light from infinity: lookup and importance sampling of a lat-long image.
#pragma once

#include "core/scene/texture.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

GPURT_INLINE Vec2f environment_uv(Vec3f w, float &sin_theta)
{
  sin_theta = sqrt(fma(w.x, w.x, w.z * w.z));
  const float turn = atan2(w.x, -w.z) * (0.5f * inv_pi);
  return {turn < 0.0f ? turn + 1.0f : turn, acos_from_sincos(sin_theta, w.y) * inv_pi};
}

// Radiance that arrives along -w; w is a unit vector.
GPURT_INLINE Vec3f environment_radiance(const SceneView &scene, Vec3f w)
{
  const Environment &e = scene.environment;
  if (e.texture == invalid_id) return e.radiance;
  float sin_theta;
  const Texel t = sample_texture(scene.textures[e.texture], environment_uv(w, sin_theta));
  return e.radiance * Vec3f{t.r, t.g, t.b};
}

// A constant environment is left to the BSDF's own directions, which fit it better than any table.
GPURT_INLINE bool samples_environment(const Environment &e) { return e.row_cdf != nullptr; }

// The last i with cdf[i] <= x, for x in [0, 1), so that cdf[i + 1] > x.
GPURT_INLINE uint32_t find_interval(const float *cdf, uint32_t n, float x)
{
  uint32_t lo = 0, hi = n;
  while (hi - lo > 1) {
    const uint32_t mid = (lo + hi) / 2;
    if (cdf[mid] <= x) lo = mid;
    else hi = mid;
  }
  return lo;
}

GPURT_INLINE float environment_cell_pdf(const Environment &e, uint32_t row, uint32_t column, float sin_theta)
{
  const float *columns = e.column_cdf + size_t(row) * (e.width + 1);
  const float p = (e.row_cdf[row + 1] - e.row_cdf[row]) * float(e.height) *
                  (columns[column + 1] - columns[column]) * float(e.width);
  return sin_theta > 0.0f ? p / (2.0f * pi * pi * sin_theta) : 0.0f;
}

// Solid-angle density of sample_environment for direction w.
GPURT_INLINE float environment_pdf(const Environment &e, Vec3f w)
{
  float sin_theta;
  const Vec2f uv = environment_uv(w, sin_theta);
  const uint32_t row = min(uint32_t(uv.y * float(e.height)), e.height - 1);
  const uint32_t column = min(uint32_t(uv.x * float(e.width)), e.width - 1);
  return environment_cell_pdf(e, row, column, sin_theta);
}

GPURT_INLINE Vec3f sample_environment(const Environment &e, Vec2f u, float &pdf)
{
  const uint32_t row = find_interval(e.row_cdf, e.height, u.y);
  const float row_width = e.row_cdf[row + 1] - e.row_cdf[row];
  const float v = (float(row) + (u.y - e.row_cdf[row]) / row_width) / float(e.height);
  const float *columns = e.column_cdf + size_t(row) * (e.width + 1);
  const uint32_t column = find_interval(columns, e.width, u.x);
  const float column_width = columns[column + 1] - columns[column];
  const float turn = (float(column) + (u.x - columns[column]) / column_width) / float(e.width);
  float sin_theta, cos_theta, sin_phi, cos_phi;
  sincos_turns(0.5f * v, sin_theta, cos_theta);
  sincos_turns(turn, sin_phi, cos_phi);
  pdf = row_width > 0.0f && column_width > 0.0f ? environment_cell_pdf(e, row, column, sin_theta) : 0.0f;
  return {sin_theta * sin_phi, cos_theta, -sin_theta * cos_phi};
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
