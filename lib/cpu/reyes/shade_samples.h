// Shades samples one by one, where no ray is needed: nothing casts shadows, and no ray that leaves a surface could meet light.
// The arithmetic is that of path tracing's stages, and so are the bits.
#pragma once

#include "core/path/path_wave.h"
#include "core/reyes/map.h"
#include "cpu/reyes/places.h"
#include "cpu/reyes/reyes_kernel.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN
namespace {

// Takes the light of the one ray to a light; the next ray finds none.
struct UnshadowedLight {
  Vec3f *light;

  void shadow(const Ray &, Vec3f contribution, uint32_t) const { *light = contribution; }
  void next(const Ray &) const {}
};

void shade_samples(const ReyesScene &scene, const PathSettings &settings, const ReyesBucket &bucket,
                   const ReyesMemory &memory, const FilmView &film, ReyesKernelCounters &counters)
{
  const uint32_t num_pixels = (bucket.x1 - bucket.x0) * (bucket.y1 - bucket.y0);
  const PathUnit unit{bucket.x0, bucket.y0, bucket.x1, bucket.y1, bucket.first_sample, 0};
  const bool has_features = film.features != nullptr || film.first_hits != nullptr;
  for (uint32_t p = 0; p < num_pixels; ++p) {
    PathSample s = path_sample(unit, p);
    for (uint32_t turn = 0; turn < bucket.num_samples; ++turn, ++s.sample) {
      const uint32_t k = turn * num_pixels + p, slot = memory.slot[k], root = memory.root[slot];
      const Ray ray = ray_of_sample(settings.camera, memory, s, k);
      const Hit hit =
          hit_of_sample(scene, settings.camera, ray, root, memory.z[slot], {memory.u[slot], memory.v[slot]});
      if (has_features) {
        EyeFeatures{scene.scene, settings, film}(s.sample, s.local, ray, hit,
                                                 [](int64_t &sum, int64_t term) { sum += term; });
      }
      const SampleKey key = sample_key(settings.seed, settings.frame_index, s.x, s.y, s.sample);
      PathState path{vec3(memory.weight[k]), 0.0f, vec3(0.0f), vec3(0.0f), vec3(0.0f), key, 0, medium_air};
      Vec3f light = vec3(0.0f);
      PathVertex{scene.scene, settings, 1}.shade(ray, hit, path, UnshadowedLight{&light});
      path.radiance += light;
      add_sample(film.pixels[s.local], s.sample, path.radiance, path.covered != 0);
      const float largest = max_component(path.radiance);
      if (largest > counters.path.largest_sample) counters.path.largest_sample = largest;
      counters.num_shaded += root != invalid_id ? 1 : 0;
    }
  }
}

}  // namespace
GPURT_FUNCTIONS_END
}  // namespace gpurt
