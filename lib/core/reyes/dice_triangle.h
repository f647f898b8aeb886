// Stage 'dice' of triangles of meshes, where micropolygons have light of their own.
//
// A triangle is flat: it is sampled as it is, and micropolygons of it would cover what it covers. They are wanted for light
// alone, after visibility: the micropolygon in which a place lies, by cutting the triangle in four at the middles of its edges,
// again and again, until the part with the place is small enough on the image. That depends on the triangle, the camera and
// the shading rate alone, so that all samples within a micropolygon find the same one; and near parts of a large
// triangle are cut more often than far ones. Its light is that of its centroid, flat or with the mesh's interpolated normal.
#pragma once

#include "core/reyes/dice.h"

namespace gpurt {

// Places are exact for so many cuts: 2^-20 of the triangle's edges.
constexpr uint32_t most_triangle_cuts = 20;

GPURT_FUNCTIONS_BEGIN

// The longest edge, squared, that a micropolygon of a triangle has. With equilateral ones, of area sqrt(3) / 4 of that, their
// areas lie between a half and twice what the rate says, and blocks take four as large.
GPURT_INLINE float largest_edge2(float shading_rate, uint32_t block_bits)
{
  return 4.6188f * shading_rate * float(1u << (2 * block_bits));
}

// Whether a part of a triangle needs no cut; what reaches behind the eye has no size.
GPURT_INLINE bool is_micropolygon(const RasterPoint (&p)[3], float edge2)
{
  if (!(min(p[0].w, min(p[1].w, p[2].w)) >= smallest_w)) return false;
  float x[3], y[3];
  for (int k = 0; k < 3; ++k) {
    const float inv_w = 1.0f / p[k].w;
    x[k] = p[k].x * inv_w;
    y[k] = p[k].y * inv_w;
  }
  for (int k = 0; k < 3; ++k) {
    const float dx = x[(k + 1) % 3] - x[k], dy = y[(k + 1) % 3] - y[k];
    if (!(dx * dx + dy * dy <= edge2)) return false;
  }
  return true;
}

GPURT_INLINE RasterPoint middle_between(const RasterPoint &a, const RasterPoint &b)
{
  return {0.5f * (a.x + b.x), 0.5f * (a.y + b.y), 0.5f * (a.w + b.w)};
}

// The centroid of the micropolygon in which a place lies: weights of the triangle's second and third corner.
GPURT_HD inline Vec2f middle_of_micropolygon(const RasterPoint (&triangle)[3], Vec2f at, float edge2)
{
  RasterPoint p[3] = {triangle[0], triangle[1], triangle[2]};
  // Corners of the part: first, first + (step, 0), first + (0, step). The middle one of four is turned about: its step is negative.
  Vec2f first{0.0f, 0.0f};
  float step = 1.0f;
  for (uint32_t cut = 0; cut < most_triangle_cuts && !is_micropolygon(p, edge2); ++cut) {
    const RasterPoint m01 = middle_between(p[0], p[1]), m02 = middle_between(p[0], p[2]),
                      m12 = middle_between(p[1], p[2]);
    const float sign = step < 0.0f ? -1.0f : 1.0f, half = 0.5f * step;
    const float u = (at.x - first.x) * sign, v = (at.y - first.y) * sign, size = half * sign;
    if (u >= size) {
      first.x += half;
      p[0] = m01;
      p[2] = m12;
    } else if (v >= size) {
      first.y += half;
      p[0] = m02;
      p[1] = m12;
    } else if (u + v <= size) {
      p[1] = m01;
      p[2] = m02;
    } else {
      first = {first.x + half, first.y + half};
      p[0] = m12;
      p[1] = m02;
      p[2] = m01;
      step = -half;
      continue;
    }
    step = half;
  }
  return {first.x + step * (1.0f / 3.0f), first.y + step * (1.0f / 3.0f)};
}

// What a sample keeps of what it sees: of a patch's micropolygon its middle already, of a mesh's triangle where on it.
GPURT_HD inline Vec2f diced_place(const ReyesScene &s, const RasterProjection &projection, uint32_t root,
                                  Vec2f at, float edge2)
{
  const RootRange range = range_of_root(s, root);
  if (s.patches[range.segment].num_patches != 0) return at;
  RasterPoint corner[3];
  transform_triangle(s, projection, range,
                     s.scene.segments[range.segment].first_triangle + uint32_t(root - range.first_root),
                     corner);
  return middle_of_micropolygon(corner, at, edge2);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
