#include "scene/gltf_meshes.h"

#include "scene/parallel.h"
#include "scene/validate.h"

namespace gpurt {
namespace {

// Number of vertices that three by three, or one by one after the first two, make triangles.
uint64_t count_triangles(int mode, uint64_t num_corners)
{
  if (mode == TINYGLTF_MODE_TRIANGLES) return num_corners / 3;
  return num_corners < 3 ? 0 : num_corners - 2;
}

// Source: glTF 2.0, Section 3.7.2.1: corners of triangle i of a list, strip or fan. The order keeps the winding.
UInt3 triangle_corners(int mode, uint32_t i)
{
  if (mode == TINYGLTF_MODE_TRIANGLE_STRIP) return {i, i + 1 + i % 2, i + 2 - i % 2};
  if (mode == TINYGLTF_MODE_TRIANGLE_FAN) return {i + 1, i + 2, 0};
  return {3 * i, 3 * i + 1, 3 * i + 2};
}

const char *mode_name(int mode)
{
  switch (mode) {
    case TINYGLTF_MODE_POINTS:
      return "points";
    case TINYGLTF_MODE_TRIANGLES:
      return "triangles";
    case TINYGLTF_MODE_TRIANGLE_STRIP:
      return "a triangle strip";
    case TINYGLTF_MODE_TRIANGLE_FAN:
      return "a triangle fan";
    default:
      return "lines";
  }
}

bool is_triangles(int mode) { return mode >= TINYGLTF_MODE_TRIANGLES; }

int find_attribute(const tinygltf::Primitive &primitive, const std::string &name)
{
  const auto it = primitive.attributes.find(name);
  return it != primitive.attributes.end() ? it->second : -1;
}

}  // namespace

GltfMeshes::GltfMeshes(const GltfDocument &document, GltfMaterials &materials, SceneData &scene)
    : document_(document),
      materials_(materials),
      scene_(scene),
      accessors_(document),
      geometries_(document.model().meshes.size())
{}

void GltfMeshes::load(int index)
{
  const tinygltf::Mesh &mesh = document_.model().meshes[size_t(index)];
  for (size_t i = 0; i < mesh.primitives.size(); ++i) {
    const std::string what = fmt::format("{}, primitive {}", gltf_label("mesh", size_t(index), mesh.name), i);
    load_primitive(mesh.primitives[i], what, geometries_[size_t(index)]);
  }
}

void GltfMeshes::load_primitive(const tinygltf::Primitive &primitive, const std::string &what,
                                std::vector<uint32_t> &out)
{
  if (const tinygltf::Value *patches = gltf_extension(primitive.extensions, "GPURT_bezier_patches")) {
    const int accessor = patches->Get("controlPoints").GetNumberAsInt();
    const SharedArray<Vec3f> points = accessors_.vec3(accessor, "control points", what);
    const uint32_t material = materials_.load(primitive.material).material;
    out.push_back(document_.checked(what, [&] { return add_patches(scene_, {points}, material); }));
    return;
  }
  if (!is_triangles(primitive.mode)) {
    document_.warn("{} consists of {}, which are not rendered: left out", what, mode_name(primitive.mode));
    return;
  }
  if (find_attribute(primitive, "POSITION") < 0) {
    document_.warn("{} has no POSITION: left out", what);
    return;
  }
  note_losses(primitive, what);
  const GltfLoadedMaterial material = materials_.load(primitive.material);
  MeshData mesh = read_mesh(primitive, material.coordinates, what);
  out.push_back(
      document_.checked(what, [&] { return add_mesh(scene_, std::move(mesh), material.material); }));
}

MeshData GltfMeshes::read_mesh(const tinygltf::Primitive &primitive,
                               const GltfTextureCoordinates &coordinates, const std::string &what)
{
  MeshData mesh;
  mesh.vertices = accessors_.vec3(find_attribute(primitive, "POSITION"), "POSITION", what);
  const uint64_t num_vertices = mesh.vertices.size();
  for (const auto &[name, accessor] : primitive.attributes) {
    if (accessors_.count(accessor) != num_vertices) {
      document_.fail("{}: {} (accessor {}) has {} elements for {} vertices", what, printable(name), accessor,
                     accessors_.count(accessor), num_vertices);
    }
  }
  mesh.indices = SharedArray<UInt3>(read_triangles(primitive, num_vertices, what));

  if (const int accessor = find_attribute(primitive, "NORMAL"); accessor >= 0) {
    mesh.normals = accessors_.vec3(accessor, "NORMAL", what);
    uint64_t num_zero = 0;
    for (uint64_t i = 0; i < num_vertices; ++i) {
      const Vec3f n = mesh.normals[i];
      num_zero += n.x == 0 && n.y == 0 && n.z == 0;
    }
    if (num_zero > 0) {
      document_.warn("{}: {} of its normals have no length; those of the faces around stand in", what,
                     num_zero);
    }
  }

  // Coordinates are kept for the texture that reads them; all are checked.
  for (const auto &[name, accessor] : primitive.attributes) {
    if (name.compare(0, 9, "TEXCOORD_") != 0) continue;
    const SharedArray<Vec2f> uvs = accessors_.vec2(accessor, "TEXCOORD", what);
    if (coordinates.is_used && name == fmt::format("TEXCOORD_{}", coordinates.set)) mesh.uvs = uvs;
  }
  if (coordinates.is_used && mesh.uvs.empty()) {
    document_.warn("{} has no TEXCOORD_{} for the texture of its material: its first texel colours all of it",
                   what, coordinates.set);
  }
  if (!mesh.uvs.empty() && coordinates.is_transformed) {
    std::vector<Vec2f> moved(num_vertices);
    const double(&m)[6] = coordinates.transform;
    parallel_for_each(num_vertices, [&](uint64_t i) {
      const Vec2f uv = mesh.uvs[i];
      moved[i] = {float(m[0] * uv.x + m[1] * uv.y + m[2]), float(m[3] * uv.x + m[4] * uv.y + m[5])};
    });
    mesh.uvs = SharedArray<Vec2f>(std::move(moved));
  }
  return mesh;
}

std::vector<UInt3> GltfMeshes::read_triangles(const tinygltf::Primitive &primitive, uint64_t num_vertices,
                                              const std::string &what)
{
  std::vector<uint32_t> indices;
  const bool has_indices = primitive.indices >= 0;
  if (has_indices) indices = accessors_.indices(primitive.indices, num_vertices, what);
  const uint64_t num_corners = has_indices ? indices.size() : num_vertices;
  if (primitive.mode == TINYGLTF_MODE_TRIANGLES && num_corners % 3 != 0) {
    document_.warn("{} has {} corners, no multiple of three: the last {} are left out", what, num_corners,
                   num_corners % 3);
  }
  std::vector<UInt3> triangles(count_triangles(primitive.mode, num_corners));
  parallel_for_each(triangles.size(), [&](uint64_t i) {
    const UInt3 c = triangle_corners(primitive.mode, uint32_t(i));
    triangles[i] = has_indices ? UInt3{indices[c.x], indices[c.y], indices[c.z]} : c;
  });
  return triangles;
}

void GltfMeshes::note_losses(const tinygltf::Primitive &primitive, const std::string &what)
{
  if (find_attribute(primitive, "COLOR_0") >= 0) losses_["vertex colours"].push_back(what);
  if (find_attribute(primitive, "JOINTS_0") >= 0) losses_["skinning"].push_back(what);
  if (!primitive.targets.empty()) losses_["morph targets"].push_back(what);
}

void GltfMeshes::report_losses() const
{
  for (const auto &[kind, primitives] : losses_) {
    document_.warn("{} of {}{} have no counterpart and are left out", kind, primitives.front(),
                   primitives.size() > 1 ? fmt::format(" and {} others", primitives.size() - 1) : "");
  }
}

}  // namespace gpurt
