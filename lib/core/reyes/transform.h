// Stage 'transform': from the world to homogeneous raster coordinates.
//
// (x, y, w) is linear in world space, so that patches stay Bezier patches: x / w and y / w are pixels from the image's
// centre, w is the distance from the camera's plane. Points with w <= 0 are behind the eye.
#pragma once

#include "core/reyes/reyes_scene.h"

namespace gpurt {

struct RasterPoint {
  float x, y, w;
};

struct RasterProjection {
  Vec3f eye;
  Vec3f row[3];              // of x, y and w
  float centre_x, centre_y;  // of the image, in raster units
};

// Fixed-point raster units a pixel. Vertices and samples lie on whole units, so that coverage is exact.
constexpr float units_per_pixel = 256.0f;
constexpr int unit_bits = 8;

// A patch in homogeneous raster coordinates: control point 4 * row + column.
struct RasterPatch {
  float x[16], y[16], w[16];
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE RasterProjection raster_projection(const Camera &camera)
{
  const Transform &m = camera.camera_to_world;
  const float scale = float(camera.height) / (2.0f * camera.tan_half_yfov);
  RasterProjection p;
  p.eye = {m.m[0][3], m.m[1][3], m.m[2][3]};
  p.row[0] = Vec3f{m.m[0][0], m.m[1][0], m.m[2][0]} * scale;
  p.row[1] = Vec3f{m.m[0][1], m.m[1][1], m.m[2][1]} * -scale;
  p.row[2] = -Vec3f{m.m[0][2], m.m[1][2], m.m[2][2]};
  p.centre_x = 0.5f * float(camera.width) * units_per_pixel;
  p.centre_y = 0.5f * float(camera.height) * units_per_pixel;
  return p;
}

GPURT_INLINE RasterPoint to_raster(const RasterProjection &p, Vec3f world)
{
  const Vec3f d = world - p.eye;
  return {dot(p.row[0], d), dot(p.row[1], d), dot(p.row[2], d)};
}

// Which root range a root belongs to.
GPURT_HD inline RootRange range_of_root(const ReyesScene &s, uint64_t root)
{
  uint32_t lo = 0, hi = s.num_ranges;
  while (hi - lo > 1) {
    const uint32_t mid = lo + (hi - lo) / 2;
    if (s.ranges[mid].first_root <= root) lo = mid;
    else hi = mid;
  }
  return s.ranges[lo];
}

GPURT_INLINE RasterPoint transform_to_raster(const ReyesScene &s, const RasterProjection &projection,
                                             uint32_t placement, Vec3f p)
{
  if (placement != invalid_id) p = transform_point(s.scene.placements[placement].object_to_world, p);
  return to_raster(projection, p);
}

GPURT_HD inline void transform_patch(const ReyesScene &s, const RasterProjection &projection,
                                     const RootRange &range, uint32_t patch, RasterPatch &out)
{
  const Vec3f *points = s.control_points + size_t(s.patches[range.segment].first_patch + patch) * 16;
  for (int k = 0; k < 16; ++k) {
    const RasterPoint p = transform_to_raster(s, projection, range.placement, points[k]);
    out.x[k] = p.x;
    out.y[k] = p.y;
    out.w[k] = p.w;
  }
}

GPURT_HD inline void transform_triangle(const ReyesScene &s, const RasterProjection &projection,
                                        const RootRange &range, uint32_t triangle, RasterPoint (&out)[3])
{
  const UInt3 corner = s.scene.indices[triangle];
  out[0] = transform_to_raster(s, projection, range.placement, s.scene.positions[corner.x]);
  out[1] = transform_to_raster(s, projection, range.placement, s.scene.positions[corner.y]);
  out[2] = transform_to_raster(s, projection, range.placement, s.scene.positions[corner.z]);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
