// The rules that every part of a scene obeys, whoever describes it: the ABI and the glTF loader add through these.
//
// Each function checks all it is given, throws gpurt::Error naming the culprit (and the first bad index), and leaves
// the scene as it was; on success it appends and returns the new index. Ids count from 0 here. Index 0 of the
// materials is the white Lambertian default; textures have no default and "none" is invalid_id.
#pragma once

#include "scene/affine.h"
#include "scene/scene_data.h"

namespace gpurt {

/// A material as its author states it; add_material turns it into the kernels' form.
struct MaterialSettings {
  MaterialType type = MaterialType::Lambert;
  Vec3f base_color{1, 1, 1};                 // in [0, 1]
  float roughness = 1;                       // Metal: in (0, 1]
  float ior = 0;                             // Glass: 0 is 1.5
  float alpha = 1;                           // in [0, 1]
  float alpha_cutoff = 0;                    // 0: no holes
  bool blends = false;                       // alpha is opacity; alpha_cutoff 0
  Vec3f emission{0, 0, 0};                   // radiance, not negative
  uint32_t base_color_texture = invalid_id;  // index into SceneData::textures
  bool two_sided_emission = false;
  uint32_t emission_texture = invalid_id;  // index into SceneData::textures
  Vec3f attenuation_color{1, 1, 1};        // Glass: in [0, 1], what is left after the distance
  float attenuation_distance = 0;          // Glass: metres of the world; 0: it does not absorb
};

/// Texels must be width * height * (4 or 16) bytes and, where they are floats, finite.
uint32_t add_texture(SceneData &scene, TextureData texture);

uint32_t add_material(SceneData &scene, const MaterialSettings &settings);

/// Vertices and uvs must be finite, indices in range. Normals must be finite; they need not be unit length, and a
/// zero normal stands for that of the faces around its vertex.
uint32_t add_mesh(SceneData &scene, MeshData mesh, uint32_t material);

/// Replaces the vertices of a mesh, and its normals if it has any: as many as there were, and finite.
void set_vertices(SceneData &scene, uint64_t geometry, SharedArray<Vec3f> vertices,
                  SharedArray<Vec3f> normals);

/// The indices 0, 1, 2, ... of a mesh that has none. Throws unless the vertices come in threes.
SharedArray<UInt3> sequential_triangles(uint64_t num_vertices);

/// The number of control points must be a multiple of 16.
uint32_t add_patches(SceneData &scene, PatchData patches, uint32_t material);

/// The transform must be finite and invertible, also once it is rounded to float.
uint32_t add_instance(SceneData &scene, uint32_t geometry, const AffineDouble &object_to_world);
uint32_t add_instance(SceneData &scene, uint32_t geometry, const Transform &object_to_world);

/// The direction (Spot, Distant) need not be unit length. Angles (Spot): outer 0 means pi/4, else 0 <= inner < outer
/// <= pi/2.
uint32_t add_light(SceneData &scene, PointLightData light);

/// The camera looks along its -Z, +Y is up; scale and shear are taken out, a mirroring stays. yfov_rad 0 means 45
/// degrees, else it lies in (0, pi).
uint32_t add_camera(SceneData &scene, const AffineDouble &camera_to_world, float yfov_rad, uint32_t width,
                    uint32_t height);

/// Radiance must be finite and not negative, in the texture too.
void set_environment(SceneData &scene, const EnvironmentData &environment);

}  // namespace gpurt
