// The layout of every public struct and the value of every enumerator, pinned: a change here breaks callers that are
// already built. New fields go to the end of a struct, where only its size changes.
#include <gtest/gtest.h>

#include <cstddef>

#include "gpurt.h"
#include "gpurt_cuda.h"

#if defined(__x86_64__) || defined(__aarch64__)

#define SIZE(T, bytes) static_assert(sizeof(T) == (bytes))
#define FIELD(T, field, offset) static_assert(offsetof(T, field) == (offset))
#define VALUE(name, value) static_assert((name) == (value))

SIZE(gpurt_device_desc, 56);
FIELD(gpurt_device_desc, struct_size, 0);
FIELD(gpurt_device_desc, type, 4);
FIELD(gpurt_device_desc, ordinal, 8);
FIELD(gpurt_device_desc, num_threads, 12);
FIELD(gpurt_device_desc, memory_limit_bytes, 16);
FIELD(gpurt_device_desc, log, 24);
FIELD(gpurt_device_desc, log_user, 32);
FIELD(gpurt_device_desc, ordinals, 40);
FIELD(gpurt_device_desc, num_ordinals, 48);
FIELD(gpurt_device_desc, reserved, 52);

SIZE(gpurt_device_properties, 216);
FIELD(gpurt_device_properties, struct_size, 0);
FIELD(gpurt_device_properties, type, 4);
FIELD(gpurt_device_properties, ordinal, 8);
FIELD(gpurt_device_properties, num_threads, 12);
FIELD(gpurt_device_properties, memory_bytes, 16);
FIELD(gpurt_device_properties, memory_limit_bytes, 24);
FIELD(gpurt_device_properties, memory_used_bytes, 32);
FIELD(gpurt_device_properties, memory_peak_bytes, 40);
FIELD(gpurt_device_properties, compute_capability, 48);
FIELD(gpurt_device_properties, name, 52);
FIELD(gpurt_device_properties, instruction_set, 180);

SIZE(gpurt_buffer_desc, 40);
FIELD(gpurt_buffer_desc, struct_size, 0);
FIELD(gpurt_buffer_desc, storage, 4);
FIELD(gpurt_buffer_desc, size_bytes, 8);
FIELD(gpurt_buffer_desc, data, 16);
FIELD(gpurt_buffer_desc, release, 24);
FIELD(gpurt_buffer_desc, release_user, 32);

SIZE(gpurt_array, 40);
FIELD(gpurt_array, data, 0);
FIELD(gpurt_array, buffer, 8);
FIELD(gpurt_array, offset_bytes, 16);
FIELD(gpurt_array, stride_bytes, 24);
FIELD(gpurt_array, count, 32);

SIZE(gpurt_texture_desc, 40);
FIELD(gpurt_texture_desc, struct_size, 0);
FIELD(gpurt_texture_desc, format, 4);
FIELD(gpurt_texture_desc, width, 8);
FIELD(gpurt_texture_desc, height, 12);
FIELD(gpurt_texture_desc, wrap_u, 16);
FIELD(gpurt_texture_desc, wrap_v, 20);
FIELD(gpurt_texture_desc, filter, 24);
FIELD(gpurt_texture_desc, reserved, 28);
FIELD(gpurt_texture_desc, texels, 32);

SIZE(gpurt_material_desc, 80);
FIELD(gpurt_material_desc, struct_size, 0);
FIELD(gpurt_material_desc, type, 4);
FIELD(gpurt_material_desc, base_color, 8);
FIELD(gpurt_material_desc, roughness, 20);
FIELD(gpurt_material_desc, ior, 24);
FIELD(gpurt_material_desc, alpha, 28);
FIELD(gpurt_material_desc, alpha_cutoff, 32);
FIELD(gpurt_material_desc, emission, 36);
FIELD(gpurt_material_desc, base_color_texture, 48);
FIELD(gpurt_material_desc, two_sided_emission, 52);
FIELD(gpurt_material_desc, blends, 56);
FIELD(gpurt_material_desc, emission_texture, 60);
FIELD(gpurt_material_desc, attenuation_color, 64);
FIELD(gpurt_material_desc, attenuation_distance, 76);

SIZE(gpurt_mesh_desc, 168);
FIELD(gpurt_mesh_desc, struct_size, 0);
FIELD(gpurt_mesh_desc, material, 4);
FIELD(gpurt_mesh_desc, vertices, 8);
FIELD(gpurt_mesh_desc, indices, 48);
FIELD(gpurt_mesh_desc, normals, 88);
FIELD(gpurt_mesh_desc, uvs, 128);

