// The k nearest points: a warp a query.
//
// All lanes fetch rows of the grid at once, and the photons of these rows are dealt out to the lanes one by one. Those
// nearer than the radius are kept in shared memory. Where there is no room, a limit is found, by counting, that at least
// k of them are below, and the others go. In the end the few that are left are sorted. Nothing depends on the order in
// which photons are met: the answer is that of any other exact search.
#include "cuda/launch.h"
#include "cuda/photon/kernels.h"
#include "cuda/warp_reduce.h"

namespace gpurt::cuda {
namespace {

constexpr unsigned warps_of_block = block_size / 32;
constexpr unsigned all_lanes = ~0u;
// Blocks of a multiprocessor that registers must leave room for: more warps in flight are worth what is spilled.
constexpr unsigned min_blocks = 12;

// What a warp keeps. Squared distances are bits of floats, which have the order of the floats.
template <uint32_t Capacity>
struct alignas(16) Kept {
  uint32_t distances2[Capacity];
  uint32_t ids[Capacity];
  uint32_t row_offsets[32];  // of the first photon of a row, less how many photons the rows before have
};

__device__ bool precedes(uint32_t distance2, uint32_t id, uint32_t than_distance2, uint32_t than_id)
{
  return distance2 < than_distance2 || (distance2 == than_distance2 && id < than_id);
}

// How many of the kept ones precede (distance2, id).
template <uint32_t Capacity>
__device__ uint32_t count_before(const Kept<Capacity> &kept, uint32_t num, uint32_t distance2, uint32_t id,
                                 unsigned lane)
{
  uint32_t count = 0;
  for (uint32_t e = lane; e < num; e += 32) count += precedes(kept.distances2[e], kept.ids[e], distance2, id);
  return warp_sum(count);
}
template <uint32_t Capacity>
__device__ uint32_t count_below(const Kept<Capacity> &kept, uint32_t num, uint32_t distance2, unsigned lane)
{
  uint32_t count = 0;
  for (uint32_t e = lane; e < num; e += 32) count += kept.distances2[e] < distance2;
  return warp_sum(count);
}

// Drops all but `least` to `most` of the smallest ones, all of which are below `limit`. Returns how many are left; none of
// those dropped is below `limit` then.
template <uint32_t Capacity>
__device__ uint32_t keep_smallest(Kept<Capacity> &kept, uint32_t num, uint32_t least, uint32_t most,
                                  uint32_t &limit, unsigned lane)
{
  // Fewer than `least` are below lo, more than `most` below hi.
  uint32_t lo = 0, hi = limit, below_lo = 0, below_hi = num, bound = 0, id_bound = 0;
  for (int round = 0;; ++round) {
    if (hi - lo <= 1) {
      // All those at lo are equally far: the smaller ids go first, and ids differ.
      uint32_t id_lo = 0, id_hi = ~0u;
      for (;;) {
        id_bound = id_lo + (id_hi - id_lo) / 2;
        const uint32_t count = count_before(kept, num, lo, id_bound, lane);
        if (count < least) id_lo = id_bound + 1;
        else if (count > most) id_hi = id_bound;
        else break;
      }
      bound = lo;
      limit = lo + 1;  // of those to come, some that are as far away may have smaller ids
      break;
    }
    // As many points are below a squared distance as on a surface: in proportion to it.
    bound = lo + (hi - lo) / 2;
    if (round < 6) {
      const float a = __uint_as_float(lo), b = __uint_as_float(hi);
      const float share =
          __fdividef(0.5f * float(least + most) - float(below_lo), float(below_hi - below_lo));
      const uint32_t guess = __float_as_uint(a + (b - a) * share);
      bound = guess > lo && guess < hi ? guess : bound;
    }
    const uint32_t count = count_below(kept, num, bound, lane);
    if (count < least) {
      lo = bound;
      below_lo = count;
    } else if (count > most) {
      hi = bound;
      below_hi = count;
    } else {
      id_bound = 0;
      limit = bound;
      break;
    }
  }
  uint32_t left = 0;
  for (uint32_t first = 0; first < num; first += 32) {
    const uint32_t e = first + lane;
    const uint32_t distance2 = e < num ? kept.distances2[e] : ~0u, id = e < num ? kept.ids[e] : ~0u;
    const bool stays = e < num && precedes(distance2, id, bound, id_bound);
    const unsigned staying = __ballot_sync(all_lanes, stays);
    const uint32_t place = left + __popc(staying & ((1u << lane) - 1));
    __syncwarp();  // all have read what is written over
    if (stays) {
      kept.distances2[place] = distance2;
      kept.ids[place] = id;
    }
    left += __popc(staying);
    __syncwarp();
  }
  return left;
}

// index / count, by a float where it is near enough.
__device__ uint32_t divide(uint32_t index, uint32_t count)
{
  if (index >= 1u << 20) return index / count;
  const uint32_t quotient = uint32_t(__fdividef(float(index), float(count)));
  if (quotient * count > index) return quotient - 1;
  return index - quotient * count >= count ? quotient + 1 : quotient;
}

// Keeps what is nearer than the radius, or the k nearest of it and perhaps others. Returns how many; all are below `limit`.
template <uint32_t Capacity>
__device__ uint32_t collect(const PhotonGrid &grid, Vec3f p, float radius, uint32_t k, Kept<Capacity> &kept,
                            uint32_t &limit, unsigned lane)
{
  const GridWalk walk = begin_walk(grid.shape, p, radius);
  const uint32_t num_y = uint32_t(max(walk.y.last - walk.y.first + 1, 0));
  const uint32_t num_z = uint32_t(max(walk.z.last - walk.z.first + 1, 0));
  const uint64_t num_rows = uint64_t(num_y) * num_z;
  const unsigned lanes_before = (1u << lane) - 1;
  limit = __float_as_uint(radius * radius);
  uint32_t num = 0;
  for (uint64_t first_row = 0; first_row < num_rows; first_row += 32) {
    RowRanges row{};
    if (first_row + lane < num_rows) {
      const uint32_t index = uint32_t(first_row) + lane;  // a grid has fewer rows than 2^32: its table has
      const uint32_t z = divide(index, num_y);
      row = row_ranges(grid, walk, walk.y.first + int(index - z * num_y), walk.z.first + int(z));
    }
    // Rows that wrap around have a second range.
    for (int part = 0; part < 2; ++part) {
      const uint32_t begin = part == 0 ? row.begin : row.begin2, end = part == 0 ? row.end : row.end2;
      const unsigned used = __ballot_sync(all_lanes, begin < end);
      if (used == 0) continue;
      const uint32_t length = begin < end ? end - begin : 0;
      uint32_t sum = length;
      for (int step = 1; step < 32; step *= 2) {
        const uint32_t other = __shfl_up_sync(all_lanes, sum, step);
        if (int(lane) >= step) sum += other;
      }
      const uint32_t total = __shfl_sync(all_lanes, sum, 31), start = sum - length;
      // Rows that have photons, side by side.
      __syncwarp();
      if (length != 0) kept.row_offsets[__popc(used & lanes_before)] = begin - start;
      __syncwarp();
      uint32_t rows_before = 0;
      for (uint32_t base = 0; base < total; base += 32) {
        // Each row marks the place where it starts: a lane's row is the last one that started before or at its place.
        const uint32_t away = start - base;
        const uint32_t marks = warp_or(length != 0 && away < 32 ? 1u << away : 0u);
        const uint32_t row_of_lane = rows_before + __popc(marks & (lanes_before << 1 | 1u)) - 1;
        rows_before += __popc(marks);
        bool is_near = false;
        uint32_t i = 0, distance2 = 0, id = 0;
        if (base + lane < total) {
          i = base + lane + kept.row_offsets[row_of_lane];
          const PhotonProbe probe = load_probe(grid, i);
          distance2 = __float_as_uint(length2(probe.position - p));
          is_near = distance2 < limit;
          id = probe.flux;
        }
        const unsigned near = __ballot_sync(all_lanes, is_near);
        if (near == 0) continue;
        if (is_near) {
          const uint32_t place = num + __popc(near & lanes_before);
          kept.distances2[place] = distance2;
          kept.ids[place] = grid.indices != nullptr ? __ldg(grid.indices + i) : id;
        }
        num += __popc(near);
        __syncwarp();
        if (num > Capacity - 32) num = keep_smallest(kept, num, k, max(k, Capacity / 2), limit, lane);
      }
    }
  }
  return num;
}

// Sorts 64 keys, of which lane i holds the (2 i)th and the next one. Source: Batcher 1968, bitonic.
__device__ void sort_pairs_of_lanes(uint32_t &a, uint32_t &b, unsigned lane)
{
#pragma unroll
  for (unsigned size = 2; size <= 64; size *= 2) {
    const bool ascends = (lane & size / 2) == 0;
#pragma unroll
    for (unsigned away = size / 4; away != 0; away /= 2) {
      const uint32_t other_a = __shfl_xor_sync(all_lanes, a, int(away)),
                     other_b = __shfl_xor_sync(all_lanes, b, int(away));
      const bool keeps_smaller = ((lane & away) == 0) == ascends;
      a = keeps_smaller ? min(a, other_a) : max(a, other_a);
      b = keeps_smaller ? min(b, other_b) : max(b, other_b);
    }
    const uint32_t smaller = min(a, b), larger = max(a, b);
    a = ascends ? smaller : larger;
    b = ascends ? larger : smaller;
  }
}

// Writes the k smallest of what is kept in their order, and invalid ids behind them.
template <uint32_t Capacity>
__device__ void write_sorted(const Kept<Capacity> &kept, uint32_t num, uint32_t k, uint32_t *ids,
                             float *distances, unsigned lane)
{
  const auto write = [&](uint32_t rank, uint32_t e) {
    if (rank >= k) return;
    if (ids != nullptr) ids[rank] = rank < num ? kept.ids[e] : invalid_id;
    if (distances != nullptr)
      distances[rank] = rank < num ? sqrt(__uint_as_float(kept.distances2[e])) : infinity;
  };
  if (num <= 64 && k <= 64) {
    // The lowest bits of the distances make room for where they are kept.
    constexpr uint32_t place_mask = 63;
    const uint32_t first = 2 * lane, second = first + 1;
    uint32_t a = (first < num ? kept.distances2[first] & ~place_mask : ~place_mask) | first;
    uint32_t b = (second < num ? kept.distances2[second] & ~place_mask : ~place_mask) | second;
    sort_pairs_of_lanes(a, b, lane);
    // Those that differ in these bits alone, or not at all, are rare.
    const uint32_t next = __shfl_down_sync(all_lanes, a, 1);
    const bool is_unclear =
        (second < num && (a ^ b) <= place_mask) || (second + 1 < num && (b ^ next) <= place_mask);
    if (!__any_sync(all_lanes, is_unclear)) {
      write(first, a & place_mask);
      write(second, b & place_mask);
      return;
    }
  }
  // The place of each is the number of those before it.
  for (uint32_t e = lane; e < num; e += 32) {
    const uint32_t distance2 = kept.distances2[e], id = kept.ids[e];
    uint32_t rank = 0;
    for (uint32_t other = 0; other < num; ++other)
      rank += precedes(kept.distances2[other], kept.ids[other], distance2, id);
    write(rank, e);
  }
  for (uint32_t rank = num + lane; rank < k; rank += 32) write(rank, 0);
}

template <uint32_t Capacity>
__global__ void __launch_bounds__(block_size, min_blocks)
    nearest_kernel(const __grid_constant__ PhotonLevels levels, const __grid_constant__ DeviceNearest nearest)
{
  __shared__ Kept<Capacity> shared[warps_of_block];
  const unsigned lane = threadIdx.x % 32;
  Kept<Capacity> &kept = shared[threadIdx.x / 32];
  const uint64_t place = thread_item() / 32;
  if (place >= nearest.num_queries) return;
  const uint32_t query = nearest.order != nullptr ? nearest.order[place] : uint32_t(place);
  const Vec3f p = nearest.positions[query];
  const uint32_t k = nearest.k;
  NearestSearch search = begin_nearest(levels, p, nearest.k, nearest.limit, nearest.hint);
  uint32_t num, limit;
  do {
    num = collect(levels.grids[level_for(levels, search.radius)], p, search.radius, k, kept, limit, lane);
  } while (num < k && grow(levels, p, search, num, k));
  // Few enough to be ranked: two to a lane, where k is not more.
  const uint32_t most = k <= 64 ? 64 : k + 32;
  if (num > most) num = keep_smallest(kept, num, k, most, limit, lane);
  __syncwarp();
  uint32_t *const ids = nearest.ids != nullptr ? nearest.ids + uint64_t(query) * k : nullptr;
  float *const distances = nearest.distances != nullptr ? nearest.distances + uint64_t(query) * k : nullptr;
  write_sorted(kept, num, k, ids, distances, lane);
  if (nearest.counts != nullptr && lane == 0) nearest.counts[query] = min(num, k);
}

}  // namespace

void launch_nearest(const PhotonLevels &levels, const DeviceNearest &nearest, cudaStream_t stream)
{
  const uint64_t threads = uint64_t(nearest.num_queries) * 32;
  if (nearest.k <= 64)
    launch("kernel that finds up to 64 nearest photons", nearest_kernel<256>, threads, stream, levels,
           nearest);
  else
    launch("kernel that finds up to 512 nearest photons", nearest_kernel<1088>, threads, stream, levels,
           nearest);
}

}  // namespace gpurt::cuda
