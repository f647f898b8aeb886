// Rays that the commands make themselves.
#pragma once

#include <cstdint>
#include <vector>

#include "cli.h"

namespace cli {

/// A small generator with a fixed sequence, so that every run and machine traces the same rays.
/// Source: Steele, Lea and Flood 2014 (SplitMix).
class Random {
 public:
  explicit Random(uint64_t seed) : state_(seed) {}
  uint64_t bits()
  {
    state_ += 0x9e3779b97f4a7c15u;
    uint64_t x = state_;
    x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9u;
    x = (x ^ x >> 27) * 0x94d049bb133111ebu;
    return x ^ x >> 31;
  }
  /// In [0, 1).
  float uniform() { return float(bits() >> 40) * 0x1p-24f; }

 private:
  uint64_t state_;
};

struct Vec {
  float x, y, z;
};
Vec operator+(Vec a, Vec b);
Vec operator-(Vec a, Vec b);
Vec operator*(Vec a, float s);
float dot(Vec a, Vec b);
Vec normalize(Vec v);

/// Uniform on the unit sphere.
Vec sphere_direction(Random &random);
/// Around a unit normal, with a density proportional to the cosine.
Vec cosine_direction(Vec normal, Random &random);

/// One ray through the centre of every pixel of a camera's image.
std::vector<gpurt_ray> camera_rays(const gpurt_camera_desc &camera, uint32_t width, uint32_t height);

/// From anywhere in the bounds to anywhere.
std::vector<gpurt_ray> random_rays(const gpurt_scene_facts &facts, uint64_t count, Random &random);

}  // namespace cli
