// A stable sort of pairs (key, value) by all threads of the calling arena.
#pragma once

#include <cstdint>
#include <memory>

#include "memory.h"

namespace gpurt {

struct KeyValue {
  uint32_t key, value;
};

/// Sorts pairs[n] by the lowest `num_bits` bits of their keys, using scratch[n]; returns which of the two holds the
/// result. Pairs with equal keys keep their order, whatever the number of threads.
KeyValue *sort_pairs(KeyValue *pairs, KeyValue *scratch, uint64_t n, int num_bits,
                     const std::shared_ptr<MemoryTracker> &memory);

}  // namespace gpurt