SIZE(gpurt_patches_desc, 48);
FIELD(gpurt_patches_desc, struct_size, 0);
FIELD(gpurt_patches_desc, material, 4);
FIELD(gpurt_patches_desc, control_points, 8);

SIZE(gpurt_subdivision_desc, 136);
FIELD(gpurt_subdivision_desc, struct_size, 0);
FIELD(gpurt_subdivision_desc, material, 4);
FIELD(gpurt_subdivision_desc, scheme, 8);
FIELD(gpurt_subdivision_desc, reserved, 12);
FIELD(gpurt_subdivision_desc, vertices, 16);
FIELD(gpurt_subdivision_desc, face_counts, 56);
FIELD(gpurt_subdivision_desc, indices, 96);

SIZE(gpurt_instance_desc, 56);
FIELD(gpurt_instance_desc, struct_size, 0);
FIELD(gpurt_instance_desc, geometry, 4);
FIELD(gpurt_instance_desc, transform, 8);

SIZE(gpurt_light_desc, 52);
FIELD(gpurt_light_desc, struct_size, 0);
FIELD(gpurt_light_desc, type, 4);
FIELD(gpurt_light_desc, intensity, 8);
FIELD(gpurt_light_desc, position, 20);
FIELD(gpurt_light_desc, direction, 32);
FIELD(gpurt_light_desc, inner_cone_angle_rad, 44);
FIELD(gpurt_light_desc, outer_cone_angle_rad, 48);

SIZE(gpurt_environment_desc, 20);
FIELD(gpurt_environment_desc, struct_size, 0);
FIELD(gpurt_environment_desc, texture, 4);
FIELD(gpurt_environment_desc, radiance, 8);

SIZE(gpurt_camera_desc, 84);
FIELD(gpurt_camera_desc, struct_size, 0);
FIELD(gpurt_camera_desc, type, 4);
FIELD(gpurt_camera_desc, transform, 8);
FIELD(gpurt_camera_desc, yfov_rad, 56);
FIELD(gpurt_camera_desc, lens_radius, 60);
FIELD(gpurt_camera_desc, focus_distance, 64);
FIELD(gpurt_camera_desc, shutter_open, 68);
FIELD(gpurt_camera_desc, shutter_close, 72);
FIELD(gpurt_camera_desc, width, 76);
FIELD(gpurt_camera_desc, height, 80);

SIZE(gpurt_build_desc, 56);
FIELD(gpurt_build_desc, struct_size, 0);
FIELD(gpurt_build_desc, accel, 4);
FIELD(gpurt_build_desc, triangle_test, 8);
FIELD(gpurt_build_desc, max_depth, 12);
FIELD(gpurt_build_desc, traversal_cost, 16);
FIELD(gpurt_build_desc, empty_bonus, 20);
FIELD(gpurt_build_desc, patch_tolerance, 24);
FIELD(gpurt_build_desc, quality, 28);
FIELD(gpurt_build_desc, tree_cache_path, 32);
FIELD(gpurt_build_desc, patch_pixels, 40);
FIELD(gpurt_build_desc, patch_camera, 44);
FIELD(gpurt_build_desc, patch_width, 48);
FIELD(gpurt_build_desc, patch_height, 52);

SIZE(gpurt_scene_facts, 208);
FIELD(gpurt_scene_facts, struct_size, 0);
FIELD(gpurt_scene_facts, num_geometries, 4);
FIELD(gpurt_scene_facts, num_instances, 8);
FIELD(gpurt_scene_facts, num_materials, 12);
FIELD(gpurt_scene_facts, num_textures, 16);
FIELD(gpurt_scene_facts, num_cameras, 20);
FIELD(gpurt_scene_facts, num_point_lights, 24);
FIELD(gpurt_scene_facts, num_distant_lights, 28);
FIELD(gpurt_scene_facts, num_patches, 32);
FIELD(gpurt_scene_facts, num_triangles, 40);
FIELD(gpurt_scene_facts, num_world_triangles, 48);
FIELD(gpurt_scene_facts, num_emissive_triangles, 56);
FIELD(gpurt_scene_facts, bounds_min, 64);
FIELD(gpurt_scene_facts, bounds_max, 76);
FIELD(gpurt_scene_facts, has_environment, 88);
FIELD(gpurt_scene_facts, has_glass, 92);
FIELD(gpurt_scene_facts, has_alpha_masks, 96);
FIELD(gpurt_scene_facts, is_committed, 100);
FIELD(gpurt_scene_facts, accel, 104);
FIELD(gpurt_scene_facts, triangle_test, 108);
FIELD(gpurt_scene_facts, accel_bytes, 112);
FIELD(gpurt_scene_facts, scene_bytes, 120);
FIELD(gpurt_scene_facts, num_nodes, 128);
FIELD(gpurt_scene_facts, num_references, 136);
FIELD(gpurt_scene_facts, tree_depth, 144);
FIELD(gpurt_scene_facts, tree_from_cache, 148);
FIELD(gpurt_scene_facts, build_seconds, 152);
FIELD(gpurt_scene_facts, sah_cost, 160);
FIELD(gpurt_scene_facts, accel_build_seconds, 168);
FIELD(gpurt_scene_facts, build_peak_bytes, 176);
FIELD(gpurt_scene_facts, tree_refitted, 184);
FIELD(gpurt_scene_facts, has_blending, 188);
FIELD(gpurt_scene_facts, patch_error, 192);
FIELD(gpurt_scene_facts, patch_error_pixels, 200);

