// The gather: photons around a visible point, summed up exactly.
//
// Every contribution is rounded to 2^-32 of a photon's mean flux and added as an integer, so that the sum does not depend
// on the order of photons, nor on how many maps they lie in: a pass that is split for want of memory has the same bits.
// Source: Knaus and Zwicker 2011, memoryless progressive photon mapping; the tests against photons of other surfaces are
// Jensen 2001.
#pragma once

#include "core/photon/eye_wave.h"
#include "core/photon/grid.h"

namespace gpurt {

// The same photons, weighed by what they say about the blur of their sum; in the same units.
struct PhotonBlur {
  int64_t flux[3];
};

struct PhotonSum {
  int64_t flux[3];         // in units of 2^-32
  uint32_t num_photons;    // that counted
  uint32_t num_overflows;  // contributions beyond photon_sum_limit, which make the sample invalid
};

// Largest contribution of a photon: sums of 2^11 of them stay in range, and of 2^31 photons of the usual flux.
constexpr float photon_sum_limit = 0x1p20f;

// Cosine between the normals of a photon and of the point that gathers it: at least, where the remedy is on.
constexpr float gather_min_cosine = 0.9f;
// Distance of a photon from the tangent plane, in radii: at most.
constexpr float gather_max_plane_distance = 0.1f;

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE void clear(PhotonSum &sum) { sum = {{0, 0, 0}, 0, 0}; }
GPURT_INLINE void clear(PhotonBlur &blur) { blur = {{0, 0, 0}}; }

// The radius of a point's gather.
GPURT_INLINE float gather_radius(const PhotonPass &pass, const VisiblePoint &point)
{
  return pass.estimator == PhotonEstimator::Memoryless ? pass.radius : point.radius;
}

// Weight of a photon at distance d; PhotonPass::scale has the norm.
GPURT_INLINE float kernel_weight(PhotonKernel kernel, float d2, float inverse_radius)
{
  return kernel == PhotonKernel::Cone ? max(1.0f - sqrt(d2) * inverse_radius, 0.0f) : 1.0f;
}

// What a photon at distance d, whose contribution is weighed by the kernel already, says about the blur of the sum.
//
// Where radiance is smooth, its mean over a ring of radius d is L + d^2 / 4 times its Laplacian. This weight makes the sum 0 for
// what is constant, and for what grows with d^2 just what that adds to the plain sum: so its expectation is the bias of the
// plain sum, up to the fourth power of the radius. For the constant kernel it is the one of least variance that does so.
// Source: Hachisuka, Jarosz and Jensen 2010, for bias by the Laplacian.
// Differs: they sum up photons with second derivatives of a smooth kernel, and multiply with the square of the radius.
GPURT_INLINE float blur_weight(PhotonKernel kernel, float d2, float inverse_radius)
{
  const float x2 = d2 * inverse_radius * inverse_radius;
  return 6.0f * (kernel == PhotonKernel::Cone ? sqrt(x2) : x2) - 3.0f;
}

GPURT_INLINE float min_normal_dot_cosine(uint32_t remedies)
{
  return remedies & remedy_normal ? gather_min_cosine : (remedies & remedy_side ? 0.0f : -2.0f);
}

// Adds the photons of one of NumParts parts, which may be summed side by side: every NumParts-th photon of the grid.
template <uint32_t NumParts = 1, bool HasBlur = false>
GPURT_INLINE void gather_photons(const PhotonGrid &grid, const PhotonPass &pass, uint32_t max_depth,
                                 const VisiblePoint &point, PhotonSum &sum, PhotonBlur &blur,
                                 uint32_t part = 0)
{
  const float radius = gather_radius(pass, point), inverse_radius = 1.0f / radius;
  const int threshold = normal_threshold(min_normal_dot_cosine(pass.remedies));
  const float max_plane_distance =
      pass.remedies & remedy_plane ? gather_max_plane_distance * radius : infinity;
  const uint32_t max_hits = max_depth - point.depth;
  Vec3f s, t, wo;
  if (point.alpha_ggx > 0.0f) {
    make_frame(point.shading_normal, s, t);
    wo = {dot(point.wo, s), dot(point.wo, t), dot(point.wo, point.shading_normal)};
  }
  const auto take = [&](uint32_t i, float d2, const PhotonProbe &probe) {
    const PhotonRest rest = load_rest(grid, i);
    if (rest.normal >> 24 > max_hits) return;
    if (normal_dot(point.normal_code, rest.normal) <= threshold) return;
    if (abs(dot(point.geometric_normal, probe.position - point.position)) > max_plane_distance) return;
    Vec3f flux = decode_flux(probe.flux) * kernel_weight(pass.kernel, d2, inverse_radius);
    if (point.alpha_ggx > 0.0f) {
      const Vec3f d = -decode_direction(rest.direction);
      const Vec3f wi{dot(d, s), dot(d, t), dot(d, point.shading_normal)};
      if (!(wi.z > 0.0f)) return;
      float pdf;
      const Bsdf bsdf{MaterialType::Metal, point.color, point.alpha_ggx, 1.0f};
      flux = flux * eval_bsdf(bsdf, wo, wi, pdf) * (1.0f / wi.z);
    }
    if (!(max_component(flux) <= photon_sum_limit)) {
      ++sum.num_overflows;
      return;
    }
    sum.flux[0] += int64_t(flux.x * 0x1p32f);
    sum.flux[1] += int64_t(flux.y * 0x1p32f);
    sum.flux[2] += int64_t(flux.z * 0x1p32f);
    ++sum.num_photons;
    if (HasBlur) {
      flux *= blur_weight(pass.kernel, d2, inverse_radius);
      blur.flux[0] += int64_t(flux.x * 0x1p32f);
      blur.flux[1] += int64_t(flux.y * 0x1p32f);
      blur.flux[2] += int64_t(flux.z * 0x1p32f);
    }
  };
  const float radius2 = radius * radius;
  for_each_range(grid, point.position, radius, [&](uint32_t begin, uint32_t end) {
    for (uint32_t i = NumParts == 1 ? begin : begin + (part - begin) % NumParts; i < end; i += NumParts) {
      const PhotonProbe probe = load_probe(grid, i);
      const float d2 = length2(probe.position - point.position);
      if (d2 < radius2) take(i, d2, probe);
    }
  });
}

// Radiance for a unit of a sum, where the disc lies on a surface.
GPURT_INLINE float flux_scale(const PhotonPass &pass, const VisiblePoint &point)
{
  if (pass.estimator == PhotonEstimator::Memoryless) return pass.scale * 0x1p-32f;
  const float ratio = pass.radius / point.radius;
  return pass.scale * 0x1p-32f * (ratio * ratio);
}

// Radiance towards the eye of what a visible point gathered in a whole pass.
GPURT_INLINE Vec3f gathered_radiance(const PhotonPass &pass, const VisiblePoint &point, const PhotonSum &sum)
{
  const float scale = flux_scale(pass, point) * point.inverse_area;
  return point.weight *
         Vec3f{float(sum.flux[0]) * scale, float(sum.flux[1]) * scale, float(sum.flux[2]) * scale};
}

// What the blur added to it, estimated. Where only a part of the disc lies on a surface, blur_weight of what is constant
// does not sum up to 0: the trials that met none say by how much. With K trials, 1 / A and the mean of the weight over the
// part that is missing have the product K / 2 times their sum as their estimate without bias.
GPURT_INLINE Vec3f gathered_blur(const PhotonPass &pass, const VisiblePoint &point, const PhotonSum &sum,
                                 const PhotonBlur &blur)
{
  const float scale = flux_scale(pass, point) * point.inverse_area;
  const float missed = 0.5f * 0x1p-20f * float(point.missed);
  return point.weight * Vec3f{(float(blur.flux[0]) + missed * float(sum.flux[0])) * scale,
                              (float(blur.flux[1]) + missed * float(sum.flux[1])) * scale,
                              (float(blur.flux[2]) + missed * float(sum.flux[2])) * scale};
}

// What a path found. Not finite where a contribution was too large to be summed up.
GPURT_INLINE Vec3f sample_radiance(const PhotonPass &pass, const PathState &path, const VisiblePoint &point,
                                   const PhotonSum &sum)
{
  if (point.depth == 0) return path.radiance;
  if (sum.num_overflows != 0) return vec3(infinity);
  return path.radiance + gathered_radiance(pass, point, sum);
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
