// Memory and stages of a wave of photons: emission, and what happens at every surface that one meets.
//
// Every ray has one slot for the photon that it may leave behind and one for the ray that goes on. Photons carry flux,
// where paths from the eye carry radiance: glass does not scale it, and where shading normals differ from the surface's
// own a factor makes up for it.
// Source: Jensen 1996 for photon maps; Veach 1997, Chapter 5, for the two corrections.
#pragma once

#include "core/path/medium.h"
#include "core/photon/emission.h"
#include "core/photon/photon.h"
#include "core/photon/photon_settings.h"

namespace gpurt {

// What a photon carries from surface to surface.
struct PhotonState {
  Vec3f flux;
  uint32_t id;  // within the pass
  SampleKey key;
  uint32_t medium;  // of the ray that is traced next, as PathState::medium
};

struct PhotonWave {
  PhotonState *states;
  RayQueue rays;       // traced next; paths are indices of states
  Hit *hits;           // of rays
  RayQueue next_rays;  // one slot a ray; tmax < 0: no ray
  Photon *slots;       // one a ray; bounce 0: nothing was left
};

// Photons [first, first + number of the wave) of a pass.
struct PhotonUnit {
  uint64_t seed;
  uint32_t frame_index;
  uint32_t max_depth;
  PhotonPass pass;
  uint32_t photons_per_pass;
  uint32_t first;
};

// Metal of at least this alpha (roughness squared) gathers photons; smoother metal is followed to what it reflects, since
// few photons within the radius would lie in its lobe.
constexpr float receiver_alpha = 0.35f;

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE bool receives_photons(const Bsdf &b)
{
  return b.type == MaterialType::Lambert || (b.type == MaterialType::Metal && b.alpha_ggx >= receiver_alpha);
}

GPURT_INLINE Bsdf bsdf_at(const SceneView &scene, const Material &material, Vec2f uv, bool behind)
{
  Bsdf bsdf{material.type, base_color(scene, material, uv), material.alpha_ggx, material.ior};
  if (material.type == MaterialType::Glass && behind) bsdf.eta = 1.0f / material.ior;
  return bsdf;
}

struct EmitPhotons {
  SceneView scene;
  EmissionView emission;
  PhotonUnit unit;
  PhotonWave wave;

  // Into the slots of next rays, since a photon may carry nothing.
  GPURT_HD void operator()(uint32_t i) const
  {
    const uint32_t id = unit.first + i;
    const SampleKey key = photon_key(unit.seed, unit.frame_index, unit.pass.index, unit.photons_per_pass, id);
    EmittedPhoton photon{};
    const bool is_there = emit_photon(scene, emission, key, photon);
    wave.next_rays.rays[i].tmax = -1.0f;
    wave.next_rays.paths[i] = i;
    if (!is_there) return;
    wave.next_rays.rays[i] = photon.ray;
    wave.states[i] = {photon.flux, id, key, medium_air};
  }
};

// A surface that a photon meets: the record that it leaves there, and how it goes on.
template <bool MayAbsorb>
struct BasicPhotonVertex {
  const SceneView &scene;
  uint32_t max_depth;
  uint32_t num_hits;  // surfaces met so far, this one included

  // Hands what is left behind to sink.store(record) and the ray that goes on to sink.next(ray), each at most once; `photon`
  // is then what goes along with that ray.
  template <class Sink>
  GPURT_HD void scatter(const Ray &ray, const Hit &hit, PhotonState &photon, const Sink &sink) const
  {
    if (hit.triangle == invalid_id) return;
    const Vec3f direction = normalize(ray.direction);
    const SurfaceHit surface = surface_at(scene, hit);
    const Material &material = scene.materials[surface.material];

    const Vec3f wo_world = -direction;
    Vec3f normal = surface.shading_normal;
    const bool behind = dot(normal, wo_world) < 0.0f;
    if (behind) normal = -normal;
    const float cos_shading = dot(normal, wo_world);
    const float cos_geometric = abs(dot(surface.geometric_normal, wo_world));
    if (!(cos_shading > 0.0f) || !(cos_geometric > 0.0f)) return;
    float survived = 1.0f;
    if (absorbs() && !absorb(hit.t * length(ray.direction), surface, material, wo_world, photon, survived))
      return;
    const Bsdf bsdf = bsdf_at(scene, material, surface.uv, behind);

    // Light that comes straight from a lamp is left to next-event estimation. A photon that has met n surfaces reaches
    // the eye at depth n + 1 or later.
    if (num_hits >= 2 && num_hits < max_depth && receives_photons(bsdf)) {
      const Vec3f flux = photon.flux * (cos_shading / cos_geometric);
      const Vec3f side = dot(surface.geometric_normal, wo_world) < 0.0f ? -surface.geometric_normal
                                                                        : surface.geometric_normal;
      if (max_component(flux) <= max_photon_flux) {
        sink.store({surface.position, encode_flux(flux, photon.id * 0x9e3779b9u + num_hits),
                    encode_direction(direction), encode_normal(side) | num_hits << 24, photon.id,
                    num_hits - 1});
      }
    }
    if (num_hits + 2 <= max_depth)
      go_on(surface, bsdf, normal, wo_world, cos_shading / cos_geometric, survived, photon, sink);
  }