SIZE(gpurt_kdtree_node, 8);
FIELD(gpurt_kdtree_node, word, 0);
FIELD(gpurt_kdtree_node, tag, 4);

SIZE(gpurt_kdtree, 72);
FIELD(gpurt_kdtree, struct_size, 0);
FIELD(gpurt_kdtree, tree, 4);
FIELD(gpurt_kdtree, num_nodes, 8);
FIELD(gpurt_kdtree, num_references, 16);
FIELD(gpurt_kdtree, num_triangles, 24);
FIELD(gpurt_kdtree, bounds_min, 32);
FIELD(gpurt_kdtree, bounds_max, 44);
FIELD(gpurt_kdtree, nodes, 56);
FIELD(gpurt_kdtree, references, 64);

SIZE(gpurt_ray, 32);
FIELD(gpurt_ray, origin, 0);
FIELD(gpurt_ray, tmin, 12);
FIELD(gpurt_ray, direction, 16);
FIELD(gpurt_ray, tmax, 28);

SIZE(gpurt_hit, 32);
FIELD(gpurt_hit, t, 0);
FIELD(gpurt_hit, u, 4);
FIELD(gpurt_hit, v, 8);
FIELD(gpurt_hit, primitive, 12);
FIELD(gpurt_hit, geometry, 16);
FIELD(gpurt_hit, instance, 20);
FIELD(gpurt_hit, padding, 24);

SIZE(gpurt_hit_compact, 16);
FIELD(gpurt_hit_compact, t, 0);
FIELD(gpurt_hit_compact, u, 4);
FIELD(gpurt_hit_compact, v, 8);
FIELD(gpurt_hit_compact, primitive, 12);

SIZE(gpurt_schedule, 40);
FIELD(gpurt_schedule, traversal, 0);
FIELD(gpurt_schedule, launch, 4);
FIELD(gpurt_schedule, fetch, 8);
FIELD(gpurt_schedule, compaction, 12);
FIELD(gpurt_schedule, shading, 16);
FIELD(gpurt_schedule, generation, 20);
FIELD(gpurt_schedule, reserved, 24);
FIELD(gpurt_schedule, ray_budget, 32);

SIZE(gpurt_schedule_counters, 128);
FIELD(gpurt_schedule_counters, ray_refills, 0);
FIELD(gpurt_schedule_counters, list_rounds, 8);
FIELD(gpurt_schedule_counters, list_overflows, 16);
FIELD(gpurt_schedule_counters, mode_switches, 24);
FIELD(gpurt_schedule_counters, packets, 32);
FIELD(gpurt_schedule_counters, shared_triangles, 40);
FIELD(gpurt_schedule_counters, compactions, 48);
FIELD(gpurt_schedule_counters, sorted_hits, 56);
FIELD(gpurt_schedule_counters, counted_rays, 64);
FIELD(gpurt_schedule_counters, wave_splits, 72);
FIELD(gpurt_schedule_counters, device_ns, 80);
FIELD(gpurt_schedule_counters, path_refills, 88);
FIELD(gpurt_schedule_counters, warp_steps, 96);
FIELD(gpurt_schedule_counters, lane_steps, 104);
FIELD(gpurt_schedule_counters, reserved, 112);

