// Photons as they leave the lights: which light, where, in which direction.
//
// Lights are drawn in proportion to the largest component of their power, so that photons carry the same flux but for
// their colour. The flux of a photon is counted in units of EmissionView::total_weight / photons of the pass: about 1,
// at any scale of the scene. Distant lights and the environment shine through the disc of the scene's bounding sphere.
#pragma once

#include "core/path/path_wave.h"

namespace gpurt {

// Lights are numbered as in SceneView::lights, then the environment.
struct EmissionView {
  const float *cdf;  // [num_sources + 1], 0 to 1; null if nothing shines
  uint32_t num_sources;
  float total_weight;  // watts
  Vec3f center;        // of the scene's bounding sphere
  float radius;
};

struct EmittedPhoton {
  Ray ray;
  Vec3f flux;
  uint32_t triangle;  // of the lamp; invalid_id: not of a lamp
};

// Pairs of sample dimensions of a photon path: those of emission, then those of each vertex.
enum PhotonDimension : uint32_t {
  photon_dim_light = 0,  // which light; the side of two-sided ones, and whether a dim place sends a photon
  photon_dim_position = 1,
  photon_dim_direction = 2,
  photon_dims_of_emission = 3,
  photon_dim_choice = 0,  // what glass does; roulette
  photon_dim_bsdf = 1,
  photon_dims_per_vertex = 2
};

// The pass index of the pilot that chooses the initial radius.
constexpr uint64_t pilot_pass = ~uint64_t(0);

GPURT_FUNCTIONS_BEGIN

// Passes of even and odd index have independent sequences, as the film's two halves want it; within each, photons of all
// passes are one sequence.
GPURT_INLINE SampleKey photon_key(uint64_t seed, uint32_t frame, uint64_t pass, uint32_t photons_per_pass,
                                  uint32_t photon)
{
  // "photon": another stream than the pixels'.
  const uint64_t stream = mix_bits(seed + 0x9e3779b97f4a7c15u * (uint64_t(frame) + 1)) ^ 0x70686f746f6eu;
  if (pass == pilot_pass) return {mix_bits(stream ^ pilot_pass), reverse_bits(photon)};
  // Sequences of 2^32 points; a pass lies in at most two of them.
  const uint64_t turn = pass >> 1;
  const uint64_t low = (turn & 0xffffffffu) * photons_per_pass + photon;
  const uint64_t high = (turn >> 32) * photons_per_pass + (low >> 32);
  return {mix_bits(mix_bits(stream) ^ (high << 1 | (pass & 1))), reverse_bits(uint32_t(low))};
}

// Cube root of x in [0, 1]: two steps of Halley's method from a guess that divides the exponent.
GPURT_INLINE float cube_root(float x)
{
  if (!(x > 0x1p-100f)) return 0.0f;
  float y = float_from_bits(float_bits(x) / 3 + 0x2a514067u);
  for (int i = 0; i < 2; ++i) {
    const float cube = y * y * y;
    y = y * ((cube + 2.0f * x) / (2.0f * cube + x));
  }
  return min(y, 1.0f);
}

GPURT_INLINE Vec3f sample_sphere(Vec2f u)
{
  float s, c;
  sincos_turns(u.y, s, c);
  const float z = 1.0f - 2.0f * u.x;
  const float r = safe_sqrt((1.0f - z) * (1.0f + z));
  return {r * c, r * s, z};
}

// A direction within a spot's cone, with a density in proportion to its falloff.
GPURT_INLINE Vec3f sample_spot(const Light &light, Vec2f u)
{
  const float width = max(0.001f, light.cos_inner - light.cos_outer);
  const float rim_end = min(light.cos_outer + width, 1.0f);  // where the falloff reaches 1, or the axis
  const float rim_share = (rim_end - light.cos_outer) / width;
  // Solid angles over 2 pi: of the part of full intensity, and of the rim, weighed by its falloff.
  const float full = 1.0f - rim_end;
  const float rim = width * rim_share * rim_share * rim_share * (1.0f / 3.0f);
  const float x = u.x * (full + rim);
  const float z =
      x < full ? rim_end + x : light.cos_outer + width * rim_share * cube_root(min((x - full) / rim, 1.0f));
  float s, c;
  sincos_turns(u.y, s, c);
  const float r = safe_sqrt((1.0f - z) * (1.0f + z));
  Vec3f a, b;
  make_frame(light.direction, a, b);
  return a * (r * c) + b * (r * s) + light.direction * min(z, 1.0f);
}

// A ray through the disc of the bounding sphere, from outside of it.
GPURT_INLINE Ray ray_through_scene(const EmissionView &emission, Vec3f direction, Vec2f u)
{
  Vec3f a, b;
  make_frame(direction, a, b);
  float s, c;
  sincos_turns(u.y, s, c);
  const float r = emission.radius * sqrt(u.x);
  const Vec3f origin = emission.center + a * (r * c) + b * (r * s) - direction * (2.0f * emission.radius);
  return {origin, 0.0f, direction, infinity};
}

// A photon of a lamp: uniform in area but for its texture, cosine-weighted in direction, which is radiance times cosine.
GPURT_INLINE bool emit_from_triangle(const SceneView &scene, const Light &light, float side, Vec2f u_position,
                                     Vec2f u_direction, Ray &ray, Vec3f &flux)
{
  Vec3f a, b, c;
  light_triangle(scene, light, a, b, c);
  const Vec2f uv = sample_triangle(u_position);
  if (scene.has_emission_textures) {
    // The light's own colour is the texture's mean. Roulette keeps the flux of photons what it is elsewhere, as far as it
    // may: few of them come from dim places.
    flux = lamp_radiance(scene, light, uv) * (1.0f / max_component(light.color));
    const float share = max_component(flux);
    const float u = light.two_sided ? (side < 0.5f ? 2.0f * side : 2.0f * side - 1.0f) : side;
    if (share < 1.0f) {
      if (u >= share) return false;
      flux *= 1.0f / share;
    }
    if (!is_finite(flux)) return false;
  } else {
    const float opacity = lamp_opacity(scene, light, uv);
    if (!(opacity > 0.0f)) return false;
    flux *= opacity;
  }
  const float w = 1.0f - uv.x - uv.y;
  const Vec3f p = a * w + b * uv.x + c * uv.y;
  const Vec3f error =
      (abs(a * w) + abs(b * uv.x) + abs(c * uv.y)) * error_gamma(7) + t_error_at(scene, p, a, b, c);
  const Vec3f area_vector = cross(b - a, c - a);
  if (!(max_component(abs(area_vector)) > 0.0f)) return false;
  Vec3f normal = normalize_any_scale(area_vector);
  if (light.two_sided && side < 0.5f) normal = -normal;
  const Vec3f local = sample_cosine_hemisphere(u_direction);
  if (!(local.z > 0.0f)) return false;
  Vec3f s, t;
  make_frame(normal, s, t);
  const Vec3f direction = s * local.x + t * local.y + normal * local.z;
  ray = {offset_origin(p, error, normal, direction), leaving_tmin, direction, infinity};
  return true;
}

// False: this photon carries nothing.
GPURT_HD inline bool emit_photon(const SceneView &scene, const EmissionView &emission, SampleKey key,
                                 EmittedPhoton &photon)
{
  if (emission.cdf == nullptr) return false;
  const Vec2f u_light = sample_2d(key, photon_dim_light);
  const Vec2f u_position = sample_2d(key, photon_dim_position);
  const Vec2f u_direction = sample_2d(key, photon_dim_direction);
  const uint32_t source = find_interval(emission.cdf, emission.num_sources, u_light.x);
  photon.triangle = invalid_id;

  const uint32_t num_lights = scene.num_tree_lights + scene.num_distant_lights;
  if (source < num_lights) {
    const Light &light = scene.lights[source];
    photon.flux = light.color * (1.0f / max_component(light.color));
    switch (light.type) {
      case LightType::Triangle:
        photon.triangle = light.triangle;
        return emit_from_triangle(scene, light, u_light.y, u_position, u_direction, photon.ray, photon.flux);
      case LightType::Point:
        photon.ray = {light.position, 0.0f, sample_sphere(u_direction), infinity};
        return true;
      case LightType::Spot:
        photon.ray = {light.position, 0.0f, sample_spot(light, u_direction), infinity};
        return true;
      default:
        photon.ray = ray_through_scene(emission, light.direction, u_position);
        return true;
    }
  }
  const Environment &environment = scene.environment;
  Vec3f towards;
  if (samples_environment(environment)) {
    float pdf;
    towards = sample_environment(environment, u_direction, pdf);
    if (!(pdf > 0.0f)) return false;
    photon.flux =
        environment_radiance(scene, towards) * (1.0f / (pdf * 4.0f * pi * environment.mean_luminance));
  } else {
    towards = sample_sphere(u_direction);
    photon.flux = environment.radiance * (1.0f / max_component(environment.radiance));
  }
  photon.ray = ray_through_scene(emission, -towards, u_position);
  return max_component(photon.flux) > 0.0f && is_finite(photon.flux);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
