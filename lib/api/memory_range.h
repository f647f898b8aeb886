// Checks of the arrays that a batch of queries reads and writes.
#pragma once

#include "error.h"

namespace gpurt::api {

/// Memory that a request reads or writes.
struct Range {
  const char *name;
  uintptr_t first;
  uint64_t bytes;
};

// An array of a request, which must be there if it has elements.
inline Range checked_range(const char *name, const void *data, uint64_t count, uint64_t element_bytes,
                           size_t alignment)
{
  const auto first = reinterpret_cast<uintptr_t>(data);
  uint64_t bytes, last;
  if (__builtin_mul_overflow(count, element_bytes, &bytes) || __builtin_add_overflow(first, bytes, &last)) {
    fail_invalid("{}: {} elements of {} bytes reach past the end of memory", name, count, element_bytes);
  }
  if (!data && count != 0) fail_invalid("{} is NULL, but {} elements are needed", name, count);
  if (first % alignment != 0) fail_invalid("{} must be aligned to {} bytes", name, alignment);
  return {name, first, bytes};
}

inline void check_disjoint(const Range &a, const Range &b)
{
  if (a.bytes == 0 || b.bytes == 0) return;
  if (a.first < b.first + b.bytes && b.first < a.first + a.bytes) {
    fail_invalid("{} and {} overlap; give them memory of their own", a.name, b.name);
  }
}

inline void check_absent(const void *data, const char *name, const char *query)
{
  if (data) fail_invalid("{} must be NULL for {}", name, query);
}

}  // namespace gpurt::api
