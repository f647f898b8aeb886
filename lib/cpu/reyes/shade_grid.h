// The light of all micropolygons of a piece's grid, or of its blocks: a row of eight at a time where that is all there is to
// it, with the bits of shade_point.
#pragma once

#include "core/reyes/shade.h"
#include "cpu/reyes/grid_light.h"
#include "cpu/reyes/lanes.h"

namespace gpurt {

GPURT_FUNCTIONS_BEGIN
namespace {

// Lights whose light takes no look at anything else.
bool has_plain_lights(const SceneView &scene)
{
  for (uint32_t i = 0; i < scene.num_tree_lights + scene.num_distant_lights; ++i) {
    const LightType type = scene.lights[i].type;
    if (type != LightType::Point && type != LightType::Spot && type != LightType::Distant) return false;
  }
  return true;
}

bool is_plain(const Material &material)
{
  return material.base_color_texture == invalid_id &&
         (material.type == MaterialType::Lambert || material.type == MaterialType::Metal);
}

struct WeightLanes {
  FloatLanes w0, w1, w2, w3;
};

GPURT_INLINE FloatLanes fused_cubic(const WeightLanes &c, const FloatLanes p0, FloatLanes p1, FloatLanes p2,
                                    FloatLanes p3)
{
  return fma(c.w0, p0, fma(c.w1, p1, fma(c.w2, p2, c.w3 * p3)));
}

GPURT_INLINE WeightLanes weight_lanes(const CubicWeights &c)
{
  return {lanes(c.w0), lanes(c.w1), lanes(c.w2), lanes(c.w3)};
}

// As make_shading_column, of columns i .. i + 7.
GPURT_INLINE void make_shading_columns(const RasterPatch &patch, const int32_t (&ku)[max_segments],
                                       uint32_t i, ShadingColumns &g)
{
  IntLanes k;
  __builtin_memcpy(&k, ku + i, sizeof k);
  const float unit = 1.0f / float(parameter_one);
  const FloatLanes a = float_lanes(int32_t(parameter_one) - k) * unit, b = float_lanes(k) * unit;
  const WeightLanes u{a * a * a, 3.0f * (a * a * b), 3.0f * (b * b * a), b * b * b};
  const WeightLanes du{-3.0f * a * a, 3.0f * a * (a - 2.0f * b), 3.0f * b * (2.0f * a - b), 3.0f * b * b};
  const float *const from[3] = {patch.x, patch.y, patch.w};
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 4; ++r) {
      const float *p = from[c] + 4 * r;
      const FloatLanes p0 = lanes(p[0]), p1 = lanes(p[1]), p2 = lanes(p[2]), p3 = lanes(p[3]);
      store_lanes(g.value[c][r] + i, fused_cubic(u, p0, p1, p2, p3));
      store_lanes(g.slope[c][r] + i, fused_cubic(du, p0, p1, p2, p3));
    }
  }
}

GPURT_INLINE FloatLanes ggx_distribution(FloatLanes cos_h, float alpha)
{
  const float a2 = alpha * alpha;
  const FloatLanes k = fma(cos_h * cos_h, lanes(a2), (1.0f - cos_h) * (1.0f + cos_h));
  return a2 / (pi * k * k);
}
GPURT_INLINE FloatLanes ggx_masking(FloatLanes cos_v, float alpha)
{
  const float a2 = alpha * alpha;
  return 2.0f * cos_v / (cos_v + sqrt(fma(lanes(a2), (1.0f - cos_v) * (1.0f + cos_v), cos_v * cos_v)));
}

// As eval_bsdf, of plain materials.
GPURT_INLINE Vec3Lanes eval_bsdf(const Bsdf &b, Vec3Lanes wo, Vec3Lanes wi)
{
  const IntLanes is_dark = (wo.z <= 0.0f) | (wi.z <= 0.0f);
  Vec3Lanes f;
  if (b.type == MaterialType::Lambert) f = lanes(b.color) * (wi.z * inv_pi);
  else {
    const Vec3Lanes h = normalize(wo + wi);
    const FloatLanes d = ggx_distribution(h.z, b.alpha_ggx);
    const FloatLanes g1_o = ggx_masking(wo.z, b.alpha_ggx), g1_i = ggx_masking(wi.z, b.alpha_ggx);
    const FloatLanes pdf = d * g1_o / (4.0f * wo.z);
    const FloatLanes m = clamp(1.0f - dot(wo, h), 0.0f, 1.0f), m2 = m * m;
    f = (lanes(b.color) + lanes(vec3(1.0f) - b.color) * (m2 * m2 * m)) * (pdf * g1_i);
  }
  return select(is_dark, lanes(vec3(0.0f)), f);
}

