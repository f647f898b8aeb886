// The references that builders of trees start from, and their partition by several threads.
#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <vector>

#include "accel/kd_build.h"
#include "accel/kd_reference.h"
#include "accel/tracked_array.h"

namespace gpurt {

using References = TrackedArray<KdReference>;

// References that one task handles. What is made does not depend on how they are shared out.
constexpr uint64_t partition_grain = 16384;

/// One for each triangle that is not degenerate, or each box that is not empty, in their order.
///
/// @param what  Names the purpose where memory runs out.
References make_references(const KdSource &source, const std::shared_ptr<MemoryTracker> &memory,
                           const char *what);

/// Both sides of a split, each in the order of `references`.
///
/// @param count_sides  (references, count, num): upper bounds of what partition will write to each side.
/// @param partition    (references, count, out, num): appends to out[0] and out[1], tells how many.
template <class CountSides, class Partition>
void partition_in_parallel(const References &references, const std::shared_ptr<MemoryTracker> &memory,
                           const char *what, const CountSides &count_sides, const Partition &partition,
                           References side[2])
{
  const uint64_t count = references.size();
  const uint64_t num_chunks = (count + partition_grain - 1) / partition_grain;
  struct Chunk {
    References side[2];
    uint64_t num[2];
    uint64_t first[2];
  };
  std::vector<Chunk> chunks(num_chunks);
  tbb::parallel_for(uint64_t(0), num_chunks, [&](uint64_t c) {
    const uint64_t begin = c * partition_grain, end = std::min(begin + partition_grain, count);
    uint64_t num[2];
    count_sides(references.data() + begin, end - begin, num);
    Chunk &chunk = chunks[c];
    KdReference *out[2];
    for (int s = 0; s < 2; ++s) {
      chunk.side[s] = References(memory, num[s], what);
      out[s] = chunk.side[s].data();
    }
    partition(references.data() + begin, end - begin, out, chunk.num);
  });
  uint64_t total[2] = {0, 0};
  for (Chunk &chunk : chunks) {
    for (int s = 0; s < 2; ++s) {
      chunk.first[s] = total[s];
      total[s] += chunk.num[s];
    }
  }
  for (int s = 0; s < 2; ++s) side[s] = References(memory, total[s], what);
  tbb::parallel_for(uint64_t(0), num_chunks, [&](uint64_t c) {
    for (int s = 0; s < 2; ++s) {
      std::copy_n(chunks[c].side[s].data(), chunks[c].num[s], side[s].data() + chunks[c].first[s]);
      chunks[c].side[s].free();
    }
  });
}

}  // namespace gpurt
