// Random numbers and directions of generated scenes and rays, the same everywhere (SplitMix64, Steele, Lea and Flood 2014).
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

using Vec = std::array<float, 3>;

class Random {
 public:
  explicit Random(uint64_t seed) : state_(seed) {}
  float unit()
  {
    state_ += 0x9e3779b97f4a7c15u;
    uint64_t z = (state_ ^ (state_ >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return float((z ^ (z >> 31)) >> 40) * 0x1p-24f;
  }
  float between(float lo, float hi) { return lo + (hi - lo) * unit(); }
  Vec direction()
  {
    for (;;) {
      const Vec v{between(-1, 1), between(-1, 1), between(-1, 1)};
      const float l = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
      if (l > 0.01f && l <= 1) return {v[0] / l, v[1] / l, v[2] / l};
    }
  }

 private:
  uint64_t state_;
};
