// The clock of everything that is timed on the host.
#pragma once

#include <chrono>

namespace gpurt {

inline double steady_seconds()
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace gpurt
