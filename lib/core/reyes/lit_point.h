// Stage 'shade' of micropolygons after visibility: the points that samples keep, and the light that falls on them.
//
// Samples keep the micropolygon that they see, by its patch and the middle of its (u, v), or of its block's; or by the
// triangle of a mesh and its centroid, see dice_triangle.h. The light of each such point is found once, however many samples see
// it, and of none that nobody sees. It is the point of the patch's tessellation, from which rays leave without meeting their own
// surface.
//
// Points, spots and distant lights are all looked at, one shadow ray each: without noise. Where there are lamps or an
// environment to be found, a path of depth 2 at most is traced from each point, by path tracing's stages, with random
// numbers that are a function of the patch, the place on it and the samples for which it is: for every samples_per_path even
// samples one, and one for as many odd ones, so that the film's halves stay independent and more samples mean less noise.
// Source: Burns, Fatahalian and Mark 2010, lazy shading of shared points after visibility.
#pragma once

#include "core/path/path_vertex.h"
#include "core/reyes/dice_triangle.h"
#include "core/reyes/map.h"
#include "core/reyes/shade.h"

namespace gpurt {

// Samples of a pixel, even ones or odd ones, for which one path finds the light of a point.
constexpr uint32_t samples_per_path = 16;

// What a sample keeps of a point.
struct PointPlace {
  uint32_t root;
  Vec2f at;  // (u, v) on it
};

// Where the light of a grid's micropolygons, or of its blocks of them, is computed.
struct GridMiddles {
  Piece piece;
  uint32_t bits_u, bits_v;    // log2 of the points along the sides
  uint32_t shift_u, shift_v;  // log2 of the micropolygons that share one
};

// A point with what its light depends on.
struct LitPoint {
  SurfaceHit surface;
  Bsdf bsdf;
  Vec3f normal, s, t, wo;
};

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE GridMiddles middles_of(const Piece &p, uint32_t block_bits)
{
  const uint32_t bits_u = shaded_bits(p.grid_u, block_bits), bits_v = shaded_bits(p.grid_v, block_bits);
  return {p, bits_u, bits_v, p.grid_u - bits_u, p.grid_v - bits_v};
}

// That of micropolygon (i, j).
GPURT_INLINE Vec2f middle_of(const GridMiddles &m, uint32_t i, uint32_t j)
{
  return {parameter(middle_of_part(m.piece.u, m.piece.u_bits, m.bits_u, i >> m.shift_u)),
          parameter(middle_of_part(m.piece.v, m.piece.v_bits, m.bits_v, j >> m.shift_v))};
}

GPURT_INLINE bool is_same_place(const PointPlace &a, const PointPlace &b)
{
  return a.root == b.root && float_bits(a.at.x) == float_bits(b.at.x) &&
         float_bits(a.at.y) == float_bits(b.at.y);
}

GPURT_INLINE uint64_t hash_of_place(const PointPlace &p)
{
  return mix_bits((uint64_t(p.root) + 1) * 0x9e3779b97f4a7c15u +
                  (uint64_t(float_bits(p.at.x)) << 32 | float_bits(p.at.y)));
}

// Which samples share a point's light, counted from those of sample `first_sample`. `is_sampled`: light is found by paths.
GPURT_INLINE uint32_t group_of_sample(uint64_t sample, uint64_t first_sample, bool is_sampled)
{
  if (!is_sampled) return 0;
  const uint64_t first = first_sample / (2 * samples_per_path);
  return uint32_t(sample / (2 * samples_per_path) - first) << 1 | uint32_t(sample & 1);
}

// The random numbers of a point's path, for such a group.
GPURT_INLINE SampleKey key_of_place(const PathSettings &settings, const PointPlace &place,
                                    uint64_t first_sample, uint32_t group)
{
  const uint64_t film = mix_bits(settings.seed + 0x9e3779b97f4a7c15u * (uint64_t(settings.frame_index) + 1));
  const uint64_t index = first_sample / (2 * samples_per_path) + uint64_t(group >> 1);
  const uint64_t sequence = hash_of_place(place) ^ ((index >> 32) << 1 | (group & 1));
  return {mix_bits(film ^ sequence), reverse_bits(uint32_t(index))};
}

// The ray from the eye to a point, and what it meets there.
GPURT_HD inline Hit hit_of_place(const ReyesScene &scene, const Camera &camera, const PointPlace &place,
                                 Ray &ray)
{
  Hit hit = hit_of_root(scene, place.root, place.at.x, place.at.y, 0.0f);
  const Transform &m = camera.camera_to_world;
  const Vec3f eye{m.m[0][3], m.m[1][3], m.m[2][3]};
  const Vec3f to_point = surface_at(scene.scene, hit).position - eye;
  hit.t = length(to_point);
  ray = {eye, 0.0f, to_point * (1.0f / hit.t), infinity};
  return hit;
}

GPURT_HD inline LitPoint lit_point(const ReyesScene &scene, const Camera &camera, const PointPlace &place)
{
  Ray ray;
  const Hit hit = hit_of_place(scene, camera, place, ray);
  LitPoint p;
  p.surface = surface_at(scene.scene, hit);
  const Material &material = scene.scene.materials[p.surface.material];
  const Vec3f wo_world = -ray.direction;
  p.normal = p.surface.shading_normal;
  if (dot(p.normal, wo_world) < 0.0f) p.normal = -p.normal;
  p.bsdf = {material.type, base_color(scene.scene, material, p.surface.uv), material.alpha_ggx, material.ior};
  make_frame(p.normal, p.s, p.t);
  p.wo = {dot(wo_world, p.s), dot(wo_world, p.t), dot(wo_world, p.normal)};
  return p;
}

// The ray to a light without extent, and what that adds if nothing is in the way; false: nothing.
GPURT_HD inline bool make_shadow_ray(const Light &light, const LitPoint &p, Ray &ray, Vec3f &contribution)
{
  if (is_delta(p.bsdf)) return false;
  const bool is_distant = light.type == LightType::Distant;
  Vec3f wi_world = -light.direction, radiance = light.color;
  if (!is_distant) {
    const Vec3f to_light = light.position - p.surface.position;
    const float distance2 = length2(to_light);
    if (!(distance2 > 0.0f)) return false;
    wi_world = to_light * (1.0f / sqrt(distance2));
    radiance *= 1.0f / distance2;
    if (light.type == LightType::Spot) radiance *= spot_falloff(light, -wi_world);
  }
  float pdf;
  const Vec3f wi{dot(wi_world, p.s), dot(wi_world, p.t), dot(wi_world, p.normal)};
  contribution = eval_bsdf(p.bsdf, p.wo, wi, pdf) * radiance;
  if (!(max_component(contribution) > 0.0f)) return false;
  ray.origin =
      offset_origin(p.surface.position, p.surface.position_error, p.surface.geometric_normal, wi_world);
  ray.tmin = leaving_tmin;
  ray.direction = is_distant ? wi_world : light.position - ray.origin;
  ray.tmax = is_distant ? infinity : shadow_tmax;
  return true;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
