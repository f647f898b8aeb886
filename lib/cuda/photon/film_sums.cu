// Adds films. Their sums are exact, so the order does not matter. Statistics have an order: films with them are one's alone.
#include "cuda/launch.h"
#include "cuda/photon/eye_paths.h"

namespace gpurt::cuda {
namespace {

__global__ void __launch_bounds__(block_size) add_film_kernel(FilmView to, FilmView from, uint64_t num_pixels)
{
  const uint64_t i = thread_item();
  if (i >= num_pixels) return;
  add(to.pixels[i], from.pixels[i]);
  if (to.features != nullptr) {
    for (int c = 0; c < 3; ++c) {
      to.features[i].normal[c] += from.features[i].normal[c];
      to.features[i].albedo[c] += from.features[i].albedo[c];
    }
  }
  if (to.errors != nullptr) add(to.errors[i], from.errors[i]);
  if (to.first_hits != nullptr && from.first_hits[i].is_set) to.first_hits[i] = from.first_hits[i];
}

}  // namespace

void launch_add_film(const FilmView &to, const FilmView &from, cudaStream_t stream)
{
  const uint64_t num_pixels = uint64_t(to.width) * to.height;
  launch("kernel that adds films", add_film_kernel, num_pixels, stream, to, from, num_pixels);
}

}  // namespace gpurt::cuda
