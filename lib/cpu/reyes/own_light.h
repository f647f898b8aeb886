// Adds the light that samples have of their micropolygons to the film.
#pragma once

#include "core/path/film_view.h"
#include "core/path/path_wave.h"
#include "core/reyes/shade.h"
#include "cpu/reyes/reyes_kernel.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN
namespace {

// Sums of packed light that no sum can overflow: 2^20 numbers of 9 bits, moved by up to 31.
constexpr uint64_t most_summed = 1u << 20;

// A pixel's sums of unweighted packed light, even and odd samples apart: whole numbers in units of 2^-light_exponent_bias,
// of exponents below 32 and of those from 32 on.
struct PackedSums {
  uint64_t sum[2][2][3] = {};

  // Returns a number in the order of the light's largest component: of which, but for the least exponent, 255 units or
  // more are left, and at most 510.
  uint32_t add(uint32_t half, uint32_t packed)
  {
    const uint32_t exponent = packed >> 26, shift = exponent & 31;
    const uint32_t r = packed >> 17 & 0x1ffu, g = packed >> 8 & 0x1ffu, b = 2 * (packed & 0xffu);
    uint64_t(&to)[3] = sum[half][exponent >> 5];
    to[0] += uint64_t(r) << shift;
    to[1] += uint64_t(g) << shift;
    to[2] += uint64_t(b) << shift;
    return exponent << 9 | max(r, max(g, b));
  }
  static float from_key(uint32_t key)
  {
    return float(key & 0x1ffu) * float_from_bits(((key >> 9) + (127 - light_exponent_bias)) << 23);
  }

  void add_to(PixelSums &pixel) const
  {
    constexpr int unit = 64 - light_exponent_bias;
    for (int half = 0; half < 2; ++half) {
      for (int c = 0; c < 3; ++c) {
        const unsigned __int128 exact = (static_cast<unsigned __int128>(sum[half][0][c]) << unit) +
                                        (static_cast<unsigned __int128>(sum[half][1][c]) << (unit + 32));
        gpurt::add(pixel.color[half][c], {uint64_t(exact), int64_t(exact >> 64)});
      }
    }
  }
};

void resolve_own_light(const ReyesSettings &reyes, const ReyesBucket &bucket, const ReyesMemory &memory,
                       const FilmView &film, ReyesKernelCounters &counters)
{
  const PathUnit unit{bucket.x0, bucket.y0, bucket.x1, bucket.y1, bucket.first_sample, 0};
  const uint32_t num_pixels = (bucket.x1 - bucket.x0) * (bucket.y1 - bucket.y0);
  float largest = counters.path.largest_sample;
  if (reyes.filter == ReyesFilter::Box && bucket.num_samples <= most_summed) {
    uint32_t key = 0;
    for (uint32_t p = 0; p < num_pixels; ++p) {
      PackedSums sums;
      uint32_t num_samples[2] = {0, 0}, num_covered = 0, num_nonfinite = 0;
      for (uint32_t turn = 0; turn < bucket.num_samples; ++turn) {
        const uint32_t slot = memory.slot[turn * num_pixels + p],
                       half = uint32_t(bucket.first_sample + turn) & 1;
        const bool covered = memory.z[slot] > 0.0f;
        const uint32_t packed = covered ? memory.root[slot] : 0;
        if (packed == unusable_light) {
          ++num_nonfinite;
          largest = infinity;
          continue;
        }
        key = max(key, sums.add(half, packed));
        num_samples[half]++;
        num_covered += covered ? 1 : 0;
      }
      PixelSums &pixel = film.pixels[path_sample(unit, p).local];
      sums.add_to(pixel);
      pixel.num_samples[0] += num_samples[0];
      pixel.num_samples[1] += num_samples[1];
      pixel.num_covered += num_covered;
      pixel.num_nonfinite += num_nonfinite;
    }
    largest = max(largest, PackedSums::from_key(key));
  } else {
    for (uint32_t k = 0; k < num_pixels * bucket.num_samples; ++k) {
      const PathSample s = path_sample(unit, k);
      const uint32_t slot = memory.slot[k];
      const bool covered = memory.z[slot] > 0.0f;
      const Vec3f light = covered ? unpack_light(memory.root[slot]) * memory.weight[k] : vec3(0.0f);
      add_sample(film.pixels[s.local], s.sample, light, covered);
      largest = max(largest, max_component(light));
    }
  }
  counters.path.largest_sample = largest;
}

}  // namespace
GPURT_FUNCTIONS_END
}  // namespace gpurt