 private:
  GPURT_HD bool absorbs() const { return MayAbsorb && scene.has_absorption != 0; }

  GPURT_HD uint32_t first_dim() const
  {
    return photon_dims_of_emission + (num_hits - 1) * photon_dims_per_vertex;
  }

  // Whether the photon comes through the medium to the surface: its flux stays what it was, as far as it may. The random
  // number that tells is uniform below `survived` if it does.
  GPURT_HD bool absorb(float distance, const SurfaceHit &surface, const Material &material, Vec3f wo_world,
                       PhotonState &photon, float &survived) const
  {
    photon.medium = medium_before(photon.medium, surface, material, wo_world);
    if (photon.medium == medium_air) return true;
    const float before = max_component(photon.flux);
    photon.flux *= transmittance(scene, photon.medium, distance);
    const float after = max_component(photon.flux);
    if (!(after > 0.0f)) return false;
    survived = after / before;
    if (sample_2d(photon.key, first_dim() + photon_dim_choice).y >= survived) return false;
    photon.flux *= before / after;
    return is_finite(photon.flux);
  }

  // `survived` as absorb leaves it; else 1.
  template <class Sink>
  GPURT_HD void go_on(const SurfaceHit &surface, const Bsdf &bsdf, Vec3f normal, Vec3f wo_world,
                      float cos_ratio, float survived, PhotonState &photon, const Sink &sink) const
  {
    Vec3f s, t;
    make_frame(normal, s, t);
    const Vec3f wo{dot(wo_world, s), dot(wo_world, t), dot(wo_world, normal)};
    const uint32_t pair = first_dim();
    const Vec2f choice = sample_2d(photon.key, pair + photon_dim_choice);
    BsdfSample next;
    if (!sample_bsdf(bsdf, wo, choice.x, sample_2d(photon.key, pair + photon_dim_bsdf), next)) return;
    Vec3f weight = next.weight;
    const Vec3f wi = s * next.wi.x + t * next.wi.y + normal * next.wi.z;
    // Flux is not scaled by the index of refraction.
    if (bsdf.type == MaterialType::Glass && next.wi.z < 0.0f) weight *= bsdf.eta * bsdf.eta;
    const float cos_out = abs(next.wi.z);
    if (!(cos_out > 0.0f)) return;
    weight *= cos_ratio * abs(dot(wi, surface.geometric_normal)) / cos_out;
    // Roulette keeps the flux of photons what it was, as far as it may: few bright ones instead of many dim ones.
    const float before = max_component(photon.flux);
    photon.flux = photon.flux * weight;
    const float after = max_component(photon.flux);
    if (!(after > 0.0f) || !is_finite(after)) return;
    if (after < before) {
      const float survival = after / before;
      if (choice.y >= survival * survived) return;
      photon.flux *= before / after;
    }
    if (absorbs())
      photon.medium = medium_after(photon.medium, surface, scene.materials[surface.material], wi);
    sink.next({offset_origin(surface.position, surface.position_error, surface.geometric_normal, wi),
               leaving_tmin, wi, infinity});
  }
};
using PhotonVertex = BasicPhotonVertex<true>;

struct ScatterPhoton {
  SceneView scene;
  PhotonUnit unit;
  PhotonWave wave;
  uint32_t num_hits;  // surfaces met so far, this one included

  GPURT_HD void operator()(uint32_t i) const
  {
    wave.next_rays.rays[i].tmax = -1.0f;
    wave.slots[i].bounce = 0;
    const uint32_t index = wave.rays.paths[i];
    wave.next_rays.paths[i] = index;
    PhotonState photon = wave.states[index];
    PhotonVertex{scene, unit.max_depth, num_hits}.scatter(wave.rays.rays[i], wave.hits[i], photon,
                                                          Slots{wave, i, index, photon});
  }

 private:
  struct Slots {
    const PhotonWave &wave;
    uint32_t i, index;
    const PhotonState &photon;

    GPURT_HD void store(const Photon &record) const { wave.slots[i] = record; }
    GPURT_HD void next(const Ray &ray) const
    {
      wave.states[index] = photon;
      wave.next_rays.rays[i] = ray;
    }
  };
};

GPURT_FUNCTIONS_END
}  // namespace gpurt
