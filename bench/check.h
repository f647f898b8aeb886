// Ends a benchmark that fails, with what failed; the clock of what it measures on the host.
#pragma once

#include <chrono>
#include <cstdio>
#include <cstdlib>

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
