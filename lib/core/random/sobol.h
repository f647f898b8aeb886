// Sample numbers as a pure function of (seed, frame, pixel, sample, dimension): Owen-scrambled Sobol points.
//
// Pairs of dimensions are independent shuffles and scrambles of the first two Sobol dimensions, a (0, 2)-sequence.
// Source: Burley 2020, practical hash-based Owen scrambling; Laine and Karras 2011 for the hash.
// Differs: the first two dimensions are multiplied out in the reversed-bit domain, where the second one is a Taylor shift
// over GF(2), so no direction numbers are stored.
#pragma once

#include "core/math/vec.h"

namespace gpurt {

// A point set: one pixel's samples of one half of the film.
struct SampleKey {
  uint32_t seed;   // hash of everything but sample and dimension
  uint32_t index;  // of the point in its sequence
};

GPURT_FUNCTIONS_BEGIN

// A bijective mix of 32 bits. Source: Wellons 2018, hash prospector (lowbias32).
GPURT_INLINE uint32_t mix_bits(uint32_t x)
{
  x ^= x >> 16;
  x *= 0x7feb352du;
  x ^= x >> 15;
  x *= 0x846ca68bu;
  x ^= x >> 16;
  return x;
}
GPURT_INLINE uint32_t hash(uint32_t a, uint32_t b) { return mix_bits(b + 0x9e3779b9u + mix_bits(a ^ 0x85ebca6bu)); }

// Owen scramble of a number whose bits are reversed: each bit flips depending on the lower ones.
GPURT_INLINE uint32_t scramble_reversed(uint32_t x, uint32_t seed)
{
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return x;
}

// The second Sobol dimension with its bits reversed: index(1 + x) as polynomials over GF(2).
GPURT_INLINE uint32_t sobol_second_reversed(uint32_t index)
{
  index ^= index >> 16;
  index ^= (index & 0xff00ff00u) >> 8;
  index ^= (index & 0xf0f0f0f0u) >> 4;
  index ^= (index & 0xccccccccu) >> 2;
  index ^= (index & 0xaaaaaaaau) >> 1;
  return index;
}

GPURT_INLINE float unit_float(uint32_t bits) { return float(bits >> 8) * 0x1p-24f; }  // in [0, 1)

// Samples of even and odd index have independent sequences, so that the film's two halves are independent.
GPURT_INLINE SampleKey sample_key(uint64_t seed, uint32_t frame, uint32_t x, uint32_t y, uint64_t sample)
{
  uint32_t h = hash(uint32_t(seed), uint32_t(seed >> 32));
  h = hash(h, frame);
  h = hash(h, x);
  h = hash(h, y);
  h = hash(h, uint32_t(sample & 1));
  const uint64_t index = sample >> 1;
  h = hash(h, uint32_t(index >> 32));  // past 2^32 points a new sequence begins
  return {h, uint32_t(index)};
}

// Two coordinates in [0, 1) of the point, for the given pair of dimensions.
GPURT_INLINE Vec2f sample_2d(SampleKey key, uint32_t pair)
{
  const uint32_t seed = hash(key.seed, pair);
  const uint32_t index = reverse_bits(scramble_reversed(reverse_bits(key.index), seed));
  const uint32_t x = reverse_bits(scramble_reversed(index, mix_bits(seed ^ 0x68bc21ebu)));
  const uint32_t y = reverse_bits(scramble_reversed(sobol_second_reversed(index), mix_bits(seed ^ 0x02e5be93u)));
  return {unit_float(x), unit_float(y)};
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