SIZE(gpurt_cuda_kernel, 128);
FIELD(gpurt_cuda_kernel, name, 0);
FIELD(gpurt_cuda_kernel, num_launches, 96);
FIELD(gpurt_cuda_kernel, block_threads, 104);
FIELD(gpurt_cuda_kernel, registers, 108);
FIELD(gpurt_cuda_kernel, local_bytes, 112);
FIELD(gpurt_cuda_kernel, shared_bytes, 116);
FIELD(gpurt_cuda_kernel, blocks_per_multiprocessor, 120);
FIELD(gpurt_cuda_kernel, occupancy, 124);

SIZE(gpurt_trace_desc, 128);
FIELD(gpurt_trace_desc, struct_size, 0);
FIELD(gpurt_trace_desc, query, 4);
FIELD(gpurt_trace_desc, format, 8);
FIELD(gpurt_trace_desc, storage, 12);
FIELD(gpurt_trace_desc, num_rays, 16);
FIELD(gpurt_trace_desc, rays, 24);
FIELD(gpurt_trace_desc, hits, 32);
FIELD(gpurt_trace_desc, occluded, 40);
FIELD(gpurt_trace_desc, offsets, 48);
FIELD(gpurt_trace_desc, hit_capacity, 56);
FIELD(gpurt_trace_desc, schedule, 64);
FIELD(gpurt_trace_desc, out_counters, 104);
FIELD(gpurt_trace_desc, coherence, 112);
FIELD(gpurt_trace_desc, image_width, 116);
FIELD(gpurt_trace_desc, count_lanes, 120);
FIELD(gpurt_trace_desc, reserved, 124);

SIZE(gpurt_patch_point, 12);
FIELD(gpurt_patch_point, patch, 0);
FIELD(gpurt_patch_point, u, 4);
FIELD(gpurt_patch_point, v, 8);

SIZE(gpurt_locate_desc, 56);
FIELD(gpurt_locate_desc, struct_size, 0);
FIELD(gpurt_locate_desc, format, 4);
FIELD(gpurt_locate_desc, num_hits, 8);
FIELD(gpurt_locate_desc, hits, 16);
FIELD(gpurt_locate_desc, geometry, 24);
FIELD(gpurt_locate_desc, instance, 28);
FIELD(gpurt_locate_desc, points, 32);
FIELD(gpurt_locate_desc, positions, 40);
FIELD(gpurt_locate_desc, normals, 48);

SIZE(gpurt_frame_desc, 40);
FIELD(gpurt_frame_desc, struct_size, 0);
FIELD(gpurt_frame_desc, width, 4);
FIELD(gpurt_frame_desc, height, 8);
FIELD(gpurt_frame_desc, camera, 12);
FIELD(gpurt_frame_desc, outputs, 16);
FIELD(gpurt_frame_desc, frame_index, 20);
FIELD(gpurt_frame_desc, seed, 24);
FIELD(gpurt_frame_desc, first_sample, 32);

SIZE(gpurt_tile, 16);
FIELD(gpurt_tile, x0, 0);
FIELD(gpurt_tile, y0, 4);
FIELD(gpurt_tile, x1, 8);
FIELD(gpurt_tile, y1, 12);

SIZE(gpurt_photon_settings, 24);
FIELD(gpurt_photon_settings, photons_per_pass, 0);
FIELD(gpurt_photon_settings, initial_radius, 4);
FIELD(gpurt_photon_settings, estimator, 8);
FIELD(gpurt_photon_settings, kernel, 12);
FIELD(gpurt_photon_settings, remedies, 16);
FIELD(gpurt_photon_settings, reserved, 20);

SIZE(gpurt_photon_counters, 112);
FIELD(gpurt_photon_counters, num_emitted, 0);
FIELD(gpurt_photon_counters, num_rays, 8);
FIELD(gpurt_photon_counters, num_stored, 16);
FIELD(gpurt_photon_counters, num_gathered, 24);
FIELD(gpurt_photon_counters, num_visible, 32);
FIELD(gpurt_photon_counters, num_sub_passes, 40);
FIELD(gpurt_photon_counters, trace_seconds, 48);
FIELD(gpurt_photon_counters, build_seconds, 56);
FIELD(gpurt_photon_counters, gather_seconds, 64);
FIELD(gpurt_photon_counters, smallest_radius, 72);
FIELD(gpurt_photon_counters, emit_seconds, 80);
FIELD(gpurt_photon_counters, scatter_seconds, 88);
FIELD(gpurt_photon_counters, reserved, 96);

