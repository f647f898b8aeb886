// The committed scene in host memory, in the layout of SceneView. Backends build accelerators from it and upload it.
#pragma once

#include <functional>
#include <vector>

#include "core/reyes/reyes_scene.h"
#include "memory.h"
#include "scene/patch_limits.h"
#include "scene/scene_data.h"

namespace gpurt {

/// A node of the light tree. Source: Conty Estevez and Kulla 2018.
struct LightNode {
  Box bounds;
  Vec3f axis;       // of the cone of emission directions
  float cos_theta;  // half angle of normals
  float cos_emit;   // and of emission around a normal
  float power;
  uint32_t child;  // inner: children at child, child + 1; leaf: the light
  uint32_t is_leaf;
  uint32_t two_sided;
  uint32_t reserved;
};

struct CompiledScene {
  std::vector<Vec3f> positions;
  std::vector<UInt3> indices;
  std::vector<uint32_t> triangle_segment;
  std::vector<Vec3f> normals;
  std::vector<Vec2f> uvs;
  std::vector<Segment> segments;
  std::vector<Group> groups;  // group 0 is always there
  std::vector<uint32_t>
      group_geometry;  // public id of the shared geometry of a group; invalid_id for group 0
  std::vector<Placement> placements;
  std::vector<Material> materials;
  std::vector<Texture>
      textures;  // those of the description, then the environment's; texels are of texture_data
  std::vector<std::shared_ptr<const std::vector<std::byte>>> texture_data;  // of the description's textures
  std::vector<Light> lights;
  std::vector<LightNode> light_nodes;      // root first
  std::vector<LightBundle> light_bundles;  // the same for SceneView
  Environment environment{};
  std::vector<float> environment_rows, environment_columns;
  std::vector<CameraData> cameras;
  std::vector<Vec3f> control_points;     // of patches, 16 each; in world space where they are placed once
  std::vector<PatchRange> patch_ranges;  // of each segment
  std::vector<PatchCells> patch_cells;   // of each patch: its triangles
  std::vector<RootRange> root_ranges;    // of REYES; the last one ends them
  Box bounds;
  uint32_t num_tree_lights = 0;
  uint32_t num_distant_lights = 0;
  bool has_alpha_masks = false;  // or materials that blend
  bool has_blending = false;
  bool has_absorption = false;         // by glass
  bool has_emission_textures = false;  // of lamps
  double patch_error = 0;  // bound on the distance of patches and their triangles, in metres of the world
  double patch_error_pixels = 0;  // in pixels of PatchLimits' picture; infinite: none is known
  uint64_t num_patches = 0;
  uint64_t hash = 0;  // of everything that decides an image: identifies the scene of a film or a tree cache

  /// Pointers into this object, valid while it lives unchanged.
  SceneView view() const;
  ReyesScene reyes_view() const;
  /// Whether there are triangles that no patch was cut into.
  bool has_meshes() const;
  uint64_t bytes() const;
};

/// Told how large the arrays will be before they are allocated, and how many triangles of them patches take; may throw.
using BeforeAllocation = std::function<void(uint64_t bytes, uint64_t patch_triangles)>;

/// Turns a description into arrays: tessellates patches to their limits, bakes geometries placed once into world space,
/// collects lights and builds the light tree and the environment's table. Transforms are applied in double precision and
/// rounded once.
CompiledScene compile_scene(const SceneData &scene, const PatchLimits &patch_limits,
                            const BeforeAllocation &before_allocation = {});

}  // namespace gpurt
