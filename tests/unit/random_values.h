// Random numbers and points for tests of the fast kernels' arithmetic.
#pragma once

#include <cmath>
#include <cstdint>
#include <random>

#include "core/math/vec.h"

namespace gpurt {

class Random {
 public:
  explicit Random(uint64_t seed) : engine_(seed) {}
  float between(float lo, float hi) { return std::uniform_real_distribution<float>(lo, hi)(engine_); }
  uint32_t below(uint32_t n) { return uint32_t(engine_() % n); }
  Vec3f point(float size) { return {between(-size, size), between(-size, size), between(-size, size)}; }
  // Of a size between 2^lo and 2^hi, evenly in the exponent.
  float magnitude(float lo, float hi) { return std::exp2(between(lo, hi)); }

 private:
  std::mt19937_64 engine_;
};

}  // namespace gpurt