SIZE(gpurt_reyes_settings, 24);
FIELD(gpurt_reyes_settings, shading_rate, 0);
FIELD(gpurt_reyes_settings, filter, 4);
FIELD(gpurt_reyes_settings, shading, 8);
FIELD(gpurt_reyes_settings, no_shadows, 12);
FIELD(gpurt_reyes_settings, flatness, 16);
FIELD(gpurt_reyes_settings, fragment_slots, 20);

SIZE(gpurt_reyes_counters, 160);
FIELD(gpurt_reyes_counters, num_patches, 0);
FIELD(gpurt_reyes_counters, num_triangles, 8);
FIELD(gpurt_reyes_counters, num_splits, 16);
FIELD(gpurt_reyes_counters, num_culled, 24);
FIELD(gpurt_reyes_counters, num_grids, 32);
FIELD(gpurt_reyes_counters, num_micropolygons, 40);
FIELD(gpurt_reyes_counters, num_fragments, 48);
FIELD(gpurt_reyes_counters, num_shaded, 56);
FIELD(gpurt_reyes_counters, largest_queue, 64);
FIELD(gpurt_reyes_counters, largest_bucket, 72);
FIELD(gpurt_reyes_counters, working_bytes, 80);
FIELD(gpurt_reyes_counters, bound_seconds, 88);
FIELD(gpurt_reyes_counters, split_seconds, 96);
FIELD(gpurt_reyes_counters, dice_seconds, 104);
FIELD(gpurt_reyes_counters, sample_seconds, 112);
FIELD(gpurt_reyes_counters, split_rounds, 120);
FIELD(gpurt_reyes_counters, num_donated, 128);
FIELD(gpurt_reyes_counters, largest_fragments, 136);
FIELD(gpurt_reyes_counters, num_lost_fragments, 144);
FIELD(gpurt_reyes_counters, reserved, 152);

SIZE(gpurt_render_desc, 136);
FIELD(gpurt_render_desc, struct_size, 0);
FIELD(gpurt_render_desc, pipeline, 4);
FIELD(gpurt_render_desc, samples_per_pixel, 8);
FIELD(gpurt_render_desc, target_error, 12);
FIELD(gpurt_render_desc, time_limit_s, 16);
FIELD(gpurt_render_desc, max_depth, 24);
FIELD(gpurt_render_desc, tile_size, 28);
FIELD(gpurt_render_desc, progress, 32);
FIELD(gpurt_render_desc, progress_user, 40);
FIELD(gpurt_render_desc, schedule, 48);
FIELD(gpurt_render_desc, photon, 88);
FIELD(gpurt_render_desc, reyes, 112);

SIZE(gpurt_statistics, 936);
FIELD(gpurt_statistics, struct_size, 0);
FIELD(gpurt_statistics, pipeline, 4);
FIELD(gpurt_statistics, accel, 8);
FIELD(gpurt_statistics, triangle_test, 12);
FIELD(gpurt_statistics, max_depth, 16);
FIELD(gpurt_statistics, tile_size, 20);
FIELD(gpurt_statistics, num_threads, 24);
FIELD(gpurt_statistics, width, 28);
FIELD(gpurt_statistics, height, 32);
FIELD(gpurt_statistics, seed, 40);
FIELD(gpurt_statistics, samples_per_pixel, 48);
FIELD(gpurt_statistics, num_samples, 56);
FIELD(gpurt_statistics, num_camera_rays, 64);
FIELD(gpurt_statistics, num_bounce_rays, 72);
FIELD(gpurt_statistics, num_shadow_rays, 80);
FIELD(gpurt_statistics, num_nonfinite, 88);
FIELD(gpurt_statistics, num_saturated, 96);
FIELD(gpurt_statistics, render_seconds, 104);
FIELD(gpurt_statistics, generate_seconds, 112);
FIELD(gpurt_statistics, trace_seconds, 120);
FIELD(gpurt_statistics, shade_seconds, 128);
FIELD(gpurt_statistics, shadow_seconds, 136);
FIELD(gpurt_statistics, film_seconds, 144);
FIELD(gpurt_statistics, build_seconds, 152);
FIELD(gpurt_statistics, estimated_error, 160);
FIELD(gpurt_statistics, largest_sample, 168);
FIELD(gpurt_statistics, memory_peak_bytes, 176);
FIELD(gpurt_statistics, reason, 184);
FIELD(gpurt_statistics, schedule, 440);
FIELD(gpurt_statistics, schedule_counters, 480);
FIELD(gpurt_statistics, photon, 608);
FIELD(gpurt_statistics, photon_counters, 632);
FIELD(gpurt_statistics, reyes, 744);
FIELD(gpurt_statistics, reyes_counters, 768);
FIELD(gpurt_statistics, estimated_bias, 928);

