// Stage 'blend' in one kernel, where no ray is needed: nothing casts shadows, and no ray that leaves a surface could meet light.
#include "cuda/reyes/blend_sample.h"

namespace gpurt::cuda {
namespace {

// Takes the light of the one ray to a light; the next ray finds none.
struct UnshadowedLight {
  Vec3f *light;

  __device__ void shadow(const Ray &, Vec3f contribution, uint32_t) const { *light = contribution; }
  __device__ void next(const Ray &) const {}
};

// A thread a sample.
template <bool MayAbsorb>
__global__ void __launch_bounds__(block_size) blend_at_once(const __grid_constant__ Blending b)
{
  const uint64_t k = thread_item();
  uint32_t num_shaded = 0;
  if (k < b.num_samples) {
    const EyeHits &eye = b.eye;
    const EyeSample e = eye_sample(eye, uint32_t(k));
    if (is_in_view(b.fragments, e.slot)) {
      SampleBlend state = begin_blend(b, e, uint32_t(k));
      blend_sample(b, e, state, [&](const Hit &hit, float share, const KeptFragment *) {
        PathState path{
            vec3(e.weight * share), 0.0f, vec3(0.0f), vec3(0.0f), vec3(0.0f), e.key, 0, medium_air};
        Vec3f light = vec3(0.0f);
        BasicPathVertex<MayAbsorb>{eye.scene.scene, eye.settings, 1}.shade(e.ray, hit, path,
                                                                           UnshadowedLight{&light});
        path.radiance += light;
        state.radiance += path.radiance;
        num_shaded += hit.triangle != invalid_id ? 1 : 0;
      });
      b.samples[k] = state;
    }
  }
  add_shaded(b.eye.numbers, num_shaded);
}

// A thread a pixel of the group.
__global__ void __launch_bounds__(block_size)
    add_blended(const __grid_constant__ Blending b, const __grid_constant__ FilmView film,
                uint32_t num_pixels, uint32_t *largest_bits)
{
  const uint64_t i = thread_item();
  float largest = 0.0f;
  if (i < num_pixels) {
    const EyeHits &eye = b.eye;
    PixelSums sums{};
    const bool has_features = film.features != nullptr || film.first_hits != nullptr;
    uint32_t local = 0;
    for (uint64_t turn = 0; turn < eye.places.num_samples; ++turn) {
      const uint32_t k = uint32_t(turn * num_pixels + i);
      const SampleBlend &sample = b.samples[k];
      const PathSample s = path_sample(eye.unit, k);
      local = s.local;
      if (has_features) {
        const EyeSample e = eye_sample(eye, k);
        EyeFeatures{eye.scene.scene, eye.settings, film}(s.sample, s.local, e.ray, sample.standing,
                                                         [](int64_t &sum, int64_t term) { sum += term; });
      }
      add_sample(sums, s.sample, sample.radiance, sample.standing.triangle != invalid_id);
      const float component = max_component(sample.radiance);
      largest = component > largest ? component : largest;
    }
    film.pixels[local] = sums;
  }
  for (int offset = 16; offset != 0; offset /= 2)
    largest = max(largest, __shfl_down_sync(0xffffffffu, largest, offset));
  if (threadIdx.x % 32 == 0 && float_bits(largest) > *largest_bits)
    atomicMax(largest_bits, float_bits(largest));
}

}  // namespace

void launch_blend_at_once(const Blending &blending, cudaStream_t stream)
{
  launch("REYES stages 'blend' and 'shade' without rays",
         blending.eye.scene.scene.has_absorption ? blend_at_once<true> : blend_at_once<false>,
         blending.num_samples, stream, blending);
}

void launch_add_blended(const Blending &blending, const FilmView &film, uint32_t num_pixels,
                        uint32_t *largest_bits, cudaStream_t stream)
{
  launch("REYES stage 'resolve' of what was blended", add_blended, num_pixels, stream, blending, film,
         num_pixels, largest_bits);
}

}  // namespace gpurt::cuda
