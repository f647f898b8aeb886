// Scattering at a surface, in the shading frame: +z is the shading normal.
//
// All materials but glass reflect alone and act on both sides: the caller turns the frame so that wo.z > 0.
#pragma once

#include "core/path/warp.h"
#include "core/scene/scene_view.h"

namespace gpurt {

struct Bsdf {
  MaterialType type;
  Vec3f color;      // albedo, or F0
  float alpha_ggx;  // Metal
  float eta;        // Glass: index of the side where light goes over that of wo's side
};

struct BsdfSample {
  Vec3f wi;
  Vec3f weight;  // f |cos| / pdf
  float pdf;     // solid angle; 0: a delta direction
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE bool is_delta(const Bsdf &b)
{
  return b.type == MaterialType::Mirror || b.type == MaterialType::Glass;
}

// Reflectance of a smooth dielectric for unpolarised light, exact. cos_i >= 0; cos_t is 0 for total reflection.
GPURT_INLINE float fresnel_dielectric(float cos_i, float eta, float &cos_t)
{
  const float sin2_t = (1.0f - cos_i * cos_i) / (eta * eta);
  cos_t = 0.0f;
  if (sin2_t >= 1.0f) return 1.0f;
  cos_t = sqrt(1.0f - sin2_t);
  const float parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
  const float perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
  return 0.5f * (parallel * parallel + perpendicular * perpendicular);
}

GPURT_INLINE Vec3f fresnel_schlick(Vec3f f0, float cos_i)
{
  const float m = clamp(1.0f - cos_i, 0.0f, 1.0f);
  const float m2 = m * m;
  return f0 + (vec3(1.0f) - f0) * (m2 * m2 * m);
}

// Source: Walter et al. 2007, Eq. 33 for D and Eq. 34 for G1 (GGX), in forms without tangents.
GPURT_INLINE float ggx_distribution(float cos_h, float alpha)
{
  const float a2 = alpha * alpha;
  const float c2 = cos_h * cos_h;
  // c^2 a^2 + (1 - c^2), written so that small a lose nothing near c = 1.
  const float k = fma(c2, a2, (1.0f - cos_h) * (1.0f + cos_h));
  return a2 / (pi * k * k);
}
GPURT_INLINE float ggx_masking(float cos_v, float alpha)
{
  const float a2 = alpha * alpha;
  return 2.0f * cos_v / (cos_v + sqrt(fma(a2, (1.0f - cos_v) * (1.0f + cos_v), cos_v * cos_v)));
}

// A visible microfacet normal. Source: Dupuy and Benyoub 2023 (spherical caps).
GPURT_INLINE Vec3f sample_ggx_visible_normal(Vec3f wo, float alpha, Vec2f u)
{
  const Vec3f stretched = normalize(Vec3f{wo.x * alpha, wo.y * alpha, wo.z});
  float s, c;
  sincos_turns(u.x, s, c);
  const float z = fma(1.0f - u.y, 1.0f + stretched.z, -stretched.z);
  const float r = safe_sqrt((1.0f - z) * (1.0f + z));
  const Vec3f h = Vec3f{r * c, r * s, z} + stretched;
  return normalize(Vec3f{h.x * alpha, h.y * alpha, max(h.z, 0.0f)});
}

// f cos of a direction that is not a delta's; its pdf under sample_bsdf.
GPURT_INLINE Vec3f eval_bsdf(const Bsdf &b, Vec3f wo, Vec3f wi, float &pdf)
{
  pdf = 0.0f;
  if (wo.z <= 0.0f || wi.z <= 0.0f) return vec3(0.0f);
  if (b.type == MaterialType::Lambert) {
    pdf = wi.z * inv_pi;
    return b.color * (wi.z * inv_pi);
  }
  if (b.type == MaterialType::Metal) {
    const Vec3f h = normalize(wo + wi);
    const float d = ggx_distribution(h.z, b.alpha_ggx);
    const float g1_o = ggx_masking(wo.z, b.alpha_ggx), g1_i = ggx_masking(wi.z, b.alpha_ggx);
    pdf = d * g1_o / (4.0f * wo.z);
    return fresnel_schlick(b.color, dot(wo, h)) * (pdf * g1_i);
  }
  return vec3(0.0f);
}

// Draws a direction; false if light ends here. `choice` picks the lobe, `u` the direction.
GPURT_INLINE bool sample_bsdf(const Bsdf &b, Vec3f wo, float choice, Vec2f u, BsdfSample &s)
{
  if (b.type == MaterialType::Lambert) {
    s.wi = sample_cosine_hemisphere(u);
    s.pdf = s.wi.z * inv_pi;
    s.weight = b.color;
    return wo.z > 0.0f && s.wi.z > 0.0f;
  }
  if (b.type == MaterialType::Mirror) {
    s.wi = {-wo.x, -wo.y, wo.z};
    s.pdf = 0.0f;
    s.weight = b.color;
    return wo.z > 0.0f;
  }
  if (b.type == MaterialType::Metal) {
    if (wo.z <= 0.0f) return false;
    const Vec3f h = sample_ggx_visible_normal(wo, b.alpha_ggx, u);
    const float cos_h = dot(wo, h);
    s.wi = h * (2.0f * cos_h) - wo;
    if (s.wi.z <= 0.0f) return false;
    s.pdf = ggx_distribution(h.z, b.alpha_ggx) * ggx_masking(wo.z, b.alpha_ggx) / (4.0f * wo.z);
    s.weight = fresnel_schlick(b.color, cos_h) * ggx_masking(s.wi.z, b.alpha_ggx);
    return s.pdf > 0.0f && is_finite(s.pdf);
  }
  // Glass: reflect or refract by the Fresnel reflectance; radiance shrinks with the squared index ratio as it enters.
  float cos_t;
  const float reflectance = fresnel_dielectric(wo.z, b.eta, cos_t);
  s.pdf = 0.0f;
  if (choice < reflectance) {
    s.wi = {-wo.x, -wo.y, wo.z};
    s.weight = vec3(1.0f);
  } else {
    const float inv_eta = 1.0f / b.eta;
    s.wi = {-wo.x * inv_eta, -wo.y * inv_eta, -cos_t};
    s.weight = b.color * (inv_eta * inv_eta);
  }
  return true;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
