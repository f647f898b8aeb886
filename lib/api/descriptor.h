// Reading and writing of the public structs that start with struct_size.
//
// Callers may be older or newer than the library: a smaller struct is completed with defaults, a larger one must be zero
// where the library does not know it, and a struct to be filled is written up to the caller's size.
#pragma once

#include <cstddef>
#include <cstring>
#include <initializer_list>

#include "error.h"

namespace gpurt::api {

/// What reading needs to know of a public struct.
struct StructInfo {
  const char *name;
  const char *init_macro;
  size_t size;
  const size_t *wide_begin, *wide_end;  // offsets of the 8-byte fields
};

template <class T>
struct StructTraits;

/// Offsets of the fields of a gpurt_array member.
#define GPURT_ARRAY_FIELDS(T, field) \
  offsetof(T, field), offsetof(T, field) + 8, offsetof(T, field) + 16, offsetof(T, field) + 24, \
      offsetof(T, field) + 32

/// Defines StructTraits<T>; the rest are the offsets of T's 8-byte fields, if any.
#define GPURT_STRUCT(T, INIT, ...) \
  template <> \
  struct StructTraits<T> { \
    static constexpr std::initializer_list<size_t> wide{__VA_ARGS__}; \
    static constexpr StructInfo info{#T, #INIT, sizeof(T), wide.begin(), wide.end()}; \
    static T defaults() { return T INIT; } \
    static_assert(offsetof(T, struct_size) == 0 && std::is_trivially_copyable_v<T>); \
  }

GPURT_STRUCT(gpurt_device_desc, GPURT_DEVICE_DESC_INIT, offsetof(gpurt_device_desc, memory_limit_bytes),
             offsetof(gpurt_device_desc, log), offsetof(gpurt_device_desc, log_user),
             offsetof(gpurt_device_desc, ordinals));
GPURT_STRUCT(gpurt_buffer_desc, GPURT_BUFFER_DESC_INIT, offsetof(gpurt_buffer_desc, size_bytes),
             offsetof(gpurt_buffer_desc, data), offsetof(gpurt_buffer_desc, release),
             offsetof(gpurt_buffer_desc, release_user));
GPURT_STRUCT(gpurt_texture_desc, GPURT_TEXTURE_DESC_INIT, offsetof(gpurt_texture_desc, texels));
GPURT_STRUCT(gpurt_material_desc, GPURT_MATERIAL_DESC_INIT);
GPURT_STRUCT(gpurt_mesh_desc, GPURT_MESH_DESC_INIT, GPURT_ARRAY_FIELDS(gpurt_mesh_desc, vertices),
             GPURT_ARRAY_FIELDS(gpurt_mesh_desc, indices), GPURT_ARRAY_FIELDS(gpurt_mesh_desc, normals),
             GPURT_ARRAY_FIELDS(gpurt_mesh_desc, uvs));
GPURT_STRUCT(gpurt_patches_desc, GPURT_PATCHES_DESC_INIT,
             GPURT_ARRAY_FIELDS(gpurt_patches_desc, control_points));
GPURT_STRUCT(gpurt_subdivision_desc, GPURT_SUBDIVISION_DESC_INIT,
             GPURT_ARRAY_FIELDS(gpurt_subdivision_desc, vertices),
             GPURT_ARRAY_FIELDS(gpurt_subdivision_desc, face_counts),
             GPURT_ARRAY_FIELDS(gpurt_subdivision_desc, indices));
GPURT_STRUCT(gpurt_instance_desc, GPURT_INSTANCE_DESC_INIT);
GPURT_STRUCT(gpurt_light_desc, GPURT_LIGHT_DESC_INIT);
GPURT_STRUCT(gpurt_environment_desc, GPURT_ENVIRONMENT_DESC_INIT);
GPURT_STRUCT(gpurt_camera_desc, GPURT_CAMERA_DESC_INIT);
GPURT_STRUCT(gpurt_build_desc, GPURT_BUILD_DESC_INIT, offsetof(gpurt_build_desc, tree_cache_path));
GPURT_STRUCT(gpurt_kdtree, GPURT_KDTREE_INIT, offsetof(gpurt_kdtree, num_nodes),
             offsetof(gpurt_kdtree, num_references), offsetof(gpurt_kdtree, num_triangles),
             offsetof(gpurt_kdtree, nodes), offsetof(gpurt_kdtree, references));
GPURT_STRUCT(gpurt_trace_desc, GPURT_TRACE_DESC_INIT, offsetof(gpurt_trace_desc, num_rays),
             offsetof(gpurt_trace_desc, rays), offsetof(gpurt_trace_desc, hits),
             offsetof(gpurt_trace_desc, occluded), offsetof(gpurt_trace_desc, offsets),
             offsetof(gpurt_trace_desc, hit_capacity), offsetof(gpurt_trace_desc, schedule.ray_budget),
             offsetof(gpurt_trace_desc, out_counters));
GPURT_STRUCT(gpurt_locate_desc, GPURT_LOCATE_DESC_INIT, offsetof(gpurt_locate_desc, num_hits),
             offsetof(gpurt_locate_desc, hits), offsetof(gpurt_locate_desc, points),
             offsetof(gpurt_locate_desc, positions), offsetof(gpurt_locate_desc, normals));
GPURT_STRUCT(gpurt_frame_desc, GPURT_FRAME_DESC_INIT, offsetof(gpurt_frame_desc, seed),
             offsetof(gpurt_frame_desc, first_sample));
GPURT_STRUCT(gpurt_render_desc, GPURT_RENDER_DESC_INIT, offsetof(gpurt_render_desc, time_limit_s),
             offsetof(gpurt_render_desc, progress), offsetof(gpurt_render_desc, progress_user),
             offsetof(gpurt_render_desc, schedule.ray_budget));
GPURT_STRUCT(gpurt_photon_map_desc, GPURT_PHOTON_MAP_DESC_INIT, offsetof(gpurt_photon_map_desc, num_points),
             offsetof(gpurt_photon_map_desc, positions), offsetof(gpurt_photon_map_desc, fluxes),
             offsetof(gpurt_photon_map_desc, normals));
GPURT_STRUCT(gpurt_photon_trace_desc, GPURT_PHOTON_TRACE_DESC_INIT, offsetof(gpurt_photon_trace_desc, seed),
             offsetof(gpurt_photon_trace_desc, pass));
GPURT_STRUCT(gpurt_photon_query_desc, GPURT_PHOTON_QUERY_DESC_INIT,
             offsetof(gpurt_photon_query_desc, num_queries), offsetof(gpurt_photon_query_desc, positions),
             offsetof(gpurt_photon_query_desc, normals), offsetof(gpurt_photon_query_desc, counts),
             offsetof(gpurt_photon_query_desc, sums), offsetof(gpurt_photon_query_desc, offsets),
             offsetof(gpurt_photon_query_desc, ids), offsetof(gpurt_photon_query_desc, distances),
             offsetof(gpurt_photon_query_desc, capacity));
// Only ever written: where a smaller struct ends is the caller's business.
GPURT_STRUCT(gpurt_device_properties, GPURT_DEVICE_PROPERTIES_INIT);
GPURT_STRUCT(gpurt_scene_facts, GPURT_SCENE_FACTS_INIT);
GPURT_STRUCT(gpurt_statistics, GPURT_STATISTICS_INIT);
GPURT_STRUCT(gpurt_state_info, GPURT_STATE_INFO_INIT);
GPURT_STRUCT(gpurt_photon_map_info, GPURT_PHOTON_MAP_INFO_INIT);

/// The caller's struct_size. Throws INVALID_ARGUMENT where no version of the struct can have that size.
uint32_t checked_struct_size(const void *caller, const StructInfo &info, const char *what);

/// Overwrites the defaults in `ours` with the caller's fields.
void read_struct(void *ours, const void *caller, const StructInfo &info, const char *what);

/// Fills the caller's struct but for struct_size; what the library does not know becomes zero.
void write_struct(void *caller, const void *ours, const StructInfo &info, const char *what);

/// A descriptor that must be there.
template <class T>
T read_descriptor(const T *caller, const char *what = "desc")
{
  if (!caller) fail_invalid("{} is NULL; {} is needed", what, StructTraits<T>::info.name);
  T ours = StructTraits<T>::defaults();
  read_struct(&ours, caller, StructTraits<T>::info, what);
  return ours;
}

/// A descriptor for which NULL means the defaults.
template <class T>
T read_optional_descriptor(const T *caller, const char *what = "desc")
{
  return caller ? read_descriptor(caller, what) : StructTraits<T>::defaults();
}

/// Fails early where the caller's struct cannot be written, before work is done for it.
template <class T>
void check_output(T *caller, const char *what)
{
  if (!caller) fail_invalid("{} is NULL", what);
  checked_struct_size(caller, StructTraits<T>::info, what);
}

template <class T>
void write_output(T *caller, const T &ours, const char *what)
{
  check_output(caller, what);
  write_struct(caller, &ours, StructTraits<T>::info, what);
}

/// The value of an enum field, which may be anything, as a number. Reads its bits: loading a value that the enum cannot
/// have would be undefined.
template <class E>
uint32_t raw(const E &value)
{
  static_assert(sizeof(E) == sizeof(uint32_t));
  uint32_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  return bits;
}

/// Throws unless an enum field holds one of the first `count` values.
template <class E>
void check_enum(const E &value, uint32_t count, const char *field, const char *enum_name)
{
  if (raw(value) >= count) {
    fail_invalid("{} is {}; it must be a value of {}, 0 to {}", field, raw(value), enum_name, count - 1);
  }
}

inline void check_reserved(uint32_t value, const char *field)
{
  if (value != 0) fail_invalid("{} is {}; it must be 0", field, value);
}

}  // namespace gpurt::api
