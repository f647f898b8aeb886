// Photons as they are stored: records in the order of emission, and what a grid keeps of them.
//
// A record has 32 bytes, so that moving it touches one sector of memory. A grid splits it into a probe of 16 bytes, which
// every candidate of a gather costs, and a rest of 8 bytes, which those within the radius cost where it is wanted.
#pragma once

#include "core/math/vec.h"

namespace gpurt {

struct alignas(16) Photon {
  Vec3f position;
  uint32_t flux;       // RGBE: encode_flux
  uint32_t direction;  // of flight, octahedral: encode_direction
  uint32_t
      normal;   // 3 x int8, of the side that the photon came to: encode_normal; the top byte is the owner's
  uint32_t id;  // of the light path
  uint32_t bounce;  // vertices of the path before this one
};
static_assert(sizeof(Photon) == 32);

struct alignas(16) PhotonProbe {
  Vec3f position;
  uint32_t flux;
};
static_assert(sizeof(PhotonProbe) == 16);

struct alignas(8) PhotonRest {
  uint32_t direction;
  uint32_t normal;
};
static_assert(sizeof(PhotonRest) == 8);

GPURT_FUNCTIONS_BEGIN

// Largest component of a flux that can be encoded: 255 * 2^120.
constexpr float max_photon_flux = 0x1.fep127f;

// Words that look random, from a counter.
// Source: Jarzynski and Olano 2020 (pcg).
GPURT_INLINE uint32_t photon_noise(uint32_t counter)
{
  const uint32_t state = counter * 747796405u + 2891336453u;
  const uint32_t word = ((state >> ((state >> 28) + 4u)) ^ state) * 277803737u;
  return (word >> 22) ^ word;
}

// Three mantissas of 8 bits and an exponent for them all. Each mantissa is rounded up or down at random, so that its
// expectation is the component itself: a sum over photons has no bias, however small one of its colours is. The flux is
// not negative and at most max_photon_flux; `seed` is a number of the photon's own.
GPURT_INLINE uint32_t encode_flux(Vec3f flux, uint32_t seed)
{
  const float largest = max_component(flux);
  if (!(largest > 0.0f)) return 0;
  // The unit is 2^(exponent - 127), such that the largest mantissa does not pass 255 when it is rounded up.
  int exponent = int((float_bits(largest) >> 23) & 0xffu) - 7;
  exponent = max(exponent, 1);
  if (largest > 255.0f * float_from_bits(uint32_t(exponent) << 23)) ++exponent;
  const float inverse_unit = float_from_bits(uint32_t(254 - exponent) << 23);
  uint32_t code = uint32_t(exponent) << 24;
  for (int k = 0; k < 3; ++k) {
    seed = photon_noise(seed + uint32_t(k));
    const float mantissa = at(flux, k) * inverse_unit;
    const float whole = floor(mantissa);
    // Both sides of the comparison are exact.
    const float share = mantissa - whole, random = float(seed >> 8) * 0x1p-24f;
    code |= (uint32_t(whole) + (random < share ? 1u : 0u)) << (8 * k);
  }
  return code;
}

// Byte k of a word as a float: put behind the bits of 2^23, from which it is then taken. Processors convert few integers at
// a time.
GPURT_INLINE float byte_to_float(uint32_t word, int k)
{
#if defined(__CUDA_ARCH__)
  return __uint_as_float(__byte_perm(word, 0x4b000000u, 0x7440u + unsigned(k))) - 0x1p23f;
#else
  return float_from_bits(0x4b000000u | (word >> (8 * k) & 0xffu)) - 0x1p23f;
#endif
}

GPURT_INLINE float flux_unit(uint32_t code) { return float_from_bits((code >> 24) << 23); }

GPURT_INLINE Vec3f decode_flux(uint32_t code)
{
  const float unit = flux_unit(code);
  return {byte_to_float(code, 0) * unit, byte_to_float(code, 1) * unit, byte_to_float(code, 2) * unit};
}

// A unit vector as a point of the octahedron |x| + |y| + |z| = 1, unfolded to a square of 16 x 16 bits.
// Source: Cigolle et al. 2014.
GPURT_INLINE uint32_t encode_direction(Vec3f d)
{
  const float sum = abs(d.x) + abs(d.y) + abs(d.z);
  float u = d.x / sum, v = d.y / sum;
  if (d.z < 0.0f) {
    const float folded = copysign(1.0f - abs(v), u);
    v = copysign(1.0f - abs(u), v);
    u = folded;
  }
  // 32768 stands for 0.
  const auto quantize = [](float x) {
    return uint32_t(clamp(floor(x * 32767.0f + 32768.5f), 1.0f, 65535.0f));
  };
  return quantize(u) | quantize(v) << 16;
}

GPURT_INLINE Vec3f decode_direction(uint32_t code)
{
  float u = (float(code & 0xffffu) - 32768.0f) * (1.0f / 32767.0f);
  float v = (float(code >> 16) - 32768.0f) * (1.0f / 32767.0f);
  const float z = 1.0f - abs(u) - abs(v);
  if (z < 0.0f) {
    const float unfolded = copysign(1.0f - abs(v), u);
    v = copysign(1.0f - abs(u), v);
    u = unfolded;
  }
  return normalize({u, v, z});
}

// A unit vector in steps of 1 / 127; the top byte is 0. Tests of such normals are exact on every machine.
GPURT_INLINE uint32_t encode_normal(Vec3f n)
{
  const auto quantize = [](float x) {
    return uint32_t(int(floor(clamp(x, -1.0f, 1.0f) * 127.0f + 0.5f))) & 0xffu;
  };
  return quantize(n.x) | quantize(n.y) << 8 | quantize(n.z) << 16;
}

// The dot product of two encoded normals, in units of 1 / 127^2. The top byte of `a` must be 0.
GPURT_INLINE int normal_dot(uint32_t a, uint32_t b)
{
#if defined(__CUDA_ARCH__)
  return __dp4a(int(a), int(b), 0);
#else
  int sum = 0;
  for (int k = 0; k < 24; k += 8) sum += int(int8_t(a >> k)) * int(int8_t(b >> k));
  return sum;
#endif
}

// The threshold for normal_dot that stands for a cosine: pairs whose product is larger pass.
GPURT_INLINE int normal_threshold(float cosine)
{
  return int(floor(clamp(cosine, -2.0f, 2.0f) * (127.0f * 127.0f)));
}

GPURT_INLINE PhotonProbe probe_of(const Photon &photon) { return {photon.position, photon.flux}; }
GPURT_INLINE PhotonRest rest_of(const Photon &photon) { return {photon.direction, photon.normal}; }

GPURT_FUNCTIONS_END
}  // namespace gpurt
