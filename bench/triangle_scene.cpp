#include "triangle_scene.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "tiny_gltf.h"

namespace bench {
namespace {

using Matrix = std::array<double, 16>;  // column major, as in glTF

[[noreturn]] void fail(const std::string &message)
{
  std::fprintf(stderr, "%s\n", message.c_str());
  std::exit(1);
}

Matrix multiply(const Matrix &a, const Matrix &b)
{
  Matrix m{};
  for (int c = 0; c < 4; ++c) {
    for (int r = 0; r < 4; ++r) {
      for (int k = 0; k < 4; ++k) m[size_t(c * 4 + r)] += a[size_t(k * 4 + r)] * b[size_t(c * 4 + k)];
    }
  }
  return m;
}

Matrix matrix_of(const tinygltf::Node &node)
{
  Matrix m = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  if (node.matrix.size() == 16) {
    std::copy(node.matrix.begin(), node.matrix.end(), m.begin());
    return m;
  }
  if (node.rotation.size() == 4) {
    const double x = node.rotation[0], y = node.rotation[1], z = node.rotation[2], w = node.rotation[3];
    m = {1 - 2 * (y * y + z * z),
         2 * (x * y + z * w),
         2 * (x * z - y * w),
         0,
         2 * (x * y - z * w),
         1 - 2 * (x * x + z * z),
         2 * (y * z + x * w),
         0,
         2 * (x * z + y * w),
         2 * (y * z - x * w),
         1 - 2 * (x * x + y * y),
         0,
         0,
         0,
         0,
         1};
  }
  for (size_t c = 0; c < 3 && node.scale.size() == 3; ++c) {
    for (size_t r = 0; r < 3; ++r) m[c * 4 + r] *= node.scale[c];
  }
  for (size_t r = 0; r < 3 && node.translation.size() == 3; ++r) m[12 + r] = node.translation[r];
  return m;
}

class GltfReader {
 public:
  explicit GltfReader(TriangleScene &scene) : scene_(scene) {}

  void read(const std::string &path)
  {
    tinygltf::TinyGLTF loader;
    // Pictures are not wanted.
    loader.SetImageLoader([](tinygltf::Image *, int, std::string *, std::string *, int, int,
                             const unsigned char *, int, void *) { return true; },
                          nullptr);
    std::string error, warning;
    const bool is_binary = path.size() > 4 && path.substr(path.size() - 4) == ".glb";
    const bool is_good = is_binary ? loader.LoadBinaryFromFile(&model_, &error, &warning, path)
                                   : loader.LoadASCIIFromFile(&model_, &error, &warning, path);
    if (!is_good) fail("cannot read " + path + ": " + error);
    const Matrix one = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    const auto &roots = model_.scenes[size_t(std::max(model_.defaultScene, 0))].nodes;
    for (int node : roots) visit(node, one);
  }

 private:
  const unsigned char *element(const tinygltf::Accessor &a, size_t i) const
  {
    const tinygltf::BufferView &view = model_.bufferViews[size_t(a.bufferView)];
    return model_.buffers[size_t(view.buffer)].data.data() + view.byteOffset + a.byteOffset +
           i * size_t(a.ByteStride(view));
  }

  void visit(int index, const Matrix &parent)
  {
    const tinygltf::Node &node = model_.nodes[size_t(index)];
    const Matrix m = multiply(parent, matrix_of(node));
    if (node.camera >= 0) {
      for (size_t r = 0; r < 3; ++r) {
        for (size_t c = 0; c < 4; ++c) scene_.camera[r * 4 + c] = float(m[c * 4 + r]);
      }
      scene_.yfov_rad = float(model_.cameras[size_t(node.camera)].perspective.yfov);
    }
    if (node.mesh >= 0) {
      for (const tinygltf::Primitive &p : model_.meshes[size_t(node.mesh)].primitives) add(p, m);
    }
    for (int child : node.children) visit(child, m);
  }

  void add(const tinygltf::Primitive &p, const Matrix &m)
  {
    if (p.mode != TINYGLTF_MODE_TRIANGLES && p.mode != -1) return;
    const tinygltf::Accessor &position = model_.accessors[size_t(p.attributes.at("POSITION"))];
    const uint32_t first = uint32_t(scene_.positions.size());
    for (size_t i = 0; i < position.count; ++i) {
      float v[3];
      std::memcpy(v, element(position, i), sizeof v);
      double w[3];
      for (size_t r = 0; r < 3; ++r) w[r] = m[r] * v[0] + m[4 + r] * v[1] + m[8 + r] * v[2] + m[12 + r];
      scene_.positions.push_back({float(w[0]), float(w[1]), float(w[2])});
    }
    std::vector<uint32_t> corners;
    if (p.indices < 0) {
      for (uint32_t i = 0; i < position.count; ++i) corners.push_back(i);
    } else {
      const tinygltf::Accessor &indices = model_.accessors[size_t(p.indices)];
      for (size_t i = 0; i < indices.count; ++i) {
        const unsigned char *e = element(indices, i);
        uint32_t value = 0;
        std::memcpy(&value, e, size_t(tinygltf::GetComponentSizeInBytes(uint32_t(indices.componentType))));
        corners.push_back(value);
      }
    }
    for (size_t i = 0; i + 2 < corners.size(); i += 3) {
      scene_.triangles.push_back({first + corners[i], first + corners[i + 1], first + corners[i + 2]});
    }
  }

  TriangleScene &scene_;
  tinygltf::Model model_;
};

// A sphere with bumps of two sizes: no two triangles alike, most of them small.
void add_bumps(TriangleScene &scene, uint64_t num_triangles)
{
  const uint32_t columns = uint32_t(std::sqrt(double(num_triangles))), rows = columns / 2;
  const double pi = 3.14159265358979323846;
  for (uint32_t j = 0; j <= rows; ++j) {
    for (uint32_t i = 0; i <= columns; ++i) {
      const double u = 2 * pi * (i % columns) / columns, v = pi * j / rows;
      const double r =
          1 + 0.05 * std::sin(40 * u) * std::sin(31 * v) + 0.004 * std::sin(400 * u + 17 * v) * std::sin(v);
      scene.positions.push_back({float(r * std::sin(v) * std::cos(u)), float(r * std::cos(v)),
                                 float(r * std::sin(v) * std::sin(u))});
    }
  }
  for (uint32_t j = 0; j < rows; ++j) {
    for (uint32_t i = 0; i < columns; ++i) {
      const uint32_t a = j * (columns + 1) + i, b = a + columns + 1;
      scene.triangles.push_back({a, a + 1, b});
      scene.triangles.push_back({a + 1, b + 1, b});
    }
  }
  scene.camera = {1, 0, 0, 0, 0, 1, 0, 0.2f, 0, 0, 1, 2.5f};
}

}  // namespace

TriangleScene load_scene(const std::string &what)
{
  TriangleScene scene;
  if (what.rfind("bumps:", 0) == 0) {
    scene.name = what;
    const uint64_t n = std::strtoull(what.c_str() + 6, nullptr, 10);
    if (n < 100) fail("bumps:N needs N of at least 100");
    add_bumps(scene, n);
    return scene;
  }
  const size_t slash = what.find_last_of('/');
  scene.name = what.substr(slash == std::string::npos ? 0 : slash + 1);
  GltfReader(scene).read(what);
  return scene;
}

}  // namespace bench
