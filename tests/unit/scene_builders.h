// Small scenes for the tests of lib/scene.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "error.h"
#include "scene/compiled_scene.h"
#include "scene/validate.h"

namespace gpurt {

inline MeshData make_mesh(std::vector<Vec3f> vertices, std::vector<UInt3> triangles,
                          std::vector<Vec3f> normals = {})
{
  MeshData mesh;
  mesh.vertices = SharedArray<Vec3f>(std::move(vertices));
  mesh.indices = SharedArray<UInt3>(std::move(triangles));
  if (!normals.empty()) mesh.normals = SharedArray<Vec3f>(std::move(normals));
  return mesh;
}

inline MeshData unit_triangle() { return make_mesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}); }

inline AffineDouble translation(double x, double y, double z) { return {1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, z}; }
inline AffineDouble scaling(double x, double y, double z) { return {x, 0, 0, 0, 0, y, 0, 0, 0, 0, z, 0}; }

/// The message of the gpurt::Error that `call` throws; "" if it throws none.
template <class Call>
std::string error_of(Call &&call)
{
  try {
    call();
  } catch (const Error &e) {
    return e.what();
  }
  return "";
}

inline void expect_contains(const std::string &text, const std::string &part)
{
  EXPECT_NE(text.find(part), std::string::npos) << "'" << text << "' does not say '" << part << "'";
}

}  // namespace gpurt
