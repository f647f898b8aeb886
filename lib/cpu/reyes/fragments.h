// Where a bucket's sampler puts the fragments of surfaces that blend: it counts them, or keeps all, or the nearest behind
// those that a sample has had.
#pragma once

#include "core/reyes/blend.h"

namespace gpurt {
GPURT_FUNCTIONS_BEGIN

// Of a bucket's samples, by their slots.
struct FragmentSink {
  enum class Mode : uint32_t { Count, Keep, Peel };
  Mode mode;
  uint32_t layers;       // Peel: that a sample keeps at most
  uint32_t *count;       // of a sample's fragments
  uint32_t *first;       // Keep: of a sample's fragments
  Fragment *fragments;   // Peel: a sample's begin at slot * layers
  const Fragment *last;  // Peel: the last one that a sample has had; z 0: none
  uint64_t *num_lost;    // Peel: counts those that a sample has no room for; null: they are looked for again

  void take(uint32_t slot, const Fragment &f) const
  {
    switch (mode) {
      case Mode::Count:
        count[slot]++;
        return;
      case Mode::Keep:
        fragments[first[slot] + count[slot]++] = f;
        return;
      case Mode::Peel:
        if (last[slot].z > 0.0f && !precedes(last[slot], f)) return;
        if (num_lost != nullptr && count[slot] == layers) ++*num_lost;
        count[slot] = insert_fragment(fragments + size_t(slot) * layers, count[slot], layers, f);
    }
  }
};

GPURT_FUNCTIONS_END
}  // namespace gpurt