GPURT_INLINE Vec3Lanes direct_light(const SceneView &scene, const Bsdf &bsdf, Vec3Lanes p, Vec3Lanes normal,
                                    Vec3Lanes wo_world)
{
  Vec3Lanes s, t;
  make_frame(normal, s, t);
  const Vec3Lanes wo{dot(wo_world, s), dot(wo_world, t), dot(wo_world, normal)};
  Vec3Lanes sum = lanes(vec3(0.0f));
  const uint32_t num_lights = scene.num_tree_lights + scene.num_distant_lights;
  for (uint32_t i = 0; i < num_lights; ++i) {
    const Light &light = scene.lights[i];
    Vec3Lanes wi_world, radiance = lanes(light.color);
    IntLanes is_apart = IntLanes{} == 0;
    if (light.type == LightType::Distant) wi_world = lanes(-light.direction);
    else {
      const Vec3Lanes to_light = lanes(light.position) - p;
      const FloatLanes distance2 = dot(to_light, to_light);
      is_apart = distance2 > 0.0f;
      wi_world = to_light * (1.0f / sqrt(distance2));
      radiance = radiance * (1.0f / distance2);
      if (light.type == LightType::Spot) {
        const FloatLanes cos_angle = dot(lanes(light.direction), -wi_world);
        const FloatLanes x =
            clamp((cos_angle - light.cos_outer) / max(0.001f, light.cos_inner - light.cos_outer), 0.0f, 1.0f);
        radiance = radiance * (x * x);
      }
    }
    const Vec3Lanes wi{dot(wi_world, s), dot(wi_world, t), dot(wi_world, normal)};
    sum = select(is_apart, sum + eval_bsdf(bsdf, wo, wi) * radiance, sum);
  }
  return sum;
}

GPURT_INLINE UintLanes pack_light(Vec3Lanes light, UintLanes noise_x, UintLanes noise_y, UintLanes noise_z)
{
  const FloatLanes largest = max_component(light);
  const auto is_finite = [](FloatLanes v) { return (bits_of(v) & 0x7f800000u) != 0x7f800000u; };
  const IntLanes is_usable =
      (largest <= fixed_sum_limit) & is_finite(light.x) & is_finite(light.y) & is_finite(light.z);
  IntLanes exponent = (IntLanes)(bits_of(largest) >> 23) - (127 + 8);
  exponent = exponent < -light_exponent_bias ? -light_exponent_bias + IntLanes{} : exponent;
  FloatLanes scale = lanes_from_bits((UintLanes)(127 - exponent) << 23);
  const IntLanes is_beyond = largest * scale > 510.0f;
  exponent -= is_beyond;
  scale = is_beyond ? scale * 0.5f : scale;
  const auto rounded = [](FloatLanes x, UintLanes noise) {
    return (UintLanes)int_lanes(floor(x + float_lanes((IntLanes)noise) * 0x1p-11f));
  };
  const UintLanes packed = (UintLanes)(exponent + light_exponent_bias) << 26 |
                           rounded(light.x * scale, noise_x) << 17 | rounded(light.y * scale, noise_y) << 8 |
                           rounded(light.z * (0.5f * scale), noise_z);
  return is_usable ? packed : lanes(unusable_light);
}