SIZE(gpurt_state_info, 120);
FIELD(gpurt_state_info, struct_size, 0);
FIELD(gpurt_state_info, width, 4);
FIELD(gpurt_state_info, height, 8);
FIELD(gpurt_state_info, camera, 12);
FIELD(gpurt_state_info, outputs, 16);
FIELD(gpurt_state_info, frame_index, 20);
FIELD(gpurt_state_info, seed, 24);
FIELD(gpurt_state_info, first_sample, 32);
FIELD(gpurt_state_info, num_samples, 40);
FIELD(gpurt_state_info, scene_hash, 48);
FIELD(gpurt_state_info, pipeline, 56);
FIELD(gpurt_state_info, accel, 60);
FIELD(gpurt_state_info, triangle_test, 64);
FIELD(gpurt_state_info, max_depth, 68);
FIELD(gpurt_state_info, photon, 72);
FIELD(gpurt_state_info, reyes, 96);

VALUE(GPURT_OK, 0);
VALUE(GPURT_ERROR_INVALID_ARGUMENT, 1);
VALUE(GPURT_ERROR_OUT_OF_MEMORY, 2);
VALUE(GPURT_ERROR_UNSUPPORTED, 3);
VALUE(GPURT_ERROR_CANCELLED, 4);
VALUE(GPURT_ERROR_DEVICE, 5);
VALUE(GPURT_ERROR_TIMEOUT, 6);
VALUE(GPURT_ERROR_IO, 7);
VALUE(GPURT_ERROR_INTERNAL, 8);
SIZE(gpurt_result, 4);

VALUE(GPURT_DEVICE_AUTO, 0);
VALUE(GPURT_DEVICE_CPU, 1);
VALUE(GPURT_DEVICE_CUDA, 2);
SIZE(gpurt_device_type, 4);

VALUE(GPURT_LOG_ERROR, 1);
VALUE(GPURT_LOG_WARNING, 2);
VALUE(GPURT_LOG_INFO, 3);
SIZE(gpurt_log_level, 4);

VALUE(GPURT_STORAGE_HOST, 0);
VALUE(GPURT_STORAGE_DEVICE, 1);
SIZE(gpurt_storage, 4);

VALUE(GPURT_TEXTURE_RGBA8_SRGB, 0);
VALUE(GPURT_TEXTURE_RGBA8_LINEAR, 1);
VALUE(GPURT_TEXTURE_RGBA32F, 2);
SIZE(gpurt_texture_format, 4);

VALUE(GPURT_WRAP_REPEAT, 0);
VALUE(GPURT_WRAP_CLAMP, 1);
VALUE(GPURT_WRAP_MIRROR, 2);
SIZE(gpurt_wrap, 4);

VALUE(GPURT_FILTER_LINEAR, 0);
VALUE(GPURT_FILTER_NEAREST, 1);
SIZE(gpurt_filter, 4);

VALUE(GPURT_MATERIAL_LAMBERT, 0);
VALUE(GPURT_MATERIAL_MIRROR, 1);
VALUE(GPURT_MATERIAL_GLASS, 2);
VALUE(GPURT_MATERIAL_METAL, 3);
SIZE(gpurt_material_type, 4);

VALUE(GPURT_SUBDIVISION_CATMULL_CLARK, 0);
VALUE(GPURT_SUBDIVISION_LOOP, 1);
SIZE(gpurt_subdivision_scheme, 4);

VALUE(GPURT_LIGHT_POINT, 0);
VALUE(GPURT_LIGHT_SPOT, 1);
VALUE(GPURT_LIGHT_DISTANT, 2);
SIZE(gpurt_light_type, 4);

VALUE(GPURT_CAMERA_PERSPECTIVE, 0);
VALUE(GPURT_CAMERA_ORTHOGRAPHIC, 1);
SIZE(gpurt_camera_type, 4);

VALUE(GPURT_ACCEL_AUTO, 0);
VALUE(GPURT_ACCEL_KDTREE, 1);
VALUE(GPURT_ACCEL_EMBREE, 2);
VALUE(GPURT_ACCEL_BVH, 3);
SIZE(gpurt_accel, 4);

