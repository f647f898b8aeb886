// The committed scene as kernels read it: plain arrays in the memory of the device.
//
// Triangles of all geometries lie in one array, group after group. Group 0 holds the geometries that are placed once,
// in world space, ordered by (instance, primitive); every other group is one shared geometry in object space, placed by
// `placements`. A segment is the run of triangles that one geometry contributes to a group.
#pragma once

#include "core/math/vec.h"

namespace gpurt {

struct Segment {
  uint32_t first_triangle;
  uint32_t num_triangles;
  uint32_t first_vertex;  // of SceneView::positions
  uint32_t first_normal;  // of SceneView::normals; invalid_id: flat
  uint32_t first_uv;      // of SceneView::uvs; invalid_id: (0, 0)
  uint32_t material;      // index into SceneView::materials
  uint32_t geometry;      // public id
  uint32_t instance;      // public id; invalid_id: shared geometry, see the placement
  uint32_t first_light;   // of its triangles, primitive by primitive; invalid_id: not a lamp, or shared
  uint32_t
      flips;  // 1: baked by a transform that mirrors; the 2nd and 3rd corner are exchanged, and so u and v
};

struct Group {
  uint32_t first_triangle;
  uint32_t num_triangles;
  Box bounds;  // of its triangles; empty if there are none
};

// One instance of a shared geometry.
struct Placement {
  Transform object_to_world;
  Transform world_to_object;
  Box bounds;  // world, conservative
  uint32_t group;
  uint32_t instance;     // public id
  uint32_t first_light;  // as in Segment
  uint32_t flips;        // 1: the transform mirrors
};

enum class MaterialType : uint32_t { Lambert = 0, Mirror = 1, Glass = 2, Metal = 3 };

struct Material {
  MaterialType type;
  Vec3f base_color;
  float alpha_ggx;  // roughness squared
  float ior;
  float alpha;
  float alpha_cutoff;  // 0: opaque
  Vec3f emission;
  uint32_t base_color_texture;  // index into SceneView::textures; invalid_id: none
  uint32_t two_sided_emission;
  uint32_t blends;            // 1: alpha is opacity, and alpha_cutoff 0
  uint32_t emission_texture;  // as base_color_texture
  Vec3f absorption;           // Glass: per metre of the world; infinity: nothing is left
};

enum class TexelFormat : uint32_t { Rgba8Srgb = 0, Rgba8Linear = 1, Rgba32f = 2 };
enum class Wrap : uint32_t { Repeat = 0, Clamp = 1, Mirror = 2 };

struct Texture {
  const void *texels;  // row major, top row first
  uint32_t width, height;
  TexelFormat format;
  Wrap wrap_u, wrap_v;
  uint32_t nearest;
};

enum class LightType : uint32_t { Triangle = 0, Point = 1, Spot = 2, Distant = 3, Environment = 4 };

struct Light {
  LightType type;
  uint32_t triangle;   // Triangle: index into SceneView::indices
  uint32_t placement;  // Triangle: of a shared geometry, else invalid_id
  uint32_t two_sided;
  Vec3f color;      // Triangle: radiance, or its mean; Point, Spot: intensity; Distant: irradiance
  Vec3f position;   // Point, Spot
  Vec3f direction;  // Spot, Distant: unit, where it shines
  float cos_inner, cos_outer;
  uint64_t tree_path;  // bit i: which child is taken at level i of the light tree, the root being level 0
};

// Up to four nodes of the light tree side by side, so that their importance is computed together: the children of a
// node's children, two of them if they are leaves. Source: Conty Estevez and Kulla 2018.
struct LightBundle {
  float center[3][4], radius[4];     // of the sphere about the lights' bounds
  float axis[3][4];                  // of the cone of their normals
  float cos_theta[4], sin_theta[4];  // half angle of that cone
  float cos_emit[4];                 // and of emission around a normal
  float facing[4];                   // -1: they shine to both sides, else 1
  float power[4];                    // 0: nothing there
  uint32_t child[4];                 // the bundle of what is below, or light_leaf_bit | light
};
constexpr uint32_t light_leaf_bit = 0x80000000u;

// The environment: constant, or a lat-long texture with a table for importance sampling.
struct Environment {
  Vec3f radiance;    // constant, or factor of the texture
  uint32_t texture;  // invalid_id: constant
  uint32_t is_present;
  float mean_luminance;     // over the sphere, of an image; else 0
  uint32_t width, height;   // of the table
  const float *row_cdf;     // [height + 1]; null: constant, or black
  const float *column_cdf;  // [height][width + 1]
};

struct SceneView {
  const Vec3f *positions;
  const UInt3 *indices;  // of all triangles, into positions
  const uint32_t *triangle_segment;
  const Vec3f *normals;
  const Vec2f *uvs;
  const Segment *segments;
  const Group *groups;
  const Placement *placements;
  const Material *materials;
  const Texture *textures;
  const Light *lights;               // triangles, points, spots: leaves of the tree; then distant lights
  const LightBundle *light_bundles;  // the first has the root alone
  Environment environment;
  Box bounds;  // world, of everything; empty for an empty scene
  uint64_t num_triangles;
  uint32_t num_groups;
  uint32_t num_placements;
  uint32_t num_segments;
  uint32_t num_materials;
  uint32_t num_tree_lights;     // leaves of the light tree
  uint32_t num_distant_lights;  // lights[num_tree_lights ...]
  uint32_t has_alpha_masks;     // or materials that blend: not every hit counts
  uint32_t has_blending;
  uint32_t has_absorption;         // by glass
  uint32_t has_emission_textures;  // of lamps
  // How far a hit's point on the ray may lie off the triangle, in units of the triangle's extent seen from there: not 0
  // for accelerators that compute t in single precision, which would hit the triangle that a ray has just left.
  float t_error;
};

}  // namespace gpurt