// As shade_point, of columns i .. i + 7, for plain materials and lights.
GPURT_INLINE UintLanes shade_points(const SceneView &scene, const Material &material, const OwnLight &own,
                                    const ShadingColumns &g, uint32_t root, uint32_t i,
                                    const int32_t (&ku)[max_segments], uint32_t kv)
{
  const WeightLanes v = weight_lanes(cubic_weights(kv)), dv = weight_lanes(cubic_slopes(kv));
  const auto along_v = [&](const WeightLanes &c, const float(&from)[4][max_segments]) {
    return fused_cubic(c, load_lanes(from[0] + i), load_lanes(from[1] + i), load_lanes(from[2] + i),
                       load_lanes(from[3] + i));
  };
  const Vec3Lanes p{along_v(v, g.value[0]), along_v(v, g.value[1]), along_v(v, g.value[2])};
  const Vec3Lanes from_eye = lanes(own.axis[0]) * p.x + lanes(own.axis[1]) * p.y + lanes(own.axis[2]) * p.z;
  const Vec3Lanes n =
      cross(Vec3Lanes{along_v(v, g.slope[0]), along_v(v, g.slope[1]), along_v(v, g.slope[2])},
            Vec3Lanes{along_v(dv, g.value[0]), along_v(dv, g.value[1]), along_v(dv, g.value[2])});
  Vec3Lanes normal = lanes(own.row[0]) * n.x + lanes(own.row[1]) * n.y + lanes(own.row[2]) * n.z;
  Vec3Lanes light = lanes(vec3(0.0f));
  if (own.is_lit) {
    const IntLanes has_normal = max_component(abs(normal)) > 0.0f;
    const Vec3Lanes wo = -normalize(from_eye);
    normal = normalize_any_scale(normal);
    normal = select(dot(normal, wo) < 0.0f, -normal, normal);
    const Bsdf bsdf{material.type, material.base_color, material.alpha_ggx, material.ior};
    light = select(has_normal, direct_light(scene, bsdf, lanes(own.eye) + from_eye, normal, wo), light);
  }
  UintLanes noise[3];
  for (uint32_t k = 0; k < num_lanes; ++k) {
    const uint64_t bits =
        mix_bits((uint64_t(root) + 1) * 0x9e3779b97f4a7c15u + (uint64_t(uint32_t(ku[i + k])) << 32 | kv));
    noise[0][k] = uint32_t(bits) & 0x7ffu;
    noise[1][k] = uint32_t(bits >> 11) & 0x7ffu;
    noise[2][k] = uint32_t(bits >> 22) & 0x7ffu;
  }
  return pack_light(light, noise[0], noise[1], noise[2]);
}

// `has_plain`: has_plain_lights of the scene.
void shade_grid(const SceneView &scene, bool has_plain, const Material &material, const OwnLight &own,
                const RasterPatch &patch, const Piece &p, uint32_t root, GridLight &light)
{
  const uint32_t bits_u = shaded_bits(p.grid_u, own.block_bits),
                 bits_v = shaded_bits(p.grid_v, own.block_bits), num_u = 1u << bits_u;
  light.shift_u = p.grid_u - bits_u;
  light.shift_v = p.grid_v - bits_v;
  light.bits_u = bits_u;
  ShadingColumns columns;
  if (has_plain && is_plain(material)) {
    int32_t ku[max_segments];
    // Lanes beyond a row repeat its end.
    for (uint32_t i = 0; i < max_segments; ++i)
      ku[i] = int32_t(middle_of_part(p.u, p.u_bits, bits_u, min(i, num_u - 1)));
    for (uint32_t i = 0; i < num_u; i += num_lanes) make_shading_columns(patch, ku, i, columns);
    // What a short row writes beyond its end the next one writes again.
    for (uint32_t j = 0; j < 1u << bits_v; ++j) {
      const uint32_t kv = middle_of_part(p.v, p.v_bits, bits_v, j);
      for (uint32_t i = 0; i < num_u; i += num_lanes) {
        store_lanes(light.packed + (j << bits_u) + i,
                    shade_points(scene, material, own, columns, root, i, ku, kv));
      }
    }
    return;
  }
  for (uint32_t i = 0; i < num_u; ++i) {
    const uint32_t k = middle_of_part(p.u, p.u_bits, bits_u, i);
    for (uint32_t r = 0; r < 4; ++r) make_shading_column(patch, k, i, r, columns);
  }
  for (uint32_t j = 0; j < 1u << bits_v; ++j) {
    const uint32_t kv = middle_of_part(p.v, p.v_bits, bits_v, j);
    for (uint32_t i = 0; i < num_u; ++i) {
      light.packed[j << bits_u | i] =
          shade_point(scene, material, own, columns, root, i, middle_of_part(p.u, p.u_bits, bits_u, i), kv);
    }
  }
}

}  // namespace
GPURT_FUNCTIONS_END
}  // namespace gpurt