VALUE(GPURT_BUILD_QUALITY_AUTO, 0);
VALUE(GPURT_BUILD_QUALITY_FAST, 1);
VALUE(GPURT_BUILD_QUALITY_HIGH, 2);
VALUE(GPURT_TRIANGLE_WATERTIGHT, 0);
VALUE(GPURT_TRIANGLE_MOLLER_TRUMBORE, 1);
VALUE(GPURT_TRIANGLE_DOUBLE, 2);
SIZE(gpurt_triangle_test, 4);

VALUE(GPURT_QUERY_CLOSEST, 0);
VALUE(GPURT_QUERY_ANY, 1);
VALUE(GPURT_QUERY_ALL, 2);
SIZE(gpurt_query, 4);

VALUE(GPURT_HIT_FULL, 0);
VALUE(GPURT_HIT_COMPACT, 1);
SIZE(gpurt_hit_format, 4);

VALUE(GPURT_TRAVERSAL_AUTO, 0);
VALUE(GPURT_TRAVERSAL_STACK, 1);
VALUE(GPURT_TRAVERSAL_LEAF_LISTS, 2);
VALUE(GPURT_TRAVERSAL_UBER, 3);
SIZE(gpurt_traversal, 4);

VALUE(GPURT_LAUNCH_AUTO, 0);
VALUE(GPURT_LAUNCH_REGULAR, 1);
VALUE(GPURT_LAUNCH_PERSISTENT, 2);
VALUE(GPURT_LAUNCH_ROUNDS, 3);
SIZE(gpurt_launch, 4);

VALUE(GPURT_FETCH_AUTO, 0);
VALUE(GPURT_FETCH_PER_THREAD, 1);
VALUE(GPURT_FETCH_PACKETS, 2);
SIZE(gpurt_fetch, 4);

VALUE(GPURT_COMPACTION_AUTO, 0);
VALUE(GPURT_COMPACTION_BLOCK_SCAN, 1);
VALUE(GPURT_COMPACTION_PYRAMID, 2);
VALUE(GPURT_COMPACTION_NAIVE_SCAN, 3);
VALUE(GPURT_COMPACTION_LIBRARY_SCAN, 4);
SIZE(gpurt_compaction, 4);

VALUE(GPURT_SHADING_AUTO, 0);
VALUE(GPURT_SHADING_IMMEDIATE, 1);
VALUE(GPURT_SHADING_SORTED, 2);
SIZE(gpurt_shading, 4);

VALUE(GPURT_GENERATION_AUTO, 0);
VALUE(GPURT_GENERATION_SLOTS, 1);
VALUE(GPURT_GENERATION_COUNTED, 2);
VALUE(GPURT_GENERATION_REFILLED, 3);
SIZE(gpurt_generation, 4);

VALUE(GPURT_OUTPUT_COLOR, 0);
VALUE(GPURT_OUTPUT_ALPHA, 1);
VALUE(GPURT_OUTPUT_DEPTH, 2);
VALUE(GPURT_OUTPUT_NORMAL, 3);
VALUE(GPURT_OUTPUT_ALBEDO, 4);
VALUE(GPURT_OUTPUT_POSITION, 5);
VALUE(GPURT_OUTPUT_PRIMITIVE, 6);
VALUE(GPURT_OUTPUT_INSTANCE, 7);
VALUE(GPURT_OUTPUT_SAMPLE_COUNT, 8);
VALUE(GPURT_OUTPUT_VARIANCE, 9);
VALUE(GPURT_OUTPUT_TIME, 10);
VALUE(GPURT_OUTPUT_BIAS, 11);
VALUE(GPURT_OUTPUT_ERROR, 12);
VALUE(GPURT_OUTPUT_COUNT, 13);
SIZE(gpurt_output, 4);

VALUE(GPURT_PIPELINE_AUTO, 0);
VALUE(GPURT_PIPELINE_PATH, 1);
VALUE(GPURT_PIPELINE_PHOTON, 2);
VALUE(GPURT_PIPELINE_REYES, 3);
VALUE(GPURT_PIPELINE_HYBRID, 4);
SIZE(gpurt_pipeline, 4);

SIZE(gpurt_photon_map_desc, 48);
FIELD(gpurt_photon_map_desc, struct_size, 0);
FIELD(gpurt_photon_map_desc, storage, 4);
FIELD(gpurt_photon_map_desc, num_points, 8);
FIELD(gpurt_photon_map_desc, positions, 16);
FIELD(gpurt_photon_map_desc, fluxes, 24);
FIELD(gpurt_photon_map_desc, normals, 32);
FIELD(gpurt_photon_map_desc, radius, 40);
FIELD(gpurt_photon_map_desc, num_levels, 44);

