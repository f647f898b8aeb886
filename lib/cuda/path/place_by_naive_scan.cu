// Places by the naive scan: log2 n passes, each of which adds to every sum the one that lies a power of two before it. It
// does n log n additions where n would do.
//
// Source: Hillis and Steele 1986; the talk.
#include "cuda/launch.h"
#include "cuda/path/place.h"

namespace gpurt::cuda {
namespace {

__global__ void __launch_bounds__(block_size)
    add_kernel(const uint32_t *from, uint32_t n, uint32_t step, uint32_t *to)
{
  const uint64_t i = thread_item();
  if (i < n) to[i] = from[i] + (i >= step ? from[i - step] : 0);
}

// From sums up to and with each item to places before it.
__global__ void __launch_bounds__(block_size)
    place_kernel(const uint32_t *sums, uint32_t n, uint32_t *places, uint32_t *total)
{
  const uint64_t i = thread_item();
  if (i >= n) return;
  places[i] = sums[i] - 1;  // where the flag is 1; elsewhere nobody reads it
  if (i == n - 1) *total = sums[i];
}

}  // namespace

uint64_t naive_scan_bytes(uint32_t n) { return uint64_t(n) * sizeof(uint32_t); }

void launch_place_by_naive_scan(uint32_t *flags, uint32_t n, void *memory, uint32_t *places, uint32_t *total,
                                cudaStream_t stream)
{
  uint32_t *from = flags, *to = static_cast<uint32_t *>(memory);
  for (uint64_t step = 1; step < n; step *= 2) {
    launch("kernel of the naive scan", add_kernel, n, stream, from, n, uint32_t(step), to);
    uint32_t *const sums = to;
    to = from;
    from = sums;
  }
  launch("kernel that makes places of sums", place_kernel, n, stream, from, n, places, total);
}

}  // namespace gpurt::cuda
