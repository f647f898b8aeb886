// Brings the crossings of one ray, as trace_all lists them, into order: for devices whose threads sort for themselves.
#pragma once

#include "core/accel/hit_ids.h"

namespace gpurt {

// Up to here insertion takes fewer steps than a heap.
constexpr uint64_t max_inserted_hits = 32;

GPURT_FUNCTIONS_BEGIN

// Lets hits[root] sink to its place in the heap hits[0] .. hits[n - 1], whose last hit is on top.
GPURT_HD inline void sift_down(const SceneView &scene, Hit *hits, uint64_t root, uint64_t n)
{
  const Hit hit = hits[root];
  for (;;) {
    uint64_t child = 2 * root + 1;
    if (child >= n) break;
    if (child + 1 < n && hit_precedes(scene, hits[child], hits[child + 1])) ++child;
    if (!hit_precedes(scene, hit, hits[child])) break;
    hits[root] = hits[child];
    root = child;
  }
  hits[root] = hit;
}

// Sorts n hits by (t, instance, primitive) and drops repetitions; returns how many are left.
GPURT_HD inline uint64_t sort_hits(const SceneView &scene, Hit *hits, uint64_t n)
{
  if (n <= max_inserted_hits) {
    for (uint64_t i = 1; i < n; ++i) {
      const Hit hit = hits[i];
      uint64_t k = i;
      for (; k != 0 && hit_precedes(scene, hit, hits[k - 1]); --k) hits[k] = hits[k - 1];
      hits[k] = hit;
    }
  } else {
    for (uint64_t i = n / 2; i-- > 0;) sift_down(scene, hits, i, n);
    for (uint64_t end = n - 1; end != 0; --end) {
      const Hit last = hits[0];
      hits[0] = hits[end];
      hits[end] = last;
      sift_down(scene, hits, 0, end);
    }
  }
  uint64_t num_kept = 0;
  for (uint64_t i = 0; i < n; ++i) {
    const bool is_repeated = num_kept != 0 && hits[i].triangle == hits[num_kept - 1].triangle &&
                             hits[i].placement == hits[num_kept - 1].placement;
    if (!is_repeated) hits[num_kept++] = hits[i];
  }
  return num_kept;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