SIZE(gpurt_photon_trace_desc, 40);
FIELD(gpurt_photon_trace_desc, struct_size, 0);
FIELD(gpurt_photon_trace_desc, num_paths, 4);
FIELD(gpurt_photon_trace_desc, seed, 8);
FIELD(gpurt_photon_trace_desc, pass, 16);
FIELD(gpurt_photon_trace_desc, frame_index, 24);
FIELD(gpurt_photon_trace_desc, max_depth, 28);
FIELD(gpurt_photon_trace_desc, radius, 32);
FIELD(gpurt_photon_trace_desc, num_levels, 36);

SIZE(gpurt_photon_map_info, 80);
FIELD(gpurt_photon_map_info, struct_size, 0);
FIELD(gpurt_photon_map_info, num_levels, 4);
FIELD(gpurt_photon_map_info, num_points, 8);
FIELD(gpurt_photon_map_info, bounds, 16);
FIELD(gpurt_photon_map_info, radius, 40);
FIELD(gpurt_photon_map_info, has_fluxes, 44);
FIELD(gpurt_photon_map_info, has_normals, 48);
FIELD(gpurt_photon_map_info, fullest_cell, 52);
FIELD(gpurt_photon_map_info, memory_bytes, 56);
FIELD(gpurt_photon_map_info, build_seconds, 64);
FIELD(gpurt_photon_map_info, has_directions, 72);
FIELD(gpurt_photon_map_info, num_paths, 76);

SIZE(gpurt_photon_query_desc, 112);
FIELD(gpurt_photon_query_desc, struct_size, 0);
FIELD(gpurt_photon_query_desc, query, 4);
FIELD(gpurt_photon_query_desc, storage, 8);
FIELD(gpurt_photon_query_desc, kernel, 12);
FIELD(gpurt_photon_query_desc, num_queries, 16);
FIELD(gpurt_photon_query_desc, positions, 24);
FIELD(gpurt_photon_query_desc, normals, 32);
FIELD(gpurt_photon_query_desc, min_cosine, 40);
FIELD(gpurt_photon_query_desc, radius, 44);
FIELD(gpurt_photon_query_desc, radius_hint, 48);
FIELD(gpurt_photon_query_desc, k, 52);
FIELD(gpurt_photon_query_desc, counts, 56);
FIELD(gpurt_photon_query_desc, sums, 64);
FIELD(gpurt_photon_query_desc, offsets, 72);
FIELD(gpurt_photon_query_desc, ids, 80);
FIELD(gpurt_photon_query_desc, distances, 88);
FIELD(gpurt_photon_query_desc, capacity, 96);
FIELD(gpurt_photon_query_desc, coherence, 104);
FIELD(gpurt_photon_query_desc, method, 108);

VALUE(GPURT_PHOTON_QUERY_COUNT, 0);
VALUE(GPURT_PHOTON_QUERY_SUM, 1);
VALUE(GPURT_PHOTON_QUERY_LIST, 2);
VALUE(GPURT_PHOTON_QUERY_NEAREST, 3);
SIZE(gpurt_photon_query, 4);

VALUE(GPURT_GATHER_KERNEL_CONSTANT, 0);
VALUE(GPURT_GATHER_KERNEL_CONE, 1);
VALUE(GPURT_GATHER_KERNEL_QUADRATIC, 2);
SIZE(gpurt_gather_kernel, 4);

VALUE(GPURT_PHOTON_ATTRIBUTE_POSITION, 0);
VALUE(GPURT_PHOTON_ATTRIBUTE_FLUX, 1);
VALUE(GPURT_PHOTON_ATTRIBUTE_NORMAL, 2);
VALUE(GPURT_PHOTON_ATTRIBUTE_DIRECTION, 3);
SIZE(gpurt_photon_attribute, 4);

VALUE(GPURT_GATHER_GRID, 0);
VALUE(GPURT_GATHER_NODE_LISTS, 1);
SIZE(gpurt_gather_method, 4);
VALUE(GPURT_MAX_NEAREST, 512);
VALUE(GPURT_INVALID_ID, 0xffffffffu);
VALUE(GPURT_WAIT_FOREVER, UINT64_MAX);
SIZE(gpurt_device, 8);
SIZE(gpurt_photon_map, 8);

#endif

extern "C" int gpurt_test_init_macros(void);

TEST(Layout, InitMacrosSetTheSize) { EXPECT_TRUE(gpurt_test_init_macros()); }
