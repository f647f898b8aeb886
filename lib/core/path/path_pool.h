// Paths of a pool: paths start where others end, so that a launch is always full, whatever the lengths of paths. Paths and
// their rays lie in queues that a step reads and writes anew without gaps; what a path has gathered lies apart, by its
// number, since it is what stays when the path ends.
//
// Source: Novak, Havran and Dachsbacher 2010 for the restart of paths that ended; Laine, Karras and Aila 2013.
#pragma once

#include "core/path/path_wave.h"

namespace gpurt {

// What a path carries from vertex to vertex.
struct alignas(16) PoolPath {
  Vec3f throughput;
  float pdf;
  Vec3f position;
  uint32_t number;  // of the path in its unit
  Vec3f normal;
  uint32_t depth;  // of the ray that is traced next
  uint64_t seed;   // the key of the path's samples
  uint32_t reversed_index;
  uint32_t medium;
};

struct alignas(16) PathResult {
  Vec3f radiance;
  uint32_t covered;
};

struct PathQueue {
  PoolPath *paths;
  Ray *rays;
  uint32_t *left_out;  // the triangle that a ray leaves and cannot meet; invalid_id: none
};

GPURT_FUNCTIONS_BEGIN

// Starts paths first, first + 1, ... of the unit in the queue's slots from `slot` on.
struct StartPaths {
  PathSettings settings;
  PathUnit unit;
  PathQueue queue;
  PathResult *results;
  uint32_t first, slot;

  GPURT_HD void operator()(uint32_t i) const
  {
    const PathSample s = path_sample(unit, first + i);
    const SampleKey key = sample_key(settings.seed, settings.frame_index, s.x, s.y, s.sample);
    const Vec2f u = sample_2d(key, dim_pixel);
    float depth_per_t;
    queue.rays[slot + i] = camera_ray(settings.camera, float(s.x) + u.x, float(s.y) + u.y, depth_per_t);
    queue.paths[slot + i] = {vec3(1.0f), 0.0f,     vec3(0.0f),         first + i, vec3(0.0f),
                             1,          key.seed, key.reversed_index, medium_air};
    queue.left_out[slot + i] = invalid_id;
    results[first + i] = {vec3(0.0f), 0};
  }
};

// Adds the results of paths 0 .. num_paths - 1 to the film: one call a pixel. Returns the largest radiance.
struct AddResults {
  PathUnit unit;
  const PathResult *results;
  FilmView film;
  uint32_t num_paths;

  GPURT_HD float operator()(uint32_t i) const
  {
    const PathSample first = path_sample(unit, i);
    PixelSums &sums = film.pixels[first.local];
    const uint32_t num_pixels = film.width * film.height;
    // One half of the film after the other, so that its sums stay in registers.
    const uint32_t even = first.sample % 2 == 0 ? i : i + num_pixels;
    const uint32_t odd = first.sample % 2 == 0 ? i + num_pixels : i;
    return max(add_half<0>(sums, even, num_pixels), add_half<1>(sums, odd, num_pixels));
  }

 private:
  template <int Half>
  GPURT_HD float add_half(PixelSums &film_sums, uint32_t begin, uint32_t num_pixels) const
  {
    PixelSums sums = film_sums;
    float largest = 0.0f;
    for (uint64_t k = begin; k < num_paths; k += 2 * uint64_t(num_pixels)) {
      const PathResult result = results[k];
      add_sample(sums, Half, result.radiance, result.covered != 0);
      // What is not a number is not above it.
      if (max_component(result.radiance) > largest) largest = max_component(result.radiance);
    }
    film_sums = sums;
    return largest;
  }
};

GPURT_FUNCTIONS_END
}  // namespace gpurt
