// Stage 'shade' of micropolygons: the surface's light in the middle of each of them, or of each block of 2 x 2.
//
// The point is a function of the patch and of whole-numbered parameters, its light one of that point, the camera and the
// scene's lights: whatever tile, batch or thread comes across a micropolygon finds the same. Position and normal are those of
// the patch in raster coordinates, which are linear in the world.
#pragma once

#include "core/fixed_sum.h"
#include "core/path/bsdf.h"
#include "core/path/lights.h"
#include "core/random/sobol.h"
#include "core/reyes/split.h"

namespace gpurt {

// What light of a micropolygon's own depends on beside the scene.
struct OwnLight {
  Vec3f eye;
  Vec3f row[3];         // raster coordinates of a vector, as in RasterProjection
  Vec3f axis[3];        // the vector whose raster coordinate is 1, and the others 0
  uint32_t block_bits;  // log2 of the micropolygons along an edge of what is shaded at once
  uint32_t is_lit;      // 0: direct light is beyond the frame's depth
};

// For each column of a grid's points that are shaded: control points along v of x, y and w, and of their slopes along u.
struct ShadingColumns {
  float value[3][4][max_segments], slope[3][4][max_segments];
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE OwnLight own_light(const RasterProjection &projection, uint32_t block_bits, bool is_lit)
{
  const Vec3f(&row)[3] = projection.row;
  const Vec3f a = cross(row[1], row[2]), b = cross(row[2], row[0]), c = cross(row[0], row[1]);
  const float scale = 1.0f / dot(row[0], a);
  return {projection.eye,
          {row[0], row[1], row[2]},
          {a * scale, b * scale, c * scale},
          block_bits,
          is_lit ? 1u : 0u};
}

// log2 of the points that are shaded along a side of 2^bits micropolygons.
GPURT_INLINE uint32_t shaded_bits(uint32_t bits, uint32_t block_bits)
{
  return bits > block_bits ? bits - block_bits : 0;
}

// The parameter in the middle of part i of 2^bits.
GPURT_INLINE uint32_t middle_of_part(uint32_t lower_end, uint32_t range_bits, uint32_t bits, uint32_t i)
{
  return lower_end + ((2 * i + 1) << (range_bits - bits - 1));
}

GPURT_INLINE float fused_cubic(const CubicWeights &c, float p0, float p1, float p2, float p3)
{
  return fma(c.w0, p0, fma(c.w1, p1, fma(c.w2, p2, c.w3 * p3)));
}

// Derivatives of the weights.
GPURT_INLINE CubicWeights cubic_slopes(uint32_t k)
{
  const float a = parameter(parameter_one - k), b = parameter(k);
  return {-3.0f * a * a, 3.0f * a * (a - 2.0f * b), 3.0f * b * (2.0f * a - b), 3.0f * b * b};
}

// Row r of column i, at parameter k.
GPURT_INLINE void make_shading_column(const RasterPatch &patch, uint32_t k, uint32_t i, uint32_t r,
                                      ShadingColumns &g)
{
  const CubicWeights u = cubic_weights(k), du = cubic_slopes(k);
  const float *const from[3] = {patch.x + 4 * r, patch.y + 4 * r, patch.w + 4 * r};
  for (int c = 0; c < 3; ++c) {
    const float *p = from[c];
    g.value[c][r][i] = fused_cubic(u, p[0], p[1], p[2], p[3]);
    g.slope[c][r][i] = fused_cubic(du, p[0], p[1], p[2], p[3]);
  }
}

// Light of points, spots and distant lights, all of them, that a surface sends along wo.
GPURT_HD inline Vec3f direct_light(const SceneView &scene, const Bsdf &bsdf, Vec3f p, Vec3f normal,
                                   Vec3f wo_world)
{
  Vec3f s, t;
  make_frame(normal, s, t);
  const Vec3f wo{dot(wo_world, s), dot(wo_world, t), dot(wo_world, normal)};
  Vec3f sum = vec3(0.0f);
  const uint32_t num_lights = scene.num_tree_lights + scene.num_distant_lights;
  for (uint32_t i = 0; i < num_lights; ++i) {
    const Light &light = scene.lights[i];
    Vec3f wi_world, radiance = light.color;
    if (light.type == LightType::Distant) wi_world = -light.direction;
    else {
      const Vec3f to_light = light.position - p;
      const float distance2 = length2(to_light);
      if (!(distance2 > 0.0f)) continue;
      wi_world = to_light * (1.0f / sqrt(distance2));
      radiance *= 1.0f / distance2;
      if (light.type == LightType::Spot) radiance *= spot_falloff(light, -wi_world);
    }
    const Vec3f wi{dot(wi_world, s), dot(wi_world, t), dot(wi_world, normal)};
    float pdf;
    sum += eval_bsdf(bsdf, wo, wi, pdf) * radiance;
  }
  return sum;
}

// Light is kept in 32 bits: 6 of an exponent, 9 of red and green, 8 of blue. Rounding goes up or down by `noise` with
// probabilities that leave the mean as it is.
constexpr uint32_t unusable_light = 0xffffffffu;  // not finite, or beyond the film's range
constexpr int light_exponent_bias = 41;

GPURT_INLINE uint32_t pack_light(Vec3f light, uint64_t noise)
{
  const float largest = max_component(light);
  if (!(largest <= fixed_sum_limit) || !is_finite(light)) return unusable_light;
  // In units of which the largest component has 256 to 510: rounding up stays within 9 bits.
  int exponent = max(int(float_bits(largest) >> 23) - 127 - 8, -light_exponent_bias);
  float scale = float_from_bits(uint32_t(127 - exponent) << 23);
  if (largest * scale > 510.0f) {
    ++exponent;
    scale *= 0.5f;
  }
  const auto rounded = [](float x, uint64_t bits) {
    return uint32_t(floor(x + float(uint32_t(bits) & 0x7ffu) * 0x1p-11f));
  };
  return uint32_t(exponent + light_exponent_bias) << 26 | rounded(light.x * scale, noise) << 17 |
         rounded(light.y * scale, noise >> 11) << 8 | rounded(light.z * (0.5f * scale), noise >> 22);
}

GPURT_INLINE Vec3f unpack_light(uint32_t bits)
{
  if (bits == unusable_light) return vec3(infinity);
  const float scale = float_from_bits(((bits >> 26) + (127 - light_exponent_bias)) << 23);
  return {float(bits >> 17 & 0x1ffu) * scale, float(bits >> 8 & 0x1ffu) * scale,
          float(bits & 0xffu) * (2.0f * scale)};
}

// The packed light of the point (ku, kv) of a patch, which lies in column i.
GPURT_HD inline uint32_t shade_point(const SceneView &scene, const Material &material, const OwnLight &own,
                                     const ShadingColumns &g, uint32_t root, uint32_t i, uint32_t ku,
                                     uint32_t kv)
{
  Vec3f light = vec3(0.0f);
  const CubicWeights v = cubic_weights(kv), dv = cubic_slopes(kv);
  const auto value = [&](const CubicWeights &c, int a) {
    return fused_cubic(c, g.value[a][0][i], g.value[a][1][i], g.value[a][2][i], g.value[a][3][i]);
  };
  const auto slope = [&](int a) {
    return fused_cubic(v, g.slope[a][0][i], g.slope[a][1][i], g.slope[a][2][i], g.slope[a][3][i]);
  };
  const Vec3f p{value(v, 0), value(v, 1), value(v, 2)};
  const Vec3f from_eye = own.axis[0] * p.x + own.axis[1] * p.y + own.axis[2] * p.z;
  // Normals go back by the transpose.
  const Vec3f n = cross(Vec3f{slope(0), slope(1), slope(2)}, Vec3f{value(dv, 0), value(dv, 1), value(dv, 2)});
  Vec3f normal = own.row[0] * n.x + own.row[1] * n.y + own.row[2] * n.z;
  Bsdf bsdf{material.type, vec3(0.0f), material.alpha_ggx, material.ior};
  // Where the surface shrinks to a curve nothing is covered, nor lit.
  if (own.is_lit && !is_delta(bsdf) && max_component(abs(normal)) > 0.0f) {
    const Vec3f wo = -normalize(from_eye);
    normal = normalize_any_scale(normal);
    if (dot(normal, wo) < 0.0f) normal = -normal;
    bsdf.color = base_color(scene, material, {parameter(ku), parameter(kv)});
    light = direct_light(scene, bsdf, own.eye + from_eye, normal, wo);
  }
  return pack_light(light, mix_bits((uint64_t(root) + 1) * 0x9e3779b97f4a7c15u + (uint64_t(ku) << 32 | kv)));
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
