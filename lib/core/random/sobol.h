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
  uint64_t seed;            // hash of everything but sample and dimension
  uint32_t reversed_index;  // of the point in its sequence, its bits reversed
  uint32_t unused = 0;      // copies of 16 bytes would read padding that nobody wrote
};

GPURT_FUNCTIONS_BEGIN

// A bijective mix of 64 bits. Source: Steele, Lea and Flood 2014 (SplitMix64's finaliser, Stafford's variant 13).
GPURT_INLINE uint64_t mix_bits(uint64_t x)
{
  x ^= x >> 30;
  x *= 0xbf58476d1ce4e5b9u;
  x ^= x >> 27;
  x *= 0x94d049bb133111ebu;
  x ^= x >> 31;
  return x;
}

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

// Samples of even and odd index have independent sequences, so that the film's two halves are independent. x and y are
// below 2^16.
GPURT_INLINE SampleKey sample_key(uint64_t seed, uint32_t frame, uint32_t x, uint32_t y, uint64_t sample)
{
  const uint64_t index = sample >> 1;
  // Past 2^32 points a new sequence begins.
  const uint64_t sequence = (index >> 32) << 33 | (sample & 1) << 32 | uint64_t(y) << 16 | x;
  const uint64_t film = mix_bits(seed + 0x9e3779b97f4a7c15u * (uint64_t(frame) + 1));
  return {mix_bits(film ^ sequence), reverse_bits(uint32_t(index))};
}

// Two coordinates in [0, 1) of the point, for the given pair of dimensions.
GPURT_INLINE Vec2f sample_2d(SampleKey key, uint32_t pair)
{
  const uint64_t seed = mix_bits(key.seed + 0x9e3779b97f4a7c15u * (uint64_t(pair) + 1));
  const uint32_t low = uint32_t(seed), high = uint32_t(seed >> 32);
  const uint32_t index = reverse_bits(scramble_reversed(key.reversed_index, low));
  const uint32_t x = reverse_bits(scramble_reversed(index, high));
  const uint32_t y =
      reverse_bits(scramble_reversed(sobol_second_reversed(index), (low ^ high) * 0x9e3779b1u));
  return {unit_float(x), unit_float(y)};
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
