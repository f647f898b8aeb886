#include "accel/build_references.h"

namespace gpurt {

References make_references(const KdSource &source, const std::shared_ptr<MemoryTracker> &memory,
                           const char *what)
{
  const uint64_t num_chunks = (source.count + partition_grain - 1) / partition_grain;
  std::vector<uint64_t> first(num_chunks + 1, 0);
  References all(memory, source.count, what);
  // Kept ones move to the front of their chunk, then chunks close up.
  tbb::parallel_for(uint64_t(0), num_chunks, [&](uint64_t chunk) {
    const uint64_t begin = chunk * partition_grain, end = std::min(begin + partition_grain, source.count);
    uint64_t kept = begin;
    for (uint64_t i = begin; i < end; ++i) {
      Box box;
      if (source.boxes != nullptr) {
        box = source.boxes[i];
        if (is_empty(box)) continue;
      } else {
        const UInt3 c = source.indices[i];
        const Vec3f p0 = source.positions[c.x], p1 = source.positions[c.y], p2 = source.positions[c.z];
        if (is_degenerate(p0, p1, p2)) continue;
        box = {min(p0, min(p1, p2)), max(p0, max(p1, p2))};
      }
      all[kept++] = {box.lo, uint32_t(i), box.hi, 0};
    }
    first[chunk + 1] = kept - begin;
  });
  for (uint64_t c = 0; c < num_chunks; ++c) first[c + 1] += first[c];
  const uint64_t count = first[num_chunks];
  if (count == source.count) return all;
  References closed(memory, count, what);
  for (uint64_t c = 0; c < num_chunks; ++c) {
    std::copy_n(all.data() + c * partition_grain, first[c + 1] - first[c], closed.data() + first[c]);
  }
  return closed;
}

}  // namespace gpurt
