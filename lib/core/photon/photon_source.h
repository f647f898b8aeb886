// What a grid is built from: records of the renderer, or arrays of the caller's, or records made of these.
#pragma once

#include "core/photon/photon.h"

namespace gpurt {

struct PhotonSource {
  const Photon *records;   // [num_photons], or null
  const Vec3f *positions;  // [num_photons]; null: those of the records
  const Vec3f *fluxes;     // [num_photons], or null: none
  const Vec3f *normals;    // [num_photons], of any length, or null: none
  uint64_t num_photons;    // below 2^31
};

// The largest number of photons: with it and the table's entries, indices have 32 bits.
constexpr uint64_t max_photons = 0x7fffffffu;

GPURT_FUNCTIONS_BEGIN

GPURT_INLINE Vec3f source_position(const PhotonSource &source, uint64_t i)
{
  return source.records ? source.records[i].position : source.positions[i];
}

GPURT_INLINE PhotonProbe source_probe(const PhotonSource &source, uint64_t i)
{
  if (source.records) return probe_of(source.records[i]);
  return {source.positions[i], source.fluxes ? encode_flux(source.fluxes[i], uint32_t(i)) : 0u};
}

// A normal of length 0 stays 0: no test of normals lets it pass.
GPURT_INLINE uint32_t encode_any_normal(Vec3f n)
{
  return max_component(abs(n)) > 0.0f ? encode_normal(normalize_any_scale(n)) : 0u;
}

GPURT_INLINE PhotonRest source_rest(const PhotonSource &source, uint64_t i)
{
  if (source.records) return rest_of(source.records[i]);
  return {0, encode_any_normal(source.normals[i])};
}

GPURT_INLINE Photon source_record(const PhotonSource &source, uint64_t i)
{
  const PhotonProbe probe = source_probe(source, i);
  const PhotonRest rest = source.normals != nullptr ? source_rest(source, i) : PhotonRest{0, 0};
  return {probe.position, probe.flux, rest.direction, rest.normal, uint32_t(i), 0};
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
