// Shades samples in one kernel, where no ray is needed: nothing casts shadows, and no ray that leaves a surface could meet
// light. The arithmetic is that of path tracing's stages, sample by sample, and so are the bits.
#include "core/reyes/map.h"
#include "cuda/launch.h"
#include "cuda/reyes/stages.h"
#include "cuda/reyes/sums.h"

namespace gpurt::cuda {
namespace {

// Takes the light of the one ray to a light; the next ray finds none.
struct UnshadowedLight {
  Vec3f *light;

  __device__ void shadow(const Ray &, Vec3f contribution, uint32_t) const { *light = contribution; }
  __device__ void next(const Ray &) const {}
};

// A thread a pixel of the group.
template <bool MayAbsorb>
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
      PathState path{vec3(place.weight), 0.0f, vec3(0.0f), vec3(0.0f), vec3(0.0f), sample, 0, medium_air};
      Vec3f light = vec3(0.0f);
      BasicPathVertex<MayAbsorb>{eye.scene.scene, eye.settings, 1}.shade(ray, hit, path,
                                                                         UnshadowedLight{&light});
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

// Light that is packed adds up in whole numbers of its smallest unit: up to so large an exponent 2^5 samples stay below 2^63.
constexpr uint32_t most_exponent = 63 - 9 - 5;
constexpr uint32_t most_summed = 32;

// Keys of a pixel that a warp reads together with those of its other pixels, into the memory for their sums. An odd number lies
// between one pixel's first and the next one's: lanes meet different banks.
constexpr uint32_t most_staged = sizeof(PixelSums) / 8;

// The keys of a warp's pixels first .. first + n - 1, one after another; pixel p's are found at (num | 1) * p.
__device__ void stage_keys(const unsigned long long *from, uint32_t n, uint32_t num, unsigned long long *to)
{
  const uint32_t lane = threadIdx.x % 32, num_keys = n * num;
  if (num % 2 != 0) {
    for (uint32_t k = lane; k < num_keys; k += 32) to[k] = from[k];
    return;
  }
  for (uint32_t k = lane; k < num_keys; k += 32) to[k + k / num] = from[k];
}

// The same under a box where samples lie pixel by pixel: sums are integers while light is not too strong, and a warp reads
// keys and writes its pixels together.
__global__ void __launch_bounds__(block_size)
    resolve_pixels(const __grid_constant__ EyeHits eye, PixelSums *pixels, uint32_t num_pixels,
                   uint32_t *largest_bits)
{
  __shared__ alignas(16) PixelSums shared_sums[block_size];
  const uint32_t i = uint32_t(thread_item()), lane = threadIdx.x % 32;
  const uint32_t num = uint32_t(eye.places.num_samples), odd = uint32_t(eye.unit.first_sample & 1);
  const uint32_t first = i - lane, num_here = first < num_pixels ? min(num_pixels - first, 32u) : 0;
  PixelSums *const warp_sums = shared_sums + (threadIdx.x - lane);
  const unsigned long long *keys = eye.keys + uint64_t(i) * num;
  if ((num | 1) <= most_staged) {
    auto *const staged = reinterpret_cast<unsigned long long *>(warp_sums);
    stage_keys(eye.keys + uint64_t(first) * num, num_here, num, staged);
    __syncwarp();
    keys = staged + lane * (num | 1);
  }
  float largest = 0.0f;
  uint64_t sum[2][3] = {{0, 0, 0}, {0, 0, 0}};
  uint32_t most = 0, num_covered = 0;
  if (i < num_pixels) {
    for (uint32_t k = 0; k < num; ++k) {
      const unsigned long long key = keys[k];
      const uint32_t bits = uint32_t(key), exponent = bits >> 26, half = (k ^ odd) & 1;
      num_covered += key != 0 ? 1 : 0;
      most = max(most, exponent);
      const uint64_t part[3] = {bits >> 17 & 0x1ffu, bits >> 8 & 0x1ffu, uint64_t(bits & 0xffu) << 1};
      for (int c = 0; c < 3; ++c) {
        const uint64_t x = part[c] << exponent;
        sum[0][c] += half == 0 ? x : 0;
        sum[1][c] += half == 0 ? 0 : x;
      }
      largest = max(largest, max_component(unpack_light(bits)));
    }
  }
  // Sums take the place of keys.
  __syncwarp();
  if (i < num_pixels) {
    PixelSums &sums = shared_sums[threadIdx.x];
    sums = {};
    if (most <= most_exponent) {
      // Units of 2^-41 to those of 2^-64.
      constexpr int shift = 64 - light_exponent_bias;
      for (int h = 0; h < 2; ++h) {
        for (int c = 0; c < 3; ++c)
          sums.color[h][c] = {sum[h][c] << shift, int64_t(sum[h][c] >> (64 - shift))};
        sums.num_samples[h] = (num + ((h ^ odd) == 0 ? 1 : 0)) / 2;
      }
      sums.num_covered = num_covered;
    } else {
      for (uint32_t k = 0; k < num; ++k) {
        const unsigned long long key = eye.keys[uint64_t(i) * num + k];
        add_sample(sums, eye.unit.first_sample + k, key != 0 ? unpack_light(uint32_t(key)) : vec3(0.0f),
                   key != 0);
      }
    }
  }
  __syncwarp();
  // As 16-byte words, one after another.
  constexpr uint32_t words = sizeof(PixelSums) / 16;
  const uint4 *from = reinterpret_cast<const uint4 *>(warp_sums);
  uint4 *to = reinterpret_cast<uint4 *>(pixels + first);
  for (uint32_t k = lane; k < num_here * words; k += 32) to[k] = from[k];
  keep_largest(largest, largest_bits);
}
static_assert(sizeof(PixelSums) % 16 == 0);

}  // namespace

void launch_shade_pixels(const EyeHits &eye, const FilmView &film, uint32_t num_pixels,
                         uint32_t *largest_bits, cudaStream_t stream)
{
  launch("REYES stages 'map' and 'shade' without rays",
         eye.scene.scene.has_absorption ? shade_pixels<true> : shade_pixels<false>, num_pixels, stream, eye,
         film, num_pixels, largest_bits);
}

void launch_resolve_own_light(const EyeHits &eye, const FilmView &film, uint32_t num_pixels,
                              uint32_t *largest_bits, cudaStream_t stream)
{
  if (eye.slots == nullptr && eye.places.filter == ReyesFilter::Box &&
      eye.places.num_samples <= most_summed) {
    launch("REYES stage 'resolve' of micropolygons' own light, pixels", resolve_pixels, num_pixels, stream,
           eye, film.pixels, num_pixels, largest_bits);
    return;
  }
  launch("REYES stage 'resolve' of micropolygons' own light", resolve_own_light, num_pixels, stream, eye,
         film, num_pixels, largest_bits);
}

}  // namespace gpurt::cuda
