// Ends a benchmark that fails, with what failed; the clock of what it measures on the host, and the median of that.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "gpurt.h"

inline void check(gpurt_result result, const char *what)
{
  if (result == GPURT_OK) return;
  std::fprintf(stderr, "error: %s: %s\n", what, gpurt_last_error());
  std::exit(1);
}

/// Seconds.
inline double now()
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Of an even number the upper one of the two in the middle. `values` must not be empty.
inline double median(std::vector<double> values)
{
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}
