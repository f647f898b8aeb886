// Shades samples in one kernel, where no ray is needed: nothing casts shadows, and no ray that leaves a surface could meet
// light. The arithmetic is that of path tracing's stages, sample by sample, and so are the bits.
#include "core/reyes/map.h"
#include "cuda/launch.h"
#include "cuda/reyes/stages.h"

namespace gpurt::cuda {
namespace {

// Takes the light of the one ray to a light; the next ray finds none.
struct UnshadowedLight {
  Vec3f *light;

  __device__ void shadow(const Ray &, Vec3f contribution, uint32_t) const { *light = contribution; }
  __device__ void next(const Ray &) const {}
};

// Of the lanes of a warp, into the bits of the largest of all.
__device__ void keep_largest(float largest, uint32_t *largest_bits)
{
  for (int offset = 16; offset != 0; offset /= 2)
    largest = max(largest, __shfl_down_sync(0xffffffffu, largest, offset));
  if (threadIdx.x % 32 == 0 && float_bits(largest) > *largest_bits)
    atomicMax(largest_bits, float_bits(largest));
}

// A thread a pixel of the group.
__global__ void __launch_bounds__(block_size)
    shade_pixels(const __grid_constant__ EyeHits eye, const __grid_constant__ FilmView film,
                 uint32_t num_pixels, uint32_t *largest_bits)
{
  const uint32_t i = uint32_t(thread_item());
  uint32_t num_shaded = 0;
  float largest = 0.0f;
  if (i < num_pixels) {
    PathSample s = path_sample(eye.unit, i);
    PixelSums sums{};
    const bool is_box = eye.places.filter == ReyesFilter::Box;
    const bool has_features = film.features != nullptr || film.first_hits != nullptr;
    for (uint64_t turn = 0; turn < eye.places.num_samples; ++turn, ++s.sample) {
      const uint64_t slot = slot_of(eye, turn * num_pixels + i, s.local, turn);
      const unsigned long long key = eye.keys[slot];
      const uint32_t root = key != 0 ? ~uint32_t(key) : invalid_id;
      const SampleKey sample = sample_key(eye.settings.seed, eye.settings.frame_index, s.x, s.y, s.sample);
      const Vec2f u = sample_2d(sample, dim_pixel);
      const FilteredPlace place =
          is_box ? FilteredPlace{u, 1.0f} : place_sample(eye.places.filter, eye.places.table, u);
      float depth_per_t;
      const Ray ray = camera_ray(eye.settings.camera, float(s.x) + place.offset.x,
                                 float(s.y) + place.offset.y, depth_per_t);
      const Hit hit =
          hit_of_sample(eye.scene, eye.settings.camera, ray, root, float_from_bits(uint32_t(key >> 32)),
                        place_from_key(root != invalid_id ? eye.spots[slot] : 0));
      if (has_features) {
        EyeFeatures{eye.scene.scene, eye.settings, film}(s.sample, s.local, ray, hit,
                                                         [](int64_t &sum, int64_t term) { sum += term; });
      }
      PathState path{vec3(place.weight), 0.0f, vec3(0.0f), vec3(0.0f), vec3(0.0f), sample, 0};
      Vec3f light = vec3(0.0f);
      PathVertex{eye.scene.scene, eye.settings, 1}.shade(ray, hit, path, UnshadowedLight{&light});
      path.radiance += light;
      add_sample(sums, s.sample, path.radiance, path.covered != 0);
      const float component = max_component(path.radiance);
      largest = component > largest ? component : largest;
      num_shaded += root != invalid_id;
    }
    film.pixels[s.local] = sums;
  }
  for (int offset = 16; offset != 0; offset /= 2)
    num_shaded += __shfl_down_sync(0xffffffffu, num_shaded, offset);
  if (threadIdx.x % 32 == 0 && num_shaded != 0)
    atomicAdd(&eye.numbers->num_shaded, static_cast<unsigned long long>(num_shaded));
  keep_largest(largest, largest_bits);
}

// A thread a pixel: its samples' light is there, packed.
__global__ void __launch_bounds__(block_size)
    resolve_own_light(const __grid_constant__ EyeHits eye, const __grid_constant__ FilmView film,
                      uint32_t num_pixels, uint32_t *largest_bits)
{
  const uint32_t i = uint32_t(thread_item());
  float largest = 0.0f;
  if (i < num_pixels) {
    PathSample s = path_sample(eye.unit, i);
    PixelSums sums{};
    const bool is_box = eye.places.filter == ReyesFilter::Box;
    for (uint64_t turn = 0; turn < eye.places.num_samples; ++turn, ++s.sample) {
      const unsigned long long key = eye.keys[slot_of(eye, turn * num_pixels + i, s.local, turn)];
      Vec3f light = vec3(0.0f);
      if (key != 0) {
        light = unpack_light(uint32_t(key));
        if (!is_box) {
          const SampleKey sample =
              sample_key(eye.settings.seed, eye.settings.frame_index, s.x, s.y, s.sample);
          light *= place_sample(eye.places.filter, eye.places.table, sample_2d(sample, dim_pixel)).weight;
        }
      }
      add_sample(sums, s.sample, light, key != 0);
      const float component = max_component(light);
      largest = component > largest ? component : largest;
    }
    film.pixels[s.local] = sums;
  }
  keep_largest(largest, largest_bits);
}

}  // namespace

void launch_shade_pixels(const EyeHits &eye, const FilmView &film, uint32_t num_pixels,
                         uint32_t *largest_bits, cudaStream_t stream)
{
  launch("REYES stages 'map' and 'shade' without rays", shade_pixels, num_pixels, stream, eye, film,
         num_pixels, largest_bits);
}

void launch_resolve_own_light(const EyeHits &eye, const FilmView &film, uint32_t num_pixels,
                              uint32_t *largest_bits, cudaStream_t stream)
{
  launch("REYES stage 'resolve' of micropolygons' own light", resolve_own_light, num_pixels, stream, eye,
         film, num_pixels, largest_bits);
}

}  // namespace gpurt::cuda
