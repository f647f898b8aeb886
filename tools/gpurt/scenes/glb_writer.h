// A binary glTF 2.0 file, built up in memory.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "mesh.h"

namespace cli::scenes {

/// Ids are those of glTF: they count from 0 in the order of adding.
class GlbWriter {
 public:
  GlbWriter();

  /// Takes the bytes of a PNG file. `repeats`: else clamped to the edge.
  int add_texture(const char *name, const std::vector<uint8_t> &png, bool repeats);

  // The materials of one exact meaning. Colours are linear. texture -1: none.
  int add_lambert(const char *name, Vec3 color, int texture = -1);
  int add_mask(const char *name,
               int texture);  // Lambertian with holes where the texture's alpha is below 1/2
  int add_mirror(const char *name, Vec3 color);
  int add_metal(const char *name, Vec3 color, double roughness);
  int add_glass(const char *name, Vec3 tint, double ior = 1.5);
  int add_lamp(const char *name, Vec3 radiance);

  /// One mesh of one or more parts, each with its material.
  int add_mesh(const char *name, const std::vector<std::pair<const Mesh *, int>> &parts);
  int add_mesh(const char *name, const Mesh &mesh, int material)
  {
    return add_mesh(name, {{&mesh, material}});
  }

  void place(const char *name, int mesh, const Matrix &matrix = {});
  void add_camera(const Matrix &matrix, double yfov_rad, int width, int height);
  void add_directional_light(Vec3 shines_to, Vec3 irradiance);
  void add_point_light(Vec3 position, Vec3 intensity);
  void set_environment(Vec3 radiance);
  /// A Radiance .hdr file in lat-long projection, which stays a file of its own beside the .glb.
  void set_environment(const std::string &file_name, std::vector<uint8_t> hdr);

  /// The whole file.
  std::string bytes() const;
  /// Files that the .glb names: to be written into its folder.
  const std::vector<std::pair<std::string, std::vector<uint8_t>>> &companions() const { return companions_; }

  uint64_t num_stored_triangles() const { return num_stored_triangles_; }
  uint64_t num_placed_triangles() const { return num_placed_triangles_; }

 private:
  using Json = nlohmann::ordered_json;
  int add_view(const void *data, size_t size_bytes, int target);
  int add_vectors(const std::vector<Vec3> &values, bool with_bounds);
  int add_material(Json material, const std::vector<const char *> &extensions);
  int add_light(Json light);
  void use_extension(const char *name);
  Json &node(const char *name, const Matrix &matrix);

  Json gltf_;
  std::string binary_;
  std::vector<std::pair<std::string, std::vector<uint8_t>>> companions_;
  std::vector<uint64_t> mesh_triangles_;
  uint64_t num_stored_triangles_ = 0, num_placed_triangles_ = 0;
};

}  // namespace cli::scenes
