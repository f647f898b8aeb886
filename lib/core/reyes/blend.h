// Stage 'blend': all surfaces that a sample sees through each other, in order, with what each of them shows.
//
// Surfaces of materials that blend do not end a sample's view. They are kept as fragments, sorted by depth, of equals by
// root, and of that one's by place: an order that depends on the scene alone, so that coincident surfaces blend to the
// same bits whatever comes first. Source: Carpenter 1984, the A-buffer; its fragments in place of opacity masks, one list
// a sample.
#pragma once

#include "core/reyes/sample.h"

namespace gpurt {

struct Fragment {
  float z;  // 1 / w
  uint32_t root;
  float u, v;     // place on it
  float opacity;  // above 0
};

// A sample whose view is that much let through, or less, sees nothing behind.
constexpr float least_through = 0x1p-16f;
// The pair of sample dimensions that chooses which of a sample's surfaces stands for it in outputs that do not blend; beyond
// those of paths.
constexpr uint32_t dim_standing = 1u << 20;

GPURT_FUNCTIONS_BEGIN

// Whether a is seen before b. Of whatever has the members of a fragment's surface and place.
template <class Fragment>
GPURT_INLINE bool precedes(const Fragment &a, const Fragment &b)
{
  if (a.z != b.z) return a.z > b.z;
  if (a.root != b.root) return a.root < b.root;
  return place_key({a.u, a.v}) < place_key({b.u, b.v});
}

// In place, by Shell's method: lists are short, and mostly come in some order already.
template <class Fragment>
GPURT_HD inline void sort_fragments(Fragment *f, uint32_t n)
{
  uint32_t gap = 1;
  while (gap < n / 3) gap = 3 * gap + 1;
  for (; gap != 0; gap /= 3) {
    for (uint32_t i = gap; i < n; ++i) {
      const Fragment moving = f[i];
      uint32_t k = i;
      for (; k >= gap && precedes(moving, f[k - gap]); k -= gap) f[k] = f[k - gap];
      f[k] = moving;
    }
  }
}

// Puts a fragment into a sorted list of at most `capacity`, which keeps the first ones. Returns the list's length.
GPURT_HD inline uint32_t insert_fragment(Fragment *f, uint32_t n, uint32_t capacity, const Fragment &added)
{
  if (n == capacity && !precedes(added, f[n - 1])) return n;
  uint32_t k = n < capacity ? n : capacity - 1;
  for (; k > 0 && precedes(added, f[k - 1]); --k) f[k] = f[k - 1];
  f[k] = added;
  return n < capacity ? n + 1 : n;
}

GPURT_FUNCTIONS_END
}  // namespace gpurt
