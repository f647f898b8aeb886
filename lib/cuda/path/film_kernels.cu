#include "cuda/path/film_kernels.h"

#include "cuda/launch.h"

namespace gpurt::cuda {
namespace {

// A pixel's sums as words of 16 bytes: six sums, then counts. A thread a word, so that a warp's lie one behind the other.
constexpr uint32_t sums_words = sizeof(PixelSums) / 16, counts_word = 6;
static_assert(sizeof(PixelSums) == 16 * 7 && offsetof(PixelSums, num_samples) == 16 * counts_word &&
              offsetof(PixelSums, num_nonfinite) == 16 * counts_word + 12);

struct GroupPlace {
  uint32_t x0, y0, width, film_width;

  __device__ uint64_t film_pixel(uint64_t group_pixel) const
  {
    const uint64_t y = group_pixel / width, x = group_pixel - y * width;
    return (y0 + y) * film_width + x0 + x;
  }
};

template <bool IsThere>
__global__ void __launch_bounds__(block_size)
    add_sums(PixelSums *film, const PixelSums *group, GroupPlace place, uint64_t num_words,
             FilmFindings *found)
{
  const uint64_t i = thread_item();
  if (i >= num_words) return;
  const uint64_t pixel = i / sums_words;
  const uint32_t word = uint32_t(i - pixel * sums_words);
  uint4 *const to = IsThere ? nullptr : reinterpret_cast<uint4 *>(film + place.film_pixel(pixel)) + word;
  const uint4 *const from = reinterpret_cast<const uint4 *>(group) + i;
  if (word == counts_word) {
    const uint4 counts = *from;
    if (!IsThere) {
      uint4 sum = *to;
      sum.x += counts.x;
      sum.y += counts.y;
      sum.z += counts.z;
      sum.w += counts.w;
      *to = sum;
    }
    if (counts.w != 0) atomicAdd(&found->num_nonfinite, static_cast<unsigned long long>(counts.w));
    return;
  }
  const ulonglong2 term = *reinterpret_cast<const ulonglong2 *>(from);
  FixedSum sum{term.x, int64_t(term.y)};
  if (!IsThere) {
    const ulonglong2 old = *reinterpret_cast<const ulonglong2 *>(to);
    add(sum, {old.x, int64_t(old.y)});
    *reinterpret_cast<ulonglong2 *>(to) = make_ulonglong2(sum.low, static_cast<unsigned long long>(sum.high));
  }
  if (is_saturated(sum)) atomicAdd(&found->num_saturated, 1ull);
}

__global__ void __launch_bounds__(block_size)
    add_features(FilmView film, FilmView group, GroupPlace place, uint64_t num_pixels)
{
  const uint64_t i = thread_item();
  if (i >= num_pixels) return;
  const uint64_t pixel = place.film_pixel(i);
  if (film.features != nullptr) {
    for (int c = 0; c < 3; ++c) {
      film.features[pixel].normal[c] += group.features[i].normal[c];
      film.features[pixel].albedo[c] += group.features[i].albedo[c];
    }
  }
  if (film.first_hits != nullptr && group.first_hits[i].is_set) film.first_hits[pixel] = group.first_hits[i];
}

// A block reads its pixels' sums together, and writes their values together.
__global__ void __launch_bounds__(block_size)
    resolve(const __grid_constant__ FilmView film, FilmOutput output, uint64_t first, uint64_t num_pixels,
            uint32_t *values)
{
  __shared__ alignas(16) PixelSums sums[block_size];
  __shared__ uint32_t block_values[3 * block_size];
  const uint64_t begin = uint64_t(blockIdx.x) * block_size, left = num_pixels - begin;
  const uint32_t n = left < block_size ? uint32_t(left) : block_size;
  const uint4 *const from = reinterpret_cast<const uint4 *>(film.pixels + first + begin);
  for (uint32_t k = threadIdx.x; k < n * sums_words; k += block_size)
    reinterpret_cast<uint4 *>(sums)[k] = from[k];
  __syncthreads();
  const uint32_t width = num_values(output);
  if (threadIdx.x < n) {
    const uint64_t pixel = first + begin + threadIdx.x;
    uint32_t pixel_values[3];
    film_values(output, sums[threadIdx.x], film.features != nullptr ? film.features + pixel : nullptr,
                film.first_hits != nullptr ? film.first_hits + pixel : nullptr, GatheredColor{},
                pixel_values);
    for (uint32_t c = 0; c < width; ++c) block_values[threadIdx.x * width + c] = pixel_values[c];
  }
  __syncthreads();
  for (uint32_t k = threadIdx.x; k < n * width; k += block_size) values[begin * width + k] = block_values[k];
}

}  // namespace

void launch_add_group(const FilmView &film, const FilmView &group, uint32_t x0, uint32_t y0,
                      FilmFindings *found, cudaStream_t stream)
{
  const GroupPlace place{x0, y0, group.width, film.width};
  const uint64_t num_pixels = uint64_t(group.width) * group.height, num_words = num_pixels * sums_words;
  const bool is_there = film.pixels == group.pixels;
  launch("kernel that adds a group to a film", is_there ? add_sums<true> : add_sums<false>, num_words, stream,
         film.pixels, group.pixels, place, num_words, found);
  if (is_there || (film.features == nullptr && film.first_hits == nullptr)) return;
  launch("kernel that adds a group's features to a film", add_features, num_pixels, stream, film, group,
         place, num_pixels);
}

void launch_resolve(const FilmView &film, FilmOutput output, uint64_t first, uint64_t num_pixels,
                    uint32_t *values, cudaStream_t stream)
{
  launch("kernel that resolves a film", resolve, num_pixels, stream, film, output, first, num_pixels, values);
}

}  // namespace gpurt::cuda
