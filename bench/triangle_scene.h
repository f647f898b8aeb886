// Triangles for benchmarks: read from glTF files or made by code, so that gpurt and its peers get the same ones.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace bench {

struct Vec3 {
  float x, y, z;
};

struct TriangleScene {
  std::string name;
  std::vector<Vec3> positions;  // world space
  std::vector<std::array<uint32_t, 3>> triangles;
  std::array<float, 12> camera{};  // to world, 3 rows of 4; looks along -z
  float yfov_rad = 0.7f;
};

/// A .glb or .gltf file, or "bumps:N" for a bumpy sphere of about N triangles. Exits with a message on failure.
TriangleScene load_scene(const std::string &what);

}  // namespace bench
