// Places by a histogram pyramid: every level holds the sums of four neighbours of the level below, up to one sum of all;
// then each place goes down from the top to the item that it belongs to.
//
// Source: Ziegler, Tevs, Theobalt and Seidel 2006. Differs: neighbours along a line, not in a square, since the queue is
// one; the base is in memory, so that an item is looked at once.
#include "cuda/launch.h"
#include "cuda/path/place.h"

namespace gpurt::cuda {
namespace {

constexpr uint32_t fan_out = 4;
constexpr int max_levels = 17;  // above the base: more than 4^16 items are no uint32_t

struct Pyramid {
  const uint32_t *base;
  uint32_t *levels[max_levels];  // levels[0] is the one above the base
  uint32_t sizes[max_levels];
  int num_levels;
};

uint32_t reduced(uint32_t n) { return n / fan_out + (n % fan_out != 0 ? 1 : 0); }

Pyramid lay_out(const uint32_t *flags, uint32_t n, uint32_t *memory, uint64_t &num_sums)
{
  Pyramid p{};
  p.base = flags;
  num_sums = 0;
  do {
    n = reduced(n);
    p.levels[p.num_levels] = memory == nullptr ? nullptr : memory + num_sums;
    p.sizes[p.num_levels++] = n;
    num_sums += n;
  } while (n > 1);
  return p;
}

__global__ void __launch_bounds__(block_size)
    reduce_kernel(const uint32_t *below, uint32_t num_below, uint32_t *sums, uint32_t num_sums)
{
  const uint64_t i = thread_item();
  if (i >= num_sums) return;
  uint32_t sum = 0;
  for (uint64_t k = i * fan_out; k < (i + 1) * fan_out && k < num_below; ++k) sum += below[k];
  sums[i] = sum;
}

__global__ void __launch_bounds__(block_size)
    descend_kernel(const __grid_constant__ Pyramid pyramid, uint32_t n, uint32_t *places, uint32_t *total)
{
  const uint64_t place = thread_item();
  const uint32_t sum = pyramid.levels[pyramid.num_levels - 1][0];
  if (place == 0) *total = sum;
  if (place >= sum) return;
  // The node that holds the place, and how many of its ones come before it.
  uint32_t node = 0, before = uint32_t(place);
  for (int level = pyramid.num_levels - 2; level >= -1; --level) {
    const uint32_t *sums = level >= 0 ? pyramid.levels[level] : pyramid.base;
    node *= fan_out;
    for (uint32_t here; before >= (here = sums[node]); ++node) before -= here;
  }
  places[node] = uint32_t(place);
}

}  // namespace

uint64_t pyramid_bytes(uint32_t n)
{
  uint64_t num_sums;
  lay_out(nullptr, n, nullptr, num_sums);
  return num_sums * sizeof(uint32_t);
}

void launch_place_by_pyramid(const uint32_t *flags, uint32_t n, void *memory, uint32_t *places,
                             uint32_t *total, cudaStream_t stream)
{
  uint64_t num_sums;
  const Pyramid p = lay_out(flags, n, static_cast<uint32_t *>(memory), num_sums);
  const uint32_t *below = flags;
  uint32_t num_below = n;
  for (int level = 0; level < p.num_levels; ++level) {
    launch("kernel that builds a histogram pyramid", reduce_kernel, p.sizes[level], stream, below, num_below,
           p.levels[level], p.sizes[level]);
    below = p.levels[level];
    num_below = p.sizes[level];
  }
  launch("kernel that goes down a histogram pyramid", descend_kernel, n, stream, p, n, places, total);
}

}  // namespace gpurt::cuda
