// Least significant digit first; each pass counts the digits of blocks, sums them up and moves pairs to their places.
#include "cpu/photon/radix_sort.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <vector>

namespace gpurt {
namespace {

// Few enough digits that the lines being written to stay in the first cache.
constexpr int max_digit_bits = 9;
constexpr uint64_t min_block = 1u << 14;

}  // namespace

KeyValue *sort_pairs(KeyValue *pairs, KeyValue *scratch, uint64_t n, int num_bits,
                     const std::shared_ptr<MemoryTracker> &memory)
{
  const int num_passes = (num_bits + max_digit_bits - 1) / max_digit_bits;
  if (num_passes == 0 || n == 0) return pairs;
  const int digit_bits = (num_bits + num_passes - 1) / num_passes;
  const uint64_t num_digits = uint64_t(1) << digit_bits;
  const uint64_t threads = uint64_t(std::max(1, tbb::this_task_arena::max_concurrency()));
  const uint64_t num_blocks = std::clamp<uint64_t>(n / min_block, 1, 4 * threads);
  const Reservation reservation(memory, num_blocks * num_digits * sizeof(uint64_t), "a sort's counts");
  std::vector<uint64_t> places(num_blocks * num_digits);
  const auto begin_of = [&](uint64_t block) { return n * block / num_blocks; };
  for (int pass = 0; pass < num_passes; ++pass) {
    const int shift = pass * digit_bits;
    const uint32_t mask = uint32_t(num_digits - 1);
    tbb::parallel_for(uint64_t(0), num_blocks, [&](uint64_t block) {
      uint64_t *counts = &places[block * num_digits];
      std::fill_n(counts, num_digits, 0);
      for (uint64_t i = begin_of(block); i < begin_of(block + 1); ++i) ++counts[pairs[i].key >> shift & mask];
    });
    uint64_t sum = 0;
    for (uint64_t digit = 0; digit < num_digits; ++digit) {
      for (uint64_t block = 0; block < num_blocks; ++block) {
        uint64_t &place = places[block * num_digits + digit];
        const uint64_t count = place;
        place = sum;
        sum += count;
      }
    }
    tbb::parallel_for(uint64_t(0), num_blocks, [&](uint64_t block) {
      uint64_t *place = &places[block * num_digits];
      for (uint64_t i = begin_of(block); i < begin_of(block + 1); ++i)
        scratch[place[pairs[i].key >> shift & mask]++] = pairs[i];
    });
    std::swap(pairs, scratch);
  }
  return pairs;
}

}  // namespace gpurt
