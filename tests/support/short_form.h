// The short form of tests, for the sanitizer of CUDA devices: GPURT_TEST_SHORT=1.
#pragma once

#include <cstdint>
#include <cstdlib>

namespace gpurt_test {

inline bool is_short_form()
{
  const char *value = std::getenv("GPURT_TEST_SHORT");
  return value != nullptr && value[0] == '1';
}

/// The number of rays, samples ... to take: `whole`, or in the short form `shortened`.
inline uint64_t amount(uint64_t whole, uint64_t shortened) { return is_short_form() ? shortened : whole; }

}  // namespace gpurt_test
